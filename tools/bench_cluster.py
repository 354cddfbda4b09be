#!/usr/bin/python3
"""What distribution costs: one scene as one part and as about sixteen, on one host of two threads and on two of one.

Two hosts hold a share of the parts each (their budget is --budget of the whole) and talk TCP over the loopback. Times
are medians of runs in turn; the processor time is that of all processes, the manager and loading included.
"""
import argparse
import json
import pathlib
import tempfile

import measure

MIB = 1 << 20


def split(program, scene, folder, part_size):
    measure.run([program, "split", scene, "-o", folder, "--part-size", int(part_size)], check=True)
    return folder


def render(args, scene, *options, spp=None):
    with tempfile.TemporaryDirectory() as scratch:
        return measure.run([args.program, "render", scene, "-o", pathlib.Path(scratch, "out.exr"), "--spp",
                            spp or args.spp, "--resolution", args.resolution, "--quiet", *options],
                           report=True, check=True)


def split_into(args, scene, folder, wanted):
    """Splits into about so many parts: the part size is found by trying. Also gives the bytes of one part's host."""
    whole = split(args.program, scene, folder / "whole", 1 << 45)
    report = render(args, whole, "--threads", 2, spp=1).report
    size = report["parts"]["bytes"] / wanted
    best = None
    for attempt in range(6):
        tried = split(args.program, scene, folder / f"try{attempt}", max(size, 4096))
        found = render(args, tried, "--threads", 2, spp=1).report
        count = found["parts"]["count"]
        if best is None or abs(count - wanted) < abs(best[1] - wanted):
            best = (tried, count, found["hosts"][0]["memory_peak"])
        if wanted <= count <= wanted * 1.25:
            break
        size *= (count / wanted) ** 0.7 if count > 1 else 0.5
    return whole, *best


def bench(args, name, scene):
    with tempfile.TemporaryDirectory(dir=args.scratch) as scratch:
        whole, parts, count, memory = split_into(args, scene, pathlib.Path(scratch), args.parts)
        budget = int(memory * args.budget)
        print(f"{name}: {count} parts, {memory / MIB:.0f} MiB resident on one host; two hosts get {budget / MIB:.0f} MiB each",
              flush=True)
        kinds = {
            "1 host x 2 threads, 1 part": (whole, "--hosts", 1, "--threads", 2),
            f"1 host x 2 threads, {count} parts": (parts, "--hosts", 1, "--threads", 2),
            f"2 hosts x 1 thread, {count} parts": (parts, "--hosts", 2, "--threads", 1, "--replication", 1,
                                                   "--memory", budget),
        }
        if args.tls:
            kinds |= {f"{kind}, TLS": (*command, "--tls", "on") for kind, command in list(kinds.items())[2:]}
        runs = {kind: [] for kind in kinds}
        for _ in range(args.runs):
            for kind, command in kinds.items():
                runs[kind].append(render(args, *command))
    figures = {}
    for kind, results in runs.items():
        report = results[0].report
        paths = report["rays"]["camera"]
        figures[kind] = {
            "render_s": measure.median([r.report["time"]["render_s"] for r in results]),
            "cpu_s": measure.median([r.cpu for r in results]),
            "paths": paths,
            "moves_per_path": measure.median([r.report["rays"]["moved"] / paths for r in results]),
            "asks_per_path": measure.median([r.report["rays"]["shadow_asked"] / paths for r in results]),
            "bytes_per_path": measure.median([r.report["wire"]["bytes_per_path"] for r in results]),
            "busy": measure.median([min(h["busy"] for h in r.report["hosts"]) for r in results]),
        }
    base = list(figures.values())[1]
    measure.table(
        ["", "render s", "cpu s", "M samples/s", "per cpu s", "wall rel.", "cpu rel.", "bytes/path", "moves/path",
         "asks/path", "least busy"],
        [[kind, f"{f['render_s']:.2f}", f"{f['cpu_s']:.2f}", f"{f['paths'] / f['render_s'] / 1e6:.3f}",
          f"{f['paths'] / f['cpu_s'] / 1e6:.3f}", f"{base['render_s'] / f['render_s']:.3f}",
          f"{base['cpu_s'] / f['cpu_s']:.3f}", f"{f['bytes_per_path']:.0f}", f"{f['moves_per_path']:.3f}",
          f"{f['asks_per_path']:.3f}", f"{f['busy']:.2f}"] for kind, f in figures.items()])
    one, split_, two = list(figures.values())[:3]
    print(f"{name}: partition cost (1 part / {count} parts, one host) {one['render_s'] / split_['render_s']:.3f}; "
          f"two hosts against one with the same split {split_['render_s'] / two['render_s']:.3f}", flush=True)
    if args.tls:
        tls = list(figures.values())[3]
        print(f"{name}: samples per second with TLS / without {two['render_s'] / tls['render_s']:.3f}; "
              f"per processor second {two['cpu_s'] / tls['cpu_s']:.3f}", flush=True)
    return {name: figures}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("--generator", type=pathlib.Path, help="generate_scene; default: beside the program")
    parser.add_argument("--shared", type=pathlib.Path, default=measure.DEFAULT_SHARED, help="folder of reference scenes")
    parser.add_argument("--scene", action="append", type=pathlib.Path, help="measure these scenes instead")
    parser.add_argument("--triangles", type=int, default=10_000_000, help="of the generated scene; 0: without it")
    parser.add_argument("--parts", type=int, default=16)
    parser.add_argument("--budget", type=float, default=0.7, help="of each of the two hosts, as a share of the whole")
    parser.add_argument("--tls", action="store_true", help="also two hosts that encrypt what they say")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--resolution", default="420x300")
    parser.add_argument("--scratch", type=pathlib.Path, help="folder for splits")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to a file too")
    args = parser.parse_args()
    measure.require_program(args.program)
    figures = {}
    with tempfile.TemporaryDirectory(dir=args.scratch) as scratch:
        scenes = {path.stem: path for path in args.scene or []}
        if not scenes:
            bmw = args.shared / "scenes" / "v3" / "bmw-m6" / "bmw-small.pbrt"
            if bmw.exists():
                scenes["bmw-m6"] = bmw
            else:
                print(f"no folder of reference scenes at {args.shared}: without bmw-m6")
            if args.triangles:
                generator = args.generator or args.program.parent / "generate_scene"
                folder = pathlib.Path(scratch, "landscape")
                measure.run([generator, "--triangles", args.triangles, "-o", folder], check=True)
                scenes[f"landscape-{args.triangles}"] = folder / "scene.pbrt"
        for name, path in scenes.items():
            figures |= bench(args, name, path)
    if args.json:
        args.json.write_text(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
