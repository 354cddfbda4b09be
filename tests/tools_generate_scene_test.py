"""The generated landscape: at least as many triangles as asked for, the same for the same seed, meshes that fit together."""
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import numpy as np

PROGRAM = pathlib.Path(sys.argv.pop(1))


def generate(folder, *options):
    return subprocess.run([PROGRAM, "-o", folder, *map(str, options)], capture_output=True, text=True, check=True).stdout


def read_ply(path):
    data = path.read_bytes()
    head, body = data.split(b"end_header\n", 1)
    vertices = int(re.search(rb"element vertex (\d+)", head).group(1))
    faces = int(re.search(rb"element face (\d+)", head).group(1))
    points = np.frombuffer(body, "<f4", vertices * 3).reshape(-1, 3)
    records = np.frombuffer(body, np.dtype([("count", "u1"), ("index", "<u4", 3)]), faces, vertices * 12)
    if len(body) != vertices * 12 + faces * 13:
        raise ValueError(f"{path} has {len(body)} bytes after its header")
    return points, records


class GenerateScene(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)

    def files(self, name):
        root = self.folder / name
        return {p.relative_to(root).as_posix(): p.read_bytes() for p in root.rglob("*") if p.is_file()}

    def test_makes_as_many_triangles_as_asked_for(self):
        for wanted in (1000, 50_000, 400_000):
            folder = self.folder / str(wanted)
            generate(folder, "--triangles", wanted, "--triangles-per-file", 40_000)
            total = 0
            for path in (folder / "geometry").glob("*.ply"):
                points, faces = read_ply(path)
                self.assertTrue((faces["count"] == 3).all())
                self.assertLess(faces["index"].max(), len(points))
                self.assertTrue(np.isfinite(points).all())
                self.assertLessEqual(len(faces), 50_000)
                total += len(faces)
            self.assertGreaterEqual(total, wanted)
            self.assertLess(total, 1.08 * wanted)
            self.assertIn(f" {total} distinct triangles", (folder / "scene.pbrt").read_text())

    def test_names_every_mesh_once(self):
        generate(self.folder / "a", "--triangles", 200_000, "--triangles-per-file", 30_000)
        named = re.findall(r'filename" "(geometry/.*?)"', (self.folder / "a" / "scene.pbrt").read_text())
        self.assertEqual(sorted(named), sorted(n for n in self.files("a") if n.startswith("geometry/")))

    def test_is_a_function_of_its_options(self):
        common = ("--triangles", 150_000, "--triangles-per-file", 20_000)
        generate(self.folder / "a", *common, "--threads", 1)
        generate(self.folder / "b", *common, "--threads", 3)
        generate(self.folder / "c", *common, "--seed", 7)
        self.assertEqual(self.files("a"), self.files("b"))
        self.assertNotEqual(self.files("a"), self.files("c"))

    def test_tiles_share_their_border(self):
        generate(self.folder / "a", "--triangles", 200_000, "--triangles-per-file", 30_000)
        ground = [read_ply(self.folder / "a" / "geometry" / f"ground_0000{k}.ply")[0] for k in (0, 1)]
        right = ground[0][ground[0][:, 0] == ground[0][:, 0].max()]
        left = ground[1][ground[1][:, 0] == ground[1][:, 0].min()]
        self.assertTrue(np.array_equal(right, left))

    def test_refuses_wrong_options(self):
        for options in (["--triangles", "many", "-o", "x"], []):
            self.assertEqual(subprocess.run([PROGRAM, *options], capture_output=True).returncode, 2)


if __name__ == "__main__":
    unittest.main()
