"""The file of a checkpoint in bad hands: shared, removed, replaced, on a full disk; and interrupts at bad moments."""
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

import numpy as np
import support
from support import measure

SIZE, SPP = "128x128", 64
JOB = ("--resolution", SIZE, "--quiet", "--spp", SPP)


class JournalTest(support.ClusterTest):
    shared = {}

    def setUp(self):
        super().setUp()
        if not self.shared:
            scratch = tempfile.TemporaryDirectory()
            unittest.addModuleCleanup(scratch.cleanup)
            scene = pathlib.Path(scratch.name, "split")
            result = self.run_program("split", support.SCENE, "-o", scene, "--part-size", "300KiB")
            self.assertEqual(result.code, 0, result.output)
            picture, report = self.render("wanted", scene, *JOB, "--threads", 2)
            self.shared.update(scene=scene, wanted=picture, whole=report["hosts"][0]["memory_peak"])
        self.scene = self.shared["scene"]
        self.out, self.ckpt = self.folder / "out.exr", self.folder / "out.ckpt"

    def command(self, *options, out=None, job=JOB):
        return ("render", self.scene, *job, "--threads", 1, "-o", out or self.out, *options)

    def expect(self, code, *arguments, words="", report=False):
        result = self.run_program(*arguments, report=report)
        self.assertEqual(result.code, code, result.output)
        if words:
            self.assertRegex(result.output, words)
        return result

    def assert_resumes(self, *options):
        """To the right picture, and not from the beginning."""
        report = self.expect(0, *self.command("--checkpoint", self.ckpt, "--resume", *options), report=True).report
        self.assertGreater(report["paths_restored"], 0)
        self.assertTrue(np.array_equal(measure.read_rgb(self.out), self.shared["wanted"]))
        return report

    def wait_until_interruptible(self, run, seconds=10):
        """Before, while it is loaded, an interrupt just ends it: it has done nothing."""
        end = time.monotonic() + seconds
        while True:
            status = pathlib.Path(f"/proc/{run.pid}/status").read_text()
            blocked = int(status.partition("SigBlk:")[2].split()[0], 16)
            blocks = lambda number: blocked & 1 << (number - 1)
            if blocks(signal.SIGINT) and not blocks(signal.SIGQUIT):  # all are while a thread is made
                return
            self.assertTrue(run.running() and time.monotonic() < end, run.text())
            time.sleep(0.002)

    def wait_for_bytes(self, run, path, least, seconds=30):
        end = time.monotonic() + seconds
        while not path.exists() or path.stat().st_size < least:
            self.assertTrue(run.running() and time.monotonic() < end, f"no checkpoint:\n{self.logs()}")
            time.sleep(0.005)

    def begun(self, *options, least=30_000, path=None, **kinds):
        run = self.start("run", *self.command("--checkpoint", path or self.ckpt, *options, **kinds))
        self.wait_for_bytes(run, path or self.ckpt, least)
        return run


