#!/usr/bin/python3
"""Renders the reference scenes and compares with their pictures: a table, and exit 1 if a bound is not met.

A picture passes when its relMSE without the worst 0.1 % of the pixels is at most 1.5 x (what the renderer itself
estimates + the noise of the reference, from noise.csv; 0.005 in all where the reference has no row there), and when
the mean of every channel is within 0.5 % of the reference's (1 % where the reference is marked noisy).
"""
import argparse
import csv
import json
import pathlib
import tempfile

import measure

# Reference -> scene, where that is not NAME.pbrt.
SCENES = {f"v2/{name}": f"v2/{name}" for name in (
    "killeroo-path teapot-path cornell-path metal-path room-path-small miscquads-direct bump-direct texfilt-direct "
    "arcsphere-ao microcity-ao spotfog-single bluespheres-path").split()}
SCENES |= {
    "v3/cornell-small": "v3/cornellbox/cornell-small",
    "v3/coffee-small": "v3/coffee/coffee-small",
    "v3/veach-small": "v3/veach/veach-small",
    "v3/killeroo-gold-small": "v3/killeroos/killeroo-gold-small",
    "v3/classroom-small": "v3/classroom/classroom-small",
    "v3/buddha-small": "v3/buddha-fractal/buddha-small",
}
# Rendered only when named with --only, or with --all.
MORE = {
    "v2/bunny-path": "v2/bunny-path",
    "v3/bmw-small": "v3/bmw-m6/bmw-small",
}
NOISY = {"v2/bunny-path", "v2/room-path-small", "v3/veach-small", "v3/classroom-small"}


def read_noise(path):
    with open(path, newline="") as file:
        return {row["reference"]: float(row["trimmed_relmse_of_the_reference_itself"]) for row in csv.DictReader(file)}


def chosen_scenes(args):
    known = SCENES | MORE
    if not args.only:
        return known if args.all else SCENES
    chosen = {}
    for name in args.only:
        matches = [key for key in known if name in (key, key.split("/")[1])]
        if not matches:
            raise SystemExit(f"no reference scene is called {name}; there are: {' '.join(known)}")
        chosen[matches[0]] = known[matches[0]]
    return chosen


def one(args, key, scene, noise, out):
    command = [args.program, "render", args.shared / "scenes" / f"{scene}.pbrt", "-o", out, "--spp", args.spp,
               "--seed", args.seed, "--quiet"]
    for option in ("hosts", "threads", "part_size"):
        if getattr(args, option) is not None:
            command += ["--" + option.replace("_", "-"), getattr(args, option)]
    result = measure.run(command, report=True, timeout=args.timeout)
    row = {"scene": key, "spp": args.spp, "wall_s": result.wall, "cpu_s": result.cpu, "pass": False}
    if result.code != 0 or result.report is None:
        return row | {"problem": f"exit code {result.code}: {result.output.strip()[-600:]}"}
    row["estimated"] = result.report["error"]["estimated_relmse_trimmed"]
    row["noise"] = noise.get(key)
    row["bound"] = 0.005 if row["noise"] is None else 1.5 * (row["estimated"] + row["noise"])
    row["mean_bound"] = 0.01 if key in NOISY else 0.005
    row["invalid_samples"] = result.report["invalid_samples"]
    row["spp"] = result.report["spp"]
    try:
        found = measure.compare(measure.read_rgb(out), measure.read_rgb(args.shared / "references" / f"{key}.exr"))
    except (ValueError, OSError) as problem:
        return row | {"problem": str(problem)}
    row |= {"trimmed": found.trimmed, "mean_ratio": found.mean_ratio}
    missed = []
    if not found.trimmed <= row["bound"]:
        missed.append("relMSE")
    if not max(abs(ratio - 1) for ratio in found.mean_ratio) <= row["mean_bound"]:
        missed.append("mean")
    if row["invalid_samples"] != 0:
        missed.append(f"{row['invalid_samples']} invalid samples")
    return row | {"pass": not missed, "problem": ", ".join(missed)}


HEADER = ["scene", "spp", "estimated", "noise", "bound", "relMSE", "mean R", "G", "B", "wall s", "cpu s", "result"]


def cells(row):
    def number(key, form="{:.3g}"):
        return "-" if row.get(key) is None else form.format(row[key])
    ratio = [f"{r:.4f}" for r in row.get("mean_ratio", [])] or ["-"] * 3
    return [row["scene"], row["spp"], number("estimated"), number("noise"), number("bound"), number("trimmed"), *ratio,
            number("wall_s", "{:.1f}"), number("cpu_s", "{:.1f}"), "pass" if row["pass"] else f"FAIL {row['problem']}"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("--shared", type=pathlib.Path, default=measure.DEFAULT_SHARED, help="folder of reference scenes")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", metavar="NAME")
    parser.add_argument("--all", action="store_true", help="also: " + " ".join(MORE))
    parser.add_argument("--hosts", type=int)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--part-size")
    parser.add_argument("--timeout", type=float, default=1800, help="seconds for a scene")
    parser.add_argument("--json", type=pathlib.Path, help="write the rows to a file too")
    parser.add_argument("--keep", type=pathlib.Path, help="keep the pictures in this folder")
    args = parser.parse_args()
    measure.require_shared(args.shared)
    measure.require_program(args.program)
    noise = read_noise(args.shared / "references" / "noise.csv")
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.keep or pathlib.Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for key, scene in chosen_scenes(args).items():
            rows.append(one(args, key, scene, noise, folder / f"{key.replace('/', '-')}.exr"))
            print(f"  {key}: {'pass' if rows[-1]['pass'] else 'FAIL'}, {rows[-1]['wall_s']:.1f} s", flush=True)
    measure.table(HEADER, [cells(row) for row in rows])
    passed = sum(row["pass"] for row in rows)
    print(f"{passed} of {len(rows)} within their bounds; {sum(r['wall_s'] for r in rows):.0f} s, "
          f"processor {sum(r['cpu_s'] for r in rows):.0f} s")
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))
    return 0 if passed == len(rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
