#!/usr/bin/python3
"""What it brings, and costs, that samples share camera rays: error and processor time with --samples-per-ray 1, 2, 4, and what the
renderer chooses by itself.

    tools/share_table.py                       reference scenes, as far as they are there
    tools/share_table.py a.pbrt b.pbrt         other scenes
    ... --runs 3 --groups 1,2,4,8              means of three seeds' errors, medians of their times

`error` is the relMSE without the worst 0.1 % of the pixels, `time` the processor time of rendering, both over those of one sample a
ray; their product is how many times longer an error takes. The truth is a picture of another seed with many samples.
"""
import argparse
import pathlib
import statistics
import sys
import tempfile

import measure

SHARED = ("v2/killeroo-path", "v2/room-path-small", "v3/bmw-m6/bmw-small", "v3/coffee/coffee-small", "v3/veach/veach-small",
          "v3/killeroos/killeroo-gold-small", "v2/metal-path", "v2/bunny-path", "v2/bluespheres-path", "v2/teapot-path", "v2/cornell-path",
          "v3/cornellbox/cornell-small", "v3/classroom/classroom-small", "v3/buddha-fractal/buddha-small")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=pathlib.Path)
    parser.add_argument("--program", type=pathlib.Path, default=measure.DEFAULT_PROGRAM)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--truth-spp", type=int, default=2048)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--groups", type=lambda s: [int(n) for n in s.split(",")], default=[1, 2, 4])
    parser.add_argument("--resolution", help="WxH (default: the scene's)")
    o = parser.parse_args()
    scenes = o.scenes or [p for p in (measure.DEFAULT_SHARED / "scenes" / f"{s}.pbrt" for s in SHARED) if p.exists()]
    if not o.scenes and len(scenes) < len(SHARED):
        print(f"{measure.DEFAULT_SHARED} is not there, or not whole: scenes are left out", file=sys.stderr)
    size = ["--resolution", o.resolution] if o.resolution else []
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        picture = pathlib.Path(folder, "picture.exr")

        def render(scene, spp, seed, *options):
            done = measure.run([o.program, "render", scene, "-o", picture, "--spp", spp, "--seed", seed, "--threads", 2, "--quiet", *size,
                                *options], report=True, check=True)
            return measure.read_rgb(picture), done.report

        for scene in scenes:
            truth, _ = render(scene, o.truth_spp, 77, "--samples-per-ray", 1)
            kinds = {str(n): ["--samples-per-ray", n] for n in o.groups} | {"chosen": []}
            errors, times, chosen = {k: [] for k in kinds}, {k: [] for k in kinds}, []
            for seed in range(1, o.runs + 1):
                for kind, options in kinds.items():
                    image, report = render(scene, o.spp, seed, *options)
                    errors[kind].append(measure.compare(image, truth).trimmed)
                    times[kind].append(report["time"]["render_cpu_s"])
                    if kind == "chosen":
                        chosen.append(str(report["samples_per_ray"]))
            base = str(o.groups[0])
            for kind in kinds:
                error = statistics.mean(errors[kind]) / statistics.mean(errors[base])
                time = statistics.median(times[kind]) / statistics.median(times[base])
                rows.append([scene.stem, ",".join(chosen) + " chosen" if kind == "chosen" else kind, f"{statistics.mean(errors[kind]):.6f}",
                             f"{error:.2f}", f"{time:.2f}", f"{error * time:.2f}"])
                print(*rows[-1], flush=True)
    measure.table(["scene", "samples a ray", "relMSE", "error", "time", "product"], rows)


if __name__ == "__main__":
    main()
