#!/usr/bin/python3
"""Memory: a generated scene on four hosts that may hold 40 % of it each. Exit 1 when a host takes more than it may.

Checked: the report's memory_peak of every host against its budget; the anonymous memory (RssAnon) of every process,
sampled twenty times a second, against the budget and a fixed allowance; that no host dropped a part while it rendered;
and that the picture is the one host's, bit for bit. Also told: file-backed memory (RssFile: mapped part files, which the
kernel may drop at any time), and what splitting takes.
"""
import argparse
import collections
import os
import pathlib
import tempfile

import numpy as np

import measure

MIB = 1 << 20


class Memory:
    """The largest RssAnon and RssFile of a process and of its descendants, by name: --name of a worker, else the command."""

    def __init__(self):
        self.anonymous = collections.defaultdict(int)
        self.file = collections.defaultdict(int)

    @staticmethod
    def name_of(pid):
        words = pathlib.Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
        return words[words.index("--name") + 1] if "--name" in words else words[1] if len(words) > 1 else f"process {pid}"

    def __call__(self, root):
        children = collections.defaultdict(list)
        for pid in filter(str.isdigit, os.listdir("/proc")):
            try:
                children[int(pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])].append(int(pid))
            except OSError:
                pass
        waiting = [root]
        while waiting:
            pid = waiting.pop()
            waiting += children[pid]
            try:
                status = dict(line.split(":", 1) for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines())
                name = self.name_of(pid)
                for field, peak in (("RssAnon", self.anonymous), ("RssFile", self.file)):
                    if field in status:  # not of a process that is ending
                        peak[name] = max(peak[name], int(status[field].split()[0]) * 1024)
            except OSError:
                pass


def dropped(host):
    """How often a host unloaded parts. (Its last counters come before what it does at the end of the job.)"""
    return host["tasks"]["unloader"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("--generator", type=pathlib.Path, help="generate_scene; default: beside the program")
    parser.add_argument("--triangles", type=int, default=10_000_000)
    parser.add_argument("--hosts", type=int, default=4)
    parser.add_argument("--budget", type=float, default=0.4, help="of each host, as a share of the whole")
    parser.add_argument("--allowance", type=int, default=400, help="MiB beside the budget")
    parser.add_argument("--split-limit", type=int, default=512, help="MiB for splitting")
    parser.add_argument("--part-size", default="32MiB")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--resolution", default="480x270")
    parser.add_argument("--scratch", type=pathlib.Path, help="folder for the scene and its split")
    args = parser.parse_args()
    measure.require_program(args.program)
    missed = []
    with tempfile.TemporaryDirectory(dir=args.scratch) as name:
        scratch = pathlib.Path(name)
        generator = args.generator or args.program.parent / "generate_scene"
        made = measure.run([generator, "--triangles", args.triangles, "-o", scratch / "scene"], check=True)
        print(f"{made.output.strip()}, {made.wall:.1f} s, at most {made.max_rss / MIB:.0f} MiB", flush=True)

        memory = Memory()
        done = measure.run([args.program, "split", scratch / "scene" / "scene.pbrt", "-o", scratch / "split",
                            "--part-size", args.part_size], check=True, watch=memory)
        anonymous = max(memory.anonymous.values(), default=0)
        print(f"split: {done.wall:.1f} s, processor {done.cpu:.1f} s, at most {anonymous / MIB:.0f} MiB anonymous, "
              f"{done.max_rss / MIB:.0f} MiB resident with mapped files", flush=True)
        if anonymous > args.split_limit * MIB:
            missed.append(f"splitting took {anonymous / MIB:.0f} MiB")

        common = ["--resolution", args.resolution, "--spp", args.spp, "--quiet"]
        one = measure.run([args.program, "render", scratch / "split", "-o", scratch / "one.exr", *common, "--hosts", 1],
                          report=True, check=True).report
        whole = one["hosts"][0]["memory_peak"]
        budget = int(whole * args.budget)
        print(f"one host holds {one['parts']['count']} parts, {one['parts']['triangles']} triangles in {whole / MIB:.0f} MiB; "
              f"{args.hosts} hosts get {budget / MIB:.0f} MiB each", flush=True)

        memory = Memory()
        result = measure.run([args.program, "render", scratch / "split", "-o", scratch / "many.exr", *common, "--hosts",
                              args.hosts, "--threads", 1, "--memory", budget], report=True, check=True, watch=memory)
        same = np.array_equal(measure.read_rgb(scratch / "one.exr"), measure.read_rgb(scratch / "many.exr"))
    report = result.report
    measure.table(["host", "budget MiB", "loaded peak", "anonymous peak", "file-backed peak", "parts", "dropped", "busy"],
                  [[h["name"], f"{h['memory_budget'] / MIB:.1f}", f"{h['memory_peak'] / MIB:.1f}",
                    f"{memory.anonymous[h['name']] / MIB:.1f}", f"{memory.file[h['name']] / MIB:.1f}", h["parts_loaded"],
                    dropped(h), f"{h['busy']:.2f}"] for h in report["hosts"]])
    names = {h["name"] for h in report["hosts"]}
    for name in memory.anonymous.keys() - names:
        print(f"{name} (manager): {memory.anonymous[name] / MIB:.1f} MiB anonymous, {memory.file[name] / MIB:.1f} MiB "
              "file-backed")
    print("the picture is the one host's, bit for bit" if same else "the picture is not the one host's")
    print(f"{report['time']['wall_s']:.1f} s, processor {result.cpu:.1f} s, moves per path "
          f"{report['rays']['moved'] / max(report['rays']['camera'], 1):.2f}")
    if len(report["hosts"]) != args.hosts:
        missed.append(f"{len(report['hosts'])} hosts in the report")
    missed += [f"{h['name']} held {h['memory_peak'] / MIB:.1f} MiB" for h in report["hosts"] if h["memory_peak"] > budget]
    missed += [f"{h['name']} dropped {dropped(h)} times" for h in report["hosts"] if dropped(h) > 0]
    missed += [f"{name} was not seen" for name in names - memory.anonymous.keys()]
    missed += [f"{name} had {p / MIB:.0f} MiB anonymous memory" for name, p in memory.anonymous.items()
               if p > budget + args.allowance * MIB]
    if not same:
        missed.append("the pictures differ")
    for problem in missed:
        print(f"MISSED: {problem}")
    print("within the budgets" if not missed else f"{len(missed)} bounds missed")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
