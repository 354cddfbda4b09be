"""A small scene in which everything moves: shapes, instances, a shape in an object, the camera."""
import math
import random

HEAD = """LookAt 0 -14 7  0 0 1  0 0 1
ActiveTransform EndTime Translate .3 0 0 ActiveTransform All
Camera "perspective" "float fov" [40] "float shutteropen" [0.1] "float shutterclose" [0.9]
Film "image" "integer xresolution" [64] "integer yresolution" [48] "string filename" "moving.exr"
Sampler "lowdiscrepancy" "integer pixelsamples" [4]
SurfaceIntegrator "path" "integer maxdepth" [4]
WorldBegin
LightSource "distant" "point from" [3 -4 8] "point to" [0 0 0] "color L" [2 2 2]
LightSource "infinite" "color L" [.3 .4 .5]
Material "matte" "color Kd" [.6 .6 .6]
Shape "trianglemesh" "point P" [-20 -20 0  20 -20 0  20 20 0  -20 20 0] "integer indices" [0 1 2 2 3 0]
ObjectBegin "thing"
Material "plastic" "color Kd" [.7 .2 .1]
Shape "cylinder" "float radius" [.2] "float zmin" [0] "float zmax" [1]
Translate 0 0 1
ActiveTransform EndTime Rotate 90 1 0 0 Translate 0 0 .2 ActiveTransform All
Shape "cone" "float radius" [.3] "float height" [.6]
ObjectEnd
"""


def bumpy_ball(n):
    points, indices = [], []
    for i in range(n + 1):
        for j in range(n + 1):
            a, b = math.pi * i / n, 2 * math.pi * j / n
            r = 0.4 + 0.1 * math.sin(5 * a) * math.cos(7 * b)
            points += [r * math.sin(a) * math.cos(b), r * math.sin(a) * math.sin(b), r * math.cos(a)]
    for i in range(n):
        for j in range(n):
            k = i * (n + 1) + j
            indices += [k, k + 1, k + n + 1, k + n + 1, k + 1, k + n + 2]
    return (f'Shape "trianglemesh" "point P" [{" ".join(f"{v:.5g}" for v in points)}] '
            f'"integer indices" [{" ".join(map(str, indices))}]')


def text(seed=3, count=40):
    rng = random.Random(seed)
    out = [HEAD]
    mesh = bumpy_ball(24)
    for k in range(count):
        out.append(f"AttributeBegin Translate {rng.uniform(-6, 6):g} {rng.uniform(-4, 6):g} {rng.uniform(.4, 2):g} "
                   f"Rotate {rng.uniform(0, 360):g} 1 2 3")
        if k % 3:
            out.append(f"ActiveTransform EndTime Translate {rng.uniform(-1, 1):g} {rng.uniform(-1, 1):g} 0 "
                       f"Rotate {rng.uniform(-60, 60):g} {rng.uniform(-1, 1):g} 1 .3 ActiveTransform All")
        out.append(f'Material "matte" "color Kd" [{rng.random():g} {rng.random():g} {rng.random():g}]')
        out.append(mesh if k % 2 else 'Material "metal" Shape "sphere" "float radius" [.45]' if k % 4 else
                   'ObjectInstance "thing"')
        out.append("AttributeEnd")
    return "\n".join([*out, "WorldEnd"])
