"""The layers of what paths see (--layers): values that are known, and the same bits on any cluster and after a resume."""
import pathlib
import sys

import numpy as np
import OpenImageIO as oiio

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "cluster"))
import support  # noqa: E402

# A wall at z = 4 that the camera (at z = -3) sees everywhere but above y = 0, and in front of it balls of mirror, glass,
# plastic, subsurface, and one of nothing.
SCENE = """
LookAt 0 0 -3  0 0 0  0 1 0
Camera "perspective" "float fov" [40]
Film "image" "integer xresolution" [80] "integer yresolution" [80]
Integrator "path" "integer maxdepth" [6]
PixelFilter "box"
WorldBegin
LightSource "infinite" "rgb L" [1 1 1]
Material "matte" "rgb Kd" [.5 .25 .125]
Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point P" [-9 -9 4  9 -9 4  9 0 4  -9 0 4]
AttributeBegin
Material "mirror" "rgb Kr" [.5 .5 .5]
Rotate 45 0 1 0
Translate 0 -.3 0
Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point P" [-.2 -.2 0  .2 -.2 0  .2 .2 0  -.2 .2 0]
AttributeEnd
# What the mirror shows: to its right, facing left.
Material "matte" "rgb Kd" [.2 .4 .8]
Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point P" [-8 -9 -9  -8 9 -9  -8 9 9  -8 -9 9]
Material "none"
AttributeBegin
Translate .6 -.6 0
Shape "sphere" "float radius" [.2]
AttributeEnd
Material "matte" "rgb Kd" [.9 .9 .9]
AttributeBegin
Translate 0 .5 0
Shape "sphere" "float radius" [.3]
AttributeEnd
MakeNamedMaterial "unused" "string type" "matte"
WorldEnd
"""


