"""The conformance kit (tools/conformance): recorded frames, and a manager that checks hosts which only intersect."""
import concurrent.futures
import pathlib
import subprocess
import tempfile
import unittest

import python_host_test
import support

KIT = support.ROOT / "tools" / "conformance"
HOST = support.ROOT / "tools" / "python_host" / "host.py"
JOIN = ("--manager", "{manager}", "--token-file", "{token}")


def run_kit(*command):
    done = subprocess.run([PYTHON, *command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120)
    return done.returncode, done.stdout


def play(*host):
    with tempfile.TemporaryDirectory() as folder:
        split = pathlib.Path(folder, "split")
        subprocess.run([support.PROGRAM, "split", KIT / "scene.pbrt", "-o", split, "--part-size", "512KiB"], check=True,
                       stdout=subprocess.DEVNULL)
        return run_kit(KIT / "play_manager.py", split, "--", *host)


class Conformance(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        """Plays wait most of the time: all at once."""
        wrong = "import sys; sys.path.insert(0, sys.argv.pop(1)); import host; right = host.bits; host.bits = lambda f: right(~f); host.main()"
        hosts = {"python": (PYTHON, HOST), "wrong": (PYTHON, "-c", wrong, HOST.parent),
                 "ours": (support.PROGRAM, "worker", "--only-intersect", "--memory", "1GiB", "--threads", "1")}
        with concurrent.futures.ThreadPoolExecutor() as pool:
            plays = {name: pool.submit(play, *host, *JOIN) for name, host in hosts.items()}
            cls.results = {name: p.result() for name, p in plays.items()}

    def test_recorded_frames(self):
        code, text = run_kit(KIT / "check_frames.py")
        print(text.strip(), flush=True)
        self.assertEqual(code, 0, text)

    def test_hosts_that_do_as_they_should(self):
        for name in ("python", "ours"):
            code, text = self.results[name]
            self.assertEqual(code, 0, text)
            self.assertEqual(text.count("ok     "), 15, text)

    def test_a_host_that_errs_is_found(self):
        code, text = self.results["wrong"]
        self.assertEqual(code, 1, text)
        self.assertRegex(text, "FAILED .* the host says it is not")


if __name__ == "__main__":
    PYTHON = python_host_test.prepare()
    support.main()
