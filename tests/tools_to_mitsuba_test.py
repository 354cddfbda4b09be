"""The converter to Mitsuba: its stand-ins in every version of pbrt's language show what the scene shows."""
import pathlib
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tools"))
import measure  # noqa: E402
import standins  # noqa: E402
import to_mitsuba  # noqa: E402
import write_scene  # noqa: E402

SCENE = """
LookAt 0 -8 4  0 0 0.7  0 0 1
Camera "perspective" "float fov" [40]
Film "image" "integer xresolution" [45] "integer yresolution" [30] "float scale" [2]
PixelFilter "box" "float xwidth" [0.5] "float ywidth" [0.5]
Integrator "path" "integer maxdepth" [5]
WorldBegin
AttributeBegin
Rotate 30 1 2 3
LightSource "infinite" "string mapname" "env.exr" "rgb L" [.5 .5 .6]
AttributeEnd
AttributeBegin
Translate 0 0 5
Rotate 20 1 0 0
LightSource "spot" "rgb I" [60 60 30] "point from" [1 0 0] "point to" [1 0 -5] "float coneangle" [20] "float conedeltaangle" [5]
LightSource "point" "rgb I" [2 0 0] "point from" [-3 -2 -3]
LightSource "distant" "rgb L" [.2 .4 .2] "point from" [1 1 1] "point to" [0 0 0]
AttributeEnd
Texture "im" "color" "imagemap" "string filename" "tex.exr" "float uscale" [2] "float vscale" [1.5] "float udelta" [.25]
Texture "ch" "color" "checkerboard" "rgb tex1" [.8 .1 .1] "rgb tex2" [.1 .1 .8] "float uscale" [5] "float vscale" [3]
Material "matte" "texture Kd" "im"
Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point P" [-3 -3 0 3 -3 0 3 3 0 -3 3 0] "float uv" [0 0 1 0 1 1 0 1]
AttributeBegin
Translate 0 3 0
Rotate 90 1 0 0
Material "matte" "texture Kd" "ch"
Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point P" [-3 0 0 3 0 0 3 3 0 -3 3 0]
AttributeEnd
AttributeBegin
Material "matte" "rgb Kd" [0 0 0]
Translate -2.4 0 1.5
ReverseOrientation
AreaLightSource "area" "rgb L" [1 2 3]
Rotate -90 0 1 0
Shape "disk" "float radius" [.6]
AttributeEnd
AttributeBegin
Material "matte" "rgb Kd" [.3 .3 .3]
Translate 0 1.5 2
AreaLightSource "area" "rgb L" [1 2 1]
Shape "cylinder" "float radius" [.2] "float zmin" [0] "float zmax" [.6]
AttributeEnd
AttributeBegin
Material "glass"
Translate -1 -1 .6
Shape "sphere" "float radius" [.6]
AttributeEnd
ObjectBegin "ball"
Material "substrate" "rgb Kd" [.5 .4 .1] "rgb Ks" [.05 .05 .05] "float uroughness" [.05] "float vroughness" [.05]
Shape "sphere" "float radius" [.6] "float zmax" [.3]
ObjectEnd
AttributeBegin
Translate 1.4 -1.6 .5
ObjectInstance "ball"
Translate -.6 .6 0
Scale .5 .5 .5
ObjectInstance "ball"
AttributeEnd
AttributeBegin
Translate 1.3 .8 .6
Material "metal" "float roughness" [.01]
Shape "sphere" "float radius" [.4]
Translate -2.2 .4 0
Material "fourier" "string bsdffile" "none.bsdf"
Shape "cone" "float radius" [.5] "float height" [1]
AttributeEnd
WorldEnd
"""


def render(program, scene, version, seed=0):
    with tempfile.TemporaryDirectory() as scratch:
        out = pathlib.Path(scratch, "out.exr")
        measure.run([program, "render", scene, "--dialect", version, "-o", out, "--spp", 64, "--threads", 2, "--seed", seed,
                     "--quiet"], check=True)
        return measure.read_rgb(out)


