"""What the scaler of hosts decides, and what it says to Slurm (sbatch and scancel played by a script)."""
import contextlib
import http.server
import io
import json
import os
import pathlib
import socketserver
import stat
import subprocess
import sys
import tempfile
import threading
import time
import types
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tools"))
import scale_hosts  # noqa: E402

# Tasks are lines "JOB_TASK STATE" of a file; every call is noted in another one.
SLURM = """#!/usr/bin/env python3
import pathlib, re, sys
folder = pathlib.Path(__file__).parent
name, arguments = pathlib.Path(sys.argv[0]).name, sys.argv[1:]
tasks = [line.split() for line in (folder / "tasks").read_text().splitlines()]
if name != "squeue":
    with open(folder / "calls", "a") as calls:
        print(name, *arguments, file=calls)
if name == "squeue":
    print("\\n".join(task for task, _ in tasks))
if name == "sbatch":
    n = int(re.search(r"--array=1-(\\d+)", " ".join(arguments))[1])
    job = 1 + max([int(task.split("_")[0]) for task, _ in tasks], default=40)
    tasks += [[f"{job}_{i}", "PENDING"] for i in range(1, n + 1)]
    print(job)
if name == "scancel" and "--state=PENDING" in arguments:
    tasks = [t for t in tasks if not (t[0] in arguments and t[1] == "PENDING")]
(folder / "tasks").write_text("".join(f"{task} {state}\\n" for task, state in tasks))
"""


def said(wanted, there=(), surplus=(), kind=""):
    named = lambda names: [{"id": "0" * 16, "name": n, "kind": kind} for n in names]  # noqa: E731
    return {"wanted": wanted, "there": len(there), "kinds": [{"kind": kind, "wanted": wanted, "there": len(there)}],
            "hosts": named(there), "surplus": named(surplus), "reasons": [{"job": None, "text": "because"}]}


class Decide(unittest.TestCase):
    def test_what_is_missing_is_started_once(self):
        self.assertEqual(scale_hosts.decide(said(6, ["a"]), "", ["a"]), (5, []))
        self.assertEqual(scale_hosts.decide(said(6, ["a"]), "", ["a", "b", "c", "d", "e", "f"]), (0, []), "five are on their way")
        self.assertEqual(scale_hosts.decide(said(6, ["a", "b", "c"]), "", ["a"]), (3, []), "hosts of others count")

    def test_surplus_hosts_of_ours_are_ended(self):
        self.assertEqual(scale_hosts.decide(said(1, ["a", "b", "c"], ["c", "b"]), "", ["a", "b", "c"]), (0, ["c", "b"]))
        self.assertEqual(scale_hosts.decide(said(1, ["a", "b", "c"], ["c", "b"]), "", ["a", "b"]), (0, ["b"]), "c is not ours to end")
        self.assertEqual(scale_hosts.decide(said(2, ["a", "b", "c"], ["c"]), "", ["a", "b", "c"]), (0, ["c"]))

    def test_who_has_not_come_yet_goes_first(self):
        self.assertEqual(scale_hosts.decide(said(1, ["a", "b"], ["b"]), "", ["a", "b", "x", "y"]), (0, ["x", "y", "b"]))
        self.assertEqual(scale_hosts.decide(said(2, ["a", "b"]), "", ["a", "b", "x"]), (0, ["x"]))

    def test_every_scaler_has_its_kind(self):
        self.assertEqual(scale_hosts.decide(said(3, ["a"], kind="big"), "small", ["s"]), (0, ["s"]))
        self.assertEqual(scale_hosts.decide(said(3, ["a"], kind="big"), "big", []), (2, []))


