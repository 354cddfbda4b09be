#!/usr/bin/python3
"""What it costs when hosts go, what it brings when one comes, and how even the work is at the end of a frame.

Every worker is a process with a fixed share of a core (a cgroup with a quota), so that hosts on one machine are as fast
with others beside them as alone. The manager has no quota. All figures are medians of runs in turn:

 - the same frame by all workers, by one fewer, and by all of them of which one is killed in the middle, with
   replication 2: the loss may cost 35 % more than never having had the host (--check makes a failure of it);
 - one worker more that comes in the first third: it must make the frame shorter;
 - `tail`: the share of the render time that the last tenth of the paths took (15 % at most), on even hosts, and with
   one that has a quarter of the others' processor;
 - samples per second with TLS and without; the memory of the hosts.
"""
import argparse
import dataclasses
import json
import pathlib
import subprocess
import sys
import tempfile
import time

import measure
import quota
from local_cluster import listening, processor_ticks, start

MIB = 1 << 20
MOST_LOSS = 1.35   # render time with a loss in the middle, over that without the host from the start
MOST_TAIL = 0.15
LEAST_IDLE = 0.1   # of the machine, by the median of the runs: with less the shares are not what they say


@dataclasses.dataclass
class Kind:
    """A way to render the frame."""
    cores: list                 # of every worker
    kill: float | None = None   # a worker is killed after this share of the undisturbed render time
    join: float | None = None   # one more comes after this share
    tls: bool = False


def render(args, kind, scene, undisturbed=None):
    """One run: the report. `undisturbed`: of a run without events, which says when the middle is."""
    with tempfile.TemporaryDirectory() as scratch, quota.Groups() as groups:
        folder = pathlib.Path(scratch)
        log = folder / "manager.log"
        began = time.monotonic()
        processes = []

        def worker(cores):
            options = ["--tls", "on"] if kind.tls else []
            with open(folder / f"worker{len(processes)}.log", "w") as out:
                processes.append(start([args.program, "worker", "--manager", address, "--threads", 1, "--memory",
                                        args.memory, "--name", f"worker{len(processes)}", *options],
                                       out, groups.group(cores, quota.FIRST)))

        def at(share):
            wanted = undisturbed["time"]["load_s"] + share * undisturbed["time"]["render_s"]
            time.sleep(max(0.0, began + wanted - time.monotonic()))
            if manager.poll() is not None:
                sys.exit(f"the frame was done before anything could happen; use more --spp\n{log.read_text()}")

        with open(log, "w") as out:
            manager = start([args.program, "manager", scene, "-o", folder / "out.exr", "--listen", "127.0.0.1:0",
                             "--min-hosts", len(kind.cores), "--replication", args.replication, "--spp", args.spp,
                             "--resolution", args.resolution, "--report", folder / "report.json", "--quiet",
                             *(["--tls", "on"] if kind.tls else [])], out)
        try:
            all_before, idle_before = processor_ticks()
            address = listening(log, manager)
            for cores in kind.cores:
                worker(cores)
            if kind.join is not None:
                at(kind.join)
                worker(kind.cores[0])
            if kind.kill is not None:
                at(kind.kill)
                processes[0].kill()
            code = manager.wait(args.timeout)
            all_after, idle_after = processor_ticks()
            for process in processes:
                process.wait(30)
        except subprocess.TimeoutExpired:
            code = "it hangs"
        finally:
            for process in [manager, *processes]:
                process.kill()
                process.wait()
        if code != 0:
            sys.exit(f"a render failed ({code}):\n" + "\n".join(p.read_text() for p in folder.glob("*.log")))
        report = json.loads((folder / "report.json").read_text())
        report["picture"] = measure.read_rgb(folder / "out.exr")
        report["idle"] = (idle_after - idle_before) / max(1, all_after - all_before)
        return report


