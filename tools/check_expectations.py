#!/usr/bin/python3
"""check_expectations.py SCENE.pbrt...: renders small scenes and checks what their comments expect. Exit 1 if one fails.

In a scene:
    # expect mean 1.0 within 1%                  of all pixels; one number for all channels, or three
    # expect pixel 3 4 0.2 0.2 0.5 within 0.01   column, row; an absolute tolerance
    # expect region 0 8 0 16 0.5 within 1%       the mean of columns 0-7, rows 0-15
    # expect error 12:5 radius                   exit code 3, and FILE:12:5: error: ... radius ... on stderr
    # render --spp 64 --hosts 2                  options for the command line
"""
import argparse
import dataclasses
import pathlib
import re
import shlex
import tempfile

import measure

EXPECT = re.compile(r"#\s*expect\s+(mean|pixel|region)\s+(.*?)\s+within\s+([0-9.eE+-]+)\s*(%?)\s*$")
ERROR = re.compile(r"#\s*expect\s+error\s+(\d+:\d+)\s*(.*?)\s*$")
RENDER = re.compile(r"#\s*render\s+(.*)$")
PLACE = {"mean": 0, "pixel": 2, "region": 4}


@dataclasses.dataclass
class Expectation:
    what: str
    place: list
    values: list
    tolerance: float
    relative: bool

    def check(self, image):
        """None, or what is wrong."""
        if self.what == "pixel":
            x, y = self.place
            area = image[y: y + 1, x: x + 1]
        elif self.what == "region":
            x0, x1, y0, y1 = self.place
            area = image[y0:y1, x0:x1]
        else:
            area = image
        found = area.reshape(-1, 3).mean(axis=0)
        wanted = self.values * 3 if len(self.values) == 1 else self.values
        for name, have, want in zip("RGB", found, wanted):
            if not abs(have - want) <= self.tolerance * (abs(want) if self.relative else 1):
                return (f"{self.what} {' '.join(map(str, self.place))}: expected {name} = {want:g} within "
                        f"{self.tolerance:g}{' relative' if self.relative else ''}, got {have:.6g}")
        return None


def parse(text):
    expectations, options, error = [], [], None
    for line in text.splitlines():
        line = line.strip()
        if match := EXPECT.match(line):
            what, numbers = match.group(1), match.group(2).split()
            count = PLACE[what]
            if len(numbers) - count not in (1, 3):
                raise ValueError(f"one or three values expected in: {line}")
            tolerance = float(match.group(3)) / (100 if match.group(4) else 1)
            expectations.append(Expectation(what, [int(n) for n in numbers[:count]],
                                            [float(n) for n in numbers[count:]], tolerance, bool(match.group(4))))
        elif match := ERROR.match(line):
            error = (match.group(1), match.group(2))
        elif match := RENDER.match(line):
            options += shlex.split(match.group(1))
        elif re.match(r"#\s*expect\b", line):
            raise ValueError(f"not understood: {line}")
    if not expectations and error is None:
        raise ValueError("nothing is expected of this scene")
    return expectations, options, error


def check_scene(program, scene, out):
    """A list of what is wrong."""
    expectations, options, error = parse(scene.read_text(encoding="latin-1"))
    result = measure.run([program, "render", scene, "-o", out, "--quiet", *options], report=error is None, timeout=300)
    if error is not None:
        place, words = error
        wanted = re.compile(re.escape(f"{scene.name}:{place}: error: ") + ".*" + re.escape(words))
        if result.code != 3:
            return [f"expected exit code 3, got {result.code}: {result.output.strip()}"]
        if not wanted.search(result.output):
            return [f"expected {scene.name}:{place}: error: ... {words}, got: {result.output.strip()}"]
        return []
    if result.code != 0:
        return [f"exit code {result.code}: {result.output.strip()}"]
    problems = [found for e in expectations if (found := e.check(measure.read_rgb(out)))]
    if result.report["invalid_samples"] != 0:
        problems.append(f"{result.report['invalid_samples']} invalid samples")
    return problems


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    args = parser.parse_args()
    measure.require_program(args.program)
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        for scene in args.scenes:
            try:
                problems = check_scene(args.program, scene, pathlib.Path(scratch, "out.exr"))
            except (ValueError, OSError) as problem:
                problems = [str(problem)]
            print(f"{scene}: {'ok' if not problems else 'FAILED'}", flush=True)
            for problem in problems:
                print(f"  {problem}", flush=True)
            failed += bool(problems)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
