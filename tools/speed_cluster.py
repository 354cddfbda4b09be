"""The part of speed_error.py that measures the cluster: hosts with a fixed share of a core each (a cgroup's quota).

Error over time and over cost (host-seconds), bytes for a path, and how much of their time hosts wait. The picture of a
sample count is the same on any number of hosts, which is checked, so that only times differ.
"""
import datetime
import json
import pathlib
import sys
import tempfile

import numpy as np

import local_cluster
import measure
import quota
import speed_programs
import speed_report

LEAST_MEMORY = 4 << 20  # of a host: tiny scenes need room for a part that is built


def add_options(parser):
    parser.add_argument("--share", type=float, default=0.2, help="of a core, that every host has")
    parser.add_argument("--held", type=float, default=0.6, help="share of the scene for which two or more hosts have memory each")
    parser.add_argument("--part-size", default="1MiB")
    parser.add_argument("--timeout", type=float, default=1800, help="seconds for one render")


def frame(args, split, size, hosts, spp, resolution, seed):
    """One run by so many hosts, which have memory for a share of the scene if they are several: the report, with the picture."""
    held = 1.5 if hosts == 1 else max(args.held, 1.25 / hosts)
    memory = max(LEAST_MEMORY, int(held * size["peak"]))
    return local_cluster.render(args.program, split, [args.share] * hosts,
                                ["--spp", spp, "--resolution", "{}x{}".format(*resolution), "--seed", seed], memory,
                                args.timeout)


def figures(args, report, hosts):
    render_s = report["time"]["render_s"]
    workers = report["hosts"]
    alive = report["time"]["load_s"] + render_s
    return {
        "render_s": render_s, "cost": hosts * render_s, "bytes_per_path": report["wire"]["bytes_per_path"],
        "moves_per_path": report["moves_per_path"],
        "waiting": 1 - float(np.mean([min(1, h["busy"]) for h in workers])),
        "quota_used": sum(h["cpu_s"] for h in workers) / max(1e-9, hosts * args.share * alive),
        "tail": report["tail"], "idle": report["idle"]}


def bench(args, case, truth, scratch):
    split = pathlib.Path(scratch, case.name)
    scene = case.folder / f"{case.model.dialect}.pbrt"
    measure.run([args.program, "split", scene, "--dialect", case.model.dialect, "-o", split, "--part-size", args.part_size],
                check=True)
    whole = measure.run([args.program, "render", split, "-o", pathlib.Path(scratch, "size.exr"), "--spp", 1, "--resolution",
                         "8x8", "--threads", 1, "--quiet"], report=True, check=True).report
    size = {"peak": whole["hosts"][0]["memory_peak"], "count": whole["parts"]["count"]}
    runs = {hosts: {spp: [] for spp in args.spp} for hosts in args.hosts}
    errors, pictures = {}, {}
    for turn in range(args.runs):
        for spp in args.spp:
            for hosts in args.hosts:
                report = frame(args, split, size, hosts, spp, case.resolution, turn)
                picture = report.pop("picture")
                if not np.array_equal(pictures.setdefault((turn, spp), picture), picture):
                    sys.exit(f"{case.name}: {hosts} hosts made another picture than {args.hosts[0]} at {spp} samples")
                errors.setdefault(spp, []).append(measure.compare(picture, truth).trimmed)
                runs[hosts][spp].append(figures(args, report, hosts))
        print(f"  {case.name}: turn {turn + 1} of {args.runs}", flush=True)
    rows = {hosts: [{"spp": spp, "error": measure.median(errors[spp]),
                     **{k: measure.median([r[k] for r in found]) for k in found[0]}} for spp, found in by_spp.items()]
            for hosts, by_spp in runs.items()}
    return {"size": size, "rows": rows}


HEADER = ["hosts", "spp", "relMSE", "render s", "host-seconds", "speed-up", "efficiency", "bytes/path", "moves/path",
          "waiting", "quota used"]


def table(found):
    base = min(found["rows"])
    cells = []
    for hosts, rows in found["rows"].items():
        for r, first in zip(rows, found["rows"][base]):
            gain = first["render_s"] / r["render_s"] * base
            cells.append([hosts, r["spp"], f"{r['error']:.3g}", f"{r['render_s']:.2f}", f"{r['cost']:.2f}", f"{gain:.2f}",
                          f"{gain / hosts:.2f}", f"{r['bytes_per_path']:.0f}", f"{r['moves_per_path']:.3f}",
                          f"{r['waiting']:.2f}", f"{r['quota_used']:.2f}"])
    return HEADER, cells


def plot_of(name, found):
    def lines(kind):
        return [{"label": f"{hosts} host{'s' * (hosts > 1)}", "x": [r[kind] for r in rows], "y": [r["error"] for r in rows],
                 "dashed": False, "colour": k} for k, (hosts, rows) in enumerate(found["rows"].items())]
    return {"title": f"{name}: error over time and over cost", "panels": [
        {"x": "wall seconds of rendering", "lines": lines("render_s")},
        {"x": "host-seconds", "lines": lines("cost")}]}


def measure_hosts(args, prepare, converged, machine):
    try:
        with quota.Groups():
            pass
    except quota.NotPermitted as why:
        print(f"SKIPPED: {why} (hosts with a share of a core need root and control groups that it may write)", flush=True)
        sys.exit(measure.SKIPPED)
    ours = speed_programs.Ours(args.program, args.threads)  # of the scene's own version
    results = {"machine": machine(), "date": datetime.date.today().isoformat(), "runs": args.runs, "share": args.share,
               "held": args.held, "command": " ".join(["tools/speed_error.py", *sys.argv[1:]]), "scenes": {}}
    with tempfile.TemporaryDirectory() as scratch:
        for case in prepare(args, [ours]):
            found = bench(args, case, converged(args, case, ours), scratch)
            results["scenes"][case.name] = found
            print(f"\n{case.name}: {found['size']['count']} parts; hosts of {args.share} cores, with memory for "
                  f"{args.held} of the scene each where they are several; all pictures the same to the bit")
            measure.table(*table(found))
            idle = measure.median([r["idle"] for rows in found["rows"].values() for r in rows])
            print(f"the machine was idle for {idle:.2f} of the time" + (
                "" if idle > .1 else ": others used it, so that hosts had less than their share"), flush=True)
            (args.out / "speed_cluster.json").write_text(json.dumps(results, indent=1))
    results["plots"] = {f"{name}-hosts": plot_of(name, found) for name, found in results["scenes"].items()}
    plots = speed_report.draw(args.out, results, args.plots)
    body = []
    for name, found in results["scenes"].items():
        body.append(f"<h2>{name}, {found['size']['count']} parts</h2>")
        if f"{name}-hosts" in plots:
            body.append(speed_report.svg_element(plots[f"{name}-hosts"]))
        body.append(speed_report.html_table(*table(found)))
    page = args.out / "speed_cluster.html"
    page.write_text(speed_report.page(f"Error over time and cost; hosts of {args.share} cores", results, body))
    print(f"page: {page}")
