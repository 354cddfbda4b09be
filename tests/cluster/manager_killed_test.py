"""A manager that is killed at seeded moments and resumed: the picture has the bits of an undisturbed one, the workers
stay and come back by themselves, and no kill costs more than ten seconds of the cluster's work.

CLOUDRENDERER_KILLS is the number of kills (default 2, with a short frame), CLOUDRENDERER_KILL_SEED replays a run."""
import json
import os
import pathlib
import random
import struct
import time

import numpy as np
import support
from support import measure

KILLS = int(os.environ.get("CLOUDRENDERER_KILLS", 2))
SEED = int(os.environ.get("CLOUDRENDERER_KILL_SEED", 1))
SIZE = "256x256" if KILLS > 2 else "128x128"
FRAME = 80 if KILLS > 2 else 2  # seconds of two undisturbed processors, at least
WORKERS = 3
LONGEST = 7                      # seconds between a start and the next kill
MOST_LOST = 10                   # seconds of the whole cluster's work
HEADER, RECORD, BODY = 112, 16, 40  # bytes, see src/tasks/checkpoint.h


def paths_in(journal):
    """Paths that the whole records of a journal hold."""
    data = journal.read_bytes() if journal.exists() else b""
    at, paths = HEADER, 0
    while at + RECORD <= len(data):
        mark, size, _ = struct.unpack_from("<4sIQ", data, at)
        at += RECORD
        if mark != b"tile" or at + size > len(data):
            break
        x0, y0, x1, y1, ranges = struct.unpack_from("<5I", data, at)
        numbers = struct.unpack_from(f"<{2 * ranges}I", data, at + BODY)
        paths += (x1 - x0) * (y1 - y0) * (sum(numbers[1::2]) - sum(numbers[::2]))
        at += size
    return paths


