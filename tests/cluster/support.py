"""A cluster of real processes for the tests: starts managers and workers on the loopback, and leaves none behind."""
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest
import uuid

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))
import measure  # noqa: E402

PROGRAM = measure.DEFAULT_PROGRAM
SCENE = ROOT / "scenes" / "killeroo" / "killeroo-path.pbrt"
MARK = "CLOUDRENDERER_TEST"


def main():
    """Takes the program as the first argument, the rest is unittest's."""
    global PROGRAM
    if len(sys.argv) > 1 and not sys.argv[1].startswith("-"):
        PROGRAM = pathlib.Path(sys.argv.pop(1))
    measure.require_program(PROGRAM)
    unittest.main(module="__main__", verbosity=2)


def free_ports(count):
    """Ports that nobody listens on just now."""
    sockets = [socket.socket() for _ in range(count)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return ports


def json_of(path):
    return json.loads(pathlib.Path(path).read_text())


def wait_until_listening(port, seconds=20):
    """True when somebody listens; looks at the kernel's table, so that no connection is made."""
    wanted = f"0100007F:{port:04X}", f"00000000:{port:04X}"
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for line in pathlib.Path("/proc/net/tcp").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[1] in wanted and fields[3] == "0A":
                return True
        time.sleep(0.05)
    return False


class Process:
    """A running program whose output goes to a file. `prefix`: a command that becomes the program (`ip netns exec`)."""

    def __init__(self, name, arguments, folder, mark, prefix=(), program=None):
        self.name = name
        self.log = folder / f"{name}.log"
        with open(self.log, "w") as log:
            self.child = subprocess.Popen([str(a) for a in [*prefix, program or PROGRAM, *arguments]], stdout=log, stderr=subprocess.STDOUT,
                                          stdin=subprocess.DEVNULL, env=os.environ | {MARK: mark},
                                          preexec_fn=measure.die_with_parent)

    @property
    def pid(self):
        return self.child.pid

    def running(self):
        return self.child.poll() is None

    def wait(self, seconds):
        """The exit code, or None when it still runs."""
        try:
            return self.child.wait(seconds)
        except subprocess.TimeoutExpired:
            return None

    def kill(self, number=signal.SIGKILL):
        if self.running():
            self.child.send_signal(number)

    def text(self):
        return self.log.read_text(errors="replace")


class ClusterTest(unittest.TestCase):
    """A test with a folder and processes of its own. Fails when a process of it is left behind."""

    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)
        self.mark = uuid.uuid4().hex
        self.processes = []
        self.addCleanup(self.end_all)

    def end_all(self):
        for process in self.processes:
            process.kill()
            process.child.wait()

    def left_behind(self, seconds=5):
        """Ids of the processes of this test, grandchildren too, that are still there after some time."""
        end = time.monotonic() + seconds
        while True:
            found = [pid for pid in map(int, filter(str.isdigit, os.listdir("/proc"))) if self.is_ours(pid)]
            if not found or time.monotonic() > end:
                return found
            time.sleep(0.1)

    def is_ours(self, pid):
        try:
            environment = pathlib.Path(f"/proc/{pid}/environ").read_bytes()
            state = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return False
        return state != "Z" and f"{MARK}={self.mark}".encode() in environment.split(b"\0")

    def assert_none_left(self):
        left = self.left_behind()
        for pid in left:  # not to disturb the tests that follow
            os.kill(pid, signal.SIGKILL)
        self.assertEqual(left, [], "processes were left behind")

    def start(self, name, *arguments, prefix=()):
        process = Process(name, arguments, self.folder, self.mark, prefix)
        self.processes.append(process)
        return process

    def run_program(self, *arguments, report=False, timeout=120):
        result = measure.run([PROGRAM, *arguments], report=report, timeout=timeout,
                             env=os.environ | {MARK: self.mark})
        self.assert_none_left()
        return result

    def render(self, name, *arguments, timeout=120):
        """Renders to a picture and gives its pixels and the report."""
        out = self.folder / f"{name}.exr"
        result = self.run_program("render", *arguments, "-o", out, "--quiet", report=True, timeout=timeout)
        self.assertEqual(result.code, 0, result.output)
        return measure.read_rgb(out), result.report

    def spp_for_frame(self, seconds, scene, size, most=4096):
        """A sample count that keeps two processors busy for at least so long. By processor time: what others do on this
        machine does not make the frame too short."""
        few, many = (self.render("probe", scene, "--spp", spp, "--resolution", size, "--threads", 2)[1]["time"]["cpu_s"]
                     for spp in (1, 65))
        return max(16, min(most, int(64 * 2 * seconds / max(many - few, 0.01))))

    def split(self, scene=SCENE, part_size="512KiB"):
        folder = self.folder / "split"
        result = self.run_program("split", scene, "-o", folder, "--part-size", part_size)
        self.assertEqual(result.code, 0, result.output)
        return folder

    def start_manager(self, scene, out, port, *options):
        manager = self.start("manager", "manager", scene, "-o", out, "--listen", f"127.0.0.1:{port}", "--report",
                             self.folder / "report.json", *options)
        self.assertTrue(wait_until_listening(port), f"the manager does not listen: {manager.text()}")
        return manager

    def start_worker(self, name, manager_port, port, memory, *options):
        return self.start(name, "worker", "--manager", f"127.0.0.1:{manager_port}", "--listen", f"127.0.0.1:{port}",
                          "--threads", 1, "--memory", memory, "--name", name, *options)

    def wait_until_all_joined(self, manager_port, workers, seconds=20):
        """Waits until every worker has a connection of its own to the manager."""
        end = time.monotonic() + seconds
        wanted = f"0100007F:{manager_port:04X}"
        while time.monotonic() < end:
            table = [line.split() for line in pathlib.Path("/proc/net/tcp").read_text().splitlines()[1:]]
            if sum(row[2] == wanted and row[3] == "01" for row in table) >= workers:
                return
            time.sleep(0.05)
        self.fail(f"{workers} workers did not connect to the manager:\n{self.logs()}")

    def logs(self):
        return "\n".join(f"--- {p.name} ({p.child.poll()})\n{p.text()[-3000:]}" for p in self.processes)
