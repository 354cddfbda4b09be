"""The picture does not depend on the cluster: the same bits for any number of hosts and threads, and any split."""
import pathlib

import moving_scene
import numpy as np
import support

SPP, SIZE = 8, "120x120"


class SameBits(support.ClusterTest):
    def check(self, wanted, name, *arguments):
        with self.subTest(name):
            image, report = self.render(name, *arguments, "--spp", SPP, "--resolution", SIZE)
            different = int((image != wanted).any(axis=2).sum())
            self.assertEqual(different, 0, f"{different} pixels differ from one host's")
            self.assertTrue(report["bit_exact"])
            self.assertEqual(report["invalid_samples"], 0)
            for host in report["hosts"]:
                if host["paths_done"]:  # one that nobody needs may be late for so short a frame
                    self.assertGreater(host["memory_peak"], 0)
                self.assertLessEqual(host["memory_peak"], host["memory_budget"], f"{host['name']} went over its budget")
            return report

    def check_in_small_parts(self, scene, part_size):
        """One host, and three that none has memory for everything."""
        wanted, report = self.render("one", scene, "--threads", 1, "--spp", SPP, "--resolution", SIZE)
        self.assertGreater(float(np.std(wanted)), 0)
        share = int(report["hosts"][0]["memory_peak"] * 0.65)
        found = self.check(wanted, "three", scene, "--hosts", 3, "--threads", 1, "--memory", share, "--part-size", part_size)
        self.assertGreater(found["rays"]["moved"], 0)
        return found

    def test_hosts_replication_threads_and_split(self):
        split = self.split()
        wanted, report = self.render("one", split, "--threads", 1, "--spp", SPP, "--resolution", SIZE)
        self.assertGreaterEqual(report["parts"]["count"], 8)
        self.assertGreater(float(np.mean(wanted)), 0)
        # With a share of the memory that one host took, the hosts cannot all hold everything.
        share = int(report["hosts"][0]["memory_peak"] * 0.65)
        self.check(wanted, "threads", split, "--threads", 2)
        self.check(wanted, "two-that-hold-all", split, "--hosts", 2, "--threads", 1, "--replication", 2)
        for hosts, threads, replication in ((2, 1, 1), (2, 2, 1), (5, 1, 1), (5, 1, 2)):
            found = self.check(wanted, f"{hosts}x{threads}r{replication}", split, "--hosts", hosts, "--threads", threads,
                               "--replication", replication, "--memory", share)
            self.assertGreater(found["rays"]["moved"], 0, "no path moved: the scene was not shared between the hosts")
            self.assertEqual(len(found["hosts"]), hosts)
        # And with less than one copy in all of them.
        for hosts, part in ((1, 0.5), (2, 0.3)):
            found = self.check(wanted, f"paged-{hosts}", split, "--hosts", hosts, "--threads", 1, "--memory",
                               int(report["hosts"][0]["memory_peak"] * part))
            self.assertGreater(sum(h["paged_in"] for h in found["hosts"]), 0, "nothing was paged")
        self.check(wanted, "unsplit", support.SCENE, "--threads", 2)
        self.check(wanted, "unsplit-two", support.SCENE, "--hosts", 2, "--threads", 1, "--part-size", "2MiB")

    def test_adaptive_samples(self):
        split, bound = self.split(), ("--max-error", 0.002, "--resolution", SIZE)
        wanted, report = self.render("one-adaptive", split, "--threads", 1, *bound)
        self.assertGreater(len(report["convergence"]), 2, "no round was decided on")
        self.assertLessEqual(report["error"]["estimated_relmse_high"], 0.002)
        share = int(report["hosts"][0]["memory_peak"] * 0.65)
        for hosts, threads in ((1, 2), (2, 1), (5, 1)):
            more = ("--memory", share) if hosts > 1 else ()
            image, found = self.render(f"{hosts}x{threads}-adaptive", split, "--hosts", hosts, "--threads", threads, *bound, *more)
            self.assertTrue(np.array_equal(image, wanted), f"the picture of {hosts} hosts differs")
            self.assertEqual(found["paths"], report["paths"])

    def test_what_moves(self):
        scene, split = self.folder / "moving.pbrt", self.folder / "moving"
        scene.write_text(moving_scene.text())
        wanted, _ = self.render("unsplit-moving", scene)
        self.assertEqual(self.run_program("split", scene, "-o", split, "--part-size", "128KiB").code, 0)
        one, report = self.render("split-moving", split, "--threads", 1)
        self.assertTrue(np.array_equal(one, wanted))
        share, asked = int(report["hosts"][0]["memory_peak"] * 0.6), 0
        for hosts in (2, 5):
            image, report = self.render(f"{hosts}-moving", split, "--hosts", hosts, "--threads", 1, "--memory", share)
            self.assertTrue(np.array_equal(image, wanted), f"the picture of {hosts} hosts differs")
            self.assertTrue(report["bit_exact"])
            self.assertEqual(report["invalid_samples"], 0)
            self.assertGreater(report["rays"]["moved"], 0)
            asked += report["rays"]["shadow_asked"]
        self.assertGreater(asked, 0, "no shadow ray was asked of another host")

    def test_a_cloud_in_bricks_and_shadow_rays_through_media(self):
        n = 40
        density = np.random.default_rng(3).random(n ** 3) ** 2
        scene = self.folder / "cloud.pbrt"
        scene.write_text(f"""
LookAt 0 .8 -4.2  0 0 0  0 1 0
MakeNamedMedium "haze" "string type" "homogeneous" "rgb sigma_a" [.01 .01 .02] "rgb sigma_s" [.05 .04 .02]
MediumInterface "" "haze"
Camera "perspective" "float fov" [38]
Integrator "volpath" "integer maxdepth" [20]
WorldBegin
LightSource "infinite" "rgb L" [.3 .4 .6]
LightSource "point" "rgb I" [20 18 15] "point from" [2 3 -2]
MakeNamedMedium "cloud" "string type" "heterogeneous" "rgb sigma_a" [.1 .1 .1] "rgb sigma_s" [9 9 9] "float g" [.4]
  "point p0" [-1 -1 -1] "point p1" [1 1 1] "integer nx" [{n}] "integer ny" [{n}] "integer nz" [{n}]
  "float density" [{" ".join(f"{d:.3f}" for d in density)}]
AttributeBegin
Material ""
MediumInterface "cloud" "haze"
Shape "sphere" "float radius" [1.75]
AttributeEnd
Material "glass"
MediumInterface "haze" "haze"
Translate 1.5 -1.2 -1
Shape "sphere" "float radius" [.5]
WorldEnd
""")
        found = self.check_in_small_parts(scene, "100KiB")
        self.assertGreater(found["rays"]["shadow_asked"], 0)

    def test_tables_of_the_rgl(self):
        table = pathlib.Path(__file__).parents[1] / "fuzz" / "corpus" / "rgl" / "spectra"
        ball = """Shape "loopsubdiv" "integer levels" 5 "integer indices" [0 2 4 2 1 4 1 3 4 3 0 4 2 0 5 1 2 5 3 1 5 0 3 5]
  "point3 P" [1.6 0 0 -1.6 0 0 0 1.6 0 0 -1.6 0 0 0 1.6 0 0 -1.6]"""
        scene = self.folder / "rgl.pbrt"
        scene.write_text(f"""
LookAt 0 -5 2  0 0 0  0 0 1
Camera "perspective" "float fov" 45
Film "rgb" "string filename" "x.exr"
Integrator "path" "integer maxdepth" 4
WorldBegin
LightSource "infinite" "rgb L" [.3 .4 .6]
LightSource "point" "rgb I" [20 18 15] "point3 from" [2 -3 2]
Material "measured" "string filename" "{table}"
{ball}
Translate 1.5 0 0
{ball}
""")
        self.check_in_small_parts(scene, "100KiB")

    def test_media_of_pbrt_4(self):
        n = 30
        random = np.random.default_rng(7)
        heat = random.random(n**3) * 4000
        colour = random.random((3, n**3, 3))
        numbers = lambda values: " ".join(f"{v:.2f}" for v in np.ravel(values))
        scene = self.folder / "media4.pbrt"
        scene.write_text(f"""
LookAt 0 -5 1  0 0 0  0 0 1
Camera "perspective" "float fov" 45
Film "rgb" "string filename" "x.exr"
Integrator "volpath" "integer maxdepth" 12
WorldBegin
LightSource "infinite" "rgb L" [.3 .4 .6]
LightSource "point" "rgb I" [20 18 15] "point3 from" [2 -3 2]
MakeNamedMedium "fire" "string type" "uniformgrid" "integer nx" {n} "integer ny" {n} "integer nz" {n} "float Lescale" .01
  "point3 p0" [-2 -1 -1] "point3 p1" [0 1 1] "float density" [{numbers(random.random(n**3))}] "float temperature" [{numbers(heat)}]
MakeNamedMedium "dye" "string type" "rgbgrid" "integer nx" {n} "integer ny" {n} "integer nz" {n} "float scale" 2 "float Lescale" .001
  "point3 p0" [0 -1 -1] "point3 p1" [2 1 1] "rgb sigma_a" [{numbers(colour[0])}] "rgb sigma_s" [{numbers(colour[1] * 3)}]
  "rgb Le" [{numbers(colour[2])}]
Material "interface"
MediumInterface "fire" ""
Translate -1 0 0
Shape "sphere" "float radius" .95
MediumInterface "dye" ""
Translate 2 0 0
Shape "sphere" "float radius" .95
""")
        self.check_in_small_parts(scene, "200KiB")

    def test_another_seed_is_another_picture(self):
        a, _ = self.render("a", support.SCENE, "--spp", 2, "--resolution", "40x40")
        b, _ = self.render("b", support.SCENE, "--spp", 2, "--resolution", "40x40", "--seed", 1)
        c, _ = self.render("c", support.SCENE, "--spp", 2, "--resolution", "40x40", "--seed", 1)
        self.assertFalse(np.array_equal(a, b))
        self.assertTrue(np.array_equal(b, c))


if __name__ == "__main__":
    support.main()
