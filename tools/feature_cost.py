#!/usr/bin/python3
"""What does a feature cost that a scene does not use? Instructions a path, counted by valgrind's callgrind.

Every scene is a plain room with something more: a feature that is declared and not used, which must cost nothing, or one that
is used, whose price is shown. Two sample counts are subtracted from each other, so that start and loading do not count.
--check fails (exit code 1) when something unused costs more than --limit.
"""
import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import measure

SIDE, FEW, MANY = 32, 2, 10
SKIP = "valgrind is missing (apt-get install valgrind)"

# floor, ceiling, back, left, right; with their normals
WALLS = [("0 0 0 1 0 0 1 1 0 0 1 0", "0 0 1"), ("0 0 1 1 0 1 1 1 1 0 1 1", "0 0 -1"), ("0 1 0 1 1 0 1 1 1 0 1 1", "0 -1 0"),
         ("0 0 0 0 1 0 0 1 1 0 0 1", "1 0 0"), ("1 0 0 1 1 0 1 1 1 1 0 1", "-1 0 0")]


def box(more=""):
    return "".join(f'Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point P" [{p}] '
                   f'{more.replace("NORMALS", 4 * (n + " "))}\n' for p, n in WALLS)


def scene(options="", world="", mesh="", shapes=""):
    return (f'LookAt .5 -1.5 .5  .5 1 .5  0 0 1\n{options}\nCamera "perspective" "float fov" [45]\n'
            f'Sampler "lowdiscrepancy" "integer pixelsamples" [4]\nSurfaceIntegrator "path" "integer maxdepth" [4]\nWorldBegin\n'
            f'LightSource "point" "point from" [.5 .4 .8]\n{world}\nMaterial "matte" "color Kd" [.6 .5 .4]\n{shapes}\n{box(mesh)}WorldEnd\n')


# name, scene, is it free?
SCENES = [
    ("plain", scene(), None),
    ("a texture that nothing uses", scene(world='Texture "t" "color" "checkerboard"'), True),
    ("a material that nothing uses",
     scene(world='Texture "t" "color" "checkerboard"\nMakeNamedMaterial "m" "string type" "uber" "texture Kd" "t"'), True),
    ("a medium that nothing is in", scene(options='MakeNamedMedium "fog" "string type" "homogeneous"'), True),
    ("a transform of time that stands still",
     scene(options="TransformTimes 0 1", world="ActiveTransform EndTime Translate 0 0 0 ActiveTransform All"), True),
    ("an object without instances",
     scene(world=f'ObjectBegin "o"\n{box()}ObjectEnd'), True),
    ("alpha of one everywhere", scene(mesh='"float alpha" [1]'), True),
    ("normals", scene(mesh='"normal N" [NORMALS]'), False),
    ("a filtered texture", scene(world='Texture "t" "color" "checkerboard" "float uscale" [8] "float vscale" [8]').replace(
        'Material "matte" "color Kd" [.6 .5 .4]', 'Material "matte" "texture Kd" "t"'), False),
    ("an alpha mask", scene(world='Texture "a" "float" "checkerboard" "float tex1" [1] "float tex2" [1]', mesh='"texture alpha" "a"'), False),
    ("an object that moves", scene(
        shapes='AttributeBegin ActiveTransform EndTime Translate .1 0 0 ActiveTransform All Translate .3 .4 .2 '
               'Shape "sphere" "float radius" [.1] AttributeEnd'), False),
    ("the same object still", scene(
        shapes='AttributeBegin Translate .3 .4 .2 Shape "sphere" "float radius" [.1] AttributeEnd'), False),
    ("an instance of the object", scene(
        world='ObjectBegin "o" Shape "sphere" "float radius" [.1] ObjectEnd',
        shapes='AttributeBegin Translate .3 .4 .2 ObjectInstance "o" AttributeEnd'), False),
    ("a lamp that rays find", scene(
        shapes='AttributeBegin Translate .3 .4 .8 AreaLightSource "area" "color L" [1 1 1] Shape "sphere" "float radius" [.05] AttributeEnd'), False),
    ("mist", scene(world='Volume "homogeneous" "color sigma_s" [.1 .1 .1] "point p0" [0 0 0] "point p1" [1 1 1]').replace(
        "WorldBegin", 'VolumeIntegrator "single"\nWorldBegin'), False),
]


def instructions(program, path, spp, folder):
    counts = folder / "callgrind.out"
    result = subprocess.run(
        ["valgrind", "--tool=callgrind", f"--callgrind-out-file={counts}", program, "render", path, "-o", folder / "o.exr",
         "--resolution", f"{SIDE}x{SIDE}", "--spp", str(spp), "--threads", "1", "--quiet"],
        capture_output=True, text=True, timeout=600)
    if result.returncode != 0:
        sys.exit(f"{path}: {result.stderr[-2000:]}")
    return int(re.search(r"^(?:summary|totals): (\d+)", counts.read_text(errors="replace"), re.M).group(1))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--limit", type=float, default=0.01, help="what counts as nothing (default 0.01: 1 %%)")
    args = parser.parse_args()
    measure.require_program(args.program)
    if not shutil.which("valgrind"):
        print(SKIP)
        sys.exit(measure.SKIPPED)
    rows, dear, plain = [], [], None
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(scratch)
        for name, text, free in SCENES:
            path = folder / "scene.pbrt"
            path.write_text(text)
            few, many = (instructions(args.program, path, spp, folder) for spp in (FEW, MANY))
            per_path = (many - few) / ((MANY - FEW) * SIDE * SIDE)
            plain = plain or per_path
            ratio = per_path / plain
            rows.append([name, {None: "", True: "no", False: "yes"}[free], f"{per_path:.0f}", f"{ratio:.3f}"])
            if free and ratio > 1 + args.limit:
                dear.append(name)
    measure.table(["scene: a plain room with", "used", "instructions a path", "of the plain room's"], rows)
    if dear:
        print(f"not free: {', '.join(dear)}")
        sys.exit(1 if args.check else 0)


if __name__ == "__main__":
    main()
