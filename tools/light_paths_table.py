#!/usr/bin/python3
"""What paths from the lights bring and cost: error and processor time of rendering with --light-paths off, caustics and all.

    tools/light_paths_table.py                 scenes/caustics with lamps of a size, and reference scenes where they are there
    tools/light_paths_table.py a.pbrt b.pbrt   other scenes
    ... --runs 3                               medians of three seeds

`gain` is how many times less time the same relMSE takes than without, if error times samples stays what it is: trimmed (without the
worst 0.1 % of the pixels, among which is what is found seldom), and of all pixels. Scenes with lamps
that no path from the camera can find (points) have no error to compare: without paths from lights their caustics are missing.
The truth is a picture of another seed with all kinds of paths, and many samples.
"""
import argparse
import pathlib
import re
import statistics
import sys
import tempfile

import measure

KINDS = ("off", "caustics", "all")
SHARED = ("v3/veach/veach-small.pbrt", "v2/room-path-small.pbrt", "v3/coffee/coffee-small.pbrt", "v3/cornellbox/cornell-small.pbrt",
          "v2/cornell-mlt.pbrt")


def caustics(folder, radius, times=1):
    """The scene with the same light from a ball instead of points, `times` as far away."""
    text = (measure.ROOT / "scenes" / "caustics" / "caustics.pbrt").read_text()
    place = re.search(r'LightSource "point" "rgb I" \[([^\]]*)\] "point from" \[([^\]]*)\]', text)
    radiance = " ".join(f"{float(i) * times**2 / (3.14159265 * radius**2):g}" for i in place[1].split())
    center = " ".join(f"{float(i) * times:g}" for i in place[2].split())
    ball = (f'AttributeBegin\nTranslate {center}\nAreaLightSource "diffuse" "rgb L" [{radiance}]\n'
            f'Shape "sphere" "float radius" [{radius}]\nAttributeEnd')
    text = re.sub(r'LightSource "spot".*\n', "", text).replace(place[0], ball)
    path = pathlib.Path(folder, f"caustics-ball-{radius:g}.pbrt" if times == 1 else f"caustics-sun-{radius:g}-{times:g}.pbrt")
    path.write_text(text)
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=pathlib.Path)
    parser.add_argument("--program", type=pathlib.Path, default=measure.DEFAULT_PROGRAM)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--truth-spp", type=int, default=4096)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--resolution", default="120x90")
    o = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scenes = o.scenes
        if not scenes:
            shared = [measure.DEFAULT_SHARED / "scenes" / s for s in SHARED]
            scenes = [caustics(folder, 0.5), caustics(folder, 0.1), caustics(folder, 6, 100)] + [s for s in shared if s.exists()]
            if len(scenes) < len(SHARED) + 3:
                print(f"{measure.DEFAULT_SHARED} is not there: its scenes are left out", file=sys.stderr)

        def render(scene, kind, spp, seed):
            picture = pathlib.Path(folder, "picture.exr")
            done = measure.run([o.program, "render", scene, "--integrator", "path", "--light-paths", kind, "--spp", spp, "--seed", seed,
                                "--resolution", o.resolution, "-o", picture, "--quiet"], report=True, check=True)
            return measure.read_rgb(picture), done.report["time"]["render_cpu_s"]

        print("| scene | light paths | processor s | trimmed relMSE | gain | relMSE | gain | mean, of the truth's |\n|---|---|---|---|---|---|---|---|")
        for scene in scenes:
            truth, _ = render(scene, "all", o.truth_spp, 99)
            before = None
            for kind in KINDS:
                times, trimmed, whole, means = [], [], [], []
                for seed in range(o.runs):
                    image, cpu = render(scene, kind, o.spp, seed)
                    found = measure.compare(image, truth)
                    times.append(cpu)
                    trimmed.append(found.trimmed)
                    whole.append(found.relmse)
                    means.append(float(image.mean() / truth.mean()))
                time, of_most, of_all = (statistics.median(x) for x in (times, trimmed, whole))
                before = before or (time * of_most, time * of_all)
                print(f"| {scene.stem} | {kind} | {time:.2f} | {of_most:.3g} | {before[0] / (time * of_most):.2f} | {of_all:.3g} | "
                      f"{before[1] / (time * of_all):.2f} | {statistics.median(means):.3f} |", flush=True)


if __name__ == "__main__":
    main()
