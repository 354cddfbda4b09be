"""Many jobs of many users on hosts that die and come: pictures, shares, meter, and what the service keeps.

CLOUDRENDERER_FIFTY_SEEDS="1,2" chooses the plans: the order of the jobs, when hosts are killed and others come. Hosts have a
fixed part of a processor each where control groups can be made (tools/quota.py), so that a plan means much the same on a
machine that is busy."""
import contextlib
import os
import random
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import fifty_jobs_scenes
import numpy as np
import service_support
import support
from support import measure

import quota  # of tools/, which support has made known

SHARE = 0.10  # how far a user's part of the processors may be from a fair one
METER = 0.02  # how far the jobs' sums may be from what the hosts measured
BYTES = 0.005  # how far their bytes may be from the frames' reports, where no host was lost: hosts count once for both
START = 0.05  # by how many processor seconds the start of a process differs from time to time
BEAT = 1.0    # seconds between what a host says of its use
SIZE, PART = "96x96", "512KiB"


class Host:
    def __init__(self, process, cores, born):
        self.process, self.cores, self.born = process, cores, born
        self.first_seen = self.died = None  # by this test's clock
        self.said_cpu = 0.0   # of its process, with its last beat
        self.cpu = None       # of its process, as the system counted it to the end
        self.killed = False

    def end(self, number):
        """Ends it, and gives the exit code."""
        self.killed = number == signal.SIGKILL
        self.died = time.monotonic()
        os.kill(self.process.pid, number)
        _, status, used = os.wait4(self.process.pid, 0)
        self.process.child.returncode = os.waitstatus_to_exitcode(status)
        self.cpu = used.ru_utime + used.ru_stime
        return self.process.child.returncode


