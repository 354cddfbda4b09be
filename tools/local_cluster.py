"""A manager and workers on this machine, every worker with a fixed share of a core: what the cluster benchmarks share."""
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import measure
import quota


def start(arguments, log, group=None):
    def enter():
        measure.die_with_parent()
        if group:
            quota.Groups.enter(group)
    return subprocess.Popen([str(a) for a in arguments], stdout=log, stderr=subprocess.STDOUT,
                            stdin=subprocess.DEVNULL, preexec_fn=enter)


def listening(path, manager):
    """The address that the manager says it listens on."""
    end = time.monotonic() + 30
    while time.monotonic() < end and manager.poll() is None:
        found = re.search(r"listening on (\S+:\d+)", path.read_text(errors="replace"))
        if found:
            return found.group(1)
        time.sleep(0.02)
    sys.exit(f"the manager does not listen:\n{path.read_text(errors='replace')}")


def processor_ticks():
    """(all, idle) of the machine since it started."""
    ticks = [int(t) for t in pathlib.Path("/proc/stat").read_text().splitlines()[0].split()[1:9]]
    return sum(ticks), ticks[3] + ticks[4]


def render(program, scene, shares, options, memory, timeout):
    """One frame by workers of one thread with these shares of a core: the report, and the picture in it."""
    with tempfile.TemporaryDirectory() as scratch, quota.Groups() as groups:
        folder = pathlib.Path(scratch)
        log = folder / "manager.log"
        processes = []
        with open(log, "w") as out:
            manager = start([program, "manager", scene, "-o", folder / "out.exr", "--listen", "127.0.0.1:0", "--min-hosts",
                             len(shares), "--report", folder / "report.json", "--quiet", *options], out, groups.group(1, quota.FIRST))
        try:
            before = processor_ticks()
            address = listening(log, manager)
            for number, share in enumerate(shares):
                with open(folder / f"worker{number}.log", "w") as out:
                    processes.append(start([program, "worker", "--manager", address, "--threads", 1, "--memory", memory,
                                            "--name", f"worker{number}"], out, groups.group(share, quota.FIRST)))
            code = manager.wait(timeout)
            after = processor_ticks()
            for process in processes:
                process.wait(30)
        except subprocess.TimeoutExpired:
            code = "it hangs"
        finally:
            for process in [manager, *processes]:
                process.kill()
                process.wait()
        if code != 0:
            sys.exit(f"a render failed ({code}):\n" + "\n".join(p.read_text() for p in sorted(folder.glob("*.log"))))
        report = json.loads((folder / "report.json").read_text())
        report["picture"] = measure.read_rgb(folder / "out.exr")
        report["idle"] = (after[1] - before[1]) / max(1, after[0] - before[0])
        return report
