"""Hosts with arm64 processors, in qemu-user. They have the bits of an x86 host whose estimate of a reciprocal is exact, as
that of qemu's x86; a real one's is not, so that they are refused unless that is allowed, and pictures differ by rounding.
tools/arm64.sh makes what this needs. Arguments: the program, the one for arm64, the root with arm64's libraries."""
import pathlib
import sys

import numpy as np
import support

SPP, SIZE, PART = 4, "64x64", "512KiB"
ROUNDING = 1e-3  # relMSE of what a rounding changes: few of the paths are sent elsewhere
EXACT_X86 = ["qemu-x86_64-static", "-cpu", "max"]


class Arm64(support.ClusterTest):
    def start_emulated(self, name, manager_port, port, emulator, program):
        process = support.Process(name, ["worker", "--manager", f"127.0.0.1:{manager_port}", "--listen", f"127.0.0.1:{port}",
                                         "--threads", 1, "--memory", "512MiB", "--name", name],
                                  self.folder, self.mark, emulator, program)
        self.processes.append(process)
        return process

    def render_emulated(self, emulator, program):
        out = self.folder / f"{emulator[0]}.exr"
        result = support.measure.run([*emulator, program, "render", support.SCENE, "-o", out, "--quiet", "--threads", 1, "--spp", SPP,
                                      "--resolution", SIZE], report=True, timeout=500)
        self.assertEqual(result.code, 0, result.output)
        self.assertEqual(result.report["invalid_samples"], 0)
        return support.measure.read_rgb(out)

    def start_cluster(self, out, port, *options):
        # The second host is waited for.
        return self.start_manager(support.SCENE, out, port, "--min-hosts", 2, "--part-size", PART, "--spp", SPP,
                                  "--resolution", SIZE, "--quiet", *options)

    def tasks_of(self, report, name):
        tasks = next(h for h in report["hosts"] if h["name"] == name)["tasks"]
        return tasks["renderer"] + tasks["tracer"]

    def expect_nearly(self, image, wanted, what):
        result = support.measure.compare(image, wanted)
        same = float((image == wanted).all(axis=2).mean())
        print(f"{what}: relMSE {result.relmse:.2g}, {100 * same:.1f} % of the pixels have the same bits", flush=True)
        self.assertLess(result.relmse, ROUNDING)
        return result

    def wanted(self):
        return self.render("x86", support.SCENE, "--threads", 1, "--part-size", PART, "--spp", SPP, "--resolution", SIZE)

    def test_a_render(self):
        wanted, _ = self.wanted()
        image = self.render_emulated(EMULATOR, ARM64)
        self.expect_nearly(image, wanted, "a render on arm64 against x86")
        exact = self.render_emulated(EXACT_X86, support.PROGRAM)
        self.assertTrue(np.array_equal(image, exact), "arm64 and an x86 processor with exact reciprocals differ")

    def test_the_same_bits_with_exact_reciprocals(self):
        wanted = self.render_emulated(EXACT_X86, support.PROGRAM)
        manager_port, *ports = support.free_ports(3)
        out = self.folder / "both.exr"
        manager = self.start_cluster(out, manager_port)
        self.start_emulated("x86", manager_port, ports[0], EXACT_X86, support.PROGRAM)
        self.start_emulated("arm64", manager_port, ports[1], EMULATOR, ARM64)
        self.assertEqual(manager.wait(300), 0, self.logs())
        report = support.json_of(self.folder / "report.json")
        self.assertTrue(report["bit_exact"])
        tasks = [self.tasks_of(report, name) for name in ("x86", "arm64")]
        print(f"tasks of an x86 host with exact reciprocals and of an arm64 host: {tasks}", flush=True)
        self.assertGreater(min(tasks), 0)
        self.assertTrue(np.array_equal(support.measure.read_rgb(out), wanted), "the picture differs from one host's")

    def test_a_real_x86_host_and_arm64_do_not_agree(self):
        wanted, one = self.wanted()
        # Emulated hosts are slow: they get work because the other one cannot hold the whole scene.
        share = int(one["hosts"][0]["memory_peak"] * 0.65)
        for allowed in (False, True):
            with self.subTest(allowed=allowed):
                self.check_worker(wanted, allowed, share)

    def check_worker(self, wanted, allowed, share):
        manager_port, *ports = support.free_ports(4)
        out = self.folder / f"{allowed}.exr"
        manager = self.start_cluster(out, manager_port, *(["--allow-inexact"] if allowed else []))
        self.start_worker(f"x86-{allowed}", manager_port, ports[0], share)
        self.wait_until_all_joined(manager_port, 1)
        arm64 = self.start_emulated(f"arm64-{allowed}", manager_port, ports[1], EMULATOR, ARM64)
        if not allowed:
            self.assertEqual(arm64.wait(100), 4, self.logs())
            line = next((x for x in arm64.text().splitlines() if "computes other bits" in x), None)
            self.assertIsNotNone(line, self.logs())
            print(f"refused: {line}", flush=True)
            self.assertIn('instruction set "neon" against "avx2"', line)
            # A second host of x86 completes the cluster, and the picture has x86's bits.
            self.start_worker("another", manager_port, ports[2], "512MiB")
        self.assertEqual(manager.wait(300), 0, self.logs())
        report = support.json_of(self.folder / "report.json")
        image = support.measure.read_rgb(out)
        self.assertEqual(report["bit_exact"], not allowed)
        if not allowed:
            self.assertTrue(np.array_equal(image, wanted), "the picture of two x86 hosts differs from one's")
            return
        tasks = self.tasks_of(report, "arm64-True")
        self.assertGreater(tasks, 0, "the arm64 host did nothing")
        self.expect_nearly(image, wanted, f"a cluster with an arm64 host, {tasks} tasks of its own")


if __name__ == "__main__":
    ROOT = sys.argv.pop(3)
    ARM64 = pathlib.Path(sys.argv.pop(2)).resolve()
    EMULATOR = ["qemu-aarch64-static", "-L", ROOT]
    support.main()
