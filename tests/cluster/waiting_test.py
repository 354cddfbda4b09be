"""Workers whose manager has gone: they wait quietly, for as long as they were told, and work for whoever comes."""
import signal
import time

import numpy as np
import support
from manager_killed_test import cpu_seconds
from support import measure

WAIT = 3  # seconds, of those that wait in vain
OTHER = support.ROOT / "scenes" / "cornell-box" / "cornell-small.pbrt"
JOB = ("--spp", 4, "--resolution", "64x64", "--quiet")


class Waiting(support.ClusterTest):
    def test_for_a_manager_that_was_killed(self):
        wanted, _ = self.render("wanted", OTHER, *JOB)
        port = support.free_ports(1)[0]
        out = self.folder / "out.exr"
        manager = self.start_manager(self.split(), out, port, "--spp", 4096, "--resolution", "256x256", "--quiet",
                                     "--min-hosts", 4)
        workers = [self.start_worker(f"worker{k}", port, 0, "512MiB", "--wait", wait)
                   for k, wait in enumerate((WAIT, 30, 30, 30))]
        impatient, ended, interrupted, patient = workers
        self.wait_until_all_joined(port, 4)
        time.sleep(0.5)
        manager.kill()
        manager.wait(10)
        began = time.monotonic()
        time.sleep(WAIT - 1.5)
        used = cpu_seconds(patient)
        for worker, number in ((ended, signal.SIGTERM), (interrupted, signal.SIGINT)):
            worker.kill(number)
            self.assertEqual(worker.wait(1.5), 0, f"it does not end at once:\n{self.logs()}")
        self.assertEqual(impatient.wait(20), 4, self.logs())
        self.assertGreater(time.monotonic() - began, WAIT - 1.5, "it has not waited")
        self.assertLess(time.monotonic() - began, WAIT + 3, "it has waited too long")
        self.assertRegex(impatient.text(), rf"the manager at 127\.0\.0\.1:{port} has gone")
        self.assertLess(cpu_seconds(patient) - used, 0.5, "it is not quiet while it waits")
        for worker in workers:
            self.assertEqual(worker.text().count("waiting for it"), 1, worker.text())
            self.assertLessEqual(len(worker.text().splitlines()), 2, worker.text())
        # Another scene, by another manager.
        manager = self.start("other", "manager", OTHER, *JOB, "-o", out, "--listen", f"127.0.0.1:{port}")
        self.assertEqual(manager.wait(30), 0, self.logs())
        self.assertEqual(patient.wait(10), 0, self.logs())
        self.assertTrue(np.array_equal(measure.read_rgb(out), wanted))
        self.assert_none_left()

    def test_for_a_manager_that_was_frozen(self):
        port = support.free_ports(1)[0]
        manager = self.start_manager(self.split(), self.folder / "out.exr", port, "--spp", 4096, "--quiet", "--lost-after", 1,
                                     "--min-hosts", 1)
        worker = self.start_worker("worker", port, 0, "512MiB", "--wait", 30)
        self.wait_until_all_joined(port, 1)
        time.sleep(0.5)
        manager.kill(signal.SIGSTOP)
        end = time.monotonic() + 10
        while "waiting for it" not in worker.text():
            self.assertLess(time.monotonic(), end, f"it misses nobody:\n{self.logs()}")
            time.sleep(0.05)
        time.sleep(1.2)  # it has a connection again, which nobody answers
        worker.kill(signal.SIGTERM)
        self.assertEqual(worker.wait(3), 0, f"it does not end at once:\n{self.logs()}")


if __name__ == "__main__":
    support.main()
