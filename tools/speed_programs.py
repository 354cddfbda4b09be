"""The programs that speed_error.py measures: ours, Mitsuba 3, and any pbrt; each renders the scenes of to_mitsuba.py."""
import dataclasses
import glob
import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import tempfile

import numpy as np

import measure
import write_scene

VENV = measure.ROOT / "build" / "mitsuba-venv"
HOME = measure.ROOT / "build" / "mitsuba-home"  # of Mitsuba's kernel cache
TINY = (8, 8)


@dataclasses.dataclass
class Case:
    """A converted scene."""
    name: str
    folder: pathlib.Path
    model: object
    resolution: tuple


@dataclasses.dataclass
class Sample:
    """One run; seconds of the whole process, and of the rendering alone."""
    wall: float
    cpu: float
    render_wall: float
    render_cpu: float
    picture: np.ndarray
    bad: int = 0                                     # pixels that were not finite
    phases: dict = dataclasses.field(default_factory=dict)
    report: dict | None = None


class Missing(Exception):
    """A program cannot be run here; the text says what it needs."""


class Program:
    """`identity` is part of the names of kept pictures: another binary makes its own."""
    name = identity = ""
    seeds = True          # other pictures can be asked for

    def truth_of(self):
        """Programs with the same answer share their converged picture."""
        return self.identity

    def run(self, case, spp, seed):
        raise NotImplementedError


def finite(picture):
    bad = ~np.isfinite(picture).all(axis=2)
    return np.where(bad[..., None], 0, picture), int(bad.sum())


class Process(Program):
    """A program that tells nothing of its phases: loading is what a picture of 8 x 8 pixels and one sample takes."""

    def __init__(self, path, threads, version=None, runs=3):
        self.path, self.threads, self.version, self.runs, self.starts = path, threads, version, runs, {}
        self.identity = hashlib.sha256(pathlib.Path(path).read_bytes()).hexdigest()[:16] + (version or "")

    def start_cost(self, case):
        """Wall and processor seconds, medians."""
        if case.name not in self.starts:
            runs = [self.render(case, TINY, 1, 0)[0] for _ in range(self.runs)]
            self.starts[case.name] = measure.median([r.wall for r in runs]), measure.median([r.cpu for r in runs])
        return self.starts[case.name]

    def run(self, case, spp, seed):
        start = self.start_cost(case)
        result, picture = self.render(case, case.resolution, spp, seed)
        picture, bad = finite(picture)
        return Sample(result.wall, result.cpu, max(result.wall - start[0], 1e-3), max(result.cpu - start[1], 1e-3), picture,
                      bad, {"start": list(start)}, result.report)

    def render(self, case, resolution, spp, seed):
        raise NotImplementedError


class Ours(Process):
    name = "cloudrenderer"
    options = ()  # of `render`

    def run(self, case, spp, seed):
        sample = super().run(case, spp, seed)
        said = sample.report["time"]  # what rendering alone took it says itself
        return dataclasses.replace(sample, render_wall=said["render_s"], render_cpu=said["render_cpu_s"])

    def render(self, case, resolution, spp, seed):
        with tempfile.TemporaryDirectory() as scratch:
            out = pathlib.Path(scratch, "out.exr")
            version = self.version or case.model.dialect
            result = measure.run([self.path, "render", case.folder / f"{version}.pbrt", "--dialect", version, "-o", out,
                                  "--resolution", "{}x{}".format(*resolution), "--spp", spp, "--seed", seed,
                                  "--threads", self.threads, "--hosts", 1, "--quiet", *self.options], report=True, check=True)
            return result, measure.read_rgb(out)


class Pbrt(Process):
    """`version`: v2, v3 or v4. pbrt has no seeds; more samples of a pixel go on with the same sequence."""
    seeds = False

    def __init__(self, version, path, threads, runs):
        super().__init__(path, threads, version, runs)
        self.name = f"pbrt-{version}"

    def render(self, case, resolution, spp, seed):
        out = case.folder / f"{self.version}-picture.exr"
        scene = case.folder / f"{self.version}-run.pbrt"
        scene.write_text(write_scene.PbrtText(case.model, case.folder, self.version).head(resolution, spp, out))
        out.unlink(missing_ok=True)
        result = measure.run([self.path, "--ncores" if self.version == "v2" else "--nthreads", self.threads, "--quiet",
                              "--outfile", out, scene], check=True, cwd=case.folder)
        return result, measure.read_rgb(out)


