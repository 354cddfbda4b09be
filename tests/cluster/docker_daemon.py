"""A Docker daemon of our own for a test. It lives in its own process, mount and network namespaces, so that nothing runs
and nothing stays mounted once it has ended, however that came about. Its images are kept in the build folder."""
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time

import support
from support import measure

BASE = "debian:bookworm-slim"
IMAGE = "cloudrenderer"
CACHE = support.ROOT / "build" / "docker-test"
CGROUPS = pathlib.Path("/sys/fs/cgroup")
CGROUP = "cr-docker-{}"  # the test's process id; also begins the name of its folder
TOOLS = {"dockerd": "docker.io", "docker": "docker.io", "docker-compose": "docker-compose", "debootstrap": "debootstrap",
         "unshare": "util-linux"}


def why_not():
    """Why no daemon can run here, or None."""
    if os.geteuid() != 0:
        return "a Docker daemon needs root"
    missing = sorted({package for tool, package in TOOLS.items() if shutil.which(tool) is None})
    if missing:
        return f"missing, to be had by apt-get install {' '.join(missing)}"
    return None


class Daemon:
    """`host_network`: builds reach the network. Otherwise the daemon has a network of its own, whose bridges go with it."""

    def __init__(self, host_network):
        remove_leftovers()
        self.scratch = tempfile.TemporaryDirectory(prefix=CGROUP.format(os.getpid()) + "-")
        folder = pathlib.Path(self.scratch.name)
        self.log = folder / "log"
        self.socket = folder / "socket"
        self.environment = os.environ | {"DOCKER_HOST": f"unix://{self.socket}", "DOCKER_BUILDKIT": "0",
                                         "DOCKER_CONFIG": str(folder), "COMPOSE_DOCKER_CLI_BUILD": "0"}
        namespaces = ["unshare", "--fork", "--kill-child", "--pid", "--mount-proc", "--mount"]
        if not host_network:
            namespaces.append("--net")
        # The loopback of a new network is down at first.
        inside = ["sh", "-c", 'ip link set lo up; exec "$@"', "sh"]
        daemon = ["dockerd", "--data-root", CACHE / "data", "--exec-root", folder / "exec", "-p", folder / "pid", "-H",
                  f"unix://{self.socket}", "--iptables=false", "--ip6tables=false", "--bridge=none", "--cgroup-parent",
                  f"/{CGROUP.format(os.getpid())}"]
        with open(self.log, "w") as log:
            self.child = subprocess.Popen([str(w) for w in [*namespaces, *inside, *daemon]], stdout=log,
                                          stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                                          preexec_fn=measure.die_with_parent)
        try:
            self.wait_until_ready()
        except BaseException:
            self.end()
            raise

    def wait_until_ready(self, seconds=60):
        end = time.monotonic() + seconds
        while self.run("docker", "info", check=False).returncode != 0:
            if self.child.poll() is not None or time.monotonic() > end:
                raise RuntimeError(f"the Docker daemon does not start:\n{self.log.read_text()[-3000:]}")
            time.sleep(0.2)

    def run(self, *command, check=True, timeout=120, **more):
        """A command that talks to this daemon. `more`: of subprocess.run."""
        result = subprocess.run([str(w) for w in command], env=self.environment | more.pop("env", {}), text=True,
                                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=timeout, **more)
        if check and result.returncode != 0:
            raise RuntimeError(f"exit code {result.returncode} of {' '.join(map(str, command))}:\n{result.stdout[-6000:]}")
        return result

    def start(self, log, *command, env):
        """The same in the background, its output in a file."""
        with open(log, "w") as out:
            return subprocess.Popen([str(w) for w in command], env=self.environment | env, stdout=out,
                                    stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                                    preexec_fn=measure.die_with_parent)

    def end(self):
        try:
            for pid in pathlib.Path(f"/proc/{self.child.pid}/task/{self.child.pid}/children").read_text().split():
                os.kill(int(pid), signal.SIGTERM)  # the daemon, which ends its containers first
            self.child.wait(60)
        except (OSError, subprocess.TimeoutExpired):
            self.child.kill()  # and with it all that is in its namespaces
            self.child.wait(120)
        remove_cgroups(CGROUP.format(os.getpid()))
        self.scratch.cleanup()


def remove_leftovers():
    """Control groups and folders of earlier runs of this test that were killed."""
    for path in (*CGROUPS.glob("*/" + CGROUP.format("*")), *pathlib.Path(tempfile.gettempdir()).glob(CGROUP.format("*-*"))):
        pid = path.name.split("-")[2]
        if os.path.exists(f"/proc/{pid}"):
            continue
        remove_cgroups(CGROUP.format(pid))
        if path.is_relative_to(tempfile.gettempdir()):
            shutil.rmtree(path, ignore_errors=True)


def remove_cgroups(name, seconds=20):
    """Docker leaves the group that its containers' groups were in. Their processes may take a moment to go."""
    end = time.monotonic() + seconds
    for top in (CGROUPS / name, *CGROUPS.glob(f"*/{name}")):
        for group in sorted((p for p in top.rglob("*") if p.is_dir()), key=lambda p: -len(p.parts)) + [top]:
            while group.is_dir():
                try:
                    group.rmdir()
                except OSError:
                    if time.monotonic() > end:
                        raise
                    time.sleep(0.1)


def make_base(daemon):
    """Debian as debootstrap makes it, instead of the image of that name, since no registry may be within reach."""
    if daemon.run("docker", "image", "inspect", BASE, check=False).returncode == 0:
        return
    with tempfile.TemporaryDirectory(dir=CACHE) as scratch:
        root = pathlib.Path(scratch, "root")
        daemon.run("debootstrap", "--variant=minbase", "bookworm", root, timeout=600)
        daemon.run("sh", "-c", 'tar -C "$1" -c . | docker import - "$2"', "sh", root, BASE, timeout=300)


def build_image():
    """Builds the image with the network of this machine; unchanged steps come from the cache."""
    CACHE.mkdir(parents=True, exist_ok=True)
    daemon = Daemon(host_network=True)
    try:
        make_base(daemon)
        daemon.run("docker", "build", "--network", "host", "-t", IMAGE, "-f", support.ROOT / "docker" / "Dockerfile",
                   support.ROOT, timeout=3000)
    finally:
        daemon.end()
