"""Draws the plots of speed_error.py; run by it with a Python that has matplotlib.

usage: speed_plot.py JOBS.json     {path without ending: {"title", "panels": [{"x", "lines": [...]}]}}

With "columns" the panels stand in rows of so many, each with a scale and a "title" of its own; "dpi" is the PNG's.
"""
import json
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib import ticker  # noqa: E402

COLOURS = ("#c23b22", "#1f5fa8", "#2e8b57", "#b8860b", "#6a3d9a", "#555555")


def main():
    matplotlib.rcParams["svg.fonttype"] = "none"
    matplotlib.rcParams["svg.hashsalt"] = "speed_error"  # the same names in every run
    for path, job in json.load(open(sys.argv[1])).items():
        count = len(job["panels"])
        columns = min(job.get("columns", count), count)
        rows = -(-count // columns)
        figure, axes = plt.subplots(rows, columns, figsize=(5.4 * columns, 4.2 * rows), sharey="columns" not in job, squeeze=False)
        for axis in axes.flat[count:]:
            axis.set_axis_off()
        for axis, panel in zip(axes.flat, job["panels"]):
            axis.set_title(panel.get("title", ""))
            for line in panel["lines"]:
                axis.loglog(line["x"], line["y"], "--" if line["dashed"] else "o-", label=line["label"] or None,
                            color=COLOURS[line["colour"] % len(COLOURS)], alpha=.5 if line["dashed"] else 1, markersize=4)
            for side in (axis.xaxis, axis.yaxis):
                side.set_major_locator(ticker.LogLocator(subs=(1, 2, 5), numticks=9))
                side.set_major_formatter(ticker.FormatStrFormatter("%g"))
                side.set_minor_formatter(ticker.NullFormatter())
            axis.set_xlabel(panel["x"])
            axis.grid(True, which="both", alpha=.25)
        for row in axes:
            row[0].set_ylabel("relMSE")
        axes[0][-1].legend(fontsize=8)
        figure.suptitle(job["title"])
        figure.tight_layout()
        for ending in ("svg", "png"):
            figure.savefig(f"{path}.{ending}", dpi=job.get("dpi", 120), metadata={"Date": None} if ending == "svg" else None)
        plt.close(figure)


if __name__ == "__main__":
    main()
