"""What the benchmark and test scripts share: running the program with its resource use, reading and comparing pictures."""
import ctypes
import dataclasses
import json
import os
import pathlib
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np
import OpenImageIO as oiio

ROOT = pathlib.Path(__file__).resolve().parent.parent
DEFAULT_PROGRAM = pathlib.Path(os.environ.get("CLOUDRENDERER", ROOT / "build" / "release" / "cloudrenderer"))
DEFAULT_SHARED = pathlib.Path(os.environ.get("CLOUDRENDERER_SHARED", ROOT.parent / "shared"))
SKIPPED = 77  # exit code that ctest counts as "skipped"


@dataclasses.dataclass
class Run:
    code: int
    wall: float
    cpu: float      # user and system time of the process and of the children that it waited for
    max_rss: int    # bytes, of the largest of them
    output: str     # stdout and stderr
    report: dict | None = None


def die_with_parent():
    """For preexec_fn: the child is killed when this script is, so that a test that runs out of time leaves nothing."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL, 0, 0, 0)  # PR_SET_PDEATHSIG


def run(command, report=False, timeout=3600, check=False, env=None, cwd=None, watch=None):
    """Runs a command to its end. With `report`, adds --report and reads it. With `check`, a failure ends the script.
    `watch` is called with the process id, in a thread, twenty times a second while it runs."""
    command = [str(word) for word in command]
    with tempfile.TemporaryDirectory() as scratch:
        report_path = pathlib.Path(scratch, "report.json")
        if report:
            command += ["--report", str(report_path)]
        with open(pathlib.Path(scratch, "output"), "w+", errors="replace") as output:
            start = time.monotonic()
            child = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                                     env=env, cwd=cwd, start_new_session=True, preexec_fn=die_with_parent)
            timed_out = threading.Event()

            def stop():
                timed_out.set()
                os.killpg(child.pid, signal.SIGKILL)

            ended = threading.Event()

            def look():
                while not ended.wait(0.05):
                    watch(child.pid)

            watcher = threading.Thread(target=look) if watch else None
            if watcher:
                watcher.start()
            timer = threading.Timer(timeout, stop)
            timer.start()
            _, status, usage = os.wait4(child.pid, 0)
            timer.cancel()
            ended.set()
            if watcher:
                watcher.join()
            wall = time.monotonic() - start
            child.returncode = os.waitstatus_to_exitcode(status)
            output.seek(0)
            text = output.read()
        if timed_out.is_set():
            text += f"\n(ended after {timeout} s)"
        result = Run(child.returncode, wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024, text)
        if report and report_path.exists():
            result.report = json.loads(report_path.read_text())
    if check and (result.code != 0 or (report and result.report is None)):
        sys.exit(f"exit code {result.code} of: {' '.join(command)}\n{result.output}")
    return result


def read_rgb(path):
    """Height x width x 3, in double precision."""
    file = oiio.ImageInput.open(str(path))
    if not file:
        raise OSError(f"cannot open {path}: {oiio.geterror()}")
    spec = file.spec()
    data = np.asarray(file.read_image("float")).reshape(spec.height, spec.width, spec.nchannels)
    names = list(spec.channelnames)
    file.close()
    return data[:, :, [names.index(c) if c in names else k for k, c in enumerate("RGB")]].astype(np.float64)


@dataclasses.dataclass
class Comparison:
    relmse: float
    trimmed: float       # without the worst 0.1 % of the pixels
    mean_ratio: list     # per channel, without the reference's brightest 0.5 % of the pixels
    identical: bool


def compare(image, reference):
    """Of an image against its reference; both as read_rgb gives them. A NaN in the image is an error."""
    if image.shape != reference.shape:
        raise ValueError(f"the sizes differ: {image.shape} and {reference.shape}")
    if not np.isfinite(image).all():
        raise ValueError("NaN or infinity in the image")
    good = np.isfinite(reference).all(axis=2)  # a few references hold bad pixels
    a, b = image[good], reference[good]
    error = (a - b) ** 2 / (b * b + 0.01)
    by_pixel = np.sort(error.mean(axis=1))
    brightest = b.max(axis=1)
    normal = brightest <= np.percentile(brightest, 99.5)
    ratio = a[normal].mean(axis=0) / np.maximum(b[normal].mean(axis=0), 1e-9)
    return Comparison(error.mean(), by_pixel[: int(len(by_pixel) * 0.999)].mean(), ratio.tolist(),
                      bool(np.array_equal(image, reference)))


def median(values):
    return statistics.median(values)


def table(header, rows):
    """Prints columns, numbers to the right."""
    cells = [[str(c) for c in row] for row in [header] + rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    for row in cells:
        print("  ".join(c.ljust(w) if k == 0 else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths))), flush=True)


def add_program_option(parser):
    parser.add_argument("--program", type=pathlib.Path, default=DEFAULT_PROGRAM, help="the cloudrenderer binary")


def require_program(path):
    if not os.access(path, os.X_OK):
        sys.exit(f"{path} is not there; build it with: cmake --workflow --preset release")


def require_shared(path):
    """Ends the script as skipped, aloud, when the folder of reference scenes is missing."""
    if not (path / "scenes").is_dir():
        print(f"SKIPPED: no folder of reference scenes at {path} (--shared DIR)", flush=True)
        sys.exit(SKIPPED)
