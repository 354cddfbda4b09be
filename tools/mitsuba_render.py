"""Renders a scene of to_mitsuba.py with Mitsuba 3; run by speed_error.py inside a virtual environment that has it.

usage: mitsuba_render.py VARIANT SCENE.xml WIDTH HEIGHT SPP SEED THREADS OUT.npy

Prints one JSON object: wall and processor seconds of its phases. `compile` is a first picture with one sample a pixel, which
is when the llvm variant makes its kernel (or takes it from its cache).
"""
import json
import resource
import sys
import time

MOST_SAMPLES = 1 << 25  # of a picture that is rendered at once: the llvm variant holds the state of them all


def seconds():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return time.monotonic(), usage.ru_utime + usage.ru_stime


def main():
    marks = [seconds()]
    variant, path, *numbers, out = sys.argv[1:]
    width, height, spp, seed, threads = map(int, numbers)
    import drjit as dr
    import mitsuba as mi
    import numpy as np
    mi.set_variant(variant)
    dr.set_thread_count(threads)
    marks.append(seconds())
    scene = mi.load_file(path, spp=spp, width=width, height=height)
    marks.append(seconds())
    if variant.startswith("llvm"):
        np.array(mi.render(scene, spp=1, seed=seed))
    marks.append(seconds())
    most = max(1, MOST_SAMPLES // (width * height))
    done, image = 0, np.zeros((height, width, 3))
    while done < spp:
        now = min(most, spp - done)
        image += now * np.array(mi.render(scene, spp=now, seed=seed + 1_000_003 * done))[:, :, :3].astype(np.float64)
        done += now
    marks.append(seconds())
    np.save(out, image / spp)
    spans = [[round(b[k] - a[k], 3) for k in (0, 1)] for a, b in zip(marks, marks[1:])]
    print(json.dumps(dict(zip(("import", "load", "compile", "render"), spans))))


if __name__ == "__main__":
    main()
