#!/usr/bin/python3
"""Out of core: a generated scene on one host with less and less of the memory that it needs. Exit 1 when a bound is missed.

Checked: at half of the memory at most three times the time of a host that holds everything; no host above its budget;
anonymous memory (RssAnon, sampled) at most the budget and an allowance; the same picture, bit for bit. The times are
whole renders of a split scene, loading included, in turn.
"""
import argparse
import pathlib
import tempfile

import numpy as np

import measure
from bench_memory import MIB, Memory


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("--generator", type=pathlib.Path, help="generate_scene; default: beside the program")
    parser.add_argument("--triangles", type=int, default=10_000_000)
    parser.add_argument("--shares", default="0.75,0.5,0.35,0.25", help="of the memory that one host needs")
    parser.add_argument("--bound", type=float, default=3, help="for the time at half of the memory, as a multiple")
    parser.add_argument("--allowance", type=int, default=400, help="MiB beside the budget")
    parser.add_argument("--part-size", default="32MiB")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--resolution", default="960x540")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--scratch", type=pathlib.Path, help="folder for the scene and its split")
    args = parser.parse_args()
    measure.require_program(args.program)
    missed, rows = [], []
    with tempfile.TemporaryDirectory(dir=args.scratch) as name:
        scratch = pathlib.Path(name)
        generator = args.generator or args.program.parent / "generate_scene"
        measure.run([generator, "--triangles", args.triangles, "-o", scratch / "scene"], check=True)
        measure.run([args.program, "split", scratch / "scene" / "scene.pbrt", "-o", scratch / "split", "--part-size",
                     args.part_size], check=True)

        def render(out, *options):
            memory = Memory()
            done = measure.run([args.program, "render", scratch / "split", "-o", scratch / out, "--resolution",
                                args.resolution, "--spp", args.spp, "--threads", args.threads, "--quiet", *options],
                               report=True, check=True, watch=memory)
            return done, max(memory.anonymous.values(), default=0), measure.read_rgb(scratch / out)

        one, anonymous, picture = render("all.exr")
        whole = one.report["hosts"][0]["memory_peak"]
        rows.append(["all", f"{whole / MIB:.0f}", f"{whole / MIB:.0f}", f"{anonymous / MIB:.0f}", one.report["parts"]["count"],
                     0, f"{one.wall:.1f}", f"{one.cpu:.1f}", "1.00", "1.00"])
        for share in map(float, args.shares.split(",")):
            budget = int(whole * share)
            done, anonymous, other = render(f"{share}.exr", "--memory", budget)
            host = done.report["hosts"][0]
            rows.append([share, f"{budget / MIB:.0f}", f"{host['memory_peak'] / MIB:.0f}", f"{anonymous / MIB:.0f}",
                         host["parts_loaded"], host["paged_in"], f"{done.wall:.1f}", f"{done.cpu:.1f}",
                         f"{done.wall / one.wall:.2f}", f"{done.cpu / one.cpu:.2f}"])
            if host["memory_peak"] > budget:
                missed.append(f"{share}: {host['memory_peak'] / MIB:.1f} MiB loaded")
            if anonymous > budget + args.allowance * MIB:
                missed.append(f"{share}: {anonymous / MIB:.0f} MiB anonymous")
            if not np.array_equal(picture, other):
                missed.append(f"{share}: another picture")
            if share >= 0.5 and done.wall > args.bound * one.wall:
                missed.append(f"{share}: {done.wall / one.wall:.2f} times the time")
    measure.table(["memory", "budget MiB", "loaded peak", "anonymous peak", "parts that stay", "parts paged in", "s",
                   "processor s", "time ratio", "processor ratio"], rows)
    for problem in missed:
        print(f"MISSED: {problem}")
    print("within the bounds" if not missed else f"{len(missed)} bounds missed")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