class Local(unittest.TestCase):
    def test_hosts_that_fail_are_not_started_for_ever(self):
        arguments = types.SimpleNamespace(program="/bin/false", manager="farm:7000", kind="", logs=None, name="x")
        hosts, stop = scale_hosts.LocalHosts(arguments, []), threading.Event()
        service = types.SimpleNamespace(wanted=lambda: said(3))
        threading.Timer(1, stop.set).start()
        with contextlib.redirect_stdout(io.StringIO()) as told:
            scale_hosts.scale(service, hosts, "", 0.02, stop)
            hosts.close()
        self.assertIn("hosts have failed one after the other", told.getvalue())
        self.assertGreaterEqual(hosts.count, 5)
        self.assertLess(hosts.count, 15, told.getvalue())


class Slurm(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)
        for name in "sbatch", "scancel", "squeue":
            (self.folder / name).write_text(SLURM)
            (self.folder / name).chmod(stat.S_IRWXU)
        (self.folder / "tasks").write_text("")
        (self.folder / "calls").write_text("")
        self.answer = said(0)
        test = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                good = self.path == "/v1/hosts/wanted" and self.headers["Authorization"] == "Bearer mine"
                self.send_response(200 if good else 404)
                self.end_headers()
                self.wfile.write(json.dumps(test.answer).encode())

            def log_message(self, *_):
                pass

        self.server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.addCleanup(self.server.server_close)
        self.addCleanup(self.server.shutdown)

    def start(self, *options):
        scaler = subprocess.Popen([sys.executable, ROOT / "tools" / "scale_hosts.py", "slurm", "--service", f"http://127.0.0.1:{self.server.server_address[1]}",
                                   "--manager", "farm:7000", "--every", "0.1", *options], stdout=subprocess.PIPE, text=True,
                                  env=os.environ | {"PATH": f"{self.folder}:{os.environ['PATH']}", "CLOUDRENDERER_USER_TOKEN": "mine"})

        def end():
            scaler.kill()
            scaler.communicate()
        self.addCleanup(end)
        return scaler

    def wait_for_calls(self, n):
        end = time.monotonic() + 20
        while len(calls := (self.folder / "calls").read_text().splitlines()) < n:
            self.assertLess(time.monotonic(), end, calls)
            time.sleep(0.05)
        return calls

    def set_running(self, *tasks):
        text = (self.folder / "tasks").read_text()
        for task in tasks:
            text = text.replace(f"{task} PENDING", f"{task} RUNNING")
        (self.folder / "tasks").write_text(text)

    def test_arrays_are_submitted_and_their_tasks_end_by_a_signal(self):
        self.answer = said(3, ["elsewhere"])
        scaler = self.start("--kind", "", "--partition=night")
        script = ROOT / "docker" / "slurm" / "worker.sbatch"
        calls = self.wait_for_calls(1)
        self.assertEqual(calls[0].split(), ["sbatch", "--parsable", "--partition=night", "--job-name=cloudrenderer-worker", "--array=1-2", str(script), "farm:7000"])
        self.set_running("41_1", "41_2")
        self.answer = said(2, ["elsewhere", "slurm-41-1", "slurm-41-2"], ["slurm-41-2"])
        calls = self.wait_for_calls(3)
        self.assertEqual(calls[1:3], ["scancel --state=PENDING 41_2", "scancel --state=RUNNING --batch --signal=TERM 41_2"])
        time.sleep(0.5)
        self.assertEqual(len(self.wait_for_calls(3)), 3, "nothing is said twice: a second signal would end the host at once")
        scaler.terminate()
        self.assertEqual(scaler.wait(10), 0)
        self.assertEqual(len(self.wait_for_calls(3)), 3, "its hosts go on")

    def test_a_dry_run_changes_nothing(self):
        self.answer = said(2)
        scaler = self.start("--dry-run")
        lines = [scaler.stdout.readline() for _ in range(2)]
        self.assertIn("2 wanted, 0 there, 0 of them ours or to come (because)", lines[0])
        self.assertRegex(lines[1], r"would run sbatch --parsable --job-name=cloudrenderer-worker --array=1-2 \S+/worker.sbatch farm:7000")
        self.assertEqual((self.folder / "calls").read_text(), "")


if __name__ == "__main__":
    unittest.main(verbosity=2)
