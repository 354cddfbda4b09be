#!/usr/bin/python3
"""What the noise of a reference picture does to the measures of reference_table.py: can a picture without any error pass?

Renders a scene with as many samples as its reference has, several times with other samples, and takes all of these together
as converged. Then compares the converged picture with the reference, and with each of our own pictures of the reference's
samples in the reference's place (the converged picture without it): what a reference of this renderer would have done.

The relMSE is also given for means over blocks of 2 x 2 to 16 x 16 pixels, times the pixels of a block: noise without
correlation gives the same number for every size, a picture of something else grows with the size.
"""
import argparse
import pathlib
import tempfile

import numpy as np

import measure
import reference_table

# Samples a pixel of the references, from the README of the scenes.
SAMPLES = {"v3/veach-small": 512, "v3/buddha-small": 128, "v2/bunny-path": 512, "v3/classroom-small": 256,
           "v3/killeroo-gold-small": 256, "v3/coffee-small": 512, "v2/room-path-small": 1024}
BLOCKS = (1, 2, 4, 8, 16)


def blocks(image, size):
    height, width = (n // size for n in image.shape[:2])
    return image[: height * size, : width * size].reshape(height, size, width, size, 3).mean(axis=(1, 3))


def by_blocks(image, reference):
    """Of the pixels that are not among the worst 0.1 %, so that single fireflies do not fill their blocks."""
    error = ((image - reference) ** 2 / (reference ** 2 + 0.01)).mean(axis=2)
    worst = error > np.quantile(error, 0.999)
    reference = np.where(worst[..., None], image, reference)
    found = []
    for size in BLOCKS:
        a, b = blocks(image, size), blocks(reference, size)
        found.append(float(((a - b) ** 2 / (b * b + 0.01)).mean()) * size * size)
    return found


def pictures(args, key, scene, folder):
    for seed in range(args.seeds):
        out = folder / f"{key.replace('/', '-')}-{seed}.exr"
        result = measure.run([args.program, "render", args.shared / "scenes" / f"{scene}.pbrt", "-o", out, "--spp",
                              SAMPLES[key], "--seed", 1000 + seed, "--quiet"], timeout=args.timeout)
        if result.code != 0:
            raise SystemExit(f"{scene}: exit code {result.code}: {result.output.strip()[-600:]}")
        yield measure.read_rgb(out).astype(np.float64)


def one(args, key, scene, folder):
    reference = measure.read_rgb(args.shared / "references" / f"{key}.exr").astype(np.float64)
    made = list(pictures(args, key, scene, folder))
    total = np.sum(made, axis=0)
    rows = [("the reference", measure.compare(total / len(made), reference), by_blocks(total / len(made), reference))]
    for number, picture in enumerate(made):
        others = (total - picture) / (len(made) - 1)
        rows.append((f"ours {number + 1}", measure.compare(others, picture), by_blocks(others, picture)))
    print(f"\n{key}: the converged picture ({len(made)} x {SAMPLES[key]} samples) against")
    measure.table(["", "relMSE", *(f"{n} x {n}" for n in BLOCKS), "mean R", "G", "B"],
                  [[name, f"{found.trimmed:.3g}", *(f"{x:.3g}" for x in sizes), *(f"{r:.4f}" for r in found.mean_ratio)]
                   for name, found, sizes in rows])
    ratios = np.array([found.mean_ratio for _, found, _ in rows])
    mean, deviation = ratios[1:].mean(axis=0), ratios[1:].std(axis=0, ddof=1)
    print("our pictures: mean ratio " + ", ".join(f"{m:.4f} +- {d:.4f}" for m, d in zip(mean, deviation)) +
          "; the reference is off by " + ", ".join(f"{z:+.1f}" for z in (ratios[0] - mean) / deviation) + " deviations", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("--shared", type=pathlib.Path, default=measure.DEFAULT_SHARED, help="folder of reference scenes")
    parser.add_argument("--only", nargs="+", metavar="NAME", default=["v3/veach-small", "v3/buddha-small", "v2/bunny-path"])
    parser.add_argument("--seeds", type=int, default=8, help="pictures of each scene, at least 3")
    parser.add_argument("--timeout", type=float, default=1800, help="seconds for a picture")
    args = parser.parse_args()
    if args.seeds < 3:
        parser.error("--seeds must be at least 3")
    measure.require_shared(args.shared)
    measure.require_program(args.program)
    scenes = reference_table.chosen_scenes(argparse.Namespace(only=args.only, all=False))
    unknown = sorted(set(scenes) - set(SAMPLES))
    if unknown:
        parser.error(f"the samples of {', '.join(unknown)} are not known")
    with tempfile.TemporaryDirectory() as folder:
        for key, scene in scenes.items():
            one(args, key, scene, pathlib.Path(folder))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
