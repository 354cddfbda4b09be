#!/usr/bin/python3
"""Processor time of cloudrenderer against Mitsuba 3 on the same scene, at equal samples, measured in turn in one run.

The scene is killeroo-path at 700 x 700, path depth 5 in pbrt-v2's counting (Mitsuba's max_depth 7). Mitsuba comes from
PyPI into a virtual environment under build/; its llvm variant needs Debian's libllvm19 (installed when run as root).
"""
import argparse
import glob
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

import numpy as np

import measure

SCENE = measure.ROOT / "scenes" / "killeroo" / "killeroo-path.pbrt"
GEOMETRY = measure.ROOT / "scenes" / "killeroo" / "geometry" / "killeroo.pbrt"
VENV = measure.ROOT / "build" / "mitsuba-venv"
HOME = measure.ROOT / "build" / "mitsuba-home"  # of Mitsuba's kernel cache
PBRT_V2_RELMSE = 0.0018  # of pbrt-v2 at 64 samples against the reference of killeroo-path


def find_llvm():
    def look():
        found = [p for pattern in ("/usr/lib/*/libLLVM.so.19*", "/usr/lib/*/libLLVM-19.so*",
                                   "/usr/lib/llvm-19/lib/libLLVM*.so*") for p in sorted(glob.glob(pattern))]
        return os.environ.get("DRJIT_LIBLLVM_PATH") or (found[0] if found else None)
    if not look() and os.geteuid() == 0:
        print("installing libllvm19", flush=True)
        subprocess.run("apt-get update -qq && apt-get install -y -qq --no-install-recommends libllvm19", shell=True,
                       check=True, stdout=subprocess.DEVNULL, env=os.environ | {"DEBIAN_FRONTEND": "noninteractive"})
    return look() or sys.exit("Mitsuba's llvm variant needs libllvm19; install it or set DRJIT_LIBLLVM_PATH")


def prepare_mitsuba():
    python = VENV / "bin" / "python"
    if not python.exists():
        print("installing Mitsuba from PyPI under build/", flush=True)
        if subprocess.run(["/usr/bin/python3", "-m", "venv", VENV]).returncode != 0:
            sys.exit("a virtual environment needs Debian's python3-venv")
        subprocess.run([python, "-m", "pip", "install", "-q", "mitsuba", "numpy"], check=True)
    shutil.rmtree(HOME, ignore_errors=True)  # the first run compiles
    HOME.mkdir(parents=True)
    return python


class Mitsuba:
    def __init__(self, threads):
        self.threads = threads
        self.env = os.environ | {"DRJIT_LIBLLVM_PATH": find_llvm(), "HOME": str(HOME)}
        self.python = prepare_mitsuba()

    def render(self, variant, width, spp):
        """Wall and processor seconds of its phases, and the picture."""
        with tempfile.TemporaryDirectory() as scratch:
            out = pathlib.Path(scratch, "out.npy")
            result = measure.run([self.python, measure.ROOT / "tools" / "mitsuba_killeroo.py", variant, GEOMETRY, width,
                                  spp, self.threads, out], env=self.env, check=True)
            return json.loads(result.output.splitlines()[-1]), np.load(out).astype(np.float64)


class Ours:
    def __init__(self, program, threads):
        self.program, self.threads = program, threads

    def render(self, width, spp, seed=0):
        with tempfile.TemporaryDirectory() as scratch:
            out = pathlib.Path(scratch, "out.exr")
            result = measure.run([self.program, "render", SCENE, "-o", out, "--resolution", f"{width}x{width}", "--spp",
                                  spp, "--threads", self.threads, "--hosts", 1, "--seed", seed, "--quiet"],
                                 report=True, check=True)
            return result, measure.read_rgb(out)


