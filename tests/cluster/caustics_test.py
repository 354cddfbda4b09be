"""Paths from lights in a cluster: what they bring to pixels far from their own is the same bits on any hosts, with some of
them killed, and from a checkpoint."""
import pathlib
import time

import numpy as np
import support

SCENE = pathlib.Path(__file__).parents[2] / "scenes" / "caustics" / "caustics.pbrt"
SIZE = "120x80"


class Caustics(support.ClusterTest):
    def setUp(self):
        super().setUp()
        self.scene = self.folder / "split"
        result = self.run_program("split", SCENE, "-o", self.scene, "--part-size", "40KiB")
        self.assertEqual(result.code, 0, result.output)

    def test_any_hosts_and_threads(self):
        wanted, report = self.render("one", self.scene, "--threads", 1, "--spp", 16, "--resolution", SIZE)
        self.assertGreaterEqual(report["parts"]["count"], 4)
        self.assertEqual(report["invalid_samples"], 0)
        without, _ = self.render("without", self.scene, "--spp", 16, "--resolution", SIZE, "--light-paths", "off")
        self.assertGreater(float(np.mean(wanted)), 1.02 * float(np.mean(without)), "there are no caustics")
        self.assertGreater(float(np.max(wanted - without)), 1, "there are no caustics")
        share = int(report["hosts"][0]["memory_peak"] * 0.65)
        for hosts, threads in ((1, 2), (2, 1), (5, 1)):
            more = ("--memory", share) if hosts > 1 else ()
            image, found = self.render(f"{hosts}x{threads}", self.scene, "--hosts", hosts, "--threads", threads, "--spp", 16, "--resolution", SIZE, *more)
            self.assertTrue(np.array_equal(image, wanted), f"the picture of {hosts} hosts differs")
            self.assertTrue(found["bit_exact"])
            if hosts > 1:
                self.assertGreater(found["rays"]["moved"], 0)
        unsplit, _ = self.render("unsplit", SCENE, "--spp", 16, "--resolution", SIZE)
        self.assertTrue(np.array_equal(unsplit, wanted))

    def test_adaptive_samples(self):
        bound = ("--max-error", 0.004, "--resolution", SIZE)
        wanted, report = self.render("one", self.scene, "--threads", 1, *bound)
        self.assertGreater(len(report["convergence"]), 2, "no round was decided on")
        image, found = self.render("three", self.scene, "--hosts", 3, "--threads", 1, *bound)
        self.assertTrue(np.array_equal(image, wanted))
        self.assertEqual(found["paths"], report["paths"])

    def test_a_worker_is_killed_and_then_the_manager(self):
        spp, ports = 1000, support.free_ports(4)
        wanted, report = self.render("wanted", self.scene, "--spp", spp, "--resolution", SIZE, "--threads", 2)
        out, checkpoint = self.folder / "out.exr", self.folder / "out.ckpt"
        options = ("--spp", spp, "--resolution", SIZE, "--quiet", "--checkpoint", checkpoint)
        memory = int(report["hosts"][0]["memory_peak"] * 0.75) + (64 << 20)
        manager = self.start_manager(self.scene, out, ports[0], "--min-hosts", 3, "--lost-after", 3, *options)
        workers = [self.start_worker(f"worker{k}", ports[0], ports[1 + k], memory) for k in range(3)]
        self.wait_until_all_joined(ports[0], 3)
        time.sleep(1.5)
        self.assertTrue(manager.running(), f"it had ended before the kill:\n{self.logs()}")
        workers[1].kill()
        time.sleep(1.5)
        self.assertTrue(manager.running(), f"it had ended before the kill:\n{self.logs()}")
        manager.kill()
        for worker in (workers[0], workers[2]):
            worker.kill()
        self.assertFalse(out.exists())
        resumed, again = self.render("resumed", self.scene, "--threads", 2, "--spp", spp, "--resolution", SIZE, "--checkpoint", checkpoint, "--resume")
        self.assertGreater(again["paths_restored"], 0)
        self.assertTrue(np.array_equal(resumed, wanted), "the picture differs from one host's")
        # A picture without is another one.
        result = self.run_program("render", self.scene, "-o", out, *options, "--resume", "--light-paths", "off")
        self.assertEqual(result.code, 2, result.output)
        self.assertIn("--light-paths", result.output)


if __name__ == "__main__":
    support.main()
