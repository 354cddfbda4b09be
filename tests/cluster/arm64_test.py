"""Hosts with arm64 processors, in qemu-user: they have the bits of x86 ones, alone and in one cluster.
tools/arm64.sh makes what this needs. Arguments: the program, the one for arm64, the root with arm64's libraries."""
import pathlib
import sys

import numpy as np
import support

SPP, SIZE, PART = 4, "64x64", "512KiB"


class Arm64(support.ClusterTest):
    def wanted(self):
        return self.render("x86", support.SCENE, "--threads", 1, "--part-size", PART, "--spp", SPP, "--resolution", SIZE)

    def test_a_render(self):
        wanted, _ = self.wanted()
        out = self.folder / "arm64.exr"
        result = support.measure.run([*EMULATOR, ARM64, "render", support.SCENE, "-o", out, "--quiet", "--threads", 1, "--spp", SPP,
                                      "--resolution", SIZE], report=True, timeout=500)
        self.assertEqual(result.code, 0, result.output)
        self.assertTrue(np.array_equal(support.measure.read_rgb(out), wanted), "arm64 and x86 differ")

    def test_renders_of_real_scenes(self):
        """Quadrics, motion, textures, media, mirrors, many lights: one sample a pixel each."""
        scenes = ("v2/miscquads-direct", "v2/anim-bluespheres", "v2/microcity", "v2/spotfog-single", "v2/metal-path", "v2/bump-direct",
                  "v3/coffee/coffee-small", "v3/classroom/classroom-small", "v3/veach/veach-small")
        shared = support.measure.DEFAULT_SHARED / "scenes"
        if not shared.is_dir():
            self.skipTest(f"there is no folder {shared}")
        for scene in scenes:
            pictures = []
            for name, program in (("x86", [support.PROGRAM]), ("arm64", [*EMULATOR, ARM64])):
                out = self.folder / f"{name}.exr"
                result = support.measure.run([*program, "render", shared / f"{scene}.pbrt", "-o", out, "--quiet", "--threads", 1, "--spp", 1],
                                             timeout=500)
                self.assertEqual(result.code, 0, result.output)
                pictures.append(support.measure.read_rgb(out))
            with self.subTest(scene=scene):
                self.assertTrue(np.array_equal(*pictures), "arm64 and x86 differ")

    def test_a_cluster_of_both(self):
        wanted, one = self.wanted()
        # The emulated host is slow: it gets work because the other one cannot hold the whole scene.
        share = int(one["hosts"][0]["memory_peak"] * 0.65)
        manager_port, *ports = support.free_ports(3)
        out = self.folder / "both.exr"
        manager = self.start_manager(support.SCENE, out, manager_port, "--min-hosts", 2, "--part-size", PART, "--spp", SPP,
                                     "--resolution", SIZE, "--quiet")
        self.start_worker("x86", manager_port, ports[0], share)
        self.wait_until_all_joined(manager_port, 1)
        self.processes.append(support.Process("arm64", [
            "worker", "--manager", f"127.0.0.1:{manager_port}", "--listen", f"127.0.0.1:{ports[1]}", "--threads", 1,
            "--memory", "512MiB", "--name", "arm64"], self.folder, self.mark, EMULATOR, ARM64))
        self.assertEqual(manager.wait(300), 0, self.logs())
        report = support.json_of(self.folder / "report.json")
        self.assertTrue(report["bit_exact"])
        tasks = {h["name"]: h["tasks"]["renderer"] + h["tasks"]["tracer"] for h in report["hosts"]}
        print(f"tasks: {tasks}", flush=True)
        self.assertGreater(min(tasks["x86"], tasks["arm64"]), 0)
        self.assertTrue(np.array_equal(support.measure.read_rgb(out), wanted), "the picture differs from one host's")


if __name__ == "__main__":
    ROOT = sys.argv.pop(3)
    ARM64 = pathlib.Path(sys.argv.pop(2)).resolve()
    EMULATOR = ["qemu-aarch64-static", "-L", ROOT]
    support.main()
