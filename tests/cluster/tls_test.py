"""Encrypted connections and the shared secret, with real processes."""
import os
import socket
import subprocess

import numpy as np
import support

PICTURE = ("--spp", 8, "--resolution", "120x120")


def own_address():
    """An address of this machine that is not of the loopback, or None."""
    try:
        words = subprocess.run(["hostname", "-I"], capture_output=True, text=True, timeout=5).stdout.split()
    except OSError:
        return None
    return next((w for w in words if ":" not in w and not w.startswith("127.")), None)


class Tls(support.ClusterTest):
    def set_token(self, token):
        os.environ["CLOUDRENDERER_TOKEN"] = token
        self.addCleanup(os.environ.pop, "CLOUDRENDERER_TOKEN", None)

    def join(self, manager_options, worker_options, host="127.0.0.1", seconds=60, split=None):
        """A manager and one worker; their exit codes."""
        self.processes.clear()
        with socket.socket() as s:
            s.bind((host, 0))
            port = s.getsockname()[1]
        manager = self.start("manager", "manager", split or support.SCENE, "-o", self.folder / "joined.exr", "--listen",
                             f"{host}:{port}", "--quiet", *PICTURE, "--wait", 3, *manager_options)
        worker = self.start("worker", "worker", "--manager", f"{host}:{port}", "--threads", 1, *worker_options)
        return manager.wait(seconds), worker.wait(seconds)

    def test_two_hosts_that_encrypt_make_the_same_bits(self):
        split = self.split()
        wanted, report = self.render("plain", split, *PICTURE, "--threads", 1)
        share = int(report["hosts"][0]["memory_peak"] * 0.65)
        for mode in ("on", "auto"):
            image, report = self.render(mode, split, *PICTURE, "--hosts", 2, "--threads", 1, "--memory", share, "--tls", mode)
            self.assertGreater(report["rays"]["moved"], 0, "nothing went from worker to worker")
            self.assertTrue(np.array_equal(image, wanted), f"--tls {mode}: the picture differs from one host's")

    def test_a_token_of_the_environment_lets_in_who_has_it(self):
        self.set_token("of the environment")
        self.assertEqual(self.join(("--tls", "on"), ("--tls", "on")), (0, 0), self.logs())
        other = self.folder / "token"
        other.write_text("another\n")
        self.assertEqual(self.join(("--tls", "on"), ("--tls", "on", "--token-file", other)), (4, 4), self.logs())
        self.assertRegex(self.logs(), "secret")

    def test_both_sides_say_so_when_one_speaks_tls_and_the_other_does_not(self):
        for manager, worker in (("on", "off"), ("off", "on"), ("auto", "on"), ("on", "auto")):
            with self.subTest(manager=manager, worker=worker):
                self.assertEqual(self.join(("--tls", manager), ("--tls", worker)), (4, 4), self.logs())
                for process in self.processes:
                    self.assertRegex(process.text(), "TLS.*--tls", process.name)

    def test_other_machines_are_spoken_to_encrypted_without_being_asked(self):
        address = own_address()
        if address is None:
            self.skipTest("this machine has the loopback only")
        self.set_token("x")
        self.assertEqual(self.join((), (), address), (0, 0), self.logs())
        self.assertEqual(self.join((), ("--tls", "off"), address), (4, 4), self.logs())
        self.assertRegex(self.logs(), "does not speak TLS")

    def test_certificates_of_an_authority(self):
        def openssl(*arguments):
            subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True, cwd=self.folder, timeout=30)

        def certificate(name, *signed):
            openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", 2, "-subj",
                    f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.pem", *signed)
            return ("--tls", "on", "--tls-cert", self.folder / f"{name}.pem", "--tls-key", self.folder / f"{name}.key",
                    "--tls-ca", self.folder / "ca.pem")

        certificate("ca")
        signed = ("-CA", "ca.pem", "-CAkey", "ca.key", "-addext", "basicConstraints=critical,CA:FALSE")
        ours, ours_too, other = certificate("host1", *signed), certificate("host2", *signed), certificate("other")
        self.assertEqual(self.join(ours, ours_too), (0, 0), self.logs())
        self.assertEqual(self.join(ours, other), (4, 4), self.logs())


if __name__ == "__main__":
    support.main()
