"""Hosts come, go, freeze and die at seeded moments of a frame, and the picture has the bits of an undisturbed one.

CLOUDRENDERER_CHAOS_SEEDS=7 replays seed 7, CLOUDRENDERER_CHAOS_SEEDS=3-22 runs these (default 0)."""
import json
import os
import pathlib
import random
import signal
import tempfile
import time
import unittest

import numpy as np
import support
from support import measure

SIZE = "160x160"
PART_SIZE = "300KiB"
LOST_AFTER = 1.5
FRAME = 5        # seconds that two undisturbed processors need at least
LAST_EVENT = 3.4 # seconds after all have joined; a disturbed frame takes longer than FRAME
LEAST = 4        # workers that are left alone at every moment


def seeds():
    first, _, last = os.environ.get("CLOUDRENDERER_CHAOS_SEEDS", "0").partition("-")
    return range(int(first), int(last or first) + 1)


class ChaosTest(support.ClusterTest):
    """A manager and workers that can be disturbed."""
    shared = {}  # of all tests: the split, the sample count, the wanted picture, what a host with everything holds

    def setUp(self):
        super().setUp()
        if not self.shared:
            scratch = tempfile.TemporaryDirectory()
            unittest.addModuleCleanup(scratch.cleanup)
            self.prepare(pathlib.Path(scratch.name))
        self.scene, self.spp = self.shared["scene"], self.shared["spp"]
        self.ports = support.free_ports(16)
        self.out = self.folder / "out.exr"
        self.workers, self.worker_options = [], ()

    def prepare(self, folder):
        scene = folder / "split"
        result = self.run_program("split", support.SCENE, "-o", scene, "--part-size", PART_SIZE)
        self.assertEqual(result.code, 0, result.output)
        spp = self.spp_for_frame(FRAME, scene, SIZE)
        image, report = self.render("wanted", scene, "--spp", spp, "--resolution", SIZE, "--threads", 2, timeout=300)
        self.assertGreaterEqual(report["parts"]["count"], 16)
        self.assertGreater(float(np.mean(image)), 0)
        self.shared.update(scene=scene, spp=spp, wanted=image, whole=report["hosts"][0]["memory_peak"])

    def start_cluster(self, workers, *options, share=0.75):
        self.memory = int(self.shared["whole"] * share)
        self.manager = self.start_manager(self.scene, self.out, self.ports[0], "--spp", self.spp, "--resolution", SIZE,
                                          "--min-hosts", workers, "--quiet", "--lost-after", LOST_AFTER, *options)
        for _ in range(workers):
            self.add_worker()
        self.wait_until_all_joined(self.ports[0], workers)
        self.began = time.monotonic()

    def add_worker(self):
        k = len(self.workers)
        self.workers.append(self.start_worker(f"worker{k}", self.ports[0], self.ports[1 + k], self.memory, "--wait", 15,
                                              "--log-level", "info", *self.worker_options))
        return self.workers[-1]

    def finish(self, seconds=150):
        code = self.manager.wait(seconds)
        self.assertIsNotNone(code, f"the manager hangs:\n{self.logs()}")
        self.ended = time.monotonic()
        self.assertEqual(code, 0, self.logs())
        self.assertTrue(np.array_equal(measure.read_rgb(self.out), self.shared["wanted"]),
                        f"the picture differs from the undisturbed one:\n{self.logs()}")
        return json.loads((self.folder / "report.json").read_text())

    def wait_for_word(self, process, words, seconds=30):
        end = time.monotonic() + seconds
        while words not in process.text():
            self.assertLess(time.monotonic(), end, f"{process.name} never says '{words}':\n{self.logs()}")
            time.sleep(0.05)

    @staticmethod
    def of(report, worker):
        """What the report says of a process: a record for every time that it joined."""
        return [h for h in report["hosts"] if h["name"] == worker.name]


