#!/usr/bin/env python3
"""Starts and ends hosts as a service wants them (GET /v1/hosts/wanted): processes of this machine, or jobs of Slurm.

    scale_hosts.py local --manager HOST:PORT [--kind NAME] [worker options]
    scale_hosts.py slurm --script docker/slurm/worker.sbatch --manager HOST:PORT [--kind NAME] [--dry-run] [sbatch options]

Both take --service URL and --user-token-file FILE, or CLOUDRENDERER_SERVICE and CLOUDRENDERER_USER_TOKEN; any user's token
will do. What to do follows from three things: how many of the kind are wanted, which of ours are there or on their way, and
which hosts the service names as surplus. Only hosts that were started here are ever ended, and only by SIGTERM, so that they
hand over what they do. With SIGTERM or Ctrl-C the scaler ends its hosts and itself."""
import argparse
import json
import os
import pathlib
import re
import shlex
import signal
import ssl
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[1]
GOODBYE = 60  # seconds that a host may take to leave
ENOUGH = 5  # hosts that fail, before they are tried one by one
LARGEST_ARRAY = 1000  # Slurm's MaxArraySize is 1001 unless set


def say(text):
    print(time.strftime("%H:%M:%S"), text, flush=True)


class Service:
    def __init__(self, url, token, authority=None):
        self.request = urllib.request.Request(url.rstrip("/") + "/v1/hosts/wanted", headers={"Authorization": f"Bearer {token}"})
        self.tls = ssl.create_default_context(cafile=authority) if url.startswith("https:") else None

    def wanted(self):
        with urllib.request.urlopen(self.request, timeout=20, context=self.tls) as answer:
            return json.load(answer)


def decide(said, kind, ours):
    """How many to start, and which of ours to end. `ours`: the names of hosts that run or are on their way.
    Ours that the service does not know yet are on their way: they go first, since nothing is lost with them."""
    row = next((k for k in said["kinds"] if k["kind"] == kind), {"wanted": 0, "there": 0})
    surplus = [h["name"] for h in said["surplus"] if h["kind"] == kind]
    there = {h["name"] for h in said["hosts"]}
    on_the_way = [name for name in ours if name not in there]
    more = row["wanted"] - row["there"] - len(on_the_way)
    if more >= 0:
        return more, []
    pending = on_the_way[: -more]
    return 0, pending + [name for name in surplus if name in ours and name not in pending][: -more - len(pending)]


class LocalHosts:
    """Workers that are processes of this machine."""

    def __init__(self, arguments, options):
        program = arguments.program or str(ROOT / "build" / "release" / "cloudrenderer")
        self.command = [program, "worker", "--manager", arguments.manager, *options]
        if arguments.kind:
            self.command += ["--kind", arguments.kind]
        self.folder = pathlib.Path(arguments.logs) if arguments.logs else None
        self.prefix = arguments.name or f"local-{os.getpid()}"
        self.processes = {}  # by name
        self.leaving = {}
        self.count = 0
        self.failed = 0  # since one has come

    def names(self):
        """Of those that run and were not asked to leave."""
        for group in self.processes, self.leaving:
            for name, process in list(group.items()):
                code = process.poll()
                if code is None:
                    continue
                del group[name]
                if code != 0 and group is self.processes:
                    self.failed += 1
                say(f"{name} has ended with code {code}")
        return list(self.processes)

    def start(self, n):
        for _ in range(n):
            self.count += 1
            name = f"{self.prefix}-{self.count}"
            log = open(self.folder / f"{name}.log", "w") if self.folder else subprocess.DEVNULL
            self.processes[name] = subprocess.Popen([*self.command, "--name", name], stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT)
            if self.folder:
                log.close()
            say(f"start {name}")

    def end(self, names):
        for name in names:
            process = self.leaving[name] = self.processes.pop(name)
            process.send_signal(signal.SIGTERM)
            say(f"end {name}")

    def close(self):
        self.end(self.names())
        end = time.monotonic() + GOODBYE
        while self.leaving and time.monotonic() < end:
            self.names()
            time.sleep(0.1)
        for process in self.leaving.values():
            process.kill()


