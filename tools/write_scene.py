"""Writes a model of standins.py as pbrt text of version 2, 3 or 4, and the files that all programs share: meshes and pictures."""
import math

import numpy as np
import OpenImageIO as oiio

import standins


def write_ply(path, mesh):
    """Binary PLY, with normals and texture coordinates where there are some."""
    columns = [("x", mesh.positions[:, 0]), ("y", mesh.positions[:, 1]), ("z", mesh.positions[:, 2])]
    if mesh.normals is not None:
        columns += [(n, mesh.normals[:, k]) for k, n in enumerate(("nx", "ny", "nz"))]
    if mesh.uvs is not None:
        columns += [(n, mesh.uvs[:, k]) for k, n in enumerate(("u", "v"))]
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corner", "<i4", 3)])
    faces["count"], faces["corner"] = 3, mesh.faces
    with open(path, "wb") as out:
        out.write((f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.positions)}\n"
                   + "".join(f"property float {name}\n" for name, _ in columns)
                   + f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n").encode())
        out.write(np.stack([values for _, values in columns], axis=1).astype("<f4").tobytes())
        out.write(faces.tobytes())


def write_exr(path, pixels):
    pixels = np.ascontiguousarray(pixels, np.float32)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, "float")
    out = oiio.ImageOutput.create(str(path))
    if not out or not out.open(str(path), spec) or not out.write_image(pixels):
        raise OSError(f"cannot write {path}: {oiio.geterror()}")
    out.close()


