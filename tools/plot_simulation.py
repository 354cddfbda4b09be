#!/usr/bin/python3
"""Draws what `cloudrenderer simulate --report FILE.json` predicts: time, money and efficiency against the number of hosts,
the manager's load, and what costs most of the rest.

usage: plot_simulation.py OUT.svg NAME=FILE.json ...     run by a Python that has matplotlib, for example
       /usr/bin/python3 -m venv build/plot-venv && build/plot-venv/bin/pip install matplotlib
"""
import json
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib import ticker  # noqa: E402

COLOURS = ("#c23b22", "#1f5fa8", "#2e8b57", "#b8860b", "#6a3d9a", "#555555")


def plain(axis):
    for side in (axis.xaxis, axis.yaxis):
        if side.get_scale() == "log":
            low, high = side.get_view_interval()
            side.set_major_locator(ticker.LogLocator(subs=(1, 2, 5) if high < 300 * low else (1,), numticks=20))
        side.set_major_formatter(ticker.FormatStrFormatter("%g"))
        side.set_minor_formatter(ticker.NullFormatter())
    axis.grid(alpha=.3)
    axis.set_xlabel("hosts")


def main():
    if len(sys.argv) < 3 or not all("=" in a for a in sys.argv[2:]):
        sys.exit(__doc__)
    figure, ((time, cost), (efficiency, manager)) = plt.subplots(2, 2, figsize=(11, 8))
    for number, argument in enumerate(sys.argv[2:]):
        name, path = argument.split("=", 1)
        rows = [p for p in json.load(open(path))["predictions"] if not p["error"]]
        if not rows:
            sys.exit(f"{path}: no prediction without an error")
        colour, hosts = COLOURS[number % len(COLOURS)], [p["hosts"] for p in rows]
        time.loglog(hosts, [p["wall_s"] for p in rows], "o-", color=colour, label=name, markersize=4)
        time.loglog(hosts, [rows[0]["wall_s"] * hosts[0] / n for n in hosts], ":", color=colour, alpha=.5)
        cost.loglog(hosts, [max(p["cost"], 1e-6) for p in rows], "o-", color=colour, markersize=4)
        efficiency.set_ylim(0, 110)
        efficiency.semilogx(hosts, [100 * p["efficiency"] for p in rows], "o-", color=colour, markersize=4)
        manager.loglog(hosts, [max(p["manager"]["cpu_share"], 1e-4) for p in rows], "o-", color=colour, markersize=4)
        manager.loglog(hosts, [max(p["manager"]["line_share"], 1e-6) for p in rows], "--", color=colour, alpha=.6)
        before = None
        for p in rows:  # where what costs most changes
            if p["bottleneck"] != before:
                last = p is rows[-1] and len(rows) > 1
                efficiency.annotate(p["bottleneck"], (p["hosts"], 100 * p["efficiency"]), textcoords="offset points",
                                    xytext=(4, -12) if last else (-4, 8), ha="right" if last else "left", fontsize=8,
                                    color=colour)
            before = p["bottleneck"]
    for axis, title in ((time, "seconds, loading included (dotted: all hosts of use)"), (cost, "money"),
                        (efficiency, "efficiency, %, and what costs most of the rest"),
                        (manager, "manager: cores (dashed: share of its line)")):
        axis.set_title(title, fontsize=10)
        plain(axis)
    manager.axhline(1, color="#888888", linewidth=.8)
    time.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(sys.argv[1])
    print(f"{sys.argv[1]} written")


if __name__ == "__main__":
    main()
