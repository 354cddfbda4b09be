"""Hosts with a fixed share of processor on one machine: control groups with a quota (cgroup v1 and v2)."""
import os
import pathlib
import subprocess
import tempfile

PERIOD_US = 10_000  # short, so that a host that waits for another does not wait for its period too
FIRST = 100  # the weight of groups that come before others on a busy machine


class NotPermitted(Exception):
    """There is no cpu controller that this process may use; the text says why."""


def _mounted():
    """(version, folder) of every mounted hierarchy that may have the cpu controller."""
    for line in pathlib.Path("/proc/self/mounts").read_text().splitlines():
        _, folder, kind, options = line.split()[:4]
        if kind == "cgroup" and "cpu" in options.split(","):
            yield 1, pathlib.Path(folder)
        elif kind == "cgroup2":
            yield 2, pathlib.Path(folder)


def _own_path(version):
    """The group that this process is in, as a path below the hierarchy."""
    for line in pathlib.Path("/proc/self/cgroup").read_text().splitlines():
        number, controllers, path = line.split(":", 2)
        if (number == "0" and not controllers) if version == 2 else "cpu" in controllers.split(","):
            return path.lstrip("/")
    return ""


class Groups:
    """A context in which command lines can be started with a share of a core. Its processes must have ended when it
    does. Raises NotPermitted."""

    def __init__(self):
        self.made = []
        self.mounted_here = None
        reasons = []
        for version, folder in _mounted():
            try:
                self._try(version, folder)
                return
            except OSError as error:
                reasons.append(f"cgroup v{version} at {folder}: {error}")
        self._mount(reasons)

    def _try(self, version, folder):
        own = folder / _own_path(version)
        self.version, self.parent = version, own if own.is_dir() else folder
        if version == 2:
            if "cpu" not in (self.parent / "cgroup.controllers").read_text().split():
                raise OSError("it has no cpu controller")
            (self.parent / "cgroup.subtree_control").write_text("+cpu")
        self.group(1)  # may it be done at all?

    def _mount(self, reasons):
        """The controller may be there without being mounted."""
        folder = tempfile.mkdtemp(prefix="cloudrenderer-cgroup-")
        done = subprocess.run(["mount", "-t", "cgroup", "-o", "cpu", "none", folder], capture_output=True, text=True)
        if done.returncode == 0:
            self.mounted_here = pathlib.Path(folder)
            try:
                return self._try(1, self.mounted_here)
            except OSError as error:
                reasons.append(f"cgroup v1 at {folder}: {error}")
            self.close()
        else:
            os.rmdir(folder)
            reasons.append(f"mounting it: {done.stderr.strip()}")
        raise NotPermitted("no cpu controller for quotas: " + "; ".join(reasons))

    def group(self, cores, weight=1):
        """A new group whose processes get so many cores together at most, and the weight of so many others where all want more."""
        folder = self.parent / f"cloudrenderer-{os.getpid()}-{len(self.made)}"
        folder.mkdir()
        self.made.append(folder)
        quota = max(1000, int(cores * PERIOD_US))
        period = max(PERIOD_US, int(quota / cores))
        if self.version == 2:
            (folder / "cpu.max").write_text(f"{quota} {period}")
            (folder / "cpu.weight").write_text(str(100 * weight))
        else:
            (folder / "cpu.cfs_period_us").write_text(str(period))
            (folder / "cpu.cfs_quota_us").write_text(str(quota))
            (folder / "cpu.shares").write_text(str(1024 * weight))
        return folder

    @staticmethod
    def enter(group):
        """For preexec_fn: the process and its children belong to the group."""
        (group / "cgroup.procs").write_text(str(os.getpid()))

    def close(self):
        for folder in self.made:
            folder.rmdir()
        self.made = []
        if self.mounted_here:
            subprocess.run(["umount", str(self.mounted_here)], check=True)
            self.mounted_here.rmdir()
            self.mounted_here = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
