"""Hosts in network namespaces of their own, a link between every two of them: links that are cut and restored, or slow.

Needs root, `ip` and `tc`; skipped otherwise."""
import itertools
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time

import numpy as np
import support
from support import measure

SIZE = "160x160"
LOST_AFTER = 1.5
WORKERS = 4
PORT = 7000
FRAME = 4.5  # seconds that two undisturbed processors need at least


def run(*command, check=True):
    return subprocess.run([str(c) for c in command], check=check, capture_output=True, text=True, timeout=20)


class Network:
    """Namespaces 0 (the manager) to `hosts`-1. Every host has one address; the route to another one is their own link."""

    def __init__(self, hosts):
        self.name = f"cr{os.getpid()}"
        self.hosts = range(hosts)
        try:
            for k in self.hosts:
                run("ip", "netns", "add", self.namespace(k))
                self.ip(k, "link", "set", "lo", "up")
            for a, b in itertools.combinations(self.hosts, 2):
                run("ip", "link", "add", self.device(b), "netns", self.namespace(a), "type", "veth", "peer", "name",
                    self.device(a), "netns", self.namespace(b))
                for here, there in ((a, b), (b, a)):
                    self.ip(here, "addr", "add", f"{self.address(here)}/32", "peer", f"{self.address(there)}/32", "dev",
                            self.device(there))
                    self.ip(here, "link", "set", self.device(there), "up")
        except BaseException:
            self.remove()
            raise

    def remove(self):
        for k in self.hosts:
            run("ip", "netns", "del", self.namespace(k), check=False)

    def namespace(self, k):
        return f"{self.name}-{k}"

    @staticmethod
    def device(to):
        return f"to{to}"

    @staticmethod
    def address(k):
        return f"10.213.0.{k + 1}"

    def ip(self, k, *arguments):
        run("ip", "-n", self.namespace(k), *arguments)

    def inside(self, k):
        """The words before a command that make it run on host k."""
        return ("ip", "netns", "exec", self.namespace(k))

    def set_link(self, a, b, state):
        """`a` sees its device down and loses the route; `b` only gets no answers any more."""
        self.ip(a, "link", "set", self.device(b), state)

    def slow_down(self, a, b, rate):
        for here, there in ((a, b), (b, a)):
            run(*self.inside(here), "tc", "qdisc", "add", "dev", self.device(there), "root", "tbf", "rate", rate, "burst",
                "32kbit", "latency", "400ms")


def remove_leftovers():
    """Namespaces of earlier runs of this test that were killed."""
    for name in re.findall(r"^cr\d+-\d+", run("ip", "netns", "list").stdout, re.MULTILINE):
        if not os.path.exists(f"/proc/{name[2:].partition('-')[0]}"):
            run("ip", "netns", "del", name, check=False)


