#!/usr/bin/python3
"""Makes the tables and the figure of docs/speed.md of what speed_error.py has measured.

    tools/speed_error.py && tools/speed_table.py build/speed_error/speed_error.json --into docs/speed.md
    tools/speed_error.py --hosts 1,2,4,8 && tools/speed_table.py build/speed_error/speed_cluster.json --into docs/speed.md

Of single machines and of clusters alike: what stands between the two marks of its kind is replaced, and the figure with the plots of
all scenes (PNG) goes beside the file.
"""
import argparse
import json
import pathlib

import speed_cluster
import speed_report


def markdown(header, rows):
    lines = ["| " + " | ".join(str(c) for c in row) + " |" for row in [header, ["---"] * len(header), *rows]]
    return "\n".join(lines)


def made_by(results):
    return f"Made by `{results['command']}` on {results['machine']}, {results['date']}; medians of {results['runs']} runs."


def peers_text(results):
    parts = [made_by(results), "How many times our time each peer needs to reach the same error (medians over the errors of a "
             "scene's table); `render` is the rendering alone, `whole` the whole process:",
             markdown(*speed_report.summary_table(results))]
    for name, scene in results["scenes"].items():
        size = "{} x {}".format(*scene["resolution"])
        parts += [f"### {name}, {size}", "Processor seconds of rendering to reach an error (~: beyond what was measured):",
                  markdown(*speed_report.reached_table(scene, "render_cpu")), "Medians of what was measured:",
                  markdown(*speed_report.measured_table(scene))]
        parts += ["\n".join(f"- beside the rendering, processor time: {line}" for line in speed_report.phase_lines(scene))]
        if scene["notes"]:
            parts[-1] += "\n" + "\n".join(f"- replaced in all programs: {note}" for note in scene["notes"])
        if scene["others"] > speed_report.MOST_OTHERS:
            parts[-1] += f"\n- {speed_report.busy(scene)}"
    return "\n\n".join(parts)


def cluster_text(results):
    parts = [made_by(results), f"Every host has {results['share']} of a core, and memory for {results['held']} of the scene where they are several."]
    for name, found in results["scenes"].items():
        parts += [f"### {name}, {found['size']['count']} parts", markdown(*speed_cluster.table(found))]
    return "\n\n".join(parts)


def panels(results, plot_of):
    """The first panel of every scene's plot."""
    return [plot_of(name, found)["panels"][0] | {"title": name} for name, found in results["scenes"].items()]


KINDS = {"speed_error": ("speed", peers_text, speed_report.plot_of, "Error over processor time (dashed: the whole process)"),
         "speed_cluster": ("cluster", cluster_text, speed_cluster.plot_of, "Error over time of rendering")}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=pathlib.Path, help="speed_error.json or speed_cluster.json")
    parser.add_argument("--into", type=pathlib.Path, help="a file with the two marks; without it the text is printed")
    args = parser.parse_args()
    if args.results.stem not in KINDS:
        raise SystemExit(f"{args.results}: expected a file named " + " or ".join(f"{k}.json" for k in KINDS))
    kind, text_of, plot_of, title = KINDS[args.results.stem]
    results = json.loads(args.results.read_text())
    for found in results["scenes"].values():  # JSON's keys are strings
        found["rows"] = {int(k) if kind == "cluster" else k: rows for k, rows in found["rows"].items()}
    text = text_of(results)
    if not args.into:
        return print(text)
    begin, end = f"<!-- {kind} table -->", f"<!-- end of the {kind} table -->"
    old = args.into.read_text()
    if begin not in old or end not in old:
        raise SystemExit(f"{args.into}: expected the lines {begin} and {end}")
    figure = f"speed-{kind}" if kind != "speed" else "speed"
    results["plots"] = {figure: {"title": title, "columns": 3, "dpi": 72, "panels": panels(results, plot_of)}}
    speed_report.draw(args.results.parent, results, "install")
    (args.into.parent / f"{figure}.png").write_bytes((args.results.parent / "plots" / f"{figure}.png").read_bytes())
    args.into.write_text(f"{old.split(begin, 1)[0]}{begin}\n![{title}]({figure}.png)\n\n{text}\n{end}{old.split(end, 1)[1]}")


if __name__ == "__main__":
    main()
