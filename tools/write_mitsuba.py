"""Writes a model of standins.py as a scene of Mitsuba 3, beside the meshes and pictures of write_scene.write_shared."""
from xml.sax.saxutils import quoteattr

import numpy as np

import standins
import write_scene

RR_DEPTH = 4  # Russian roulette begins where pbrt's does
# pbrt's directions to Mitsuba's, whose maps are around y: x = -Z, y = X, z = Y.
MAP_AXES = np.array([[0, 0, -1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float)


def tag(kind, name, value):
    if not isinstance(value, str):
        value = ("true" if value else "false") if isinstance(value, bool) else write_scene.numbers(value)
    return f"<{kind} name={quoteattr(name)} value={quoteattr(value)}/>"


def matrix(name, m):
    return f'<transform name="{name}"><matrix value="{write_scene.numbers(m)}"/></transform>'


def to_uv(scale, delta):
    return f'<transform name="to_uv"><scale x="{scale[0]:.9g}" y="{scale[1]:.9g}"/>' \
           f'<translate x="{delta[0]:.9g}" y="{delta[1]:.9g}"/></transform>'


def colour(name, value):
    if isinstance(value, np.ndarray):
        return tag("rgb", name, value)
    if isinstance(value, standins.Checks):  # Mitsuba's squares are half of a unit
        half = np.array(value.scale) / 2, np.array(value.delta) / 2
        return f'<texture type="checkerboard" name="{name}">{tag("rgb", "color0", value.first)}' \
               f'{tag("rgb", "color1", value.second)}{to_uv(*half)}</texture>'
    # A picture's first row is at v = 0.
    return f'<texture type="bitmap" name="{name}">{tag("string", "filename", value.file)}' \
           f'{tag("string", "wrap_mode", value.wrap)}{tag("boolean", "raw", True)}' \
           f'{to_uv((value.scale[0], -value.scale[1]), (value.delta[0], 1 - value.delta[1]))}</texture>'


class Xml:
    def __init__(self, model, folder):
        self.model, self.folder, self.pictures = model, folder, 0
        # Blinn's distribution of pbrt-v2 is like Beckmann's, that of v3 is Trowbridge and Reitz's.
        self.distribution = "beckmann" if model.dialect == "v2" else "ggx"

    def bsdf(self, s):
        kind = s["kind"]
        microfacets = tag("string", "distribution", self.distribution) + tag("float", "alpha", s.get("alpha", 0))
        if kind == "matte":
            return f'<bsdf type="diffuse">{colour("reflectance", s["kd"])}</bsdf>'
        if kind in ("plastic", "substrate"):
            eta, albedo = standins.coat(s)
            # Mitsuba lets light in and out through the coat, pbrt adds a lobe: the same albedo in even light.
            kd = self.owned(standins.mapped(albedo, lambda c: np.minimum(c / standins.transmitted(eta), 1)))
            ks = s["ks"] / max(float(s["ks"].max()), 1e-3) if kind == "substrate" else np.minimum(s["ks"], 1)
            return f'<bsdf type="roughplastic">{microfacets}{tag("float", "int_ior", eta)}' \
                   f'{colour("diffuse_reflectance", kd)}{colour("specular_reflectance", ks)}</bsdf>'
        if kind == "metal":
            return f'<bsdf type="roughconductor">{microfacets}{colour("eta", s["eta"])}{colour("k", s["k"])}</bsdf>'
        if kind == "glass":
            rough = s["alpha"] > 0
            return f'<bsdf type="{"rough" if rough else ""}dielectric">{microfacets if rough else ""}' \
                   f'{tag("float", "int_ior", s["eta"])}{tag("float", "ext_ior", 1)}' \
                   f'{colour("specular_reflectance", s["kr"])}{colour("specular_transmittance", s["kt"])}</bsdf>'
        if kind == "mirror":
            return f'<bsdf type="conductor">{tag("string", "material", "none")}' \
                   f'{colour("specular_reflectance", s["kr"])}</bsdf>'
        inner = "".join(self.bsdf(self.model.surfaces[name]) for name in s["of"])
        return f'<bsdf type="blendbsdf">{tag("float", "weight", 1 - s["amount"])}{inner}</bsdf>'

    def owned(self, value):
        """Gives a picture that only this program has its file."""
        if isinstance(value, standins.Picture):
            value.file = f"textures/mitsuba-{self.pictures}.exr"
            self.pictures += 1
            write_scene.write_exr(self.folder / value.file, value.pixels)
        return value

    def surface(self, name, s):
        inner = self.bsdf(s)
        if s["kind"] != "glass":
            inner = f'<bsdf type="twosided">{inner}</bsdf>'
        return inner.replace("<bsdf ", f"<bsdf id={quoteattr(name)} ", 1)

    def shape(self, s):
        inside = f'<ref id={quoteattr(s.surface)}/>'
        if s.emission:
            inside += f'<emitter type="area">{tag("rgb", "radiance", np.array(s.emission))}</emitter>'
        if isinstance(s, standins.Mesh):
            return f'<shape type="ply">{tag("string", "filename", s.file)}' \
                   f'{tag("boolean", "face_normals", s.normals is None)}{inside}</shape>'
        place = s.to_world @ np.diag([s.radius, s.radius, s.radius, 1])
        return f'<shape type="{s.kind}">{matrix("to_world", place)}{tag("boolean", "flip_normals", bool(s.flip))}{inside}</shape>'

    def light(self, light):
        kind = light["kind"]
        if kind == "infinite":
            if isinstance(light["L"], np.ndarray):
                return f'<emitter type="constant">{tag("rgb", "radiance", light["L"])}</emitter>'
            return f'<emitter type="envmap">{tag("string", "filename", light["L"].file)}' \
                   f'{matrix("to_world", light["to_world"] @ MAP_AXES)}</emitter>'
        if kind == "distant":
            return f'<emitter type="directional">{tag("rgb", "irradiance", light["L"])}' \
                   f'{tag("vector", "direction", write_scene.numbers(light["towards"]))}</emitter>'
        if kind == "point":
            return f'<emitter type="point">{tag("rgb", "intensity", light["I"])}' \
                   f'{tag("point", "position", write_scene.numbers(light["from"]))}</emitter>'
        axis = (light["to"] - light["from"]) / np.linalg.norm(light["to"] - light["from"])
        aside = np.eye(3)[np.argmin(abs(axis))]
        x = np.cross(aside, axis) / np.linalg.norm(np.cross(aside, axis))
        place = np.eye(4)
        place[:3, :] = np.stack([x, np.cross(axis, x), axis, light["from"]], axis=1)
        return f'<emitter type="spot">{tag("rgb", "intensity", light["I"])}{matrix("to_world", place)}' \
               f'{tag("float", "cutoff_angle", light["cone"])}' \
               f'{tag("float", "beam_width", max(0., light["cone"] - light["delta"]))}</emitter>'

    def text(self):
        m = self.model
        out = ['<?xml version="1.0"?>', '<scene version="3.0.0">']
        out += [f'<default name="{n}" value="{v}"/>' for n, v in
                (("spp", 64), ("width", m.resolution[0]), ("height", m.resolution[1]))]
        out.append(f'<integrator type="path">{tag("integer", "max_depth", m.depth + 1)}'
                   f'{tag("integer", "rr_depth", RR_DEPTH)}</integrator>')
        thin = m.lens[0] > 0
        camera = m.camera_to_world @ np.diag([-1, 1, 1, 1])  # Mitsuba's x points to the left
        out.append(f'<sensor type="{"thinlens" if thin else "perspective"}">{matrix("to_world", camera)}'
                   f'{tag("float", "fov", m.fov)}{tag("string", "fov_axis", "smaller")}'
                   + (tag("float", "aperture_radius", m.lens[0]) + tag("float", "focus_distance", m.lens[1]) if thin else "")
                   + f'{tag("float", "near_clip", self.near())}{tag("float", "far_clip", 1e8 * self.near())}'
                   + '<sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>'
                   '<film type="hdrfilm"><integer name="width" value="$width"/><integer name="height" value="$height"/>'
                   '<rfilter type="box"/></film></sensor>')
        out += [self.surface(name, s) for name, s in m.surfaces.items()]
        out += [f'<shape type="shapegroup" id={quoteattr(name)}>{"".join(map(self.shape, shapes))}</shape>'
                for name, shapes in m.prototypes.items()]
        out += [self.shape(s) for s in m.shapes]
        out += [f'<shape type="instance"><ref id={quoteattr(name)}/>{matrix("to_world", place)}</shape>'
                for name, place in m.instances]
        out += [self.light(light) for light in m.lights]
        return "\n".join(out + ["</scene>\n"])

    def near(self):
        """Clip planes that clip nothing: 1e-5 of the size of the scene."""
        corners = [c for s in self.model.shapes if isinstance(s, standins.Mesh)
                   for c in (s.positions.min(axis=0), s.positions.max(axis=0))]
        size = float(np.linalg.norm(np.ptp(corners, axis=0))) if corners else 1.
        return 1e-5 * max(size, 1e-6)


def write(model, folder):
    path = folder / "scene.xml"
    path.write_text(Xml(model, folder).text())
    return path
