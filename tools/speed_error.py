#!/usr/bin/python3
"""Speed against error: how long every program takes to make a picture this good.

Renders the same scenes (converted by to_mitsuba.py, so that nothing in them is unknown to one of the programs) with us and
with every peer that is found, at several sample counts, in turn, with the same threads and maximum depth. The error is the
relMSE without the worst 0.1 % of the pixels, of each program against its own converged picture, since materials differ a
little. Prints the time to reach each error and the ratios, and writes into --out: speed_error.json, a plot for each scene
(SVG and PNG), and speed_error.html, which holds all of it.

    tools/speed_error.py                                  the table of six scenes (needs the folder of reference scenes)
    tools/speed_error.py --hosts 1,2,4,8                  the cluster instead: hosts with a share of a core each, as root
    tools/speed_error.py --scene a.pbrt --spp 4,16,64     other scenes and sample counts

Needs Debian's python3-numpy, python3-openimageio and python3-venv; Mitsuba 3 and matplotlib come from PyPI into build/, and
libllvm19 from Debian when this is run as root. Times: `render` is the rendering alone. Of ours and pbrt's that is the whole
process less what a picture of 8 x 8 pixels and one sample takes (ours we report ourselves); Mitsuba's is its
render call, without importing, loading and compiling, which are given by themselves. Converged pictures are kept in --out
and used again.
"""
import argparse
import datetime
import hashlib
import json
import math
import os
import pathlib
import platform
import sys

import numpy as np

import local_cluster
import measure
import pbrt_text
import speed_cluster
import speed_programs
import speed_report
import standins
import to_mitsuba

SCENES = ("v2/killeroo-path", "v2/room-path-small", "v3/bmw-m6/bmw-small", "v3/coffee/coffee-small",
          "v3/veach/veach-small", "v3/killeroos/killeroo-gold-small")
TRUTH_SEED = 77_000  # other samples than those of any run
STEPS = (1, 2, 5)    # of the errors in the tables, in a decade


def machine():
    model = next((line.split(":")[1].strip() for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines()
                  if line.startswith("model name")), platform.processor())
    return f"{model}, {os.cpu_count()} processors, {platform.platform()}"


def prepare(args, programs):
    """The scenes, converted."""
    paths = args.scene
    if not paths:
        measure.require_shared(args.shared)
        paths = [args.shared / "scenes" / f"{name}.pbrt" for name in SCENES]
    versions = {p.version for p in programs if isinstance(p, speed_programs.Process) and p.version}
    cases = []
    for path in paths:
        folder = args.out / "scenes" / path.stem
        try:
            model = to_mitsuba.convert(args.program, path, folder, versions, coats=args.coats)
        except (standins.NoCounterpart, pbrt_text.TextError, OSError) as problem:
            sys.exit(f"{path}: {problem}")
        width, height = model.resolution
        if args.pixels:
            scale = math.sqrt(args.pixels / (width * height))
            width, height = max(8, round(width * scale)), max(8, round(height * scale))
        cases.append(speed_programs.Case(path.stem, folder, model, (width, height)))
        for note in model.notes:
            print(f"{path.stem}: replaced in all programs: {note}", flush=True)
    return cases


def converged(args, case, program):
    """The program's own picture with many samples; kept, and named after all that it depends on."""
    scene = hashlib.sha256()
    for path in sorted(case.folder.rglob("*")):
        if path.suffix in (".ply", ".exr") and path.parent != case.folder or path.name.endswith("-world.pbrt") or \
                path.name == "scene.xml":
            scene.update(path.read_bytes())
    key = f"{case.name}-{program.truth_of()}-{scene.hexdigest()[:12]}-{case.resolution[0]}x{case.resolution[1]}-{args.truth_spp}"
    kept = args.out / "truth" / f"{key}.npy"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        sample = program.run(case, args.truth_spp, TRUTH_SEED)
        np.save(kept, sample.picture)
        print(f"  {case.name}: converged picture of {program.name}, {args.truth_spp} samples, {sample.wall:.1f} s", flush=True)
    return np.load(kept)


