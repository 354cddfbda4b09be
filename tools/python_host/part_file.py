"""Part files (src/parts/README.md) as numpy arrays. Of parts that have triangles only."""
import struct

import numpy as np
import xxhash

NONE = 0xffffffff
POSITIONS, NORMALS, UVS, TRIANGLES, PRIMITIVE_IDS, CHUNKS = range(6)
ELEMENTS = {POSITIONS: ("<f4", 3), NORMALS: ("<f4", 3), UVS: ("<f4", 2), TRIANGLES: ("<u4", 3),
            PRIMITIVE_IDS: ("<u4", 1), CHUNKS: ("<u4", 14)}
CHUNK = ("shape material light alpha shadow_alpha first_triangle triangles first_vertex vertices first_normal first_uv "
         "first_primitive primitive_ids flip").split()


class PartError(Exception):
    pass


def sections(data):
    """The arrays of sections 0 to 5 of a part file; nothing else may be in it."""
    if len(data) < 64 or data[:8] != b"CLRPART\0":
        raise PartError("it is no part file")
    version, count, length, checksum = struct.unpack_from("<IIQQ", data, 8)
    if version != 1 or not 8 <= count <= 16 or length != len(data) or len(data) < 64 + 24 * count:
        raise PartError("its header is not that of a part file of version 1")
    if xxhash.xxh3_64_intdigest(data[64:]) != checksum:
        raise PartError("its checksum does not match")
    found = {}
    for i in range(count):
        section, size, offset, elements = struct.unpack_from("<IIQQ", data, 64 + 24 * i)
        if offset + size * elements > len(data):
            raise PartError(f"section {section} goes beyond its end")
        if section not in ELEMENTS:
            if elements:
                raise PartError(f"it has section {section}: more than triangles")
            continue
        kind, width = ELEMENTS[section]
        if size != 4 * width:
            raise PartError(f"section {section} has elements of {size} bytes")
        found[section] = np.frombuffer(data, kind, elements * width, offset).reshape(elements, width)
    return found


class Arrays:
    """What a part file says of its triangles; nothing is built."""

    def __init__(self, data):
        s = sections(data)
        self.positions, self.normals, self.uvs = s[POSITIONS], s[NORMALS], s[UVS]
        self.triangles, self.primitive_ids = s[TRIANGLES], s[PRIMITIVE_IDS].reshape(-1)
        self.chunks = {name: s[CHUNKS][:, i] for i, name in enumerate(CHUNK)}
        if len(self.triangles) == 0 or int(self.triangles.max()) >= len(self.positions):
            raise PartError("its triangles are none, or name vertices that are not there")
        if not np.isfinite(self.positions).all():
            raise PartError("a position is not finite")

    def ids(self, triangles):
        """(chunk, shape, primitive) of triangles."""
        c = self.chunks
        chunk = np.searchsorted(c["first_triangle"], triangles, side="right") - 1
        within = triangles.astype(np.uint32) - c["first_triangle"][chunk]
        primitive = c["first_primitive"][chunk] + within
        listed = c["primitive_ids"][chunk] != NONE
        primitive[listed] = self.primitive_ids[c["primitive_ids"][chunk[listed]] + within[listed]]
        return chunk, c["shape"][chunk], primitive
