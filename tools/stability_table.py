#!/usr/bin/python3
"""Runs the stability tests and prints what they bound and measured as a markdown table; exit 1 if a bound is not met.

    tools/stability_table.py                       the counts of the ordinary tests
    tools/stability_table.py --full                millions of rays a case: minutes
    tools/stability_table.py --full --into README.md   replaces what stands between the two marks in that file
"""
import argparse
import datetime
import os
import pathlib
import platform
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "build" / "release" / "tests" / "stability" / "stability_tests"
BEGIN, END = "<!-- stability table -->", "<!-- end of the stability table -->"


def run(program, full, pattern):
    """The rows that the tests wrote, and whether all of them passed."""
    with tempfile.TemporaryDirectory() as folder:
        table = pathlib.Path(folder, "rows.tsv")
        environment = dict(os.environ, CLOUDRENDERER_STABILITY_TABLE=str(table))
        environment.pop("CLOUDRENDERER_STABILITY", None)
        if full:
            environment["CLOUDRENDERER_STABILITY"] = "full"
        result = subprocess.run([program, "--gtest_brief=1", f"--gtest_filter={pattern}"], env=environment,
                                stdout=subprocess.PIPE, text=True)
        if result.returncode != 0:
            print(result.stdout, file=sys.stderr)
        rows = [line.split("\t") for line in table.read_text().splitlines()] if table.exists() else []
    return rows, result.returncode == 0


def processor():
    for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def markdown(rows):
    lines = ["| case | bounded | bound | measured | tries |", "|---|---|---|---|---|"]
    for case, quantity, bound, measured, count, kind in rows:
        mark = " (limit)" if kind == "limit" else "" if float(measured) <= float(bound) else " **not met**"
        lines.append(f"| {case} | {quantity} | {bound}{mark} | {measured} | {int(count):,} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=pathlib.Path, default=PROGRAM)
    parser.add_argument("--full", action="store_true", help="the counts of the slow test")
    parser.add_argument("--filter", default="*-Record.*", help="gtest's filter")
    parser.add_argument("--into", type=pathlib.Path, help="a file with the two marks that the table goes between")
    args = parser.parse_args()
    rows, passed = run(args.program, args.full, args.filter)
    if not rows:
        raise SystemExit(f"{args.program} wrote no row: was expected to, for the tests {args.filter}")
    text = markdown(rows)
    if args.into:
        options = " --full" if args.full else ""
        note = f"Made by `tools/stability_table.py{options}` on {processor()}, {datetime.date.today()}."
        old = args.into.read_text()
        if BEGIN not in old or END not in old:
            raise SystemExit(f"{args.into}: expected the lines {BEGIN} and {END}")
        head, rest = old.split(BEGIN, 1)
        args.into.write_text(f"{head}{BEGIN}\n{note}\n\n{text}\n{END}{rest.split(END, 1)[1]}")
    else:
        print(text)
    sys.exit(0 if passed else 1)


if __name__ == "__main__":
    main()