def equal_samples(args, ours, mitsuba):
    rows, pictures = {"ours": [], "llvm_ad_rgb": [], "scalar_rgb": []}, {}
    phases = []
    for turn in range(args.runs):
        result, pictures["ours"] = ours.render(args.width, args.spp)
        rows["ours"].append((result.cpu, result.wall, result.report["time"]["render_s"]))
        for variant in ("llvm_ad_rgb", "scalar_rgb"):
            if variant == "scalar_rgb" and turn >= args.scalar_runs:
                continue
            found, pictures[variant] = mitsuba.render(variant, args.width, args.spp)
            if variant == "llvm_ad_rgb":
                phases.append(found)
            rows[variant].append((found["render"][1], found["render"][0], found["render"][0]))
        print(f"  turn {turn + 1}: " + ", ".join(f"{name} {times[-1][0]:.2f} s" for name, times in rows.items() if times),
              flush=True)
    cpu = {name: measure.median([t[0] for t in times]) for name, times in rows.items() if times}
    measure.table(["renderer", "runs", "processor s", "wall s", "ours / it"],
                  [[name, len(times), f"{cpu[name]:.2f}", f"{measure.median([t[1] for t in times]):.2f}",
                    f"{cpu['ours'] / cpu[name]:.3f}"] for name, times in rows.items() if times])
    rays = result.report["rays"]
    print(f"ours is the whole process, loading included (render alone {measure.median([t[2] for t in rows['ours']]):.2f} s "
          f"wall); {sum(rays[k] for k in ('camera', 'bounce', 'shadow')) / 1e6:.1f} M rays. Mitsuba is the render call "
          f"alone; not counted: compiling {phases[0]['compile'][1]:.2f} s the first time, "
          f"{measure.median([p['compile'][1] for p in phases]):.2f} s from its cache (with one sample a pixel), "
          f"loading {measure.median([p['load'][1] for p in phases]):.2f} s")
    ratio = pictures["ours"].mean(axis=(0, 1)) / pictures["llvm_ad_rgb"].mean(axis=(0, 1))
    print("mean of ours / Mitsuba's, by channel (other plastic models): " + " ".join(f"{r:.3f}" for r in ratio))
    return cpu


def equal_error(args, ours, mitsuba, cpu):
    """relMSE at 200 x 200 and the same samples, each against its own converged picture; time x error."""
    _, truth = mitsuba.render("llvm_ad_rgb", 200, args.truth_spp)
    _, sample = mitsuba.render("llvm_ad_rgb", 200, args.spp)
    theirs = measure.compare(sample, truth).trimmed
    _, own_truth = ours.render(200, args.truth_spp, seed=1)
    result, picture = ours.render(200, args.spp)
    own = measure.compare(picture, own_truth).trimmed
    print(f"relMSE at 200 x 200, {args.spp} spp, against the own picture at {args.truth_spp}: ours {own:.5f} "
          f"(it estimates {result.report['error']['estimated_relmse']:.5f}), Mitsuba {theirs:.5f}")
    print(f"faster than llvm_ad_rgb at equal error: {cpu['llvm_ad_rgb'] * theirs / (cpu['ours'] * own):.2f} x")
    reference = args.shared / "references" / "v2" / "killeroo-path.exr"
    if reference.exists():
        found = measure.compare(picture, measure.read_rgb(reference))
        print(f"against pbrt-v2's reference of killeroo-path at {args.spp} spp: ours {found.trimmed:.5f}, "
              f"pbrt-v2 itself at 64 spp {PBRT_V2_RELMSE}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measure.add_program_option(parser)
    parser.add_argument("--shared", type=pathlib.Path, default=measure.DEFAULT_SHARED, help="folder of reference scenes")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--scalar-runs", type=int, default=1)
    parser.add_argument("--width", type=int, default=700)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--truth-spp", type=int, default=4096, help="of the pictures that errors are measured against")
    parser.add_argument("--no-error", action="store_true", help="equal samples only")
    args = parser.parse_args()
    measure.require_program(args.program)
    ours, mitsuba = Ours(args.program, args.threads), Mitsuba(args.threads)
    cpu = equal_samples(args, ours, mitsuba)
    if not args.no_error:
        equal_error(args, ours, mitsuba, cpu)


if __name__ == "__main__":
    main()
