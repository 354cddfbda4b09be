#!/usr/bin/env bash
# Set-up, build, and a picture of a real scene, rendered by a cluster of three hosts on this machine.
# Arguments go to `cloudrenderer render` (`tools/demo.sh --spp 256`).
set -euo pipefail
cd "$(dirname "$0")/.."

tools/setup.sh
cmake --workflow --preset release

program=build/release/cloudrenderer
out=build/demo
mkdir -p "$out"

# Parts of 768 KiB: the two killeroos become more than eight, so that the three hosts have something to share.
"$program" split scenes/killeroo/killeroo-demo.pbrt -o "$out/killeroo.split" --part-size 768KiB
"$program" render "$out/killeroo.split" -o "$out/killeroo.exr" --hosts 3 --threads 1 \
  --report "$out/report.json" "$@"

/usr/bin/python3 - "$out" <<'PYTHON'
import json, sys
import numpy as np
import OpenImageIO as oiio
out = sys.argv[1]
image = oiio.ImageBuf(f"{out}/killeroo.exr")
srgb = oiio.ImageBufAlgo.colorconvert(oiio.ImageBufAlgo.channels(image, ("R", "G", "B")), "linear", "sRGB")
srgb.set_write_format("uint8")
if not srgb.write(f"{out}/killeroo.png"):
    sys.exit(srgb.geterror())
report = json.load(open(f"{out}/report.json"))
paths = max(report["rays"]["camera"], 1)
print(f"{report['parts']['count']} parts on {len(report['hosts'])} hosts, {report['time']['wall_s']:.1f} s; "
      f"moves per path {report['rays']['moved'] / paths:.2f}, bytes on the wire per path {report['wire']['bytes_per_path']:.0f}")
print(f"The picture: {out}/killeroo.exr and {out}/killeroo.png; the report: {out}/report.json")
PYTHON
