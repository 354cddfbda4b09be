"""A host in another language (tools/python_host) in a cluster of C++ hosts, with parts that nobody else holds."""
import signal
import subprocess
import sys

import support

SPP, SIZE, BOUND = 4, "120x120", 1e-4
FOLDER = support.ROOT / "tools" / "python_host"


def prepare():
    result = subprocess.run([FOLDER / "prepare.sh"], stdout=subprocess.PIPE, text=True, timeout=280)
    if result.returncode == 77:
        print("SKIPPED: Embree for Python cannot be had from PyPI here", flush=True)
        sys.exit(77)
    result.check_returncode()
    return result.stdout.split()[-1]


class PythonHost(support.ClusterTest):
    def start_python(self, manager_port, memory, *options):
        process = support.Process("python", [FOLDER / "host.py", "--manager", f"127.0.0.1:{manager_port}", "--memory", memory,
                                             *options], self.folder, self.mark, program=PYTHON)
        self.processes.append(process)
        return process

    def start_cluster(self, split, memory, spp, *options, tls=()):
        port, first, second = support.free_ports(3)
        self.token = self.folder / "token"
        self.token.write_text("a secret\n")
        given = ("--token-file", self.token)
        manager = self.start_manager(split, self.folder / "with-python.exr", port, "--min-hosts", 3, "--spp", spp, "--resolution",
                                     SIZE, "--quiet", *given, *tls, *options)
        python = self.start_python(port, memory, *given, *tls)
        for name, listen in (("one", first), ("two", second)):
            self.start_worker(name, port, listen, memory, *given, *tls)
        return manager, python

    def compare(self, wanted):
        result = self.run_program("compare", self.folder / "with-python.exr", wanted, "--max-relmse", BOUND)
        print(result.output.strip(), flush=True)
        self.assertEqual(result.code, 0, result.output)

    def test_the_picture_and_the_report(self):
        split = self.split()
        _, one = self.render("one-host", split, "--threads", 1, "--spp", SPP, "--resolution", SIZE)
        memory = int(one["hosts"][0]["memory_peak"] * 0.45)
        manager, python = self.start_cluster(split, memory, SPP)
        self.assertEqual(manager.wait(60), 0, self.logs())
        self.assertEqual(python.wait(10), 0, self.logs())
        self.compare(self.folder / "one-host.exr")
        report = support.json_of(self.folder / "report.json")
        self.assertFalse(report["bit_exact"])
        self.assertEqual(report["invalid_samples"], 0)
        hosts = {h["name"]: h for h in report["hosts"]}
        self.assertGreater(hosts["python"]["parts_loaded"], 0)
        self.assertLess(hosts["one"]["parts_loaded"] + hosts["two"]["parts_loaded"], report["parts"]["count"] - 1)
        self.assertGreater(report["rays"]["nearest_asked"], 0)
        self.assertGreater(hosts["python"]["tasks"]["intersection"], 0)
        self.assertEqual(hosts["python"]["tasks"]["renderer"], 0)
        self.assertEqual(sum(h["lost"] for h in report["hosts"]), 0, self.logs())

    def test_over_tls(self):
        split = self.split()
        _, one = self.render("one-host", split, "--threads", 1, "--spp", SPP, "--resolution", SIZE)
        memory = int(one["hosts"][0]["memory_peak"] * 0.45)
        manager, python = self.start_cluster(split, memory, SPP, tls=("--tls", "on"))
        self.assertEqual(manager.wait(60), 0, self.logs())
        self.assertEqual(python.wait(10), 0, self.logs())
        self.compare(self.folder / "one-host.exr")
        hosts = {h["name"]: h for h in support.json_of(self.folder / "report.json")["hosts"]}
        self.assertGreater(hosts["python"]["tasks"]["intersection"], 0)  # asked by hosts over connections of their own

    def test_a_proof_holds_for_one_channel_only(self):
        """Who decrypts in between and passes the messages on proves nothing."""
        port, between = support.free_ports(2)
        (self.folder / "token").write_text("a secret")
        given = ("--token-file", self.folder / "token", "--tls", "on")
        manager = self.start_manager(support.SCENE, self.folder / "out.exr", port, *given)
        relay = support.Process("relay", [support.ROOT / "tests" / "cluster" / "tls_relay.py", FOLDER, between, port], self.folder, self.mark,
                                program=PYTHON)
        self.processes.append(relay)
        self.assertTrue(support.wait_until_listening(between), relay.text())
        python = self.start_python(between, 1 << 30, *given, "--wait", 2)
        self.assertEqual(python.wait(20), 4, self.logs())
        self.assertTrue(self.wait_for_text(manager, "does not know the cluster's secret"), self.logs())
        self.assertNotIn("this is host", python.text())

    def test_without_tls_where_it_is_asked_for(self):
        port, = support.free_ports(1)
        manager = self.start_manager(support.SCENE, self.folder / "out.exr", port, "--tls", "on")
        python = self.start_python(port, 1 << 30, "--tls", "off", "--wait", 1)
        self.assertEqual(python.wait(20), 4, self.logs())
        self.assertIn("does not speak TLS", manager.text())

    def test_it_leaves_when_asked_to(self):
        split = self.split()
        spp = self.spp_for_frame(2.5, split, SIZE)
        wanted, one = self.render("one-host", split, "--threads", 2, "--spp", spp, "--resolution", SIZE)
        memory = int(one["hosts"][0]["memory_peak"] * 0.8)
        manager, python = self.start_cluster(split, memory, spp)
        self.assertTrue(self.wait_for_text(python, "this is host"), self.logs())
        support.time.sleep(1)
        python.kill(signal.SIGTERM)
        self.assertEqual(python.wait(20), 0, self.logs())
        self.assertTrue(manager.running(), self.logs())
        self.assertEqual(manager.wait(60), 0, self.logs())
        self.compare(self.folder / "one-host.exr")
        report = support.json_of(self.folder / "report.json")
        left = next(h for h in report["hosts"] if h["name"] == "python")
        self.assertIsNotNone(left["left_s"])
        self.assertFalse(left["lost"])
        self.assertEqual(report["wasted_paths"], 0)

    def wait_for_text(self, process, text, seconds=20):
        end = support.time.monotonic() + seconds
        while support.time.monotonic() < end:
            if text in process.text():
                return True
            support.time.sleep(0.05)
        return False

    def test_a_wrong_token(self):
        port, = support.free_ports(1)
        (self.folder / "other").write_text("another secret")
        (self.folder / "token").write_text("a secret")
        manager = self.start_manager(support.SCENE, self.folder / "out.exr", port, "--token-file", self.folder / "token")
        python = self.start_python(port, 1 << 30, "--token-file", self.folder / "other", "--wait", 1)
        self.assertEqual(python.wait(20), 4, self.logs())
        self.assertTrue(manager.running())
        self.assertIn("does not know the cluster's secret", manager.text())


if __name__ == "__main__":
    PYTHON = prepare()
    support.main()