class Layers(support.ClusterTest):
    def layers(self, name, *arguments):
        path = self.folder / f"{name}.exr"
        result = self.run_program("render", *arguments, "-o", path, "--quiet")
        self.assertEqual(result.code, 0, result.output)
        file = oiio.ImageInput.open(str(path))
        spec = file.spec()
        self.formats = dict(zip(spec.channelnames, map(str, spec.channelformats)))
        pixels = {}
        for i, channel in enumerate(spec.channelnames):
            kind = "uint" if self.formats.get(channel) == "uint" else "float"
            pixels[channel] = np.array(file.read_image(0, 0, i, i + 1, kind)).reshape(spec.height, spec.width)
        return pixels

    def assert_same(self, a, b, what):
        self.assertEqual(a.keys(), b.keys())
        for channel, values in a.items():
            self.assertEqual(values.tobytes(), b[channel].tobytes(), f"{channel} differs: {what}")

    def scene(self):
        path = self.folder / "scene.pbrt"
        path.write_text(SCENE)
        return path

    def test_known_values(self):
        at = self.layers("a", self.scene(), "--spp", 16, "--layers", "albedo,normal,depth,position,ids")
        names = set(at)
        self.assertEqual(names, {"R", "G", "B", "albedo.R", "albedo.G", "albedo.B", "N.X", "N.Y", "N.Z", "Z", "P.X", "P.Y", "P.Z",
                                 "id.shape", "id.primitive", "id.material"})
        self.assertEqual({self.formats[c] for c in names if c.startswith("id.")}, {"uint"})
        triple = lambda name, p: [float(at[f"{name}.{c}"][p]) for c in ("RGB" if name == "albedo" else "XYZ")]  # noqa: E731

        def expect(pixel, albedo, normal, depth):
            np.testing.assert_allclose(triple("albedo", pixel), albedo, atol=2e-6)
            np.testing.assert_allclose(triple("N", pixel), normal, atol=2e-6)
            np.testing.assert_allclose(float(at["Z"][pixel]), depth, rtol=2e-5)

        wall, sky, mirror, nothing, ball = (75, 40), (5, 75), (48, 40), (60, 56), (21, 40)
        expect(wall, [.5, .25, .125], [0, 0, -1], 7)
        expect(nothing, [.5, .25, .125], [0, 0, -1], 7)  # looked through
        expect(sky, [0, 0, 0], [0, 0, 0], 1e10)
        # A mirror's depth, and the colour and the normal of what it shows.
        self.assertLess(abs(float(at["Z"][mirror]) - 3), .1)
        np.testing.assert_allclose(triple("albedo", mirror), [.1, .2, .4], atol=2e-6)
        np.testing.assert_allclose(np.abs(triple("N", mirror)), [1, 0, 0], atol=2e-6)
        np.testing.assert_allclose(triple("albedo", ball), [.9, .9, .9], atol=2e-6)
        self.assertLess(triple("N", ball)[2], -.8)
        self.assertLess(abs(float(at["Z"][ball]) - 2.7), .02)
        # Positions project to where they are seen: 80 pixels span 2 tan(20 degrees) of the depth.
        across = float(at["P.X"][wall]) / 7 / np.tan(np.radians(20)) * 40
        self.assertLess(abs(abs(across) - .5), .5)
        np.testing.assert_allclose(float(at["P.Z"][wall]), 4, rtol=1e-6)
        ids = [tuple(int(at[f"id.{k}"][p]) for k in ("shape", "material")) for p in (wall, mirror, ball)]
        self.assertEqual(len({i[0] for i in ids}), 3)
        self.assertEqual(len({i[1] for i in ids}), 3)
        self.assertNotIn(0, [n for i in ids for n in i])
        self.assertEqual(int(at["id.shape"][sky]), 0)
        self.assertEqual({int(at["id.primitive"][75, x]) for x in range(80)} - {1, 2}, set(), "the wall has two triangles")

    def test_the_picture_is_the_same_with_layers(self):
        scene = self.scene()
        plain = self.layers("plain", scene, "--spp", 4)
        both = self.layers("both", scene, "--spp", 4, "--layers", "normal")
        self.assert_same(plain, {c: both[c] for c in "RGB"}, "with layers")

    def test_the_same_bits_on_any_cluster(self):
        scene, args = support.SCENE, ("--spp", 4, "--resolution", "60x60", "--layers", "all")
        split = self.folder / "split"
        self.assertEqual(self.run_program("split", scene, "-o", split, "--part-size", "1MiB").code, 0)
        one = self.layers("one", split, *args, "--threads", 1)
        self.assertGreater(len(np.unique(one["id.primitive"])), 100)
        self.assert_same(one, self.layers("unsplit", scene, *args), "one part")
        _, report = self.render("budget", split, *args)
        share = int(report["hosts"][0]["memory_peak"] * .65)
        for hosts, threads in ((2, 2), (4, 1)):
            more = ("--hosts", hosts, "--threads", threads, "--memory", share, "--report", self.folder / "r.json")
            self.assert_same(one, self.layers(f"{hosts}", split, *args, *more), f"{hosts} hosts")
            self.assertGreater(support.json_of(self.folder / "r.json")["rays"]["moved"], 0)

    def test_a_resumed_render_has_them_too(self):
        scene, args = self.scene(), ("--resolution", "40x40", "--layers", "all")
        wanted = self.layers("wanted", scene, "--spp", 6, *args)
        journal = self.folder / "journal"
        self.layers("first", scene, "--spp", 3, *args, "--checkpoint", journal)
        self.assert_same(wanted, self.layers("more", scene, "--spp", 6, *args, "--checkpoint", journal, "--resume"), "resumed")
        refused = self.run_program("render", scene, "--spp", 6, "--resolution", "40x40", "-o", self.folder / "x.exr", "--checkpoint", journal,
                                   "--resume", "--quiet")
        self.assertEqual(refused.code, 2)
        self.assertIn("--layers", refused.output)


if __name__ == "__main__":
    support.main()
