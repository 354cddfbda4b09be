"""Does the confidence interval of the report hold the true relMSE? Many seeds of five small scenes, each against a picture
of our own with many times the samples and another seed; prints how many of them it holds.

confidence_test.py PROGRAM [--runs N] [--threads N] [--stopped SHARE] [SCENE...]

With --stopped the runs end by --max-error, at SHARE of what they would have with 16 samples: who stops at the first good
look takes a lucky one, and the interval must be right all the same."""
import argparse
import pathlib
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))
import measure  # noqa: E402

SCENES = [ROOT / "scenes" / "killeroo" / "killeroo-path.pbrt", ROOT / "scenes" / "cornell-box" / "cornell-small.pbrt",
          *(ROOT / "tests" / "image" / "scenes" / f"{name}.pbrt" for name in ("motion", "curves", "disk-light"))]
SPP = 16
MOST = 64 * SPP  # of a pixel, where the error ends a run
REFERENCE_SEED = 1_000_000
PROMISED = 0.9


def render(arguments, split, seed, spp, picture, *more, report=False):
    return measure.run([arguments.program, "render", split, "-o", picture, "--seed", seed, "--spp", spp, "--resolution",
                        arguments.resolution, "--threads", arguments.threads, "--quiet", *more], report=report, check=True)


def held(arguments, scene, folder):
    """How many of the runs have the true relMSE within their interval; and below, above it, the intervals' mean width."""
    split = folder / scene.stem
    measure.run([arguments.program, "split", scene, "-o", split], check=True)
    reference, journal = folder / "reference.exr", folder / f"{scene.stem}.ckpt"
    # In two steps, so that the textures of the reference are filtered for as many samples as those of the runs.
    first = MOST if arguments.stopped else SPP
    for spp, more in ((first, ()), (SPP * arguments.factor, ("--resume",))):
        render(arguments, split, REFERENCE_SEED, spp, reference, "--checkpoint", journal, *more)
    ends, spp = (), SPP
    if arguments.stopped:
        error = render(arguments, split, REFERENCE_SEED + 1, SPP, folder / "picture.exr", report=True).report["error"]
        ends, spp = ("--max-error", f"{arguments.stopped * error['estimated_relmse']:.3g}"), MOST
    inside, below, above, widths, samples = 0, 0, 0, [], []
    for seed in range(1, arguments.runs + 1):
        report = render(arguments, split, seed, spp, folder / "picture.exr", "--reference", reference, *ends, report=True).report
        error = report["error"]
        if arguments.stopped and error["estimated_relmse_high"] > float(ends[1]):
            sys.exit(f"{scene.stem}, seed {seed}: --max-error {ends[1]} was not met")
        samples.append(report["paths"] / report["width"] / report["height"])
        low, high, true = error["estimated_relmse_low"], error["estimated_relmse_high"], error["relmse"]
        if not low <= error["estimated_relmse"] <= high:
            sys.exit(f"{scene.stem}, seed {seed}: the estimate {error['estimated_relmse']} is outside of its interval [{low}, {high}]")
        inside += low <= true <= high
        below += true < low
        above += true > high
        widths.append((high - low) / max(error["estimated_relmse"], 1e-30))
    print(f"{scene.stem:16s} {inside:3d} of {arguments.runs} runs; true relMSE below the interval {below}, above {above}; "
          f"the interval is {sum(widths) / len(widths):.2f} of the estimate wide; {sum(samples) / len(samples):.0f} samples", flush=True)
    return inside


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--resolution", default="32x32")
    parser.add_argument("--factor", type=int, default=64, help="samples of the reference for each of a run")
    parser.add_argument("--stopped", type=float, default=0, metavar="SHARE")
    parser.add_argument("scenes", nargs="*", type=pathlib.Path, default=SCENES)
    arguments = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for scene in arguments.scenes:
            results[scene.stem] = held(arguments, scene, pathlib.Path(folder))
    print(f"together {sum(results.values())} of {len(results) * arguments.runs}")
    # Few runs are judged together: chance may take two of six.
    if arguments.runs >= 50:
        missed = [name for name, inside in results.items() if inside < PROMISED * arguments.runs]
    else:
        missed = ["all"] if sum(results.values()) < PROMISED * len(results) * arguments.runs else []
    if missed:
        sys.exit(f"fewer than {PROMISED:.0%} of the intervals hold the true relMSE: {', '.join(missed)}")


if __name__ == "__main__":
    main()