class Mitsuba(Program):
    def __init__(self, variant, threads, python):
        self.variant, self.threads, self.python = variant, threads, python
        self.name = f"mitsuba {variant}"
        self.identity = "mitsuba-" + subprocess.run([python, "-c", "import importlib.metadata as m; print(m.version('mitsuba'))"],
                                                    capture_output=True, text=True, check=True).stdout.strip()
        self.env = os.environ | {"HOME": str(HOME)}
        if variant.startswith("llvm"):
            self.env["DRJIT_LIBLLVM_PATH"] = find_llvm()

    def run(self, case, spp, seed):
        with tempfile.TemporaryDirectory() as scratch:
            out = pathlib.Path(scratch, "out.npy")
            result = measure.run([self.python, measure.ROOT / "tools" / "mitsuba_render.py", self.variant,
                                  case.folder / "scene.xml", *case.resolution, spp, seed, self.threads, out],
                                 env=self.env, check=True)
            phases = json.loads(result.output.splitlines()[-1])
            picture, bad = finite(np.load(out).astype(np.float64))
        return Sample(result.wall, result.cpu, *phases["render"], picture, bad, phases)


def find_llvm(install=False):
    def look():
        found = [p for pattern in ("/usr/lib/*/libLLVM.so.19*", "/usr/lib/*/libLLVM-19.so*",
                                   "/usr/lib/llvm-19/lib/libLLVM*.so*") for p in sorted(glob.glob(pattern))]
        return os.environ.get("DRJIT_LIBLLVM_PATH") or (found[0] if found else None)
    if not look() and install and os.geteuid() == 0:
        print("installing libllvm19", flush=True)
        subprocess.run("apt-get update -qq && apt-get install -y -qq --no-install-recommends libllvm19", shell=True,
                       stdout=subprocess.DEVNULL, env=os.environ | {"DEBIAN_FRONTEND": "noninteractive"})
    if not look():
        raise Missing("Mitsuba's llvm variant needs Debian's libllvm19 (or DRJIT_LIBLLVM_PATH)")
    return look()


def make_venv(folder, packages, install=True):
    """The Python of a virtual environment that has the packages; made from PyPI when it is not there."""
    python = folder / "bin" / "python"
    if not python.exists():
        if not install:
            raise Missing(f"{' '.join(packages)} from PyPI is not installed in {folder}")
        print(f"installing {' '.join(packages)} from PyPI in {folder}", flush=True)
        for step in (["/usr/bin/python3", "-m", "venv", folder], [python, "-m", "pip", "install", "-q", *packages]):
            done = subprocess.run(step, capture_output=True, text=True)
            if done.returncode != 0:
                shutil.rmtree(folder, ignore_errors=True)
                why = (done.stderr or done.stdout).strip().splitlines()
                raise Missing(f"{' '.join(packages)} could not be installed (Debian's python3-venv and PyPI are needed): "
                              f"{why[-1] if why else 'no reason given'}")
    return python


def find_mitsuba(variants, threads, install):
    """The variants that run here, and why others do not."""
    found, reasons = [], []
    try:
        python = make_venv(VENV, ["mitsuba", "numpy"], install)
    except Missing as why:
        return [], [f"without Mitsuba: {why}"]
    shutil.rmtree(HOME, ignore_errors=True)  # the first run compiles
    HOME.mkdir(parents=True)
    for variant in variants:
        try:
            if variant.startswith("llvm"):
                find_llvm(install)
            found.append(Mitsuba(variant, threads, python))
        except (Missing, subprocess.CalledProcessError) as why:
            reasons.append(f"without {variant}: {why}")
    return found, reasons
