"""Nearest hits and occlusion in parts, by Embree for Python."""
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from part_file import NONE, Arrays

FLIP, NORMALS, UVS = 1, 2, 4  # flags of a hit


class Part(Arrays):
    def __init__(self, data):
        super().__init__(data)
        self.scene = EmbreeScene(robust=True)
        self.mesh = TriangleMesh(self.scene, np.ascontiguousarray(self.positions, np.float32),
                                 np.ascontiguousarray(self.triangles, np.int32))

    def occluded(self, origins, directions, t_max):
        return self.scene.run(origins, directions, dists=t_max, query="OCCLUDED") >= 0

    def nearest(self, origins, directions, t_max):
        """(indices of the rays that hit, their t, u, v, triangle)"""
        r = self.scene.run(origins, directions, dists=t_max.copy(), output=1)  # it writes into what it is given
        hit = np.flatnonzero(r["primID"] >= 0)
        return hit, r["tfar"][hit], r["u"][hit], r["v"][hit], r["primID"][hit]


def occluded(parts, rays):
    blocked = np.zeros(len(rays), bool)
    for part in parts:
        left = np.flatnonzero(~blocked)
        if len(left) == 0:
            break
        r = rays[left]
        blocked[left] = part.occluded(*columns(r))
    return blocked


def columns(rays):
    return (np.ascontiguousarray(rays[:, 0:3]), np.ascontiguousarray(rays[:, 3:6]), np.ascontiguousarray(rays[:, 6]))


class Hits:
    """The nearest hits of a block of rays, as columns of the wire."""

    def __init__(self, parts, rays):
        n = len(rays)
        origins, directions, t_max = columns(rays)
        best = t_max.copy()
        self.found = np.zeros(n, bool)
        uv = np.zeros((n, 2), np.float32)
        ids = np.full((n, 2), NONE, np.uint32)  # shape, primitive
        corners, normals = np.zeros((2, n, 3, 3), np.float32)
        uvs = np.zeros((n, 3, 2), np.float32)
        of = np.full((n, 2), NONE, np.uint32)  # material, light
        flags = np.zeros(n, np.uint16)
        for part in parts:
            hit, t, u, v, triangle = part.nearest(origins, directions, best)
            chunk, shape, primitive = part.ids(triangle)
            # Embree decides between triangles of one part at the same t; between parts the lowest ids win.
            same = t == best[hit]
            first = (t < best[hit]) | (same & ((shape < ids[hit, 0]) | ((shape == ids[hit, 0]) & (primitive < ids[hit, 1]))))
            hit, t, u, v, triangle, chunk = (x[first] for x in (hit, t, u, v, triangle, chunk))
            best[hit], self.found[hit] = t, True
            uv[hit] = np.stack((u, v), 1)
            ids[hit] = np.stack((shape[first], primitive[first]), 1)
            c = part.chunks
            index = part.triangles[triangle]
            own = index - c["first_vertex"][chunk][:, None]
            corners[hit] = part.positions[index]
            has_normals, has_uvs = c["first_normal"][chunk] != NONE, c["first_uv"][chunk] != NONE
            normals[hit] = uvs[hit] = 0
            normals[hit[has_normals]] = part.normals[c["first_normal"][chunk][has_normals][:, None] + own[has_normals]]
            uvs[hit[has_uvs]] = part.uvs[c["first_uv"][chunk][has_uvs][:, None] + own[has_uvs]]
            of[hit] = np.stack((c["material"][chunk], c["light"][chunk]), 1)
            flags[hit] = (c["flip"][chunk] != 0) * FLIP + has_normals * NORMALS + has_uvs * UVS
        f = self.found
        self.count = int(f.sum())
        self.normals, self.uvs = bool((flags & NORMALS).any()), bool((flags & UVS).any())
        self.columns = [best[f], uv[f], ids[f, 0], ids[f, 1], corners[f]]
        self.columns += [normals[f]] if self.normals else []
        self.columns += [uvs[f]] if self.uvs else []
        self.columns += [of[f, 0], of[f, 1], flags[f]]

    def bulk(self):
        return b"".join([bits(self.found)] + [np.ascontiguousarray(c).tobytes() for c in self.columns])


def bits(flags):
    padded = np.zeros(-(-len(flags) // 64) * 64, bool)
    padded[:len(flags)] = flags
    return np.packbits(padded, bitorder="little").tobytes()
