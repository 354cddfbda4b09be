#!/usr/bin/python3
"""Is one build of cloudrenderer faster than another? Both render a scene at the same time, each on a processor of its own,
and then change places, so that what else the machine does meets both alike: differences of a hundredth show in a minute.
Prints the ratios of their processor times (median and range), and exits 1 if the pictures differ.
    --truth-spp 1024    for builds that are to differ: each pair of runs has a seed of its own, and their trimmed relMSEs against a
                        picture by `after` of so many samples are told, too (means); that they differ is no failure then"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

import measure

STAGES = ("camera", "trace", "shade", "occlusion")


def start(program, processor, scene, folder, name, options):
    picture, report = folder / f"{name}.exr", folder / f"{name}.json"
    return subprocess.Popen(["taskset", "-c", str(processor), program, "render", scene, "--threads", "1", "--quiet", "-o", picture,
                             "--report", report, *options], preexec_fn=measure.die_with_parent)


def seconds(folder, name):
    report = json.loads((folder / f"{name}.json").read_text())
    return {"render": report["time"]["render_cpu_s"], **{stage: report["engine_cpu_s"][stage] for stage in STAGES}}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", help="a cloudrenderer binary")
    parser.add_argument("after", help="another one")
    parser.add_argument("scene")
    parser.add_argument("--pairs", type=int, default=4, help="how often both run (default 4)")
    parser.add_argument("--spp", help="samples a pixel (default: the scene's)")
    parser.add_argument("--truth-spp", type=int, help="compares errors as well, against so many samples")
    arguments, options = parser.parse_known_args()  # the rest is for `render`
    processors = sorted(os.sched_getaffinity(0))[:2]
    if len(processors) < 2:
        sys.exit("compare_builds: two processors are needed")
    programs = {"before": os.path.abspath(arguments.before), "after": os.path.abspath(arguments.after)}
    times, errors = {name: [] for name in programs}, {name: [] for name in programs}
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(scratch)
        truth = None
        if arguments.truth_spp:
            picture = folder / "truth.exr"
            measure.run([programs["after"], "render", arguments.scene, "--quiet", "-o", picture, *options, "--seed", 77, "--spp",
                         arguments.truth_spp], check=True)
            truth = measure.read_rgb(picture)
        for pair in range(arguments.pairs):
            run_options = [*options, *(["--spp", arguments.spp] if arguments.spp else []), *(["--seed", str(pair + 1)] if arguments.truth_spp else [])]
            places = processors if pair % 2 == 0 else processors[::-1]
            running = [start(program, place, arguments.scene, folder, name, run_options)
                       for (name, program), place in zip(programs.items(), places)]
            codes = [process.wait() for process in running]
            if any(codes):
                sys.exit(f"compare_builds: the renders ended with {codes[0]} (before) and {codes[1]} (after)")
            for name in programs:
                times[name].append(seconds(folder, name))
                if truth is not None:
                    errors[name].append(measure.compare(measure.read_rgb(folder / f"{name}.exr"), truth).trimmed)
        pictures = [measure.read_rgb(folder / f"{name}.exr") for name in programs]
    rows = []
    for stage in ("render", *STAGES):
        before, after = ([t[stage] for t in times[name]] for name in programs)
        ratios = [a / b for a, b in zip(after, before)]
        rows.append([stage, *(f"{x:.3f}" for x in map(measure.median, (before, after, ratios))), f"{min(ratios):.3f} to {max(ratios):.3f}"])
    if truth is not None:
        before, after = (sum(errors[name]) / arguments.pairs for name in programs)
        ratios = [a / b for a, b in zip(errors["after"], errors["before"])]
        rows.append(["trimmed relMSE", f"{before:.6f}", f"{after:.6f}", f"{after / before:.3f}", f"{min(ratios):.3f} to {max(ratios):.3f}"])
    measure.table(["processor s", "before", "after", "ratio", f"range of {arguments.pairs}"], rows)
    if truth is not None:
        return 0
    same = np.array_equal(*pictures)
    print("the same picture" if same else "the pictures differ")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
