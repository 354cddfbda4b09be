"""Hosts of a pool work for several jobs at once: shares by weight, the same bits, parts loaded once, a meter that is right.

The service that would give the orders is pool_driver (the second argument). Shares are measured in processor time, so what
else runs on this machine does not count."""
import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import support
from support import measure

DRIVER = pathlib.Path(sys.argv.pop(2)) if len(sys.argv) > 2 else measure.DEFAULT_PROGRAM.parent / "tests/cluster/pool_driver"
SIZE = "200x200"
FRAME = 4       # seconds of two processors that a frame takes by itself
WINDOW = 3.5    # processor seconds in which a share is measured
SHARE = 0.10    # how far it may be off
METER = 0.02


class Driver:
    """Gives orders to the pool, and keeps what it last said."""

    def __init__(self, test):
        self.child = subprocess.Popen([DRIVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                      env=os.environ | {support.MARK: test.mark}, preexec_fn=measure.die_with_parent)
        self.address = json.loads(self.child.stdout.readline())["listening"]
        self.state = {"hosts": [], "usage": {}}
        self.thread = threading.Thread(target=self.read, daemon=True)
        self.thread.start()

    def read(self):
        for line in self.child.stdout:
            self.state = json.loads(line)

    def order(self, *orders):
        names = ("job", "manager", "weight", "memory")
        self.child.stdin.write(json.dumps([dict(zip(names, o)) for o in orders]) + "\n")
        self.child.stdin.flush()

    def close(self):
        self.child.stdin.close()
        code = self.child.wait(20)
        self.thread.join(5)
        self.child.stdout.close()
        return code

    def hosts(self):
        return [h for h in self.state["hosts"] if not h["left"]]

    def usage(self, job):
        return self.state["usage"].get(job, {})


class Pool(support.ClusterTest):
    def start_pool(self):
        self.driver, self.managers = Driver(self), {}
        self.addCleanup(lambda: self.driver.child.poll() is None and self.driver.child.kill())

    def wait_for(self, condition, seconds, what):
        end = time.monotonic() + seconds
        while not condition():
            self.assertLess(time.monotonic(), end, f"never: {what}\n{json.dumps(self.driver.state)}\n{self.logs()}")
            time.sleep(0.05)

    def scene(self, name, text_of):
        """A split of the killeroo scene, changed."""
        text = text_of(support.SCENE.read_text()).replace('Include "', f'Include "{support.SCENE.parent}/')
        scene, folder = self.folder / f"{name}.pbrt", self.folder / name
        scene.write_text(text)
        result = self.run_program("split", scene, "-o", folder, "--part-size", "512KiB")
        self.assertEqual(result.code, 0, result.output)
        return folder

    def start_job(self, name, split, spp, hosts=2):
        port = support.free_ports(1)[0]
        manager = self.start(name, "manager", split, "-o", self.folder / f"{name}.exr", "--listen", f"127.0.0.1:{port}", "--spp", spp,
                             "--resolution", SIZE, "--min-hosts", hosts, "--quiet", "--report", self.folder / f"{name}.json",
                             "--lost-after", 2)
        self.assertTrue(support.wait_until_listening(port), manager.text())
        self.managers[name] = manager
        return f"127.0.0.1:{port}"

    def start_host(self, name, memory):
        return self.start(name, "worker", "--manager", self.driver.address, "--threads", 1, "--memory", memory, "--name", name,
                          "--kind", "small", "--log-level", "info")

    def finish(self, name, wanted):
        self.assertEqual(self.managers[name].wait(90), 0, self.logs())
        image = measure.read_rgb(self.folder / f"{name}.exr")
        self.assertTrue(np.array_equal(image, wanted), f"the picture of {name} differs from one host's")
        report = support.json_of(self.folder / f"{name}.json")
        self.assertTrue(report["bit_exact"])
        return report

    def share(self, first, second, seconds=60):
        """What part of the processor time of the two jobs the first one gets from now on."""
        used = lambda: [self.driver.usage(job)["cpu_s"] for job in (first, second)]  # noqa: E731
        begin = used()
        self.wait_for(lambda: sum(used()) - sum(begin) > WINDOW, seconds, f"{first} and {second} computing")
        for job in (first, second):
            self.assertTrue(self.managers[job].running(), f"{job} ended while the share was measured")
        a, b = (now - before for now, before in zip(used(), begin))
        print(f"{first}: {a:.2f} s, {second}: {b:.2f} s of processor", flush=True)
        return a / (a + b)

    def check_meter(self):
        """Of the hosts that are there: what the jobs used in sum is what the process used."""
        for host in self.driver.hosts():
            jobs = sum(u["cpu_s"] for u in host["jobs"].values())
            self.assertAlmostEqual(jobs / host["cpu_s"], 1, delta=METER, msg=f"{host}")
            self.assertLessEqual(host["memory_peak"], host["memory"])
            print(f"{host['name']}: {host['cpu_s']:.2f} s of processor, {jobs:.2f} s metered", flush=True)

    def test_jobs_side_by_side_and_one_after_the_other(self):
        # The same geometry in another place of the film, and another floor: the killeroo's parts are alike.
        splits = {"a": self.scene("a", lambda t: t), "b": self.scene("b", lambda t: t.replace("LookAt 400 20 30", "LookAt 380 60 50"))}
        spp = self.spp_for_frame(FRAME, splits["a"], SIZE)
        wanted, whole = {}, 0
        for name, split in splits.items():
            wanted[name], report = self.render(f"{name}-alone", split, "--spp", spp, "--resolution", SIZE, "--threads", 2)
            whole = max(whole, report["hosts"][0]["memory_peak"])
        memory = int(1.5 * whole)  # of a host; two jobs with parts of their own would need twice the whole

        self.start_pool()
        orders = {name: self.start_job(name, split, spp) for name, split in splits.items()}
        self.driver.order(*((name, orders[name], 1, 0) for name in orders))
        hosts = [self.start_host(f"host{i}", memory) for i in range(2)]
        # The first tasks are small, until the managers know how fast the hosts are.
        begun = lambda h: all(h["jobs"].get(j, {}).get("cpu_s", 0) > 0.3 for j in orders)  # noqa: E731
        self.wait_for(lambda: sum(map(begun, self.driver.hosts())) == 2, 30, "both jobs are under way on both hosts")
        even = self.share("a", "b")
        print(f"weights 1:1, share of a: {even:.3f}", flush=True)
        self.assertAlmostEqual(even, 1 / 2, delta=SHARE / 2)
        self.driver.order(("a", orders["a"], 3, 0), ("b", orders["b"], 1, 0))
        time.sleep(0.5)
        triple = self.share("a", "b")
        print(f"weights 3:1, share of a: {triple:.3f}", flush=True)
        self.assertAlmostEqual(triple, 3 / 4, delta=3 / 4 * SHARE)
        self.check_meter()
        # One is killed, another one comes.
        hosts[0].kill()
        hosts.append(self.start_host("host2", memory))
        reports = {name: self.finish(name, wanted[name]) for name in orders}
        self.assertIn("host2", {h["name"] for h in reports["b"]["hosts"]})
        self.assertEqual({h["kind"] for h in self.driver.state["hosts"]}, {"small"})

        # The next frame of the same scene finds everything there, on the host that has had it all.
        self.driver.order(("next", self.start_job("next", splits["a"], 8), 1, 0))
        self.assertEqual(self.managers["next"].wait(30), 0, self.logs())
        self.driver.order()
        self.wait_for(lambda: not self.driver.usage("next").get("working", True), 10, "the end of the last job")
        for host in self.driver.hosts():
            sums = {job: (u["loaded_bytes"], u["shared_bytes"]) for job, u in host["jobs"].items()}
            print(f"{host['name']}: bytes of parts loaded, and found there, by job: {sums}", flush=True)
            if host["name"] == "host1":
                self.assertEqual(sums["next"], (0, sum(sums["a"])))
                # What the two scenes have in common was loaded once.
                self.assertLess(sums["a"][0] + sums["b"][0], 0.7 * (sum(sums["a"]) + sum(sums["b"])))
        again = self.driver.usage("next")
        self.assertGreater(again["host_s"], 0)
        self.assertGreater(again["memory_byte_s"], 0)
        self.assertGreater(again["bytes_received"], 0)
        self.check_meter()

        # Who is asked to leave goes; who has lost the service waits for another one, and then goes as well.
        hosts[1].kill(signal.SIGTERM)
        self.assertEqual(hosts[1].wait(10), 0, self.logs())
        self.wait_for(lambda: len(self.driver.hosts()) == 1, 10, "the leaving host is gone")
        self.assertEqual(self.driver.close(), 0)
        hosts[2].kill(signal.SIGTERM)
        self.assertEqual(hosts[2].wait(10), 0, self.logs())
        self.assert_none_left()


if __name__ == "__main__":
    support.main()
