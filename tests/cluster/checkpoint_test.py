"""Checkpoints: a render that is killed, cut short or interrupted goes on, and its picture has the same bits."""
import random
import shlex
import signal
import subprocess
import time

import numpy as np
import support
from support import measure

SIZE, SPP = "128x128", 224
JOB = ("--spp", SPP, "--resolution", SIZE)


class Checkpoints(support.ClusterTest):
    @classmethod
    def setUpClass(cls):
        cls.dice = random.Random(5)
        cls.pictures = {}

    def setUp(self):
        super().setUp()
        self.out, self.ckpt = self.folder / "out.exr", self.folder / "out.ckpt"

    def wanted(self, spp=SPP):
        if spp not in self.pictures:
            self.pictures[spp], _ = self.render("wanted", support.SCENE, "--spp", spp, "--resolution", SIZE,
                                                "--threads", 2)
        return self.pictures[spp]

    def assert_picture(self, spp=SPP):
        self.assertTrue(np.array_equal(measure.read_rgb(self.out), self.wanted(spp)),
                        "the picture differs from the undisturbed one")

    def command(self, *options, job=JOB, scene=support.SCENE, threads=2):
        return ("render", scene, *job, "--threads", threads, "--quiet", "-o", self.out, *options)

    def expect(self, code, *arguments, words="", report=False):
        result = self.run_program(*arguments, report=report)
        self.assertEqual(result.code, code, result.output)
        if words:
            self.assertRegex(result.output, words)
        return result

    def wait_for_bytes(self, least, process, seconds=30, after=0):
        """Until the checkpoint is so large, and was written later than `after` (st_mtime_ns)."""
        end = time.monotonic() + seconds
        while not self.ckpt.exists() or self.ckpt.stat().st_size < least or self.ckpt.stat().st_mtime_ns <= after:
            self.assertTrue(process.running() and time.monotonic() < end, f"no checkpoint:\n{self.logs()}")
            time.sleep(0.02)

    def test_killed_again_and_again(self):
        spp = 4 * SPP  # so that no run ends before it is killed
        job = ("--spp", spp, "--resolution", SIZE)
        for attempt, hosts in enumerate((2, 1, 2)):
            before = self.ckpt.stat().st_mtime_ns if attempt else 0
            run = self.start(f"run{attempt}", *self.command("--hosts", hosts, "--checkpoint", self.ckpt,
                                                            *(["--resume"] if attempt else []), threads=1, job=job))
            self.wait_for_bytes(1000, run, after=before)
            time.sleep(self.dice.uniform(0, 0.4))
            self.assertTrue(run.running(), f"it had ended before the kill:\n{run.text()}")
            run.kill()
            run.wait(10)
            self.assert_none_left()
        report = self.expect(0, *self.command("--hosts", 2, "--checkpoint", self.ckpt, "--resume", job=job), report=True).report
        self.assertGreater(report["paths_restored"], 0)
        self.assertLess(report["paths_restored"], report["paths"])
        self.assertEqual(report["spp_done"], spp)
        self.assert_picture(spp)
        self.assertLess(self.ckpt.stat().st_size, 3_000_000, "the journal of all rounds was never compacted")
        # Of a finished one nothing is left to do.
        self.out.unlink()
        report = self.expect(0, *self.command("--checkpoint", self.ckpt, "--resume", job=job), report=True).report
        self.assertEqual(report["paths_restored"], report["paths"])
        self.assertEqual(report["hosts"], [])
        self.assert_picture(spp)

    def test_cut_off_anywhere(self):
        spp = 48
        job = ("--spp", spp, "--resolution", SIZE)
        self.expect(0, *self.command("--checkpoint", self.ckpt, job=job))
        whole = self.ckpt.read_bytes()
        for size in (50, self.dice.randrange(len(whole)), len(whole) - 1):
            with self.subTest(size):
                self.ckpt.write_bytes(whole[:size])
                self.expect(0, *self.command("--checkpoint", self.ckpt, "--resume", "--hosts", 2, job=job))
                self.assert_picture(spp)

    def test_adaptive_cut_off_anywhere(self):
        job = ("--max-error", 0.002, "--resolution", SIZE)
        report = self.expect(0, *self.command("--checkpoint", self.ckpt, job=job), report=True).report
        self.assertGreater(len(report["convergence"]), 2, "no round was decided on")
        wanted = measure.read_rgb(self.out)
        whole = self.ckpt.read_bytes()
        for size in (self.dice.randrange(len(whole) // 3), *(self.dice.randrange(len(whole) // 3, len(whole)) for _ in range(2))):
            with self.subTest(size):
                self.ckpt.write_bytes(whole[:size])
                found = self.expect(0, *self.command("--checkpoint", self.ckpt, "--resume", "--hosts", 2, job=job), report=True).report
                self.assertTrue(np.array_equal(measure.read_rgb(self.out), wanted), "other samples were decided on")
                self.assertEqual(found["paths"], report["paths"])

    def test_an_interrupt_leaves_a_checkpoint_that_can_be_resumed(self):
        for number in (signal.SIGHUP, signal.SIGINT):  # the terminal is closed; Ctrl-C
            self.out.unlink(missing_ok=True)
            self.ckpt.unlink(missing_ok=True)
            run = self.start("run", *self.command("--hosts", 2, threads=1))
            time.sleep(1)
            run.kill(number)
            self.assertEqual(run.wait(20), 5, run.text())
            self.assert_none_left()
            self.assertTrue(self.out.exists() and self.ckpt.exists(), run.text())
        self.expect(0, *self.command("--resume"))  # the default is the file that the interrupt left
        self.assert_picture()

    def test_samples_are_added_to_a_finished_picture(self):
        few = ("--spp", 40, "--resolution", SIZE)
        self.expect(0, *self.command("--checkpoint", self.ckpt, job=few))
        more = ("--spp", 77, "--resolution", SIZE)
        report = self.expect(0, *self.command("--checkpoint", self.ckpt, "--resume", "--hosts", 2, job=more),
                             report=True).report
        self.assertEqual(report["paths_restored"] * 77, report["paths"] * 40)
        self.assert_picture(77)
        self.expect(2, *self.command("--checkpoint", self.ckpt, "--resume", job=few), words="spp 77, .*spp 40")

    def test_errors_name_what_does_not_fit(self):
        tiny = ("--spp", 2, "--resolution", "32x32")
        self.expect(0, *self.command("--checkpoint", self.ckpt, "--seed", 3, job=tiny))
        resume = ("--checkpoint", self.ckpt, "--resume")
        self.expect(2, *self.command(*resume, job=tiny), words="out.ckpt was made with seed 3, this render has seed 0")
        self.expect(2, *self.command(*resume, "--seed", 3, job=("--spp", 2, "--resolution", "30x32")),
                    words="resolution 32x32, this render has resolution 30x32")
        for options, field in ((("--max-depth", 1), "depth"), (("--crop", "0,0.5,0,1"), "crop"),
                               (("--integrator", "ambientocclusion"), "integrator"),
                               (("--part-size", "300KiB"), "split")):
            self.expect(2, *self.command(*resume, "--seed", 3, *options, job=tiny), words=f"made with {field}")
        self.expect(2, *self.command("--checkpoint", self.ckpt, "--seed", 3, job=tiny), words="--resume goes on")
        self.expect(2, *self.command("--checkpoint", self.out, "--resume", job=tiny), words="not a checkpoint")
        self.expect(2, *self.command("--checkpoint", self.folder / "none" / "x", job=tiny), words="cannot write")

    def test_a_full_disk_ends_in_words_and_a_picture(self):
        # A limit on the size of files stands for it: the picture fits, the journal does not.
        split = self.split()  # makes no files when it is rendered
        spp = 48
        job = ("--spp", spp, "--resolution", SIZE)
        command = self.command("--checkpoint", self.ckpt, scene=split, job=job)
        program = shlex.join(map(str, [support.PROGRAM, *command]))
        result = subprocess.run(["bash", "-c", f"trap '' XFSZ; ulimit -f 250; exec {program}"], timeout=60,
                                capture_output=True, text=True)
        self.assertEqual(result.returncode, 4, result.stderr)
        self.assertRegex(result.stderr, r"cannot write the checkpoint .*out\.ckpt: File too large")
        self.assertTrue(self.out.exists())
        self.expect(0, *command, "--resume")
        self.assert_picture(spp)


if __name__ == "__main__":
    support.main()
