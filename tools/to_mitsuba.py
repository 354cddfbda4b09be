#!/usr/bin/python3
"""Converts a .pbrt scene into one of Mitsuba 3, and into pbrt's own words with the same stand-ins.

    tools/to_mitsuba.py scene.pbrt -o DIR        DIR/scene.xml, DIR/v3.pbrt (or v2), DIR/meshes, DIR/textures
    mitsuba -m scalar_rgb DIR/scene.xml

`cloudrenderer split --text` reads the scene. What has no counterpart in every program is replaced by the same stand-in in all
of them; what that was is printed and stands in DIR/replaced.txt. Depths: pbrt-v2's maxdepth d is v3's d + 1 and Mitsuba's
d + 2. Materials with a counterpart still differ: the Fresnel term of v2's and v3's plastic and uber has its indices exchanged
and reflects everything beyond 42 degrees, Mitsuba's coats do not; substrate (Ashikhmin and Shirley) becomes a coat with its
reflectance along the normal and its albedo in even light; spot lights fall off otherwise between their two angles.
"""
import argparse
import pathlib
import sys
import tempfile

import measure
import pbrt_text
import standins
import write_mitsuba
import write_scene


def convert(program, scene, folder, versions=(), dialect=None, coats=False):
    """Writes the folder; returns the model. `versions`: of pbrt, beside the scene's own."""
    with tempfile.TemporaryDirectory() as scratch:
        command = [program, "split", scene, "--text", "-o", pathlib.Path(scratch, "split")]
        measure.run(command + (["--dialect", dialect] if dialect else []), check=True)
        model = standins.simplify(pbrt_text.read_scene(pathlib.Path(scratch, "split")), coats)
    folder.mkdir(parents=True, exist_ok=True)
    write_scene.write_shared(model, folder)
    for version in dict.fromkeys([model.dialect, *versions]):
        write_scene.PbrtText(model, folder, version).write()
    write_mitsuba.write(model, folder)
    (folder / "replaced.txt").write_text("".join(f"{note}\n" for note in model.notes))
    return model


def add_coats_option(parser, default=False):
    parser.add_argument("--coats", action=argparse.BooleanOptionalAction, default=default,
                        help="replace plastic and uber by substrate in all programs, which is more like Mitsuba's coats")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("scene", type=pathlib.Path)
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True, metavar="DIR")
    parser.add_argument("--version", action="append", default=[], choices=("v2", "v3", "v4"),
                        help="write this version of pbrt's language too; may be given several times")
    parser.add_argument("--dialect", choices=("v2", "v3", "v4"), help="read the scene as this version's")
    add_coats_option(parser)
    args = parser.parse_args()
    measure.require_program(args.program)
    try:
        model = convert(args.program, args.scene, args.output, args.version, args.dialect, args.coats)
    except (standins.NoCounterpart, pbrt_text.TextError, OSError) as problem:
        sys.exit(f"{args.scene}: {problem}")
    for note in model.notes:
        print(f"replaced in all programs: {note}")
    print(f"{args.output}/scene.xml and {args.output}/{model.dialect}.pbrt: {len(model.shapes)} shapes, "
          f"{len(model.surfaces)} surfaces, {len(model.lights)} lights beside those that are shapes")


if __name__ == "__main__":
    main()