class Chaos(ChaosTest):
    def plan(self, dice):
        """Moments and what happens then: everything at least once, and never fewer than LEAST workers that nobody touches.
        A worker is touched once."""
        kinds = ["kill", "stop", "join", "leave", dice.choice(["kill", "stop", "leave", "join"]), "join"]
        dice.shuffle(kinds)
        untouched = 6
        events = []
        for at, kind in zip(sorted(dice.uniform(0.3, LAST_EVENT) for _ in kinds), kinds):
            if kind != "join" and untouched == LEAST:  # one more first
                events.append((at, "join", None))
                untouched += 1
            untouched += 1 if kind == "join" else -1
            events.append((at, kind, LOST_AFTER + dice.uniform(0.3, 1.5) if kind == "stop" else None))
        return events

    def test_seeds(self):
        for seed in seeds():
            with self.subTest(seed=seed):
                self.disturb(seed)
            self.end_all()
            self.processes.clear()

    def disturb(self, seed):
        dice = random.Random(seed)
        self.ports, self.workers = support.free_ports(16), []
        options = ("--replication", dice.choice([1, 2]), *dice.choice([(), ("--tls", "on")]))
        plan = self.plan(dice)
        story = f"CLOUDRENDERER_CHAOS_SEEDS={seed}: {options} {[(round(at, 2), kind) for at, kind, _ in plan]}"
        self.worker_options = options[2:]
        try:
            self.start_cluster(6, *options)
            touched = self.run_plan(plan, dice)
            report = self.finish()
            self.check_ends(touched, report)
        except AssertionError as e:
            raise AssertionError(f"{story}\n{e}") from None
        print(f"seed {seed}: {time.monotonic() - self.began:.1f} s, {report['wasted_paths']} of {report['paths']} paths "
              f"wasted, {' '.join(kind for _, kind, _ in plan)}", flush=True)

    def run_plan(self, plan, dice):
        touched = {}
        again = []  # who goes on when
        actions = list(plan)
        while actions or again:
            next_again = min(again, default=None, key=lambda a: a[0])
            due = actions[0][0] if actions else float("inf")
            at = min(due, next_again[0] if next_again else float("inf"))
            time.sleep(max(0, self.began + at - time.monotonic()))
            if next_again and next_again[0] <= due:
                again.remove(next_again)
                next_again[1].kill(signal.SIGCONT)
                continue
            _, kind, stopped = actions.pop(0)
            self.assertTrue(self.manager.running(), f"the frame had ended before the last event:\n{self.logs()}")
            if kind == "join":
                self.add_worker()
                continue
            worker = dice.choice([w for w in self.workers if w not in touched and "this is host" in w.text()])
            touched[worker] = (kind, time.monotonic())
            worker.kill({"kill": signal.SIGKILL, "stop": signal.SIGSTOP, "leave": signal.SIGTERM}[kind])
            if kind == "stop":
                again.append((at + stopped, worker))
        return touched

    def check_ends(self, touched, report):
        for worker in self.workers:
            kind, _ = touched.get(worker, (None, 0))
            code = worker.wait(30)
            # Who is late for the end of the frame waits for the manager in vain.
            allowed = {"kill": (-signal.SIGKILL,), "stop": (0, 4)}.get(kind, (0, 4) if worker is self.workers[-1] else (0,))
            self.assertIn(code, allowed, f"{worker.name} ({kind}):\n{self.logs()}")
        for worker, (kind, when) in touched.items():
            records = self.of(report, worker)
            seen = self.ended - when > LOST_AFTER + 3  # else the frame may have ended before it was missed
            if kind in ("kill", "stop") and seen:
                self.assertTrue(records[0]["lost"], f"nobody has missed {worker.name} ({kind}):\n{self.logs()}")
            if kind == "leave":
                self.assertFalse(records[0]["lost"], f"{worker.name} was asked to leave and was lost:\n{self.logs()}")
        self.assert_none_left()


class OneAtATime(ChaosTest):
    def test_who_leaves_hands_over_and_nothing_is_computed_twice(self):
        self.start_cluster(5)
        time.sleep(2)
        for worker in self.workers[:2]:
            worker.kill(signal.SIGTERM)
            self.assertEqual(worker.wait(60), 0, self.logs())
        self.assertTrue(self.manager.running(), f"the frame had ended before they had gone:\n{self.logs()}")
        report = self.finish()
        for worker in self.workers[:2]:
            host, = self.of(report, worker)
            self.assertFalse(host["lost"])
            self.assertIsNotNone(host["left_s"])
            self.assertGreater(host["paths_done"], 0)
        self.assertEqual(report["wasted_paths"], 0)

    def test_who_joins_in_the_middle_takes_work_within_seconds(self):
        self.start_cluster(4)
        time.sleep(1.5)
        worker = self.add_worker()
        report = self.finish()
        host, = self.of(report, worker)
        self.assertGreater(host["parts_loaded"], 0)
        self.assertGreater(host["tasks"]["tracer"], 0)
        self.assertGreater(host["paths_done"], 0)
        self.assertEqual(report["wasted_paths"], 0)

    def test_who_was_frozen_comes_back_as_a_new_host(self):
        self.start_cluster(5, "--replication", 2)
        time.sleep(1)
        frozen = self.workers[2]
        frozen.kill(signal.SIGSTOP)
        time.sleep(LOST_AFTER + 1.5)
        frozen.kill(signal.SIGCONT)
        report = self.finish()
        self.assertEqual(frozen.wait(20), 0, frozen.text())
        first, second = self.of(report, frozen)
        self.assertTrue(first["lost"])
        self.assertFalse(second["lost"])
        self.assertGreater(second["paths_done"], 0)

    def test_a_manager_without_workers_waits_and_says_so(self):
        self.start_cluster(2, share=2)
        time.sleep(1.5)
        self.workers[0].kill()
        self.workers[1].kill(signal.SIGTERM)  # nobody to hand over to: it ends what it has begun
        self.assertEqual(self.workers[1].wait(60), 0, self.logs())
        self.wait_for_word(self.manager, "no worker is left: waiting for one to join")
        self.assertTrue(self.manager.running())
        self.add_worker()
        self.finish()


if __name__ == "__main__":
    support.main()