def cpu_seconds(process):
    """What the process has used of the processors, the threads that have ended included."""
    fields = pathlib.Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class ManagerKilled(support.ClusterTest):
    def setUp(self):
        super().setUp()
        self.token = self.folder / "token"
        self.token.write_text("of this test\n")
        self.scene = self.split(part_size="300KiB")
        _, report = self.render("memory", self.scene, "--spp", 1, "--resolution", "16x16")
        self.memory = int(0.75 * report["hosts"][0]["memory_peak"])  # nobody has room for everything
        self.out, self.ckpt = self.folder / "out.exr", self.folder / "out.ckpt"
        self.spp = self.spp_for_frame(FRAME, self.scene, SIZE)
        self.total = self.spp * int(SIZE.partition("x")[0]) ** 2
        self.starts = 0

    def start_cluster(self, *options):
        self.ports = support.free_ports(1 + WORKERS)
        manager = self.manager(*options)
        self.workers = [self.start_worker(f"worker{k}", self.ports[0], self.ports[1 + k], self.memory, "--token-file",
                                          self.token, "--wait", 20, "--log-level", "info") for k in range(WORKERS)]
        return manager

    def manager(self, *options):
        """Another one on the same port; the logs of all are kept."""
        self.starts += 1
        return self.start(f"manager{self.starts}", "manager", self.scene, "-o", self.out, "--listen",
                          f"127.0.0.1:{self.ports[0]}", "--spp", self.spp, "--resolution", SIZE, "--min-hosts", WORKERS,
                          "--token-file", self.token, "--quiet", "--log-level", "info", "--report",
                          self.folder / "report.json", *options)

    def cluster_seconds(self):
        return sum(map(cpu_seconds, self.workers))

    def end(self, manager, seconds):
        """To the end of the frame: its pixels, its report, the workers' processor seconds just before."""
        end, used = time.monotonic() + seconds, 0
        while manager.running():
            self.assertLess(time.monotonic(), end, f"the manager hangs:\n{self.logs()}")
            if all(worker.running() for worker in self.workers):
                used = self.cluster_seconds()
            time.sleep(0.02)
        self.assertEqual(manager.wait(1), 0, self.logs())
        for worker in self.workers:
            self.assertEqual(worker.wait(20), 0, self.logs())
        return measure.read_rgb(self.out), json.loads((self.folder / "report.json").read_text()), used

    def undisturbed(self):
        wanted, report, used = self.end(self.start_cluster(), 400)
        self.assertGreater(report["parts"]["count"], 8)
        self.assertEqual(report["paths"], self.total)
        self.out.unlink()
        per_path = used / self.total
        self.assertGreater(report["rays"]["moved"], 0)
        seconds = report["time"]["render_s"]
        power = used / seconds  # processors that the cluster keeps busy
        print(f"{SIZE}, {self.spp} samples, {report['parts']['count']} parts: {seconds:.1f} s undisturbed, "
              f"{1e9 * per_path:.0f} ns of a worker's processor a path, {power:.2f} processors busy", flush=True)
        return wanted, per_path, power

    def plan(self, dice):
        """What is waited for before each kill, and how long then."""
        if KILLS <= 2:
            return [("growth", dice.uniform(0, 0.5)) for _ in range(KILLS)]
        kinds = ["start"] * (KILLS // 7) + ["compaction"] * (KILLS // 7)
        kinds += ["moment"] * (KILLS - len(kinds))
        dice.shuffle(kinds)
        return [(kind, {"start": dice.uniform(0, 0.5), "moment": dice.uniform(0.5, LONGEST)}.get(kind, 0)) for kind in kinds]

    def wait_for_growth(self, manager, seconds=30):
        """Until this manager has recorded something."""
        size = lambda: self.ckpt.stat().st_size if self.ckpt.exists() else 0
        before, end = size(), time.monotonic() + seconds
        while size() == before:
            self.assertTrue(manager.running() and time.monotonic() < end, f"no record was made:\n{self.logs()}")
            time.sleep(0.01)

    def wait_for_compaction(self, manager, seconds=30):
        """Until the file is there that is to take the journal's place. Looks as often as it can: it is there for
        milliseconds."""
        new, end = f"{self.ckpt}.new", time.monotonic() + seconds
        while not os.path.exists(new):
            self.assertTrue(manager.running() and time.monotonic() < end, f"no compaction was seen:\n{self.logs()}")
            time.sleep(0.0005)

    def test_killed_and_resumed(self):
        dice = random.Random(SEED)
        wanted, per_path, power = self.undisturbed()
        plan = self.plan(dice)
        story = f"CLOUDRENDERER_KILLS={KILLS} CLOUDRENDERER_KILL_SEED={SEED}: {[(k, round(s, 2)) for k, s in plan]}"
        try:
            self.disturbed(plan, wanted, per_path, power)
        except AssertionError as e:
            raise AssertionError(f"{story}\n{e}") from None

    def disturbed(self, plan, wanted, per_path, power):
        manager = self.start_cluster("--checkpoint", self.ckpt)
        kept, used, lost = 0, 0, []
        for k, (kind, seconds) in enumerate(plan, 1):
            if kind == "compaction":
                self.wait_for_compaction(manager)
            elif kind == "growth":
                self.wait_for_growth(manager)
            time.sleep(seconds)
            self.assertTrue(manager.running(), f"the frame had ended before kill {k}:\n{self.logs()}")
            manager.kill()
            manager.wait(10)
            before, kept = kept, paths_in(self.ckpt)
            self.assertGreaterEqual(kept, before, "the journal has lost what it had")
            self.assertLess(kept, self.total, "the frame had ended before the last kill")
            # All that the workers have done since the last kill and that is in no record: what was under way, what they
            # did for a manager that was gone, and loading the scene again.
            spent, used = -used, self.cluster_seconds()
            lost.append((spent + used - per_path * (kept - before)) / power)
            print(f"kill {k:2} ({kind}, {seconds:.2f} s): {kept / self.total:6.1%} are in the journal, "
                  f"{lost[-1]:5.2f} s of the cluster's work lost", flush=True)
            manager = self.manager("--checkpoint", self.ckpt, "--resume")
            self.assertLess(lost[-1], MOST_LOST, self.logs())
        image, report, last = self.end(manager, 400)
        self.assertEqual(report["paths_restored"], kept, "the records that are there are those that count")
        self.assertEqual(report["paths"], self.total)
        self.assertTrue(np.array_equal(image, wanted), "the picture differs from the undisturbed one")
        self.assertFalse(os.path.exists(f"{self.ckpt}.new"), "half a compaction was left behind")
        self.assert_none_left()
        whole = (last - per_path * self.total) / power
        print(f"{len(plan)} kills, seed {SEED}: at most {max(lost):.2f} s of the cluster's work lost, {whole / len(plan):.2f} s "
              f"a kill of all that it has done", flush=True)


if __name__ == "__main__":
    support.main()