def busy_seconds():
    """Of all processors of the machine."""
    ticks, idle = local_cluster.processor_ticks()
    return (ticks - idle) / os.sysconf("SC_CLK_TCK")


def measure_case(args, case, programs):
    """All runs of a scene: {program: {spp: [run]}}, the converged pictures, and what share of the processor time meanwhile was not
    theirs."""
    truths = {}
    for program in programs:  # the first of those that share one makes it
        truths.setdefault(program.truth_of(), converged(args, case, program))
    runs = {p.name: {spp: [] for spp in args.spp} for p in programs}
    used, began = 0., busy_seconds()
    for turn in range(args.runs):
        for spp in args.spp:
            for p in programs:
                sample = p.run(case, spp, turn)
                used += sample.cpu
                found = measure.compare(sample.picture, truths[p.truth_of()])
                runs[p.name][spp].append({
                    "wall": sample.wall, "cpu": sample.cpu, "render_wall": sample.render_wall,
                    "render_cpu": sample.render_cpu, "relmse": found.relmse, "trimmed": found.trimmed,
                    "bad": sample.bad, "phases": sample.phases})
        print(f"  {case.name}: turn {turn + 1} of {args.runs}", flush=True)
    others = 1 - used / max(busy_seconds() - began, used)
    return runs, {p.name: truths[p.truth_of()] for p in programs}, others


TIMES = ("render_cpu", "render_wall", "cpu", "wall")


def medians(runs):
    """Rows by sample count."""
    return [{"spp": spp, "error": measure.median([r["trimmed"] for r in found]),
             "full_error": measure.median([r["relmse"] for r in found]),
             **{t: measure.median([r[t] for r in found]) for t in TIMES}, "bad": max(r["bad"] for r in found)}
            for spp, found in runs.items()]


def time_at(rows, error, kind):
    """Seconds to reach the error, and whether that is between measured points; beyond them error x time is constant."""
    rows = sorted(rows, key=lambda r: r[kind])
    for a, b in zip(rows, rows[1:]):
        if a["error"] >= error >= b["error"] and a["error"] > b["error"]:
            share = math.log(a["error"] / error) / math.log(a["error"] / b["error"])
            return float(a[kind] * (b[kind] / a[kind]) ** share), True
    near = min(rows, key=lambda r: abs(math.log(max(r["error"], 1e-30) / error)))
    return float(near[kind] * near["error"] / error), bool(near["error"] == error)


def targets(rows):
    """Round errors within what we measured of us."""
    low, high = min(r["error"] for r in rows), max(r["error"] for r in rows)
    found = [s * 10.0 ** e for e in range(-9, 3) for s in STEPS if low <= s * 10.0 ** e <= high]
    return sorted(found, reverse=True) or [math.sqrt(low * high)]


def analyse(runs):
    """Tables of one scene."""
    rows = {name: medians(found) for name, found in runs.items()}
    own = rows[speed_programs.Ours.name]
    wanted = targets(own)
    reached = {name: [{kind: time_at(r, e, kind) for kind in TIMES} for e in wanted] for name, r in rows.items()}
    ratios = {name: {kind: measure.median([theirs[kind][0] / ours[kind][0] for theirs, ours
                                           in zip(reached[name], reached[speed_programs.Ours.name])]) for kind in TIMES}
              for name in rows if name != speed_programs.Ours.name}
    phases = {}
    for name, found in runs.items():
        all_ = [r["phases"] for by_spp in found.values() for r in by_spp]
        phases[name] = {k: measure.median([p[k][1] for p in all_]) for k in all_[0]}
        if "compile" in all_[0]:
            phases[name]["compile without its cache"] = max(p["compile"][1] for p in all_)
    return {"rows": rows, "targets": wanted, "reached": reached, "ratios": ratios, "phases": phases}


