"""What speed_error.py shows of its results: tables, plots, a page that holds everything."""
import base64
import html
import json
import pathlib
import subprocess
import tempfile

import numpy as np
import OpenImageIO as oiio

import measure
import speed_programs

PLOT_VENV = measure.ROOT / "build" / "plot-venv"
OURS = speed_programs.Ours.name
MOST_OTHERS = .1  # of the processor time: with more it is said


def peers(scene):
    return [name for name in scene["rows"] if name != OURS]


def seconds(value):
    return f"{value:.3f}" if value < 10 else f"{value:.1f}"


def measured_table(scene):
    header = ["", "spp", "relMSE", "all pixels", "render cpu s", "render wall s", "whole cpu s", "whole wall s"]
    rows = [[name if k == 0 else "", r["spp"], f"{r['error']:.3g}", f"{r['full_error']:.3g}"]
            + [seconds(r[kind]) for kind in ("render_cpu", "render_wall", "cpu", "wall")]
            for name, found in scene["rows"].items() for k, r in enumerate(found)]
    return header, rows


def reached_table(scene, kind):
    """Seconds to each error; ~ is beyond what was measured. Then the ratio to ours."""
    header = ["relMSE", OURS] + [word for name in peers(scene) for word in (name, "ratio")]
    rows = []
    for k, error in enumerate(scene["targets"]):
        own = scene["reached"][OURS][k][kind]
        row = [f"{error:.2g}", seconds(own[0]) + ("" if own[1] else "~")]
        for name in peers(scene):
            value, inside = scene["reached"][name][k][kind]
            row += [seconds(value) + ("" if inside else "~"), f"{value / own[0]:.2f}"]
        rows.append(row)
    return header, rows


def phase_lines(scene):
    """Processor seconds beside the rendering."""
    return [f"{name}: " + ", ".join(f"{k} {v:.2f} s" for k, v in found.items() if k != "render")
            for name, found in scene["phases"].items()]


def truth_noise(results, scene, name):
    """What the converged picture itself is expected to be off, by the longest runs."""
    last = scene["rows"][name][-1]
    return last["error"] * last["spp"] / results["truth_spp"]


def print_scene(name, scene):
    print(f"\n{name}, {scene['resolution'][0]} x {scene['resolution'][1]}, depth {scene['depth']} as pbrt-v3 counts")
    measure.table(*measured_table(scene))
    print("processor seconds of rendering to reach an error:")
    measure.table(*reached_table(scene, "render_cpu"))
    for line in phase_lines(scene):
        print(f"  beside the rendering, processor time: {line}")
    for peer in peers(scene):
        print(f"  mean of ours / {peer}'s: " + " ".join(f"{r:.3f}" for r in scene["means"][peer]))
    bad = {n: max(r["bad"] for r in rows) for n, rows in scene["rows"].items()}
    for n, count in bad.items():
        if count:
            print(f"  {n} left {count} pixels that are not finite; they count as black")
    if scene["others"] > MOST_OTHERS:
        print(f"  {busy(scene)}")
    print(flush=True)


def busy(scene):
    return f"others used {scene['others']:.2f} of the processor time meanwhile: wall times are not to be trusted"


def summary_table(results):
    names = sorted({p for s in results["scenes"].values() for p in peers(s)})
    header = [""] + [f"{n} {word}" for n in names
                                                    for word in ("render cpu", "render wall", "whole cpu", "whole wall")]
    kinds = ("render_cpu", "render_wall", "cpu", "wall")
    rows = [[name] + [f"{s['ratios'][n][kind]:.2f}" for n in names for kind in kinds]
            for name, s in results["scenes"].items()]
    for word, pick in (("median", measure.median), ("smallest", min)):
        rows.append([word] + [f"{pick([s['ratios'][n][kind] for s in results['scenes'].values()]):.2f}"
                              for n in names for kind in kinds])
    return header, rows


def print_summary(results):
    if not any(peers(s) for s in results["scenes"].values()):
        print("no peer was found: only ours was measured")
        return
    header, rows = summary_table(results)
    names = header[1::4]
    print("how many times our time each peer needs to reach the same error (medians over the errors of the tables):")
    for k, name in enumerate(names):
        measure.table([name.removesuffix(" render cpu"), "render cpu", "render wall", "whole cpu", "whole wall"],
                      [[row[0]] + row[1 + 4 * k:5 + 4 * k] for row in rows])
    print(f"{results['machine']}; {results['date']}; {results['threads']} threads, medians of {results['runs']} runs")