def why_not():
    """Why this cannot run here, or None."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    missing = [tool for tool in ("ip", "tc") if shutil.which(tool) is None]
    if missing:
        return f"{' and '.join(missing)} not found (Debian: iproute2)"
    try:
        remove_leftovers()
        Network(2).remove()
    except (OSError, subprocess.SubprocessError) as e:
        return f"no network namespaces here: {getattr(e, 'stderr', '') or e}"
    return None


class Links(support.ClusterTest):
    known = {}  # sample count, wanted picture and memory of a host that holds everything

    def setUp(self):
        super().setUp()
        os.environ["CLOUDRENDERER_TOKEN"] = "of the network test"
        self.addCleanup(os.environ.pop, "CLOUDRENDERER_TOKEN", None)
        self.scene = self.split(part_size="300KiB")
        if not self.known:
            spp = self.spp_for_frame(FRAME, self.scene, SIZE)
            image, report = self.render("wanted", self.scene, "--spp", spp, "--resolution", SIZE, "--threads", 2, timeout=300)
            self.known.update(spp=spp, wanted=image, whole=report["hosts"][0]["memory_peak"])
        self.network = Network(1 + WORKERS)
        self.addCleanup(self.network.remove)
        self.out = self.folder / "out.exr"

    def start_cluster(self, *options):
        manager_at = f"{self.network.address(0)}:{PORT}"
        self.manager = self.start("manager", "manager", self.scene, "-o", self.out, "--listen", manager_at, "--report",
                                  self.folder / "report.json", "--spp", self.known["spp"], "--resolution", SIZE, "--quiet",
                                  "--min-hosts", WORKERS, "--lost-after", LOST_AFTER, "--log-level", "info", *options,
                                  prefix=self.network.inside(0))
        for k in range(1, 1 + WORKERS):
            self.start(f"worker{k}", "worker", "--manager", manager_at, "--listen", f"{self.network.address(k)}:{PORT}",
                       "--threads", 1, "--memory", int(0.7 * self.known["whole"]), "--name", f"worker{k}", "--log-level",
                       "info", prefix=self.network.inside(k))
        end = time.monotonic() + 30
        while self.manager.text().count("info: host ") < WORKERS:
            self.assertLess(time.monotonic(), end, f"not all have joined:\n{self.logs()}")
            time.sleep(0.05)

    def finish(self):
        code = self.manager.wait(150)
        self.assertEqual(code, 0, self.logs())
        self.assertTrue(np.array_equal(measure.read_rgb(self.out), self.known["wanted"]),
                        f"the picture differs:\n{self.logs()}")
        for worker in self.processes[1:]:
            self.assertIn(worker.wait(60), (0, 4), self.logs())
        self.assert_none_left()
        return json.loads((self.folder / "report.json").read_text())

    def cut(self, links, seconds):
        for a, b in links:
            self.network.set_link(a, b, "down")
        time.sleep(seconds)
        for a, b in links:
            self.network.set_link(a, b, "up")

    def lost(self, report):
        return [h["name"] for h in report["hosts"] if h["lost"]]

    def test_links_to_the_manager_that_are_cut_for_a_moment_cost_no_host(self):
        self.start_cluster()
        time.sleep(1)
        self.cut([(1, 0)], LOST_AFTER / 3)  # the worker sees it
        self.cut([(0, 2)], LOST_AFTER / 3)  # the manager sees it
        self.assertTrue(self.manager.running(), "the frame had ended")
        report = self.finish()
        self.assertEqual(self.lost(report), [])
        self.assertEqual(len(report["hosts"]), WORKERS)
        self.assertEqual(report["wasted_paths"], 0)

    def test_a_link_to_the_manager_that_is_cut_for_long_makes_a_new_host(self):
        self.start_cluster("--replication", 2)
        time.sleep(1)
        self.cut([(0, 3)], LOST_AFTER + 1.5)
        self.assertTrue(self.manager.running(), "the frame had ended")
        report = self.finish()
        self.assertEqual(self.lost(report), ["worker3"])
        self.assertEqual([h["name"] for h in report["hosts"]].count("worker3"), 2, self.logs())

    def test_links_between_workers(self):
        self.start_cluster()
        time.sleep(1)
        self.cut([(1, 2)], 1)
        self.cut([(4, 3), (1, 3)], LOST_AFTER + 1)
        self.assertTrue(self.manager.running(), "the frame had ended")
        self.finish()

    def test_cuts_at_random(self):
        seed = int(os.environ.get("CLOUDRENDERER_CHAOS_SEEDS", "0"))
        dice = random.Random(seed)
        self.start_cluster("--replication", 2)
        pairs = list(itertools.combinations(self.network.hosts, 2))
        cuts = []
        for _ in range(5):
            a, b = dice.choice(pairs)
            if dice.random() < 0.5:
                a, b = b, a
            cuts.append(((a, b), dice.uniform(0.2, LOST_AFTER + 0.5)))
        try:
            for link, seconds in cuts:
                time.sleep(dice.uniform(0, 0.5))
                self.cut([link], seconds)
            self.finish()
        except AssertionError as e:
            raise AssertionError(f"seed {seed}, cuts {cuts}: {e}") from None

    def test_a_slow_link(self):
        self.network.slow_down(1, 2, "20mbit")
        self.network.slow_down(3, 0, "20mbit")
        self.start_cluster()
        report = self.finish()
        self.assertEqual(self.lost(report), [])
        self.assertEqual(report["wasted_paths"], 0)


if __name__ == "__main__":
    reason = why_not()
    if reason:
        print(f"SKIPPED: {reason}")
        sys.exit(measure.SKIPPED)
    support.main()