class SlurmHosts:
    """Workers that are tasks of Slurm's array jobs: task K of array J is the host slurm-J-K."""

    def __init__(self, arguments, options):
        self.submit = ["sbatch", "--parsable", *options]
        self.worker = [arguments.script, arguments.manager, *([arguments.kind] if arguments.kind else [])]
        self.name = f"cloudrenderer-{arguments.kind or 'worker'}"
        self.dry_run = arguments.dry_run
        self.failed = 0  # Slurm knows
        self.ended = set()  # told to leave: a second signal would end them at once

    def run(self, command, changes=True):
        if changes:
            say(("would run " if self.dry_run else "") + shlex.join(command))
            if self.dry_run:
                return ""
        return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=60).stdout

    def names(self):
        listed = self.run(["squeue", "--me", "--noheader", "--array", f"--name={self.name}", "--states=PENDING,CONFIGURING,RUNNING",
                           "--format=%F_%K"], changes=False)
        names = ["slurm-" + line.strip().replace("_", "-") for line in listed.splitlines() if re.fullmatch(r"\d+_\d+", line.strip())]
        self.ended &= set(names)
        return [name for name in names if name not in self.ended]

    def start(self, n):
        if n > 0:
            self.run([*self.submit, f"--job-name={self.name}", f"--array=1-{min(n, LARGEST_ARRAY)}", *self.worker])

    def end(self, names):
        if not names:
            return
        tasks = ["{}_{}".format(*name.split("-")[1:]) for name in names]
        self.run(["scancel", "--state=PENDING", *tasks])
        self.run(["scancel", "--state=RUNNING", "--batch", "--signal=TERM", *tasks])
        self.ended.update(names)

    def close(self):
        pass  # who runs goes on: another scaler finds them by their name


def scale(service, hosts, kind, every, stop):
    """Until `stop` is set. A service that cannot be reached changes nothing."""
    while True:
        try:
            said = service.wanted()
            ours = hosts.names()
            if any(h["name"] in ours for h in said["hosts"]):
                hosts.failed = 0
            more, fewer = decide(said, kind, ours)
            if more or fewer:
                reasons = "; ".join(r["text"] for r in said["reasons"])
                say(f"{said['wanted']} wanted, {said['there']} there, {len(ours)} of them ours or to come ({reasons})")
            if more and hosts.failed >= ENOUGH:
                say(f"{hosts.failed} hosts have failed one after the other (--logs); in a while one is tried again")
                if stop.wait(10 * every):
                    return
                more = 1
            hosts.start(more)
            hosts.end(fewer)
        except (urllib.error.URLError, OSError, ValueError, KeyError, subprocess.SubprocessError) as fault:
            say(f"trying again: {fault}")
        if stop.wait(every):
            return


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    commands = parser.add_subparsers(dest="where", required=True)
    local, slurm = (commands.add_parser(name, allow_abbrev=False) for name in ("local", "slurm"))
    for command in local, slurm:
        command.add_argument("--service", default=os.environ.get("CLOUDRENDERER_SERVICE"), help="http://HOST:PORT of its API")
        command.add_argument("--user-token-file")
        command.add_argument("--service-ca", default=os.environ.get("CLOUDRENDERER_SERVICE_CA"),
                             help="PEM: the service's certificate, or one that it leads to")
        command.add_argument("--manager", required=True, help="HOST:PORT where the service awaits workers")
        command.add_argument("--kind", default="", help="of these hosts, as the price table names it")
        command.add_argument("--every", type=float, default=5, help="seconds between two looks")
    local.add_argument("--program", help="default: build/release/cloudrenderer")
    local.add_argument("--name", help="what the hosts' names begin with")
    local.add_argument("--logs", help="folder for the hosts' logs")
    slurm.add_argument("--script", default=str(ROOT / "docker" / "slurm" / "worker.sbatch"))
    slurm.add_argument("--dry-run", action="store_true", help="say what would be done")
    arguments, options = parser.parse_known_args()
    token = os.environ.get("CLOUDRENDERER_USER_TOKEN", "")
    if arguments.user_token_file:
        token = pathlib.Path(arguments.user_token_file).read_text().strip()
    if not arguments.service or not token:
        parser.error("--service and --user-token-file are needed, or CLOUDRENDERER_SERVICE and CLOUDRENDERER_USER_TOKEN")
    hosts = (LocalHosts if arguments.where == "local" else SlurmHosts)(arguments, options)
    stop = threading.Event()
    for number in signal.SIGINT, signal.SIGTERM:
        signal.signal(number, lambda *_: stop.set())
    scale(Service(arguments.service, token, arguments.service_ca), hosts, arguments.kind, arguments.every, stop)
    hosts.close()


if __name__ == "__main__":
    sys.exit(main())