def draw(out, results, wanted):
    """The plots: {scene: SVG text}; empty, with the reason said, when matplotlib is not to be had. `wanted`: install, auto
    (if it is there), never."""
    if wanted == "never":
        return {}
    try:
        python = "/usr/bin/python3"
        if subprocess.run([python, "-c", "import matplotlib"], capture_output=True).returncode != 0:
            python = speed_programs.make_venv(PLOT_VENV, ["matplotlib"], wanted == "install")
    except speed_programs.Missing as why:
        print(f"without plots: {why}")
        return {}
    (out / "plots").mkdir(exist_ok=True)
    jobs = results["plots"] if "plots" in results else {name: plot_of(name, s) for name, s in results["scenes"].items()}
    with tempfile.NamedTemporaryFile("w", suffix=".json") as data:
        json.dump({str(out / "plots" / name): job for name, job in jobs.items()}, data)
        data.flush()
        measure.run([python, measure.ROOT / "tools" / "speed_plot.py", data.name], check=True)
    print(f"plots: {out / 'plots'}")
    return {name: (out / "plots" / f"{name}.svg").read_text() for name in jobs}


def plot_of(name, scene):
    def lines(kinds):
        return [{"label": label, "x": [r[kind] for r in rows], "y": [r["error"] for r in rows], "dashed": dashed,
                 "colour": k}
                for k, (program, rows) in enumerate(scene["rows"].items())
                for kind, label, dashed in ((kinds[0], program, False), (kinds[1], "", True))]
    return {"title": f"{name}: error over time (dashed: the whole process)",
            "panels": [{"x": "processor seconds", "lines": lines(("render_cpu", "cpu"))},
                       {"x": "wall seconds", "lines": lines(("render_wall", "wall"))}]}


def png(picture, white):
    """A picture as PNG's bytes; `white` becomes 0.8 of white."""
    shown = np.clip(picture * (.8 / max(white, 1e-9)), 0, 1)
    shown = np.where(shown <= .0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - .055).astype(np.float32)
    with tempfile.TemporaryDirectory() as scratch:
        path = pathlib.Path(scratch, "picture.png")
        out = oiio.ImageOutput.create(str(path))
        out.open(str(path), oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, "uint8"))
        out.write_image(np.ascontiguousarray(shown))
        out.close()
        return path.read_bytes()


def html_table(header, rows):
    def line(cells, word):
        return "<tr>" + "".join(f"<{word}>{html.escape(str(c))}</{word}>" for c in cells) + "</tr>"
    return "<table>" + line(header, "th") + "".join(line(row, "td") for row in rows) + "</table>"


def svg_element(text):
    return text[text.index("<svg"):]


STYLE = """body { font: 15px sans-serif; max-width: 1100px; margin: 2em auto; color: #222 }
table { border-collapse: collapse; margin: 1em 0 } td, th { padding: .15em .7em; text-align: right; border-bottom: 1px solid #ddd }
td:first-child, th:first-child { text-align: left; white-space: nowrap } svg { max-width: 100%; height: auto }
figure { display: inline-block; margin: 0 1em 1em 0 } figcaption { font-size: 13px }"""


def page(title, results, body):
    about = f"{results['machine']}; {results['date']}; {results['runs']} runs, medians. Made by {results['command']}"
    return f"<!doctype html><html lang=en><meta charset=utf-8><title>{title}</title><style>{STYLE}</style>" \
           f"<h1>{title}</h1><p>{html.escape(about)}</p>" + "\n".join(body) + "</html>\n"


def write_page(out, results, plots, truths):
    body = []
    if any(peers(s) for s in results["scenes"].values()):
        body += ["<p>How many times our time each peer needs to reach the same error; <em>render</em> is the rendering alone, "
                 "<em>whole</em> the whole process.</p>", html_table(*summary_table(results))]
    for name, scene in results["scenes"].items():
        body.append(f"<h2>{html.escape(name)}, {scene['resolution'][0]} x {scene['resolution'][1]}</h2>")
        if name in plots:
            body.append(svg_element(plots[name]))
        body += ["<p>Processor seconds of rendering to reach an error (~: beyond what was measured):</p>",
                 html_table(*reached_table(scene, "render_cpu")), "<p>Medians of what was measured:</p>",
                 html_table(*measured_table(scene)), "<ul>"]
        body += [f"<li>{html.escape(text)}</li>" for text in
                 [f"beside the rendering, processor time: {line}" for line in phase_lines(scene)]
                 + [f"the converged picture of {n} is itself expected to be off by {truth_noise(results, scene, n):.2g}"
                    for n in scene["rows"]]
                 + [f"replaced in all programs: {note}" for note in scene["notes"]]
                 + ([busy(scene)] if scene["others"] > MOST_OTHERS else [])] + ["</ul>"]
        white = float(np.percentile(truths[name][OURS], 97))
        for program, picture in truths[name].items():
            data = base64.b64encode(png(picture, white)).decode()
            ratio = " ".join(f"{r:.3f}" for r in scene["means"][program])
            body.append(f'<figure><img src="data:image/png;base64,{data}" alt="">'
                        f"<figcaption>{html.escape(program)}, converged; mean of ours / its {ratio}</figcaption></figure>")
    path = out / "speed_error.html"
    path.write_text(page("Speed against error", results, body))
    print(f"page: {path}", flush=True)