def write_shared(model, folder):
    """Meshes and pictures; notes in the pictures what they are called."""
    for name in ("meshes", "textures"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    meshes = [s for shapes in [model.shapes, *model.prototypes.values()] for s in shapes
              if isinstance(s, standins.Mesh)]
    for number, mesh in enumerate(meshes):
        mesh.file = f"meshes/{number:04}.ply"
        write_ply(folder / mesh.file, mesh)
    pictures = [v for s in [*model.surfaces.values(), *model.lights] for v in s.values()
                if isinstance(v, standins.Picture)]
    for number, picture in enumerate(dict.fromkeys(pictures)):
        picture.file = f"textures/{number:04}.exr"
        write_exr(folder / picture.file, picture.pixels)


def numbers(values):
    return " ".join(f"{v:.9g}" for v in np.ravel(values))


def lines(array, integer=False):
    return "\n".join(" ".join(map(str, row)) if integer else numbers(row) for row in array.tolist())


def transform(matrix):
    return f"Transform [ {numbers(np.asarray(matrix).T)} ]\n"


def equal_area(pixels):
    """A map of latitude and longitude as pbrt-v4's square of equal areas (Clarberg 2008, Fast equal-area mapping of the
    (hemi)sphere using SIMD)."""
    height, width = pixels.shape[:2]
    size = 1 << max(4, math.ceil(math.log2(math.sqrt(width * height / 2))))
    x, y = np.meshgrid(*[(np.arange(size) + .5) / size * 2 - 1] * 2)
    signed = 1 - (abs(x) + abs(y))
    r = 1 - abs(signed)
    phi = np.where(r > 0, (abs(y) - abs(x)) / np.maximum(r, 1e-12) + 1, 1) * (math.pi / 4)
    z = np.copysign(1 - r * r, signed)
    across = r * np.sqrt(np.maximum(0, 2 - r * r))
    dx, dy = np.copysign(np.cos(phi), x) * across, np.copysign(np.sin(phi), y) * across
    column = (np.arctan2(dy, dx) / (2 * math.pi)) % 1 * width - .5
    row = np.clip(np.arccos(np.clip(z, -1, 1)) / math.pi * height - .5, 0, height - 1)
    c0, r0 = np.floor(column).astype(int), np.floor(row).astype(int)
    fc, fr = (column - c0)[..., None], (row - r0)[..., None]
    r1 = np.minimum(r0 + 1, height - 1)
    at = lambda r, c: pixels[r, c % width]
    return (at(r0, c0) * (1 - fc) + at(r0, c0 + 1) * fc) * (1 - fr) + (at(r1, c0) * (1 - fc) + at(r1, c0 + 1) * fc) * fr


class PbrtText:
    """`version` is v2, v3 or v4."""

    def __init__(self, model, folder, version):
        self.model, self.folder, self.version = model, folder, version
        self.textures = {}

    def write(self):
        """VERSION-world.pbrt and VERSION.pbrt, which includes it; returns the path of the latter."""
        m = self.model
        surfaces = "".join(self.surface(name, s) for name, s in sorted(m.surfaces.items(), key=lambda s: "of" in s[1]))
        lights = "".join(self.light(k, light) for k, light in enumerate(m.lights))
        objects = "".join(f'ObjectBegin "{name}"\n{"".join(map(self.shape, shapes))}ObjectEnd\n'
                          for name, shapes in m.prototypes.items())
        placed = "".join(f'AttributeBegin\n{transform(matrix)}ObjectInstance "{name}"\nAttributeEnd\n'
                         for name, matrix in m.instances)
        with open(self.folder / f"{self.version}-world.pbrt", "w") as out:
            out.write("WorldBegin\n" + "".join(self.textures.values()) + surfaces + lights + objects)
            for s in m.shapes:
                out.write(self.shape(s))
            out.write(placed + ("" if self.version == "v4" else "WorldEnd\n"))
        path = self.folder / f"{self.version}.pbrt"
        path.write_text(self.head(m.resolution, 64, f"{self.version}.exr"))
        return path

    def head(self, resolution, spp, picture):
        m, v = self.model, self.version
        out = transform(np.linalg.inv(m.camera_to_world)) + f'Camera "perspective" "float fov" [ {m.fov:.9g} ]'
        if m.lens[0] > 0:
            out += f' "float lensradius" [ {m.lens[0]:.9g} ] "float focaldistance" [ {m.lens[1]:.9g} ]'
        out += f'\nFilm "{"rgb" if v == "v4" else "image"}" "integer xresolution" [ {resolution[0]} ] ' \
               f'"integer yresolution" [ {resolution[1]} ] "string filename" [ "{picture}" ]\n'
        size = "radius" if v == "v4" else "width"
        out += f'PixelFilter "box" "float x{size}" [ 0.5 ] "float y{size}" [ 0.5 ]\n'
        sampler = {"v2": "lowdiscrepancy", "v3": "halton", "v4": "zsobol"}[v]
        out += f'Sampler "{sampler}" "integer pixelsamples" [ {spp} ]\n'
        depth = m.depth - (v == "v2")
        out += f'{"Surface" if v == "v2" else ""}Integrator "path" "integer maxdepth" [ {depth} ]\n'
        return out + f'Include "{v}-world.pbrt"\n'

    def value(self, name, v):
        """A colour or a texture as a parameter."""
        if isinstance(v, np.ndarray):
            return f' "rgb {name}" [ {numbers(v)} ]'
        key = f"t{list(self.textures).index(id(v)) if id(v) in self.textures else len(self.textures)}"
        mapping = f'"float uscale" [ {v.scale[0]:.9g} ] "float vscale" [ {v.scale[1]:.9g} ] ' \
                  f'"float udelta" [ {v.delta[0]:.9g} ] "float vdelta" [ {v.delta[1]:.9g} ]'
        kind = "spectrum" if self.version == "v4" else "color"
        if isinstance(v, standins.Checks):
            text = f'Texture "{key}" "{kind}" "checkerboard" {mapping} "rgb tex1" [ {numbers(v.first)} ] ' \
                   f'"rgb tex2" [ {numbers(v.second)} ]\n'
        else:
            file = v.file
            if self.version == "v2":  # whose first row is the lowest t
                file = file.replace(".exr", "-v2.exr")
                write_exr(self.folder / file, v.pixels[::-1])
            text = f'Texture "{key}" "{kind}" "imagemap" {mapping} "string filename" [ "{file}" ] ' \
                   f'"string wrap" [ "{v.wrap}" ]\n'
        self.textures[id(v)] = text
        return f' "texture {name}" [ "{key}" ]'

    def surface(self, name, s):
        v4, kind = self.version == "v4", s["kind"]
        rough = ""
        if "alpha" in s and (kind != "glass" or s["alpha"] > 0):
            value = s["alpha"]
            if self.version == "v2":
                value = 1 / max(2 / s["alpha"] ** 2 - 2, 1e-3)
            rough = f' "float roughness" [ {value:.9g} ]'
            if self.version != "v2":
                rough += ' "bool remaproughness" [ "false" ]'
        if kind == "matte":
            words = "diffuse" + self.value("reflectance", s["kd"]) if v4 else "matte" + self.value("Kd", s["kd"])
        elif kind == "plastic":
            if v4:
                words = self.coated(s)
            else:
                words = "plastic" if abs(s["eta"] - 1.5) < 1e-6 else "uber"
                words += self.value("Kd", s["kd"]) + self.value("Ks", s["ks"])
                if words.startswith("uber"):
                    words += f' "float {"index" if self.version == "v2" else "eta"}" [ {s["eta"]:.9g} ]'
        elif kind == "substrate":
            if v4:
                words = self.coated(s)
            else:
                words = "substrate" + self.value("Kd", s["kd"]) + self.value("Ks", s["ks"])
                rough = "".join(rough.replace("roughness", n + "roughness", 1) for n in "uv").replace(
                    ' "bool remaproughness" [ "false" ]', "", 1)
        elif kind == "metal":
            words = ("conductor" if v4 else "metal") + self.value("eta", s["eta"]) + self.value("k", s["k"])
        elif kind == "glass":
            index = f'[ {s["eta"]:.9g} ]'
            words = f'dielectric "float eta" {index}' if v4 else \
                f'glass "float index" {index}' + self.value("Kr", s["kr"]) + self.value("Kt", s["kt"])
            if rough and not v4:
                rough = rough.replace('"float roughness"', '"float uroughness"') + \
                    f' "float vroughness" [ {s["alpha"]:.9g} ]'
        elif kind == "mirror":
            words = f'conductor{self.value("reflectance", s["kr"])} "float roughness" [ 0 ]' if v4 else \
                "mirror" + self.value("Kr", s["kr"])
        elif v4:
            words = f'mix "string materials" [ "{s["of"][0]}" "{s["of"][1]}" ] "float amount" [ {1 - s["amount"]:.9g} ]'
        else:
            words = f'mix "string namedmaterial1" [ "{s["of"][0]}" ] "string namedmaterial2" [ "{s["of"][1]}" ]' + \
                self.value("amount", np.full(3, s["amount"]))
        first, _, rest = words.partition(" ")
        return f'MakeNamedMaterial "{name}" "string type" [ "{first}" ] {rest}{rough}\n'

    def coated(self, s):
        """pbrt-v4's coat: the diffuse surface under it that makes the albedo A in even light. With the share T let in and Fi
        thrown back inside, A = T (1 - Fi) k / (1 - Fi k)."""
        eta, albedo = standins.coat(s)
        into = standins.transmitted(eta)
        back = 1 - into / eta ** 2
        k = standins.mapped(albedo, lambda a: np.minimum(a / (into * (1 - back) + a * back), 1))
        if isinstance(k, standins.Picture):
            k.file = f"textures/v4-{len(self.textures)}.exr"
            write_exr(self.folder / k.file, k.pixels)
        return "coateddiffuse" + self.value("reflectance", k) + f' "float eta" [ {eta:.9g} ] "float thickness" [ 0 ]'

    def light(self, number, light):
        point = "point3" if self.version == "v4" else "point"
        def at(name, p):
            return f' "{point} {name}" [ {numbers(p)} ]'
        out = "AttributeBegin\n"
        kind = light["kind"]
        if kind == "infinite":
            out += transform(light["to_world"])
            if isinstance(light["L"], np.ndarray):
                words = self.value("L", light["L"])
            elif self.version == "v4":
                file = f"textures/light{number}-v4.exr"
                write_exr(self.folder / file, equal_area(light["L"].pixels))
                words = f' "string filename" [ "{file}" ]'
            else:
                words = f' "string mapname" [ "{light["L"].file}" ]'
        elif kind == "distant":
            words = self.value("L", light["L"]) + at("from", -light["towards"]) + at("to", np.zeros(3))
        else:
            words = self.value("I", light["I"]) + at("from", light["from"])
            if kind == "spot":
                words += at("to", light["to"]) + f' "float coneangle" [ {light["cone"]:.9g} ] ' \
                                                 f'"float conedeltaangle" [ {light["delta"]:.9g} ]'
        return out + f'LightSource "{kind}"{words}\nAttributeEnd\n'

    def shape(self, s):
        out = f'AttributeBegin\nNamedMaterial "{s.surface}"\n'
        if s.emission:
            out += f'AreaLightSource "{"area" if self.version == "v2" else "diffuse"}" "rgb L" [ {numbers(s.emission)} ]\n'
        if self.version == "v2" and isinstance(s, standins.Quadric) and s.kind == "disk":
            s = standins.as_mesh(s)  # pbrt-v2 shows a disk's light on one side and samples the other
        if isinstance(s, standins.Quadric):
            out += ("ReverseOrientation\n" if s.flip else "") + transform(s.to_world)
            words = f'"{s.kind}" "float radius" [ {s.radius:.9g} ]'
        elif self.version == "v2":  # which reads no PLY
            words = f'"trianglemesh" "integer indices" [\n{lines(s.faces, True)}\n] "point P" [\n{lines(s.positions)}\n]'
            if s.normals is not None:
                words += f' "normal N" [\n{lines(s.normals)}\n]'
            if s.uvs is not None:
                words += f' "float uv" [\n{lines(s.uvs)}\n]'
        else:
            words = f'"plymesh" "string filename" [ "{s.file}" ]'
        return out + f"Shape {words}\nAttributeEnd\n"
