"""A host whose processor lacks the instructions of the cluster says so at its start. Needs qemu-user."""
import shutil
import subprocess
import sys

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


if __name__ == "__main__":
    if not QEMU:
        print("SKIPPED: there is no qemu-x86_64 (Debian: qemu-user)", flush=True)
        sys.exit(77)
    support.main()