class ToMitsuba(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.scratch.name)
        (cls.folder / "scene.pbrt").write_text(SCENE)
        texture = np.zeros((16, 32, 3), np.float32)
        texture[:, :, 0], texture[:, :, 1] = np.linspace(0, 1, 32)[None, :], np.linspace(0, 1, 16)[:, None]
        sky = np.full((16, 32, 3), .1, np.float32)
        sky[2:4, 3:6], sky[5:7, 15:17] = [20, 5, 5], [3, 20, 3]
        write_scene.write_exr(cls.folder / "tex.exr", texture)
        write_scene.write_exr(cls.folder / "env.exr", sky)
        cls.out = cls.folder / "out"
        cls.model = to_mitsuba.convert(cls.program, cls.folder / "scene.pbrt", cls.out, ("v2", "v3", "v4"))

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def test_the_stand_ins_show_the_scene_in_every_version(self):
        # The same material models: noise only. v2's Blinn distribution and v4's coats are others.
        own = render(self.program, self.out / "v3.pbrt", "v3")
        for version, most in (("v3", .01), ("v2", .06), ("v4", .06)):
            found = measure.compare(render(self.program, self.out / f"{version}.pbrt", version, seed=1), own)
            with self.subTest(version):
                self.assertLess(max(abs(r - 1) for r in found.mean_ratio), most, found)
                self.assertLess(found.trimmed, .05, found)

    def test_only_what_was_said_differs_from_the_scene(self):
        scene = (self.folder / "scene.pbrt").read_text()
        matte = self.folder / "matte.pbrt"
        matte.write_text(scene.replace('"fourier" "string bsdffile" "none.bsdf"', '"matte"'))
        found = measure.compare(render(self.program, self.out / "v3.pbrt", "v3"), render(self.program, matte, "v3", seed=1))
        self.assertLess(max(abs(r - 1) for r in found.mean_ratio), .01, found)
        self.assertLess(found.trimmed, .05, found)
        told = (self.out / "replaced.txt").read_text()
        self.assertIn("fourier: matte", told)
        self.assertIn("cylinder", told)
        self.assertNotIn("substrate", told)

    def test_the_scene_of_mitsuba_names_files_that_exist_and_surfaces_that_are_there(self):
        root = ElementTree.parse(self.out / "scene.xml").getroot()
        for element in root.iter("string"):
            if element.get("name") == "filename":
                self.assertTrue((self.out / element.get("value")).is_file(), element.get("value"))
        known = {e.get("id") for e in root.iter() if e.get("id")}
        used = {e.get("id") for e in root.iter("ref")}
        self.assertTrue(used and used <= known, used - known)
        kinds = [e.get("type") for e in root.iter("emitter")]
        self.assertEqual(sorted(kinds), ["area", "area", "directional", "envmap", "point", "spot"])
        self.assertEqual(len(root.findall("shape[@type='instance']")), 2)
        self.assertEqual(root.find("integrator/integer[@name='max_depth']").get("value"), "6")

    def test_triangles_of_a_mesh_are_those_of_the_scene(self):
        data = (self.out / "meshes" / "0000.ply").read_bytes()
        head, body = data.split(b"end_header\n")
        vertices, faces = (int(head.split(b"element " + name)[1].split()[0]) for name in (b"vertex", b"face"))
        floats = head.count(b"property float")
        self.assertEqual(len(body), vertices * floats * 4 + faces * 13)

    def test_coats_let_in_and_out_what_fresnel_says(self):
        self.assertAlmostEqual(standins.transmitted(1.5), 0.9082, places=3)  # 1 - 0.0918: Egan and Hilgeman 1973
        eta, albedo = standins.coat({"kind": "substrate", "kd": np.ones(3), "ks": np.full(3, .04)})
        self.assertAlmostEqual(eta, 1.5, places=6)
        self.assertAlmostEqual(float(albedo[0]), .96 * 28 / 23 * .821429 ** 2, places=5)

    def test_what_cannot_be_converted_is_said(self):
        scene = self.folder / "all-around.pbrt"
        scene.write_text(SCENE.replace('"perspective" "float fov" [40]', '"environment"'))
        with self.assertRaisesRegex(standins.NoCounterpart, "camera environment: only perspective"):
            to_mitsuba.convert(self.program, scene, self.folder / "none")


if __name__ == "__main__":
    ToMitsuba.program = pathlib.Path(sys.argv.pop(1))
    unittest.main()
