"""Hosts of other makes: a processor that lacks the instructions of the cluster says so at its start; one that estimates
reciprocals otherwise, as makers do, gives the same bits. Needs qemu-user, whose estimates are exact."""
import shutil
import subprocess
import sys

import numpy as np
import support

QEMU = shutil.which("qemu-x86_64") or shutil.which("qemu-x86_64-static")


class Processor(support.ClusterTest):
    def start_on(self, processor):
        return subprocess.run([QEMU, "-cpu", processor, support.PROGRAM, "worker", "--manager", "127.0.0.1:1", "--wait", "0"],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=50)

    def test_without_avx2(self):
        ended = self.start_on("Nehalem")
        self.assertEqual(ended.returncode, 4, ended.stdout)
        self.assertIn("this processor lacks the instructions AVX2", ended.stdout)

    def test_with_avx2(self):
        ended = self.start_on("max")
        self.assertNotIn("this processor lacks", ended.stdout)
        self.assertIn("127.0.0.1:1", ended.stdout)  # it has got as far as to look for a manager

    def test_two_makes_give_the_same_bits(self):
        options = ["--spp", 2, "--resolution", "64x64", "--part-size", "512KiB"]
        wanted, one = self.render("one", support.SCENE, "--threads", 1, *options)
        # The emulated host is slow: it gets work because the other one cannot hold the whole scene.
        share = int(one["hosts"][0]["memory_peak"] * 0.65)
        manager_port, *ports = support.free_ports(3)
        out = self.folder / "both.exr"
        manager = self.start_manager(support.SCENE, out, manager_port, "--min-hosts", 2, "--quiet", *options)
        self.start_worker("real", manager_port, ports[0], share)
        self.wait_until_all_joined(manager_port, 1)
        self.processes.append(support.Process("emulated", [
            "worker", "--manager", f"127.0.0.1:{manager_port}", "--listen", f"127.0.0.1:{ports[1]}", "--threads", 1,
            "--memory", "512MiB", "--name", "emulated"], self.folder, self.mark, [QEMU, "-cpu", "max"]))
        self.assertEqual(manager.wait(100), 0, self.logs())
        report = support.json_of(self.folder / "report.json")
        self.assertTrue(report["bit_exact"])
        tasks = {h["name"]: h["tasks"]["renderer"] + h["tasks"]["tracer"] for h in report["hosts"]}
        self.assertGreater(min(tasks["real"], tasks["emulated"]), 0, tasks)
        self.assertTrue(np.array_equal(support.measure.read_rgb(out), wanted), "the picture differs from one host's")


if __name__ == "__main__":
    if not QEMU:
        print("SKIPPED: there is no qemu-x86_64 (Debian: qemu-user)", flush=True)
        sys.exit(77)
    support.main()