class Files(JournalTest):
    def test_two_renders_share_no_journal(self):
        run = self.begun()
        run.kill(signal.SIGSTOP)  # it may have ended else
        second = self.start("second", *self.command("--checkpoint", self.ckpt, "--resume"))
        self.assertEqual(second.wait(20), 2, second.text())
        self.assertIn("another render is using it", second.text())
        # One that has named no checkpoint and is interrupted: its default is the file that is in use.
        other = self.start("other", *self.command("--hosts", 2, job=(*JOB[:-1], 4096)))
        time.sleep(0.5)
        self.wait_until_interruptible(other)
        other.kill(signal.SIGINT)
        self.assertEqual(other.wait(20), 5, other.text())
        self.assertRegex(other.text(), r"--checkpoint \S*out\.ckpt~ --resume goes on")
        run.kill()
        run.wait(10)
        self.assert_resumes()

    def test_one_that_is_removed_is_made_anew(self):
        run = self.begun()
        self.ckpt.unlink()
        self.wait_for_bytes(run, self.ckpt, 50_000)
        run.kill()
        run.wait(10)
        self.assertIn("has been removed, and is made anew", run.text())
        self.assert_resumes()

    def test_one_whose_place_is_taken_or_gone_ends_the_render_with_a_picture(self):
        letter = self.folder / "letter"
        letter.write_text("not ours")
        run = self.begun()
        letter.rename(self.ckpt)
        self.assertEqual(run.wait(20), 4, run.text())
        self.assertRegex(run.text(), r"cannot write the checkpoint \S*out\.ckpt: another file has taken its place")
        self.assertEqual(self.ckpt.read_text(), "not ours")
        self.assertTrue(self.out.exists())
        self.out.unlink()
        folder = self.folder / "gone"
        folder.mkdir()
        run = self.begun(path=folder / "a.ckpt")
        shutil.rmtree(folder)
        self.assertEqual(run.wait(20), 4, run.text())
        self.assertRegex(run.text(), r"cannot write the checkpoint \S*a\.ckpt: No such file or directory")
        self.assertTrue(self.out.exists())

    def test_a_full_disk_with_picture_and_journal(self):
        disk = self.folder / "disk"
        disk.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=300k", "none", disk], capture_output=True, text=True)
        if mounted.returncode != 0:
            self.skipTest(f"a small disk cannot be mounted: {mounted.stderr.strip()}")
        self.addCleanup(subprocess.run, ["umount", disk], check=True)
        self.out, self.ckpt = disk / "out.exr", disk / "out.ckpt"
        self.expect(4, *self.command("--checkpoint", self.ckpt),
                    words=r"cannot write \S*out\.exr: No space .*; cannot write the checkpoint \S*out\.ckpt: No space")
        self.assertEqual(os.listdir(disk), ["out.ckpt"])
        subprocess.run(["mount", "-o", "remount,size=8m", disk], check=True)
        self.assert_resumes()

    def test_killed_at_the_end(self):
        """Between the last record and the picture's last byte. The moment is met or not; either way --resume ends it."""
        job = ("--resolution", "400x400", "--quiet", "--spp", 1)
        self.expect(0, *self.command("--checkpoint", self.ckpt, job=job))
        whole, wanted, met = self.ckpt.stat().st_size, measure.read_rgb(self.out), 0
        for wait in (0, 0.02):
            self.out.unlink()
            self.ckpt.unlink()
            run = self.begun(job=job, least=whole)
            time.sleep(wait)
            run.kill()
            run.wait(10)
            met += not self.out.exists()
            if self.out.exists():
                self.assertTrue(np.array_equal(measure.read_rgb(self.out), wanted), "half a picture")
            self.expect(0, *self.command("--checkpoint", self.ckpt, "--resume", job=job))
            self.assertTrue(np.array_equal(measure.read_rgb(self.out), wanted))
        print(f"killed {met} times of 2 between journal and picture", flush=True)


class Interrupts(JournalTest):
    def test_at_once_twice_and_with_a_frozen_host(self):
        for seconds in (0, 0.2):
            run = self.start("run", *self.command("--hosts", 3, job=(*JOB[:-1], 100_000)))
            self.wait_until_interruptible(run)
            time.sleep(seconds)
            run.kill(signal.SIGINT)
            self.assertEqual(run.wait(4), 5, run.text())
            self.assertTrue(self.out.exists() and self.ckpt.exists(), run.text())
            self.out.unlink()
            self.ckpt.unlink()
        run = self.begun("--hosts", 2)
        host = int(pathlib.Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()[0])
        os.kill(host, signal.SIGSTOP)
        run.kill(signal.SIGINT)
        time.sleep(0.2)
        run.kill(signal.SIGINT)
        self.assertEqual(run.wait(10), 5, run.text())
        self.assert_none_left()
        self.assertTrue(self.out.exists(), run.text())
        # On other hosts, none of which has room for the whole scene.
        report = self.assert_resumes("--hosts", 3, "--memory", int(0.75 * self.shared["whole"]))
        self.assertEqual(len(report["hosts"]), 3)


if __name__ == "__main__":
    support.main()
