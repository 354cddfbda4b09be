"""A manager and workers as processes of their own: that it works, that it survives kills and strangers."""
import json
import random
import signal
import socket
import threading
import time

import numpy as np
import support
from support import measure

SIZE = "160x160"
MEMORY = "512MiB"  # more than enough


class Processes(support.ClusterTest):
    def setUp(self):
        super().setUp()
        self.scene = self.split()
        self.ports = support.free_ports(4)
        self.out = self.folder / "out.exr"

    def wanted(self, spp):
        image, _ = self.render("wanted", self.scene, "--spp", spp, "--resolution", SIZE, "--threads", 2)
        return image

    def spp_for(self, seconds):
        """A sample count that keeps two threads busy for about so long."""
        _, report = self.render("probe", self.scene, "--spp", 8, "--resolution", SIZE, "--threads", 2)
        return max(16, min(4096, int(8 * seconds / max(report["time"]["render_s"], 0.01))))

    def start_cluster(self, spp, workers, *options, memory=MEMORY, worker_options=()):
        manager = self.start_manager(self.scene, self.out, self.ports[0], "--spp", spp, "--resolution", SIZE,
                                     "--min-hosts", workers, "--quiet", *options)
        started = [self.start_worker(f"worker{k}", self.ports[0], self.ports[1 + k], memory, *worker_options)
                   for k in range(workers)]
        return manager, started

    def finish(self, manager, seconds=90):
        code = manager.wait(seconds)
        self.assertIsNotNone(code, f"the manager hangs:\n{self.logs()}")
        return code

    def assert_picture(self, wanted):
        self.assertTrue(np.array_equal(measure.read_rgb(self.out), wanted), "the picture differs from one host's")

    def test_two_workers_make_the_picture_of_one_host(self):
        wanted = self.wanted(8)
        manager, workers = self.start_cluster(8, 2)
        self.assertEqual(self.finish(manager), 0, self.logs())
        self.assert_picture(wanted)
        for worker in workers:
            self.assertEqual(worker.wait(20), 0, f"{worker.name} did not end with the job:\n{worker.text()}")
        report = json.loads((self.folder / "report.json").read_text())
        self.assertEqual(sorted(h["name"] for h in report["hosts"]), ["worker0", "worker1"])
        self.assert_none_left()

    def test_a_killed_worker_whose_parts_nobody_else_has_room_for(self):
        """They come and go then."""
        spp = self.spp_for(6)
        _, report = self.render("whole", self.scene, "--spp", 1, "--resolution", "16x16")
        memory = int(report["hosts"][0]["memory_peak"] * 0.65)
        manager, workers = self.start_cluster(spp, 2, "--lost-after", 3, "--wait", 5, memory=memory)
        self.wait_until_all_joined(self.ports[0], 2)
        time.sleep(3)
        self.assertTrue(manager.running(), f"it had ended before the kill:\n{self.logs()}")
        workers[1].kill()
        self.assertEqual(self.finish(manager), 0, self.logs())
        self.assertIsNotNone(workers[0].wait(30), f"the surviving worker hangs:\n{workers[0].text()}")
        self.assert_none_left()
        self.assert_picture(self.wanted(spp))

    def test_workers_end_when_their_manager_is_killed(self):
        manager, workers = self.start_cluster(4096, 2, worker_options=("--wait", 3))
        self.wait_until_all_joined(self.ports[0], 2)
        time.sleep(1)
        manager.kill()
        for worker in workers:
            self.assertEqual(worker.wait(30), 4, f"{worker.name} hangs without its manager:\n{worker.text()}")
        self.assert_none_left()

    def test_garbage_on_encrypted_ports_changes_nothing(self):
        tls = ("--tls", "on")
        spp = self.spp_for(5)
        manager, workers = self.start_cluster(spp, 2, *tls, worker_options=tls)
        self.wait_until_all_joined(self.ports[0], 2)
        done = threading.Event()
        sent = []

        def stranger():
            noise = random.Random(4)
            kinds = [lambda: b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", lambda: b"\xff" * 4096, lambda: b"\0" * 64,
                     lambda: b"\x16\x03\x01" + noise.randbytes(600),
                     lambda: noise.randbytes(noise.randrange(1, 100_000)), lambda: b""]
            while not done.is_set():
                for port in self.ports[:3]:
                    try:
                        with socket.create_connection(("127.0.0.1", port), timeout=1) as s:
                            s.settimeout(0.2)
                            s.sendall(noise.choice(kinds)())
                            sent.append(port)
                            if noise.random() < 0.5:
                                s.recv(1000)
                    except OSError:
                        pass
                time.sleep(0.02)

        thread = threading.Thread(target=stranger)
        thread.start()
        try:
            code = self.finish(manager)
        finally:
            done.set()
            thread.join()
        self.assertEqual(code, 0, self.logs())
        self.assertEqual(set(sent), set(self.ports[:3]), "a port was never reached")
        wanted = self.wanted(spp)
        self.assert_picture(wanted)
        for worker in workers:
            self.assertEqual(worker.wait(20), 0, worker.text())

    def test_an_interrupt_ends_everything_with_5(self):
        manager, workers = self.start_cluster(4096, 2)
        self.wait_until_all_joined(self.ports[0], 2)
        time.sleep(2)
        manager.kill(signal.SIGINT)
        self.assertEqual(self.finish(manager, 30), 5, self.logs())
        self.assertTrue(self.out.exists(), "no partial picture")
        for worker in workers:
            self.assertIsNotNone(worker.wait(40), f"{worker.name} hangs:\n{worker.text()}")
        self.assert_none_left()


if __name__ == "__main__":
    support.main()
