"""What answers of a host that only intersects must be, by brute force in double precision."""
import numpy as np

from part_file import NONE


class Failed(Exception):
    pass


def expect(condition, text):
    if not condition:
        raise Failed(text)


class Truth:
    def __init__(self, parts):
        self.parts, self.held = parts, set()
        self.dice = np.random.default_rng(1)

    def rays(self, n):
        """Through the parts that are held; some end on the way."""
        corners = np.concatenate([p.positions for p in self.parts.values()])
        low, high = corners.min(0), corners.max(0)
        size = np.linalg.norm(high - low)
        start = self.dice.uniform(low - 0.3 * size, high + 0.3 * size, (n, 3))
        held = sorted(self.held) or sorted(self.parts)
        part = [self.parts[held[i]] for i in self.dice.integers(len(held), size=n)]
        towards = np.array([p.positions[p.triangles[self.dice.integers(len(p.triangles))]].mean(0) for p in part])
        direction = towards - start
        length = np.linalg.norm(direction, axis=1)
        rays = np.zeros((n, 7), np.float32)
        rays[:, 0:3], rays[:, 3:6] = start, direction / length[:, None]
        ends = self.dice.random(n)
        rays[:, 6] = np.where(ends < 0.3, np.inf, length * np.where(ends < 0.6, 0.9, 1.2))
        return rays

    def brute_force(self, ray):
        """All hits along a ray in double precision: t, part, triangle, and how far from its border (barycentric)."""
        o, d = ray[0:3].astype(float), ray[3:6].astype(float)
        found = []
        for number in sorted(self.held):
            part = self.parts[number]
            a, b, c = (part.positions[part.triangles[:, k]].astype(float) for k in range(3))
            with np.errstate(all="ignore"):  # Moeller and Trumbore 1997
                e1, e2 = b - a, c - a
                h = np.cross(d, e2)
                inverse = 1 / (e1 * h).sum(1)
                s = o - a
                u = (s * h).sum(1) * inverse
                q = np.cross(s, e1)
                v, t = (q @ d) * inverse, (e2 * q).sum(1) * inverse
                inside = np.minimum(np.minimum(u, v), 1 - u - v)
            found += [(t[i], number, i, inside[i]) for i in np.flatnonzero((t > 0) & (inside > -1e-3))]
        return sorted(found)

    def check_blocked(self, rays, m):
        n = len(rays)
        expect(m.control.count == n and len(m.bulk) == 8 * -(-n // 64), "a reply has the wrong length")
        flags = np.unpackbits(np.frombuffer(m.bulk, np.uint8), bitorder="little")
        expect(not flags[n:].any(), "bits behind the last ray are set")
        for i, ray in enumerate(rays):
            hits = self.brute_force(ray)
            sure = [h for h in hits if h[0] < ray[6] * (1 - 1e-4) and h[3] > 1e-3]
            maybe = [h for h in hits if h[0] < ray[6] * (1 + 1e-4)]
            expect(flags[i] or not sure, f"ray {ray.tolist()} is blocked at t = {sure and sure[0][0]}, the host says it is not")
            expect(maybe or not flags[i], f"ray {ray.tolist()} is free, the host says it is not")

    def check_nearest(self, rays, m):
        c, n, at = m.control, len(rays), 0

        def column(kind, width, count):
            nonlocal at
            values = np.frombuffer(m.bulk, kind, width * count, at).reshape(count, width)
            at += values.nbytes
            return values

        expect(c.nearest and c.count == n, "the reply does not say that it has nearest hits of all rays")
        try:
            flags = np.unpackbits(column("<u8", 1, -(-n // 64)).view(np.uint8), bitorder="little")
            t, uv = column("<f4", 1, c.hits)[:, 0], column("<f4", 2, c.hits)
            shape, primitive = column("<u4", 1, c.hits)[:, 0], column("<u4", 1, c.hits)[:, 0]
            corners = column("<f4", 9, c.hits).reshape(-1, 3, 3)
            normals = column("<f4", 9, c.hits).reshape(-1, 3, 3) if c.normals else None
            uvs = column("<f4", 6, c.hits).reshape(-1, 3, 2) if c.uvs else None
            material, light, kinds = (column(k, 1, c.hits)[:, 0] for k in ("<u4", "<u4", "<u2"))
        except ValueError:
            raise Failed("the columns are shorter than they should be") from None
        expect(at == len(m.bulk), "the columns are longer than they should be")
        expect(int(flags.sum()) == c.hits and not flags[n:].any(), "the bits do not fit the number of hits")
        for i in np.flatnonzero(flags[:n] == 0):
            sure = [h for h in self.brute_force(rays[i]) if h[0] < rays[i, 6] * (1 - 1e-4) and h[3] > 1e-3]
            expect(not sure, f"ray {rays[i].tolist()} hits at t = {sure and sure[0][0]}, the host has not found it")
        for k, i in enumerate(np.flatnonzero(flags)):
            where = f"the hit of ray {rays[i].tolist()}: "
            hits = [h for h in self.brute_force(rays[i]) if h[0] < t[k] * (1 + 1e-4) + 1e-4]
            expect(t[k] <= rays[i, 6], where + "it lies behind t_max")
            expect(not [h for h in hits if h[0] < t[k] * (1 - 1e-4) - 1e-4 and h[3] > 1e-3], where + "there is a nearer one")
            for _, number, triangle, _ in hits:
                part = self.parts[number]
                chunk, of, source = part.ids(np.array([triangle]))
                if (of[0], source[0]) == (shape[k], primitive[k]) and (part.positions[part.triangles[triangle]] == corners[k]).all():
                    break
            else:
                raise Failed(where + "no triangle there has these corners, shape and primitive")
            ch, own = {name: int(v[chunk[0]]) for name, v in part.chunks.items()}, part.triangles[triangle]
            own = own - ch["first_vertex"]
            p = (1 - uv[k].sum()) * corners[k, 0] + uv[k, 0] * corners[k, 1] + uv[k, 1] * corners[k, 2]
            q = rays[i, 0:3] + t[k] * rays[i, 3:6]
            expect(np.abs(p - q).max() < 1e-3 * (1 + np.abs(q).max()), where + f"u, v say {p.tolist()}, t says {q.tolist()}")
            expect((material[k], light[k]) == (ch["material"], ch["light"]), where + "another material or light")
            wanted = (ch["flip"] != 0) * 1 + (ch["first_normal"] != NONE) * 2 + (ch["first_uv"] != NONE) * 4
            expect(kinds[k] == wanted, where + f"flags {kinds[k]} instead of {wanted}")
            if wanted & 2:
                expect((normals[k] == part.normals[ch["first_normal"] + own]).all(), where + "other normals")
            if wanted & 4:
                expect((uvs[k] == part.uvs[ch["first_uv"] + own]).all(), where + "other uvs")
