"""A scene with nothing in it but what every program has: the same stand-ins for the rest, and a note of each.

Surfaces are matte, plastic, substrate, metal, glass, mirror, and mixes; textures are pictures or checks in texture space; lights
are infinite, distant, point, spot, and shapes that shine; shapes are meshes, spheres, disks. A microfacet's width `alpha`
is that of its distribution, Trowbridge-Reitz for a pbrt-v3 scene; of a pbrt-v2 scene's Blinn exponent e it is
alpha^2 = 2 / (e + 2), which makes Beckmann's distribution alike (Walter et al. 2007).
"""
import dataclasses
import math

import numpy as np
import OpenImageIO as oiio

from pbrt_text import Entity

COPPER = (np.array([.2004, .9240, 1.1022]), np.array([3.9129, 2.4528, 2.1421]))  # eta, k: Johnson and Christy 1972
ROUND = 96  # segments of a full turn, where a quadric becomes a mesh


@dataclasses.dataclass(eq=False)
class Picture:
    """Linear RGB; the first row is the highest t, as pbrt-v3 has it. Texture space is (u * uscale + udelta, ...)."""
    pixels: np.ndarray
    scale: tuple = (1., 1.)
    delta: tuple = (0., 0.)
    wrap: str = "repeat"
    file: str = ""       # set by who writes it


@dataclasses.dataclass(eq=False)
class Checks:
    first: np.ndarray
    second: np.ndarray
    scale: tuple = (1., 1.)
    delta: tuple = (0., 0.)


@dataclasses.dataclass
class Mesh:
    surface: str
    emission: tuple | None
    positions: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None = None
    uvs: np.ndarray | None = None


@dataclasses.dataclass
class Quadric:
    kind: str            # sphere, disk
    surface: str
    emission: tuple | None
    radius: float
    to_world: np.ndarray  # rotation and translation
    flip: bool           # its normals are those of pbrt's shape, turned


@dataclasses.dataclass
class Model:
    dialect: str
    camera_to_world: np.ndarray
    fov: float
    lens: tuple          # radius, focal distance
    resolution: tuple
    depth: int           # maxdepth as pbrt-v3 counts
    surfaces: dict
    lights: list
    shapes: list
    prototypes: dict     # name -> shapes
    instances: list      # (name, matrix)
    notes: list          # what was replaced, a sentence each


class NoCounterpart(Exception):
    pass


def transmitted(eta):
    """The share of even light from outside that a smooth dielectric lets in (Fresnel's equations, integrated)."""
    c = (np.arange(4096) + .5) / 4096
    t = np.sqrt(1 - (1 - c * c) / (eta * eta))
    parallel, across = (eta * c - t) / (eta * c + t), (c - eta * t) / (c + eta * t)
    return 1 - float(np.mean((parallel ** 2 + across ** 2) * c))  # 2 c of the cosine, 1/2 of the polarizations


def mapped(value, change):
    """A colour or texture whose every colour was changed; a picture has another file then."""
    if isinstance(value, Picture):
        return dataclasses.replace(value, pixels=change(value.pixels).astype(np.float32), file="")
    if isinstance(value, Checks):
        return dataclasses.replace(value, first=change(value.first), second=change(value.second))
    return change(value)


# Of the diffuse part of Ashikhmin and Shirley's model (2000) in even light, without Kd (1 - Ks): 28/23 of the square of the
# integral of 1 - (1 - c/2)^5 over the hemisphere.
SUBSTRATE_ALBEDO = 28 / 23 * (8 * (1 - 1 / 2 - 1 / 6 + 1 / 7 - (1 / 2 - 1 / 8 - 1 / 384 + 1 / 896))) ** 2


