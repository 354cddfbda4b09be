#!/usr/bin/python3
"""check_layers.py [ROOT]: includes point down only. Exit 1 and one line per offence; long files are only warned about.

A header include links cleanly whatever the libraries say, so the layers are checked on the text of the files.
"""
import pathlib
import re
import sys

LAYERS = "base images scene shapes parts trace shading film integrator wire tasks simulate net cluster web service cli".split()
RANK = {name: rank for rank, name in enumerate(LAYERS)}
# Libraries that only some layers may name.
FENCED = [
    (re.compile(r"OpenImageIO/"), {"images"}),
    (re.compile(r"embree[34]/|rtcore"), {"trace"}),
    (re.compile(r"asio(\.hpp|/)|boost/asio"), {"net", "cluster", "web", "service"}),
    (re.compile(r"httplib|prometheus/"), {"web", "service"}),
    (re.compile(r"sqlite3"), {"service"}),
    (re.compile(r"CLI/|CLI11"), {"cli"}),
]
# What the public headers may not name, besides everything in src/.
PUBLIC_FORBIDDEN = re.compile(r"embree|rtcore|asio|\.pb\.h|google/protobuf")
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
LONGEST = 500


def offences(path, layer, text):
    """Yields (line number, message) for every include of a file that its layer (None: a public header) may not have."""
    for number, line in enumerate(text.splitlines(), 1):
        match = INCLUDE.match(line)
        if not match:
            continue
        quoted, name = match.group(1) == '"', match.group(2)
        first = name.split("/")[0]
        if layer is None:
            if first in RANK or PUBLIC_FORBIDDEN.search(name):
                yield number, f"a public header may not include {name}"
            continue
        for pattern, allowed in FENCED:
            if pattern.search(name) and layer not in allowed:
                yield number, f"{name} belongs to {', '.join(sorted(allowed))} only, not to {layer}"
        if first in RANK and RANK[first] > RANK[layer]:
            yield number, f"{layer} is below {first} and may not include {name}"
        if quoted and "/" not in name and not name.endswith(".pb.h") and (path.parent / name).exists():
            yield number, f'include "{layer}/{name}", not "{name}": names start at the layer'


def source_files(root):
    for folder in ("include", "src", "tests", "tools"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".h", ".hpp", ".cpp", ".cc", ".py") and path.is_file():
                yield folder, path


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).resolve().parent.parent)
    bad = checked = 0
    for folder, path in source_files(root):
        text = path.read_text(encoding="utf-8")
        shown = path.relative_to(root)
        lines = text.count("\n")
        if lines > LONGEST:
            print(f"{shown}:{LONGEST}: warning: {lines} lines; wants to be two files")
        if folder not in ("include", "src") or path.suffix == ".py":
            continue
        checked += 1
        layer = None if folder == "include" else path.relative_to(root / "src").parts[0]
        if layer is not None and layer not in RANK and path.parent != root / "src":
            print(f"{shown}:1: error: src/{layer} is not a layer; the order of layers stands in check_layers.py")
            bad += 1
            continue
        # A file directly in src/ (main.cpp) sees everything.
        for number, message in offences(path, layer if layer in RANK or layer is None else "cli", text):
            print(f"{shown}:{number}: error: {message}")
            bad += 1
    print(f"{checked} files checked, {bad} includes that point up")
    return 1 if bad or checked == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
