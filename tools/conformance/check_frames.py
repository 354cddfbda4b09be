#!/usr/bin/env python3
"""Reads the recorded frames with the codec of tools/python_host, and compares with what frames.json says of them.

A codec in another language is tested in the same way. frames.json has an entry a frame: type and link fields, the control
part as protobuf's JSON (64-bit numbers are strings, bytes base64), and the columns, value by value; "inf" is infinity.
"""
import json
import pathlib
import sys

import numpy as np
from google.protobuf import json_format

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "python_host"))
import frames  # noqa: E402

FOLDER = pathlib.Path(__file__).parent / "frames"


def layout(name, c):
    """(column, type, numbers an entry, entries) of the bulk. "i5": two's complement of five bytes."""
    if name == "PathEnds":
        def whose(what, n):
            return [(what + "task", "<u4", 1, n), (what + "pixel", "<u4", 1, n), (what + "sample", "<u4", 1, n),
                    (what + "owner", "<u2", 1, n), (what + "flags", "<u2", 1, n)]
        seen = whose("features ", c.features) + [("features ids", "<u4", 3, c.features),
                                                 ("features values", f"i{c.feature_bytes}", 10, c.features)]
        lit = [("splats end", "<u4", 1, c.splats), ("splats target", "<u4", 1, c.splats), ("splats light", f"i{c.splat_bytes}", 3, c.splats)]
        return (whose("", c.count) + [("radiance", f"i{c.radiance_bytes}", 3, c.count)] + (seen if c.features else []) +
                (lit if c.splats else []))
    if name == "Reply":
        words = -(-c.count // 64)
        if c.refused:
            return []
        if c.category == frames.pb.TRACER:
            return [("accepted", "<u8", 1, words), ("tested", "<u8", 1, c.misses)] + [("windows", "<u2", 1, c.misses)] * c.windows
        if c.category == frames.pb.RENDERER:
            n = c.count * (2 if c.negative_lobes else 1)
            lit = [("splats pixel", "<u4", 1, c.splats), ("splats sums", f"i{c.splat_bytes}", 6, c.splats)]
            return [("counts", "<u4", 2, n), ("sums", f"i{c.sum_bytes}", 6, n)] + (lit if c.splats else [])
        if not c.nearest:
            return [("blocked", "<u8", 1, words)]
        return ([("found", "<u8", 1, words), ("t", "<f4", 1, c.hits), ("uv", "<f4", 2, c.hits), ("shape", "<u4", 1, c.hits),
                 ("primitive", "<u4", 1, c.hits), ("corners", "<f4", 9, c.hits)] + [("normals", "<f4", 9, c.hits)] * c.normals +
                [("uvs", "<f4", 6, c.hits)] * c.uvs +
                [("material", "<u4", 1, c.hits), ("light", "<u4", 1, c.hits), ("flags", "<u2", 1, c.hits)])
    if name != "SubmitTask" or c.category == frames.pb.RENDERER:
        return []
    n = c.count
    if c.category == frames.pb.INTERSECTION:
        return [("rays", "<f4", 7, n)] + [("times", "<f4", 1, n)] * c.times
    has = [bool(c.columns >> bit & 1) for bit in range(5)]
    return ([("origin", "<f4", 3, n), ("direction", "<f4", 3, n), ("throughput", "<f4", 3, n), ("previous_pdf", "<f4", 1, n),
             ("radiance", f"i{c.radiance_bytes}", 3, n)] + [("previous_normal", "<f4", 3, n)] * has[2] + [("best_hit", "hit", 3, n)] * has[0] +
            [("tested", "<u8", 1, n), ("window", "<u2", 1, n)] * has[1] + [(x, "<u4", 1, n) for x in ("task", "pixel", "sample")] +
            [(x, "<u2", 1, n) for x in ("owner", "vertex", "flags", "passed")] + [("cone", "<f4", 2, n)] * has[3] +
            [("medium", "<u2", 1, n)] * has[4])


def columns(name, control, bulk):
    at, found = 0, {}
    for column, kind, width, entries in layout(name, control):
        if kind[0] == "i":
            size = int(kind[1:])
            values = [int.from_bytes(bulk[at + i * size:at + (i + 1) * size], "little", signed=True) for i in range(width * entries)]
            at += size * width * entries
        elif kind == "hit":
            rows = np.frombuffer(bulk, "<f4,<u4,<u4", entries, at)
            values = [x for row in rows for x in row.tolist()]
            at += 12 * entries
        else:
            values = np.frombuffer(bulk, kind, width * entries, at).tolist()
            at += int(kind[2]) * width * entries
        found[column] = values
    return found, at


def flat(values):
    if isinstance(values, list):
        return [x for v in values for x in flat(v)]
    return [float("inf") if values == "inf" else values]


def check(entry):
    data = (FOLDER / entry["file"]).read_bytes()
    size, link = frames.decode_header(data[:frames.HEADER_BYTES])
    payload = data[frames.HEADER_BYTES:]
    assert size == len(payload), "the length does not fit"
    assert link._asdict() == entry["link"], link
    message = frames.decode(payload)
    assert message.name == entry["message"] and frames.NAMES.index(message.name) == entry["type"], message.name
    wanted = json_format.ParseDict(entry["control"], frames.control_class(message.name)())
    assert wanted == message.control, f"control: {message.control}"
    found, end = columns(message.name, message.control, message.bulk)
    assert end == len(message.bulk), f"the columns take {end} bytes of {len(message.bulk)}"
    assert list(found) == [c["name"] for c in entry["columns"]], list(found)
    for c in entry["columns"]:
        assert found[c["name"]] == flat(c["values"]), c["name"]
    # The header that this codec makes, too. (Protobuf does not promise the same bytes of a control part.)
    assert frames.frame(payload, link) == data, "another frame header"
    altered = bytearray(data)
    altered[-1] ^= 1
    try:
        frames.decode(bytes(altered[frames.HEADER_BYTES:]))
        raise AssertionError("an altered byte was not noticed")
    except frames.WireError:
        pass
    return message


def main():
    entries = json.loads((FOLDER / "frames.json").read_text())
    messages = {}
    for entry in entries:
        try:
            messages[entry["file"]] = check(entry)
        except AssertionError as e:
            sys.exit(f"{entry['file']}: {e}")
    proof = frames.proof(b"a secret", "connects", messages["challenge.bin"].control.nonce)
    assert messages["proof.bin"].control.code == proof, "the proof"
    print(f"{len(entries)} frames are read as they are meant")


if __name__ == "__main__":
    main()