def coat(s):
    """Of plastic and substrate: the index of refraction of a coat, and what the diffuse part reflects of even light."""
    if s["kind"] == "plastic":
        return s["eta"], s["kd"]
    root = math.sqrt(min(.8, max(float(s["ks"].max()), 1e-3)))  # Fresnel's ((eta - 1) / (eta + 1))^2 along the normal
    return (1 + root) / (1 - root), mapped(s["kd"], lambda c: c * SUBSTRATE_ALBEDO * (1 - float(s["ks"].max())))


def luminance(rgb):
    return float(np.dot(rgb, [.2126, .7152, .0722]))


class _Simplifier:
    def __init__(self, scene, coats):
        self.scene, self.coats = scene, coats
        self.notes = dict.fromkeys(sorted(scene.left_out))  # in order, each once
        self.flat, self.made = {}, {}
        self.bright = scene.options["Film"].number("scale", 1)  # every light has it, since not every film does

    def note(self, text):
        self.notes[text] = None

    # --- textures -------------------------------------------------------------------------------------------------

    def read(self, name, decode):
        path = self.scene.folder / name
        file = oiio.ImageInput.open(str(path))
        if not file:
            raise NoCounterpart(f"cannot read the picture {name}: {oiio.geterror()}")
        spec = file.spec()
        pixels = np.asarray(file.read_image("float"), np.float32).reshape(spec.height, spec.width, spec.nchannels)
        file.close()
        pixels = np.repeat(pixels[:, :, :1], 3, axis=2) if spec.nchannels < 3 else pixels[:, :, :3]
        if decode and spec.format.basetype == oiio.UINT8:  # IEC 61966-2-1
            pixels = np.where(pixels <= .04045, pixels / 12.92, ((pixels + .055) / 1.055) ** 2.4)
        return pixels

    def texture(self, name):
        """A picture, checks, or a colour."""
        if name not in self.flat:
            self.flat[name] = self.make_texture(name)
        return self.flat[name]

    def operand(self, entity, name, default):
        return self.texture(entity.texture(name)) if entity.texture(name) else entity.rgb(name, default)

    def make_texture(self, name):
        if name not in self.scene.textures:
            return np.full(3, .5)
        entity = self.scene.textures[name].entity
        placed = entity.word("mapping", "uv") == "uv"
        mapping = {"scale": (entity.number("uscale", 1), entity.number("vscale", 1)),
                   "delta": (entity.number("udelta", 0), entity.number("vdelta", 0))}
        if entity.type == "constant":
            return entity.rgb("value", 1)
        if entity.type == "imagemap":
            v3 = self.scene.dialect == "v3"
            pixels = self.read(entity.word("filename"), v3 and entity.flag("gamma", True)) * entity.number("scale", 1)
            if placed:
                wrap = entity.word("wrap", "repeat")
                if wrap == "black":
                    self.note("texture that is black around its picture: clamped")
                return Picture(pixels if v3 else pixels[::-1], wrap="repeat" if wrap == "repeat" else "clamp", **mapping)
            self.note(f"texture imagemap with mapping {entity.word('mapping')}: its mean colour")
            return pixels.reshape(-1, 3).mean(axis=0)
        if entity.type == "scale":
            first, second = self.operand(entity, "tex1", 1), self.operand(entity, "tex2", 1)
            if isinstance(first, np.ndarray):
                first, second = second, first
            if isinstance(first, Picture):
                return mapped(first, lambda c: c * self.mean(second))
            return self.mean(first) * self.mean(second)
        if entity.type in ("checkerboard", "mix"):
            first, second = self.operand(entity, "tex1", [1, 0][entity.type == "mix"]), \
                self.operand(entity, "tex2", [0, 1][entity.type == "mix"])
            amount = luminance(self.mean(self.operand(entity, "amount", .5)))
            if entity.type == "checkerboard" and placed and entity.number("dimension", 2) == 2:
                return Checks(self.mean(first), self.mean(second), **mapping)
            self.note(f"texture {entity.type}: its mean colour")
            return self.mean(first) * (1 - amount) + self.mean(second) * amount
        self.note(f"texture {entity.type}: grey, 0.5")
        return np.full(3, .5)

    @staticmethod
    def mean(value):
        if isinstance(value, Picture):
            return value.pixels.reshape(-1, 3).mean(axis=0)
        return (value.first + value.second) / 2 if isinstance(value, Checks) else value

    # --- surfaces -------------------------------------------------------------------------------------------------

    def colour(self, m, name, default):
        """Of a parameter that may not vary."""
        if m.texture(name):
            self.note(f"material {m.type}: the mean of {name}'s texture")
        return np.array(self.mean(self.operand(m, name, default)))

    def width(self, m, default):
        """alpha of the distribution, of `roughness`, or of uroughness and vroughness."""
        def one(name, otherwise):
            value = luminance(self.colour(m, name, otherwise))
            if self.scene.dialect == "v2":
                return math.sqrt(2 / (1 / max(value, 1e-6) + 2))
            if not m.flag("remaproughness", True):
                return max(value, 1e-4)
            x = math.log(max(value, 1e-3))  # pbrt-v3's fit
            return 1.62142 + .819955 * x + .1734 * x * x + .0171201 * x ** 3 + .000640711 * x ** 4
        roughness = m.number("roughness", default)
        u, v = one("uroughness", roughness), one("vroughness", roughness)
        if abs(u - v) > .05 * max(u, v):
            self.note(f"material {m.type} with two roughnesses: their geometric mean")
        return math.sqrt(u * v)

    def surface(self, name):
        if name not in self.made:
            self.made[name] = self.make_surface(self.scene.materials[name])
        return self.made[name]

    def make_surface(self, m):
        if m.texture("bumpmap"):
            self.note(f"bump map of {m.type}: none")
        if m.type == "matte":
            if np.any(self.colour(m, "sigma", 0) != 0):
                self.note("matte with sigma: Lambert's")
            return {"kind": "matte", "kd": self.operand(m, "Kd", .5)}
        if m.type in ("plastic", "uber", "translucent"):
            kd, ks = self.operand(m, "Kd", .25), self.colour(m, "Ks", .25)
            eta = 1.5
            if m.type == "uber":
                eta = m.number("eta", m.number("index", 1.5))
                if np.any(self.colour(m, "Kr", 0) > 0) or np.any(self.colour(m, "Kt", 0) > 0) or \
                        np.any(self.colour(m, "opacity", 1) < 1):
                    self.note("uber with Kr, Kt or opacity: plastic without them")
            if m.type == "translucent":
                share = float(np.mean(self.colour(m, "reflect", .5)))
                self.note("translucent: plastic that reflects its share and lets nothing through")
                kd, ks = mapped(kd, lambda c: c * share), ks * share
            if self.coats:
                self.note(f"{m.type}: substrate that reflects as much along the normal (--coats)")
                return {"kind": "substrate", "kd": kd, "ks": ks * ((eta - 1) / (eta + 1)) ** 2, "alpha": self.width(m, .1)}
            return {"kind": "plastic", "kd": kd, "ks": ks, "alpha": self.width(m, .1), "eta": eta}
        if m.type == "substrate":
            return {"kind": "substrate", "kd": self.operand(m, "Kd", .5), "ks": self.colour(m, "Ks", .5),
                    "alpha": self.width(m, .1)}
        if m.type in ("metal", "shinymetal"):
            eta, k = self.colour(m, "eta", COPPER[0]), self.colour(m, "k", COPPER[1])
            if m.type == "shinymetal":
                self.note("shinymetal: copper")
            return {"kind": "metal", "eta": eta, "k": k, "alpha": self.width(m, .01)}
        if m.type == "glass":
            rough = self.scene.dialect == "v3" and (m.number("uroughness", 0) > 0 or m.number("vroughness", 0) > 0)
            return {"kind": "glass", "kr": self.colour(m, "Kr", 1), "kt": self.colour(m, "Kt", 1),
                    "eta": m.number("eta", m.number("index", 1.5)), "alpha": self.width(m, 0) if rough else 0.}
        if m.type == "mirror":
            return {"kind": "mirror", "kr": self.colour(m, "Kr", .9)}
        if m.type in ("none", ""):
            return {"kind": "none"}
        if m.type == "mix":
            names = [m.word("namedmaterial1"), m.word("namedmaterial2")]
            inner = [self.surface(n) for n in names]
            if all(s["kind"] in ("matte", "plastic", "substrate", "metal", "mirror") for s in inner):
                return {"kind": "mix", "of": names, "amount": luminance(self.colour(m, "amount", .5))}
            self.note("mix of what is not simply reflecting: its first material")
            return inner[0]
        colour = self.operand(m, "color" if m.type in ("disney", "hair") else "Kd", .5)
        self.note(f"{m.type}: matte")
        return {"kind": "matte", "kd": colour}

    # --- shapes ---------------------------------------------------------------------------------------------------

    def shape(self, s, surfaces):
        made = self.surface(s.material) if s.material is not None else {"kind": "none"}
        name = s.material
        if made["kind"] == "none":
            if not s.light:
                return None  # without media it cannot be seen
            name, made = "black", {"kind": "matte", "kd": np.zeros(3)}
        if name not in surfaces:
            surfaces[name] = made
            for inner in made.get("of", []):
                surfaces.setdefault(inner, self.surface(inner))
        emission = None
        if s.light:
            if s.light.flag("twosided"):
                self.note("lights that shine on both sides: on their front only")
            emission = tuple(s.light.rgb("L", 1) * s.light.rgb("scale", 1) * self.bright)
        if any(s.entity.texture(n) for n in ("alpha", "shadowalpha")):
            self.note("alpha: opaque")
        if s.entity.type == "trianglemesh":
            return self.mesh(s, name, emission, surfaces)
        if s.entity.type == "curve":
            self.note("curves: left out")
            return None
        return self.quadric(s, name, emission)

    def mesh(self, s, name, emission, surfaces):
        p = s.entity.params
        faces = p["indices"].reshape(-1, 3)
        positions = p["P"].reshape(-1, 3)
        normals = p["N"].reshape(-1, 3) if "N" in p else None
        uvs = p["uv"].reshape(-1, 2) if "uv" in p else None
        if s.reverse:
            faces = faces[:, [0, 2, 1]]
            normals = None if normals is None else -normals
        if not any(isinstance(v, (Picture, Checks)) for inner in [name, *surfaces[name].get("of", [])]
                   for v in surfaces[inner].values()):
            uvs = None
        elif uvs is None:  # pbrt's coordinates of a triangle that has none
            corners = faces.ravel()
            uvs = np.tile([[0., 0.], [1., 1.], [1., 0.]] if s.reverse else [[0., 0.], [1., 0.], [1., 1.]],
                          (len(faces), 1))
            positions, normals = positions[corners], None if normals is None else normals[corners]
            faces = np.arange(len(corners)).reshape(-1, 3)
        return Mesh(name, emission, positions, faces, normals, uvs)

    def quadric(self, s, name, emission):
        e, matrix = s.entity, s.entity.to_world
        linear = matrix[:3, :3]
        mirrored = np.linalg.det(linear) < 0
        flip = s.reverse ^ bool(mirrored and self.scene.dialect == "v3") ^ (e.type == "disk" and self.scene.dialect == "v2")
        lengths = np.linalg.norm(linear, axis=0)
        even = np.ptp(lengths) < 1e-4 * lengths.max() and \
            np.allclose(linear.T @ linear, np.eye(3) * lengths[0] ** 2, atol=1e-4 * lengths[0] ** 2)
        radius = e.number("radius", 1)
        whole = e.number("phimax", 360) >= 360 and (
            e.type == "sphere" and e.number("zmin", -radius) <= -radius and e.number("zmax", radius) >= radius or
            e.type == "disk" and e.number("innerradius", 0) == 0 and self.scene.dialect == "v3" and not mirrored)
        if even and whole:
            rigid = matrix.copy()
            rigid[:3, :3] = linear / lengths[0] if e.type == "disk" else np.eye(3)
            if e.type == "disk":
                rigid[:3, 3] = (matrix @ [0, 0, e.number("height", 0), 1])[:3]
            return Quadric(e.type, name, emission, radius * lengths[0], rigid, flip)
        self.note("disk of pbrt-v2, which shows light on one side and samples the other: a mesh that shines where it is seen"
                  if e.type == "disk" and self.scene.dialect == "v2" else
                  f"{e.type} that is partial, stretched or unknown to others: a mesh")
        positions, faces, normals = tessellate(e)
        normals = normals @ np.linalg.inv(linear)
        if flip:
            normals, faces = -normals, faces[:, [0, 2, 1]]
        if mirrored:
            faces = faces[:, [0, 2, 1]]
        return Mesh(name, emission, positions @ linear.T + matrix[:3, 3], faces,
                    normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))

    # --- lights ---------------------------------------------------------------------------------------------------

    def light(self, e):
        def point(name, default):
            return (e.to_world @ np.append(e.params.get(name, np.array(default, float)), 1))[:3]
        scale = e.rgb("scale", 1) * self.bright
        for name in ("illuminance", "power", "mapping"):
            if name in e.params:
                self.note(f"light {e.type}: without its {name}")
        if e.type in ("infinite", "exinfinite"):
            value = e.rgb("L", 1) * scale
            if e.word("mapname"):
                value = Picture((self.read(e.word("mapname"), False) * value).astype(np.float32))
            return {"kind": "infinite", "L": value, "to_world": e.to_world}
        if e.type == "distant":
            towards = point("to", [0, 0, 1]) - point("from", [0, 0, 0])
            return {"kind": "distant", "L": e.rgb("L", 1) * scale, "towards": towards / np.linalg.norm(towards)}
        if e.type == "spot":
            return {"kind": "spot", "I": e.rgb("I", 1) * scale, "from": point("from", [0, 0, 0]),
                    "to": point("to", [0, 0, 1]), "cone": e.number("coneangle", 30),
                    "delta": e.number("conedeltaangle", 5)}
        if e.type != "point":
            self.note(f"light {e.type}: a point light")
        return {"kind": "point", "I": e.rgb("I", 1) * scale, "from": point("from", [0, 0, 0])}

    def model(self):
        scene, options = self.scene, self.scene.options
        camera, film = options["Camera"], options["Film"]
        if camera.type != "perspective" or {"screenwindow", "frameaspectratio"} & set(camera.params):
            raise NoCounterpart(f"camera {camera.type}: only perspective ones without a screen window can be converted")
        if options["PixelFilter"].type != "box":
            self.note(f"pixel filter {options['PixelFilter'].type}: a box")
        if "cropwindow" in film.params:
            self.note("crop window: the whole picture")
        integrator = options["Integrator"]
        if integrator.type != "path":
            self.note(f"integrator {integrator.type}: path")
        fov = camera.number("halffov", camera.number("fov", 90) / 2) * 2
        surfaces = {}
        shapes = merged([self.shape(s, surfaces) for s in scene.shapes])
        prototypes = {name: merged([self.shape(s, surfaces) for s in all_]) for name, all_ in scene.prototypes.items()}
        return Model(
            scene.dialect, np.linalg.inv(scene.world_to_camera if scene.world_to_camera is not None else np.eye(4)), fov,
            (camera.number("lensradius", 0), camera.number("focaldistance", 1e30)),
            (int(film.number("xresolution", 640)), int(film.number("yresolution", 480))),
            int(integrator.number("maxdepth", 5)) + (scene.dialect == "v2"), surfaces,
            [self.light(e) for e in scene.lights], shapes, prototypes, scene.instances, list(self.notes))


