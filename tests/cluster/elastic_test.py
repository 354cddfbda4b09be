"""Hosts as they are wanted: a burst of three jobs brings six of them, its end takes five away again, and nothing is lost."""
import signal
import subprocess
import sys
import time

import numpy as np
import service_support
import service_test
import support
from support import measure

SCALER = support.ROOT / "tools" / "scale_hosts.py"
SIZE = "96x96"
MOST = 6
BURST, LATER = 1.5, 4  # seconds that a job keeps two processors busy at least: of the burst, of the one with a deadline


class Elastic(service_support.ServiceTest):
    SERVE = ("--log-level", "info", "--min-hosts", 1, "--max-hosts", MOST, "--host-start", 0.5, "--host-worth", 0.25, "--host-idle", 2)

    def wanted(self, user="root"):
        status, answer = self.ask(user, "GET", "/v1/hosts/wanted")
        self.assertEqual(status, 200, answer)
        return answer

    def test_a_burst_brings_hosts_and_its_end_takes_them(self):
        per_second = self.spp_for_frame(1, support.SCENE, SIZE)
        one, last = (["--spp", int(per_second * seconds), "--resolution", SIZE, "--seed", seed, *service_test.SPLIT] for seed, seconds in enumerate((BURST, LATER)))
        self.serve(0)
        logs = self.folder / "logs"
        logs.mkdir()
        output = open(self.folder / "scaler.log", "w")
        self.addCleanup(output.close)
        scaler = subprocess.Popen([sys.executable, SCALER, "local", "--service", f"http://127.0.0.1:{self.api_port}", "--user-token-file",
                                   self.folder / "bob.token", "--manager", f"127.0.0.1:{self.pool_port}", "--every", "0.3", "--program", support.PROGRAM,
                                   "--logs", logs, "--name", "elastic", "--threads", "1", "--memory", "64MiB"], stdout=output, stderr=subprocess.STDOUT,
                                  preexec_fn=measure.die_with_parent)
        self.addCleanup(scaler.wait)
        self.addCleanup(scaler.kill)
        story = lambda: (self.folder / "scaler.log").read_text() + self.logs()  # noqa: E731
        seen = []

        def look():
            answer = self.wanted()
            if not seen or (answer["wanted"], answer["there"]) != seen[-1]:
                seen.append((answer["wanted"], answer["there"]))
            self.assertLessEqual(answer["there"], MOST, story())
            return answer

        self.wait_for(lambda: look()["there"] == 1, "no first host")
        self.assertIn("1 host is kept always", str(look()["reasons"]))
        # The burst, and a job whose deadline is far away: for it one host is enough.
        burst = [int(self.submit("ann", support.SCENE, *one)) for _ in range(3)]
        later = int(self.submit("root", support.SCENE, "--deadline", "1h", "--priority", -5, *last))
        self.wait_for(lambda: look()["there"] == MOST, f"the burst brings no hosts: {seen}\n{story()}", 40)
        status, metrics = self.ask("root", "GET", "/v1/metrics")
        self.assertEqual(status, 200)
        self.assertIn(f'cloudrenderer_service_hosts_wanted{{kind=""}} {MOST}'.encode(), metrics)
        self.assertRegex(self.command("root", "status", "--hosts"), rf"any kind: {MOST} wanted, {MOST} there\n(.|\n)*no more than {MOST} hosts are allowed")
        # Reasons speak of a user's own jobs only.
        self.assertEqual({j["job"] for j in self.wanted("ann")["jobs"]} - set(burst), set())
        self.assertEqual(self.wanted("bob")["jobs"], [])
        self.assertEqual([r for r in self.wanted("bob")["reasons"] if r["job"]], [])
        for job in burst:
            self.wait_for(lambda job=job: look() and self.state("ann", job)["state"] == "done", f"job {job} does not end\n{story()}", 60)
        # Hosts go while the last job is under way.
        self.wait_for(lambda: look()["there"] == 1, f"the hosts stay: {seen}\n{story()}", 40)
        under_way = self.state("root", later)["state"] == "running"
        state = self.wait_for_end("root", later)
        self.assertAlmostEqual(state["deadline_at"], state["submitted_at"] + 3600, delta=1e-3)
        self.wait_for(lambda: look()["wanted"] == 1 and not self.wanted()["surplus"], "it does not come to rest")
        print(f"hosts (wanted, there): {seen}; the last job was still running when one host was left: {under_way}", flush=True)
        self.assertEqual(max(there for _, there in seen), MOST)
        # Nothing is lost: every picture is that of one host, at the first attempt, and who went has handed over.
        wasted = 0
        alone = {user: self.reference(f"alone-{user}", support.SCENE, "--threads", 2, *options) for user, options in (("ann", one), ("root", last))}
        for user, job in [*(("ann", j) for j in burst), ("root", later)]:
            self.assertEqual([f["attempts"] for f in self.state(user, job)["frames"]], [1])
            report = self.ask(user, "GET", f"/v1/jobs/{job}/frames/0/report")[1]
            self.assertFalse([h["name"] for h in report["hosts"] if h.get("lost")], "a host was lost instead of leaving")
            wasted += report["wasted_paths"]
            if job == later:
                self.assertGreater(sum(h["left_s"] is not None for h in report["hosts"]), 0, "no host has left in its middle")
            self.assertTrue(np.array_equal(self.picture(user, job), alone[user]), f"job {job} differs")
        print(f"paths that were made twice: {wasted}", flush=True)
        scaler.send_signal(signal.SIGTERM)
        self.assertEqual(scaler.wait(30), 0, story())
        text = (self.folder / "scaler.log").read_text()
        self.assertEqual(text.count("has ended with code 0"), text.count(" start elastic"), text)
        self.assertEqual(text.count("has ended with code"), text.count("has ended with code 0"), text)
        self.assertGreaterEqual(text.count(" end elastic"), MOST - 1)


if __name__ == "__main__":
    support.main()
