#!/usr/bin/python3
"""Predictions of `cloudrenderer simulate` against real runs on this machine.

A scene is rendered once in one process for the costs and the paths (--sample-paths), and by one worker of one thread with
--share of a core (a cgroup with a quota), with all and with a quarter of the samples, which says how fast such a worker
is and what it takes once. Messages wait for the receiver's share (tools/quota.py: periods of 10 ms). Nothing else is known when clusters of
--hosts such workers, each with --budget of the scene's memory, are predicted; then they are run. Predicted and measured
render times stand beside each other; with --check a difference of more than --within is a failure. Medians of --runs. Where less than a tenth of the processors was idle the row says so: shares are then not
what they say.
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

import local_cluster
import measure
import quota

MIB = 1 << 20
LEAST_IDLE = 0.1


def calibrate(args, scene, options, report):
    """One host, one thread, in this process: costs are processor time, so that other load matters little."""
    with tempfile.TemporaryDirectory() as scratch:
        measure.run([args.program, "render", scene, "-o", pathlib.Path(scratch, "out.exr"), "--threads", 1, "--quiet",
                     "--sample-paths", 2048, *options, "--report", report], check=True)
    return json.loads(pathlib.Path(report).read_text())


def predict(args, model, hosts, memory, speed, start, folder):
    out = folder / "prediction.json"
    subprocess.run([args.program, "simulate", model, "--hosts", ",".join(map(str, hosts)), "--kind",
                    f"worker:1:{memory}:0:{speed}", "--bandwidth", "20", "--latency", "5", "--start", str(start), "--report", out, "--seed",
                    str(args.seed)], check=True, stdout=subprocess.DEVNULL)
    return {p["hosts"]: p for p in json.loads(out.read_text())["predictions"]}


def compare(args, name, scene, spp):
    options = ["--resolution", args.resolution]
    with tempfile.TemporaryDirectory(dir=args.scratch) as scratch:
        folder = pathlib.Path(scratch)
        model = folder / "one.json"
        report = calibrate(args, scene, [*options, "--spp", spp], model)
        parts = report["model"]["parts"]
        largest = max(p["bytes"] + p["build"] for p in parts)
        memory = int(args.budget * sum(p["bytes"] for p in parts) + largest)
        whole = int(1.1 * sum(p["bytes"] for p in parts) + 2 * largest)
        print(f"{name}: {report['parts']['count']} parts, {report['parts']['triangles']} triangles; a host may use "
              f"{memory / MIB:.0f} MiB (one alone {whole / MIB:.0f}); share {args.share} of a core, {spp} samples, seed "
              f"{args.seed}", flush=True)
        # Few samples would not share camera rays by themselves.
        options += ["--samples-per-ray", report["samples_per_ray"]] if report["samples_per_ray"] > 1 else []
        def real(hosts, samples=spp):
            return [local_cluster.render(args.program, scene, [args.share] * hosts, [*options, "--spp", samples],
                                         whole if hosts == 1 else memory, args.timeout) for _ in range(args.runs)]
        seconds = lambda runs: statistics.median(r["time"]["render_s"] for r in runs)
        alone = real(1)
        # What does not grow with the samples a host takes once.
        few = int(spp) // 4
        fixed = seconds(alone) - (seconds(alone) - seconds(real(1, few))) * int(spp) / (int(spp) - few)
        start = max(0.0, fixed) * args.share
        speed = args.share
        for _ in range(3):  # so that one host takes as long as it did
            one = predict(args, model, [1], whole, speed, start, folder)
            speed *= one[1]["render_s"] / seconds(alone)
        print(f"a worker is as fast as {speed:.3f} of the core that the costs are of, and takes {start:.2f} s of it once", flush=True)
        several = [n for n in args.hosts if n > 1]
        predicted = predict(args, model, [1], whole, speed, start, folder)
        if several:
            predicted |= predict(args, model, several, memory, speed, start, folder)
        print("| hosts | predicted s | measured s | ratio | runs | moves a path | measured | bytes a path | measured | load s | measured | idle |\n"
              "|---|---|---|---|---|---|---|---|---|---|---|---|", flush=True)
        worst = 0
        for hosts in args.hosts:
            runs = alone if hosts == 1 else real(hosts)
            median = lambda get: statistics.median(get(r) for r in runs)
            p = predicted[hosts]
            measured, idle = median(lambda r: r["time"]["render_s"]), median(lambda r: r["idle"])
            ratio = p["render_s"] / measured
            worst = max(worst, abs(ratio - 1))
            print(f"| {hosts} | {p['render_s']:.2f} | {measured:.2f} | {ratio:.2f} | "
                  f"{', '.join('%.2f' % r['time']['render_s'] for r in runs)} | {p['moves_per_path']:.2f} | "
                  f"{median(lambda r: r['moves_per_path']):.2f} | {p['bytes_per_path']:.0f} | "
                  f"{median(lambda r: r['wire']['bytes_per_path']):.0f} | {p['load_s']:.1f} | "
                  f"{median(lambda r: r['time']['load_s']):.1f} | {idle:.0%}{' (too busy)' if idle < LEAST_IDLE else ''} |",
                  flush=True)
        return worst


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", help="NAME=SPLIT_FOLDER:SPP")
    parser.add_argument("--program", type=pathlib.Path, default=measure.DEFAULT_PROGRAM)
    parser.add_argument("--hosts", type=lambda t: [int(n) for n in t.split(",")], default=[1, 2, 4, 8])
    parser.add_argument("--share", type=float, default=0.1, help="of a core, a worker")
    parser.add_argument("--budget", type=float, default=0.6, help="memory of a worker beside room for one build, of the whole scene's")
    parser.add_argument("--resolution", default="400x400")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1, help="of the simulation")
    parser.add_argument("--timeout", type=float, default=900)
    parser.add_argument("--scratch", help="folder for temporary files")
    parser.add_argument("--within", type=float, default=0.2)
    parser.add_argument("--check", action="store_true")
    args = parser.parse_args()
    try:
        worst = max(compare(args, *(lambda name, rest: (name, *rest.rsplit(":", 1)))(*text.split("=", 1)))
                    for text in args.scenes)
    except quota.NotPermitted as reason:
        print(f"skipped: {reason}")
        return measure.SKIPPED
    print(f"largest difference {worst:.0%}")
    return 1 if args.check and worst > args.within else 0


if __name__ == "__main__":
    sys.exit(main())