def tessellate(e):
    """A quadric in its own space: positions, faces, normals (of growing u and v, as pbrt's)."""
    radius, height = e.number("radius", 1), e.number("height", 0 if e.type == "disk" else 1)
    z0 = e.number("zmin", 0 if e.type == "paraboloid" else -radius if e.type == "sphere" else -1)
    z1 = e.number("zmax", radius if e.type == "sphere" else 1)
    zero = np.zeros(3)
    p1, p2 = e.params.get("p1", zero), e.params.get("p2", np.ones(3))
    inner = e.number("innerradius", 0)

    def profile(v):
        """Distance from the axis, height, and the angle by which the point is ahead."""
        if e.type == "sphere":
            ends = [math.acos(min(1, max(-1, z / radius))) for z in (z0, z1)]
            theta = ends[0] + v * (ends[1] - ends[0])
            return radius * np.sin(theta), radius * np.cos(theta), 0
        if e.type == "cylinder":
            return radius + 0 * v, z0 + v * (z1 - z0), 0
        if e.type == "disk":
            return radius - v * (radius - inner), height + 0 * v, 0
        if e.type == "cone":
            return radius * (1 - v), height * v, 0
        if e.type == "paraboloid":
            z = z0 + v * (z1 - z0)
            return radius * np.sqrt(z / z1), z, 0
        if e.type == "hyperboloid":
            p = p1 + v[..., None] * (p2 - p1)
            return np.hypot(p[..., 0], p[..., 1]), p[..., 2], np.arctan2(p[..., 1], p[..., 0])
        raise NoCounterpart(f"the shape {e.type} cannot be converted")

    def at(u, v):
        r, z, ahead = profile(np.clip(v, 0, 1))
        phi = u * math.radians(e.number("phimax", 360)) + ahead
        return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)

    rows = ROUND // 2
    u, v = np.meshgrid(np.linspace(0, 1, ROUND + 1), np.linspace(0, 1, rows + 1))
    near = np.clip(v, 1e-3, 1 - 1e-3)  # poles have no direction of u
    h = 5e-4
    normals = np.cross(at(u + h, near) - at(u - h, near), at(u, near + h) - at(u, near - h)).reshape(-1, 3)
    corner = (np.arange(rows)[:, None] * (ROUND + 1) + np.arange(ROUND)).ravel()
    a, b, c, d = corner, corner + 1, corner + ROUND + 2, corner + ROUND + 1
    return (at(u, v).reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]),
            normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))


