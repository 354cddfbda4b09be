"""tools/compare_builds.py: a build has its own picture, with times of all stages; another picture, and a render that fails, are told."""
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = sys.argv[1]
SCENE = ROOT / "scenes" / "killeroo" / "killeroo-demo.pbrt"


def compare(after, scene=SCENE):
    return subprocess.run([ROOT / "tools" / "compare_builds.py", PROGRAM, after, scene, "--pairs", "1", "--resolution", "32x32", "--spp", "1"],
                          capture_output=True, text=True)


def main():
    if len(os.sched_getaffinity(0)) < 2:
        print("skipped: two processors are needed")
        return 77
    same = compare(PROGRAM)
    assert same.returncode == 0 and "the same picture" in same.stdout, same.stdout + same.stderr
    ratios = re.findall(r"^(render|camera|trace|shade|occlusion)\b.* (\d+\.\d+) to (\d+\.\d+)$", same.stdout, re.M)
    assert len(ratios) == 5 and all(0 < float(low) <= float(high) for _, low, high in ratios), same.stdout
    with tempfile.TemporaryDirectory() as scratch:
        other = pathlib.Path(scratch, "other_seed")  # a build whose picture is another one
        other.write_text(f'#!/bin/sh\nif [ "$1" = render ]; then exec "{PROGRAM}" "$@" --seed 1; fi\nexec "{PROGRAM}" "$@"\n')
        other.chmod(0o755)
        differs = compare(other)
        assert differs.returncode == 1 and "the pictures differ" in differs.stdout, differs.stdout + differs.stderr
        missing = compare(PROGRAM, pathlib.Path(scratch, "none.pbrt"))
        assert missing.returncode == 1 and "ended with 3" in missing.stderr, missing.stdout + missing.stderr
    return 0


if __name__ == "__main__":
    sys.exit(main())