def bench(args, scene):
    even = [args.cores] * args.hosts
    kinds = {
        f"{args.hosts} hosts": Kind(even),
        f"{args.hosts - 1} hosts": Kind(even[1:]),
        "one of them lost in the middle": Kind(even, kill=0.5),
        f"{args.hosts + 1}th joins at a quarter": Kind(even, join=0.25),
        "one with a quarter of the speed": Kind([*even[1:], args.cores / 4]),
        f"{args.hosts} hosts, TLS": Kind(even, tls=True),
    }
    reports = {name: [] for name in kinds}
    identical = True
    for turn in range(args.runs):
        for name, kind in kinds.items():
            undisturbed = reports[f"{args.hosts} hosts"]
            report = render(args, kind, scene, undisturbed[-1] if undisturbed else None)
            reports[name].append(report)
            picture = report.pop("picture")
            if turn == 0 and kind == next(iter(kinds.values())):
                wanted = picture
            identical = identical and bool((picture == wanted).all())
    median = {name: {
        "render_s": measure.median([r["time"]["render_s"] for r in found]),
        "samples_per_s": measure.median([r["samples_per_s"] for r in found]),
        "tail": measure.median([r["tail"] for r in found]),
        "wasted": measure.median([(r["wasted_paths"] + r["copied_paths"]) / r["paths"] for r in found]),
        "moves": measure.median([r["moves_per_path"] for r in found]),
        "memory_peak": measure.median([max(h["memory_peak"] for h in r["hosts"]) for r in found]),
        "peak_rss": measure.median([max(h["peak_rss"] for h in r["hosts"]) for r in found]),
    } for name, found in reports.items()}
    measure.table(
        ["", "render s", "M samples/s", "tail", "wasted paths", "moves/path", "parts MiB", "resident MiB"],
        [[name, f"{m['render_s']:.2f}", f"{m['samples_per_s'] / 1e6:.3f}", f"{m['tail']:.3f}", f"{m['wasted']:.3f}",
          f"{m['moves']:.2f}", f"{m['memory_peak'] / MIB:.1f}", f"{m['peak_rss'] / MIB:.0f}"]
         for name, m in median.items()])
    all_, fewer, lost, joined, _, tls = median.values()
    figures = {
        "loss": lost["render_s"] / fewer["render_s"],
        "join": joined["render_s"] / all_["render_s"],
        "tail": max(m["tail"] for m in list(median.values())[:2]),
        "tls": tls["samples_per_s"] / all_["samples_per_s"],
        "identical": identical,
        "idle": measure.median([r["idle"] for found in reports.values() for r in found]),
    }
    print(f"a host lost in the middle, against without it from the start: {figures['loss']:.2f} of the time "
          f"(at most {MOST_LOSS})")
    print(f"one more host from the first third on: {figures['join']:.2f} of the time (less than 1)")
    print(f"the last tenth of the paths: {figures['tail']:.3f} of the time (at most {MOST_TAIL})")
    print(f"samples per second with TLS, against without: {figures['tls']:.3f}")
    print(f"the machine was idle for {figures['idle']:.2f} of the time (at least {LEAST_IDLE})")
    print(f"all pictures the same to the bit: {'yes' if identical else 'NO'}", flush=True)
    return {"kinds": median, **figures}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("--scene", type=pathlib.Path,
                        default=measure.ROOT / "scenes" / "killeroo" / "killeroo-path.pbrt")
    parser.add_argument("--part-size", default="512KiB")
    parser.add_argument("--hosts", type=int, default=5)
    parser.add_argument("--cores", type=float, default=0.2, help="of every worker")
    parser.add_argument("--memory", default="5MiB", help="of every worker, for parts; the default is less than the scene")
    parser.add_argument("--replication", type=int, default=2)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--resolution", default="300x300")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--timeout", type=float, default=600, help="seconds for one render")
    parser.add_argument("--check", action="store_true", help="exit code 1 when a bound is not met")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to a file too")
    args = parser.parse_args()
    measure.require_program(args.program)
    try:
        with quota.Groups():
            pass
    except quota.NotPermitted as why:
        print(f"SKIPPED: {why}", flush=True)
        sys.exit(measure.SKIPPED)
    with tempfile.TemporaryDirectory() as scratch:
        scene = pathlib.Path(scratch, "split")
        measure.run([args.program, "split", args.scene, "-o", scene, "--part-size", args.part_size], check=True)
        figures = bench(args, scene)
    if args.json:
        args.json.write_text(json.dumps(figures, indent=1))
    if args.check:
        missed = [name for name, bad in [("loss", figures["loss"] > MOST_LOSS), ("join", figures["join"] >= 1),
                                         ("tail", figures["tail"] > MOST_TAIL),
                                         ("picture", not figures["identical"])] if bad]
        if figures["identical"] and figures["idle"] < LEAST_IDLE:
            print("SKIPPED: others use this machine, so that no host had its share of it", flush=True)
            sys.exit(measure.SKIPPED)
        if missed:
            sys.exit(f"not met: {', '.join(missed)}")


if __name__ == "__main__":
    main()