def as_mesh(q):
    """A sphere or a disk as a mesh."""
    positions, faces, normals = tessellate(Entity(q.kind, {"radius": np.array([q.radius])}))
    rotation = q.to_world[:3, :3]
    faces, sign = (faces[:, [0, 2, 1]], -1) if q.flip else (faces, 1)
    return Mesh(q.surface, q.emission, positions @ rotation.T + q.to_world[:3, 3], faces, sign * normals @ rotation.T)


def merged(shapes):
    """Meshes of one surface are one mesh: many small ones would measure how a program holds them."""
    groups, out = {}, []
    for s in shapes:
        if isinstance(s, Mesh):
            groups.setdefault((s.surface, s.emission, s.normals is None, s.uvs is None), []).append(s)
        elif s is not None:
            out.append(s)
    for (surface, emission, flat, plain), meshes in groups.items():
        first = np.cumsum([0] + [len(m.positions) for m in meshes])
        out.append(Mesh(surface, emission, np.concatenate([m.positions for m in meshes]),
                        np.concatenate([m.faces + n for m, n in zip(meshes, first)]),
                        None if flat else np.concatenate([m.normals for m in meshes]),
                        None if plain else np.concatenate([m.uvs for m in meshes])))
    return out


def simplify(scene, coats=False):
    """`coats`: plastic and uber become substrate. Their Fresnel term, in pbrt-v2 and v3, has its indices exchanged and reflects
    everything beyond 42 degrees, which no other program does, and which makes a picture noisier."""
    return _Simplifier(scene, coats).model()