def find_programs(args):
    programs = [speed_programs.Ours(args.program, args.threads, args.ours, args.runs)]
    if args.samples_per_ray:
        programs[0].options = ("--samples-per-ray", args.samples_per_ray)
    for version in ("v2", "v3", "v4"):
        path = getattr(args, f"pbrt_{version}")
        if path:
            if not os.access(path, os.X_OK):
                sys.exit(f"--pbrt-{version}: {path} is not a program")
            programs.append(speed_programs.Pbrt(version, path.resolve(), args.threads, args.runs))
    if args.mitsuba == "never":
        print("without Mitsuba: --mitsuba never")
    else:
        found, reasons = speed_programs.find_mitsuba(args.variants, args.threads, args.mitsuba == "install")
        programs += found
        for why in reasons:
            print(why)
    print("measured: " + ", ".join(p.name for p in programs), flush=True)
    return programs


def against_peers(args):
    programs = find_programs(args)
    results = {"machine": machine(), "date": datetime.date.today().isoformat(), "threads": args.threads, "runs": args.runs,
               "truth_spp": args.truth_spp, "command": " ".join(["tools/speed_error.py", *sys.argv[1:]]), "scenes": {}}
    truths = {}
    for case in prepare(args, programs):
        runs, truths[case.name], others = measure_case(args, case, programs)
        found = analyse(runs) | {"runs": runs, "notes": case.model.notes, "resolution": case.resolution,
                                 "depth": case.model.depth, "others": others}
        own = truths[case.name][speed_programs.Ours.name]
        found["means"] = {name: measure.compare(own, t).mean_ratio for name, t in truths[case.name].items()}
        results["scenes"][case.name] = found
        speed_report.print_scene(case.name, found)
        (args.out / "speed_error.json").write_text(json.dumps(results, indent=1))  # what there is, should it be stopped
    speed_report.print_summary(results)
    plots = speed_report.draw(args.out, results, args.plots)
    speed_report.write_page(args.out, results, plots, truths)
    return results


def numbers(text):
    return sorted({int(n) for n in text.split(",")})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("--shared", type=pathlib.Path, default=measure.DEFAULT_SHARED, help="folder of reference scenes")
    parser.add_argument("--scene", action="append", type=pathlib.Path, help="instead of the six; may be given several times")
    parser.add_argument("--spp", type=numbers, default=[4, 16, 64, 256], metavar="N,N,...")
    parser.add_argument("--truth-spp", type=int, default=8192, help="of the converged pictures")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--pixels", type=int, help="of the pictures, about; default: as the scenes say")
    parser.add_argument("--mitsuba", choices=("install", "auto", "never"), default="install",
                        help="auto: if it is installed under build/")
    parser.add_argument("--variants", type=lambda t: t.split(","), default=["llvm_ad_rgb", "scalar_rgb"])
    for version in ("v2", "v3", "v4"):
        parser.add_argument(f"--pbrt-{version}", type=pathlib.Path, metavar="BINARY")
    parser.add_argument("--ours", choices=("v2", "v3", "v4"),
                        help="the version of the scene's text that we render; default: its own")
    to_mitsuba.add_coats_option(parser, default=True)
    parser.add_argument("--samples-per-ray", type=int, choices=(1, 2, 4, 8), help="of ours; default: what it finds to pay")
    parser.add_argument("--hosts", type=numbers, metavar="N,N,...", help="measure the cluster with so many hosts")
    speed_cluster.add_options(parser)
    parser.add_argument("--out", type=pathlib.Path, default=measure.ROOT / "build" / "speed_error")
    parser.add_argument("--plots", choices=("install", "auto", "never"), default="install", help="as --mitsuba, for matplotlib")
    args = parser.parse_args()
    measure.require_program(args.program)
    args.program, args.out = args.program.resolve(), args.out.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    if args.truth_spp < 4 * max(args.spp):
        sys.exit("--truth-spp: the converged picture needs at least four times the samples of the others")
    if args.hosts:
        speed_cluster.measure_hosts(args, prepare, converged, machine)
    else:
        against_peers(args)


if __name__ == "__main__":
    main()