class FiftyJobs(service_support.ServiceTest):
    SHARES = {"one": 1, "uno": 1, "two": 2, "duo": 2, "four": 4}
    USERS = {name: {"share": share} for name, share in SHARES.items()} | {"root": {"admin": True}}

    # Hosts are slow by their quota, and the service has the rest, whatever else runs on the machine: where it must compete for
    # that, hosts wait for managers and not the managers for hosts. (Niceness decides only within a session or group.)
    WEIGHT = 50

    def setUp(self):
        super().setUp()
        self.groups = None
        with contextlib.suppress(quota.NotPermitted):
            self.groups = quota.Groups()
            self.addCleanup(self.close_groups)
            self.PREFIX = self.in_group(self.groups.group(os.cpu_count(), self.WEIGHT))
            self.groups.enter(self.groups.group(os.cpu_count(), self.WEIGHT))  # who looks late sees hosts come late

    def close_groups(self):
        self.end_all()
        self.groups.enter(self.groups.parent)
        self.groups.close()

    @staticmethod
    def in_group(group):
        """A command that becomes another one in a control group."""
        return "sh", "-c", f'echo $$ > "{group}/cgroup.procs"; exec "$@"', "sh"

    def join(self, cores, memory):
        name = f"host{len(self.hosts)}"
        command = ["--manager", f"127.0.0.1:{self.pool_port}", "--threads", max(1, round(cores)), "--memory", memory, "--name", name,
                   "--log-level", "info"]
        prefix = self.in_group(self.groups.group(cores, self.WEIGHT)) if self.groups else ()
        self.hosts[name] = Host(self.start(name, "worker", *command, prefix=prefix), cores, time.monotonic())

    def starting_costs(self, memory):
        """Processor seconds that a host's process takes before it is in the pool, and at its end."""
        self.join(1, memory)
        idle = self.hosts.pop("host0")
        self.wait_for(lambda: self.ask("root", "GET", "/v1/hosts")[1], "the host does not come")
        said = self.ask("root", "GET", "/v1/hosts")[1][0]["cpu_s"]
        self.assertEqual(idle.end(signal.SIGTERM), 0)
        self.wait_for(lambda: not self.ask("root", "GET", "/v1/hosts")[1], "the host does not go")
        return idle.cpu - said

    def look(self):
        """What the service says now; None while it is away."""
        try:
            hosts, usage, jobs = (self.ask("root", "GET", f"/v1/{what}")[1] for what in ("hosts", "usage", "jobs"))
        except OSError:
            return None
        now = time.monotonic()
        for said in hosts:
            host = self.hosts[said["name"]]
            host.first_seen = host.first_seen or now
            host.said_cpu = max(host.said_cpu, said["cpu_s"])
        used = {u["user"]: u["cpu_s"] for u in usage["users"] if u["user"] != "root"}
        backlogged = all(any(j["user"] == user and j["state"] in ("checking", "queued") for j in jobs) for user in self.shares)
        ended = sum(j["state"] in ("done", "failed", "cancelled") for j in jobs)
        return used, backlogged, ended

    def samples_for(self, scenes, seconds):
        """Samples that make a frame of every scene take so many processor seconds."""
        out = {}
        for name, files in scenes.items():
            few, many = (self.render("probe", files[0], "--spp", spp, "--resolution", SIZE, "--threads", 1)[1]["time"]["cpu_s"] for spp in (1, 33))
            out[name] = max(4, min(65536, int(32 * seconds / max(many - few, 0.002))))
        return out

    def references(self, todo):
        """The picture of every frame by one host, by its file and seed."""
        frames = {(file, seed): spp for _, files, seed, spp in todo for file in files}
        return {(file, seed): self.reference(f"one-{file.stem}-{seed}", file, "--spp", spp, "--seed", seed, "--resolution", SIZE,
                                             "--part-size", PART) for (file, seed), spp in frames.items()}

    def check_pictures(self, jobs, wanted):
        for number, (user, files, seed) in jobs.items():
            state = self.state("root", number)
            self.assertEqual(state["state"], "done", f"{state}\n{self.logs()}")
            for frame, file in enumerate(files):
                self.assertEqual(state["frames"][frame]["attempts"], 1, f"{state}: whoever dies, the frame is not to blame")
                self.assertTrue(np.array_equal(self.picture(user, number, frame), wanted[file, seed]),
                                f"frame {frame} of job {number} ({file.name}) differs from one host's")

    def check_meter(self, jobs, killed_service, cut_off, start_cpu, always_busy):
        """Processor time: of the jobs against what the system counted for the hosts' processes, less what their start takes;
        for those that were killed against what they had said of their process with their last beat, and the rest is shown
        to be a beat each at most. Time: against how long the hosts were there, less a beat for those that were killed, and
        the seconds in which there was no service. Bytes: against what hosts told the frames' managers, of jobs that lost no host
        (which may have told the pool more) and had no frame under way when the service was killed (`cut_off`: reports know of the
        last attempt only, and the jobs have more)."""
        states = [self.state("root", j) for j in jobs]
        sums = {key: sum(s["usage"][key] for s in states) for key in ("cpu_s", "host_s", "bytes")}
        stayed = [h for h in self.hosts.values() if not h.killed]
        killed = [h for h in self.hosts.values() if h.killed]
        measured = sum(h.cpu - start_cpu for h in stayed) + sum(h.said_cpu for h in killed)
        lost = sum(h.cpu - start_cpu - h.said_cpu for h in killed)
        print(f"processor seconds: jobs {sums['cpu_s']:.2f}, {len(self.hosts)} hosts {measured:.2f} ({sums['cpu_s'] / measured - 1:+.2%}), "
              f"after the last beats of {len(killed)} killed hosts {lost:.2f}, starts {start_cpu:.2f} each", flush=True)
        there = sum(h.died - h.first_seen for h in self.hosts.values())
        print(f"host seconds: jobs {sums['host_s']:.1f}, from the hosts' coming to their end {there:.1f} ({sums['host_s'] / there - 1:+.2%})", flush=True)
        frames = [[h for f in range(len(s["frames"])) for h in self.ask("root", "GET", f"/v1/jobs/{j}/frames/{f}/report")[1]["hosts"]]
                  for j, s in zip(jobs, states)]  # hosts, by job
        sent = sum(h["bytes_sent"] for hosts in frames for h in hosts)
        safe = [(s["usage"]["bytes"], sum(h["bytes_sent"] for h in hosts)) for j, s, hosts in zip(jobs, states, frames)
                if j not in cut_off and not any(h["lost"] for h in hosts)]
        metered, told = (sum(column) for column in zip(*safe))
        print(f"bytes: jobs {sums['bytes']:.0f}, hosts in the frames' reports {sent} ({sums['bytes'] / sent - 1:+.2%}); "
              f"{len(safe)} jobs that lost nothing {metered:.0f}, {told} ({metered / told - 1:+.2%})", flush=True)
        for j, s, hosts in zip(jobs, states, frames):
            told_by = [(h["name"], h["bytes_sent"]) for h in hosts]
            if j not in cut_off and not any(h["lost"] for h in hosts) and abs(s["usage"]["bytes"] / sum(b for _, b in told_by) - 1) > BYTES:
                print(f"job {j}: {s['usage']['bytes']:.0f} bytes metered, reported {told_by}", flush=True)
                for f in range(len(s["frames"])):
                    print(self.ask("root", "GET", f"/v1/jobs/{j}/frames/{f}/log")[1].decode(), flush=True)
        self.assertAlmostEqual(sums["cpu_s"], measured, delta=METER * measured + START * len(stayed))
        self.assertLessEqual(lost, sum(START + (h.cores if self.groups else 1) * 1.3 * BEAT for h in killed))
        self.assertLessEqual(sums["host_s"], there + 0.5 * len(self.hosts))  # we look now and then
        if self.groups:  # while they work, they use no more than their quota
            self.assertGreaterEqual(sums["host_s"] * max(h.cores for h in self.hosts.values()) * 1.05, sums["cpu_s"])
        # Hosts wait for managers that wait for the processor: no fault of the meter.
        crowded = os.getloadavg()[1] > 2 * os.cpu_count()
        if always_busy and crowded:
            print(f"load {os.getloadavg()[1]:.1f}: hosts had nothing to do at times, so their seconds are not compared", flush=True)
        elif always_busy:
            self.assertLessEqual(there - sums["host_s"], METER * there + 1.3 * BEAT * len(killed) + 6 * killed_service * len(stayed))
        self.assertGreater(sums["bytes"] / sent, 1 - METER)
        self.assertAlmostEqual(metered / told, 1, delta=BYTES)
        if not killed_service:
            self.assertLess(sums["bytes"] / sent, 1 + METER * (1 + (1 if always_busy else 2) * len(killed)))
        self.assertTrue(all(s["usage"]["service_cpu_s"] > 0 for s in states), "managing the frames is not metered")

    def check_shares(self, looks):
        """From when everybody has begun to when the first has nothing waiting any more."""
        window = [used for used, backlogged, _ in looks if backlogged and min(used.values()) > 0.2]
        self.assertGreater(len(window), 1, "there was no time at which all users had jobs waiting")
        got = {user: window[-1][user] - window[0][user] for user in self.shares}
        whole, shares = sum(got.values()), sum(self.shares.values())
        off = {}
        for user, share in self.shares.items():
            off[user] = got[user] / whole / (share / shares) - 1
            print(f"{user}: {got[user]:.2f} of {whole:.2f} processor seconds, {got[user] / whole:.3f}; fair is {share / shares:.3f} ({off[user]:+.1%})", flush=True)
        return off

    def plan_of(self, seed, frame_seconds, users, jobs_of_one):
        rng = random.Random(seed)
        scenes = fifty_jobs_scenes.write(self.folder / "scenes")
        spp = self.samples_for(scenes, frame_seconds) if frame_seconds else dict.fromkeys(scenes, 64)
        self.shares = {user: self.SHARES[user] for user in users}
        todo = []
        for user, share in self.shares.items():
            names = list(scenes)
            for i in range(jobs_of_one * share):
                name = names[i % len(names)]
                todo.append((user, scenes[name] if name == "turn" and i < len(names) else scenes[name][:1], rng.randrange(2), spp[name]))
        rng.shuffle(todo)
        return rng, todo, self.references(todo)

    def run_plan(self, seed, hosts, cores, memory, kills, frame_seconds, users, jobs_of_one, kill_service, at_once, limit, fair=True):
        print(f"seed {seed}: {hosts} hosts of {cores} processors{'' if self.groups else ' at most (no control groups)'}, {kills} kills", flush=True)
        rng, todo, wanted = self.plan_of(seed, frame_seconds, users, jobs_of_one)
        self.SERVE = ("--log-level", "info", "--jobs-at-once", at_once)
        self.hosts = {}
        self.start_service("service")
        start_cpu = self.starting_costs(memory)

        def submit(job):
            user, files, picture_seed, spp = job
            return self.submit(user, *files, "--spp", spp, "--seed", picture_seed, "--resolution", SIZE, "--part-size", PART), (user, files, picture_seed)

        with ThreadPoolExecutor(4) as pool:
            jobs = dict(pool.map(submit, todo))
        for _ in range(hosts):
            self.join(cores, memory)
        # Events by how many jobs have ended, so that they come on a slow machine, too.
        at = sorted(rng.sample(range(1, int(0.8 * len(todo))), kills))
        service_dies_at = len(todo) // 2 if kill_service else None
        looks, cut_off, begin = [], set(), time.monotonic()
        while True:
            self.assertLess(time.monotonic() - begin, limit, f"jobs do not end: {[self.state('root', j) for j in jobs if self.state('root', j)['state'] != 'done']}\n{self.logs()}")
            seen = self.look()
            if seen:
                looks.append(seen)
                if seen[2] == len(jobs):
                    break
                if at and seen[2] >= at[0]:
                    at.pop(0)
                    # One comes for every one that dies, before it or after it.
                    comes_first = rng.random() < 0.5
                    if comes_first:
                        self.join(cores, memory)
                    rng.choice([h for h in self.hosts.values() if h.died is None and h.first_seen]).end(signal.SIGKILL)
                    if not comes_first:
                        self.join(cores, memory)
                elif service_dies_at is not None and seen[2] >= service_dies_at:
                    service_dies_at = None
                    time.sleep(3 * BEAT)  # what killed hosts said last has been kept
                    cut_off = {j for j in jobs if self.state("root", j)["state"] == "running"}
                    self.service.kill()
                    self.service.child.wait()
                    self.start_service("service-again")
            time.sleep(0.2)
        print(f"{len(jobs)} jobs in {time.monotonic() - begin:.1f} s", flush=True)
        off = self.check_shares(looks) if fair else {}
        self.look()
        codes = {name: host.end(signal.SIGTERM) for name, host in self.hosts.items() if host.died is None}
        self.assertEqual(set(codes.values()), {0}, f"{codes}\n{self.logs()}")
        self.wait_for(lambda: not self.ask("root", "GET", "/v1/hosts")[1], "hosts that have left are still there")
        self.check_pictures(jobs, wanted)
        self.check_meter(jobs, kill_service, cut_off, start_cpu, always_busy=fair)
        self.assertLessEqual(max(map(abs, off.values()), default=0), SHARE, f"shares are not fair: {off}")
        self.service.kill(signal.SIGTERM)
        self.assertEqual(self.service.wait(20), 0)
        self.assert_none_left()

    @staticmethod
    def seeds():
        return [int(s) for s in os.environ.get("CLOUDRENDERER_FIFTY_SEEDS", "1").split(",")]

    def test_eight_jobs(self):
        self.run_plan(self.seeds()[0], hosts=3, cores=0.5, memory="64MiB", kills=1, frame_seconds=None, users=("one", "uno", "two"), jobs_of_one=2,
                      kill_service=False, at_once=4, limit=60, fair=False)  # too short for shares

    def test_few_fat_hosts(self):
        for seed in self.seeds():
            with self.subTest(seed=seed):
                self.run_plan(seed, hosts=3, cores=0.5, memory="128MiB", kills=5, frame_seconds=1.5, users=self.SHARES, jobs_of_one=5,
                              kill_service=False, at_once=8, limit=400)

    def test_fewer_places_than_users(self):
        for seed in self.seeds():
            with self.subTest(seed=seed):
                self.run_plan(seed, hosts=3, cores=0.5, memory="128MiB", kills=3, frame_seconds=1.5, users=self.SHARES, jobs_of_one=5,
                              kill_service=False, at_once=4, limit=400)

    def test_many_thin_hosts(self):
        for seed in self.seeds():
            with self.subTest(seed=seed):
                self.run_plan(seed, hosts=8, cores=0.19, memory="48MiB", kills=8, frame_seconds=1.5, users=self.SHARES, jobs_of_one=5,
                              kill_service=True, at_once=8, limit=400)


if __name__ == "__main__":
    support.main()
