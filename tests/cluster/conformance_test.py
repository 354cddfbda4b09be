"""The conformance kit (tools/conformance): recorded frames, and a manager that checks hosts which only intersect."""
import pathlib
import subprocess
import tempfile
import unittest

import python_host_test
import support

KIT = support.ROOT / "tools" / "conformance"
HOST = support.ROOT / "tools" / "python_host" / "host.py"
JOIN = ("--manager", "{manager}", "--token-file", "{token}")


class Conformance(unittest.TestCase):
    def run_kit(self, *command):
        done = subprocess.run([PYTHON, *command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120)
        return done.returncode, done.stdout

    def play(self, *host):
        with tempfile.TemporaryDirectory() as folder:
            split = pathlib.Path(folder, "split")
            subprocess.run([support.PROGRAM, "split", KIT / "scene.pbrt", "-o", split, "--part-size", "512KiB"], check=True,
                           stdout=subprocess.DEVNULL)
            return self.run_kit(KIT / "play_manager.py", split, "--", *host)

    def test_recorded_frames(self):
        code, text = self.run_kit(KIT / "check_frames.py")
        print(text.strip(), flush=True)
        self.assertEqual(code, 0, text)

    def test_the_host_in_python(self):
        code, text = self.play(PYTHON, HOST, *JOIN)
        self.assertEqual(code, 0, text)

    def test_ours(self):
        code, text = self.play(support.PROGRAM, "worker", "--only-intersect", "--memory", "1GiB", "--threads", "1", *JOIN)
        self.assertEqual(code, 0, text)

    def test_a_host_that_errs_is_found(self):
        wrong = "import sys; sys.path.insert(0, sys.argv.pop(1)); import host; right = host.bits; host.bits = lambda f: right(~f); host.main()"
        code, text = self.play(PYTHON, "-c", wrong, HOST.parent, *JOIN)
        self.assertEqual(code, 1, text)
        self.assertIn("FAILED", text)
        self.assertIn("blocked", text)


if __name__ == "__main__":
    PYTHON = python_host_test.prepare()
    support.main()
