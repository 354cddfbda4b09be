"""Reads the pbrt text that `cloudrenderer split --text` writes: few directives, all spectra as RGB, meshes in world space."""
import copy
import dataclasses
import pathlib
import re

import numpy as np

TOKEN = re.compile(r'\s*(?:#[^\n]*\s*)*("(?:[^"\\]|\\.)*"|\[|[^\s"\[\]#]+)')


class TextError(Exception):
    pass


@dataclasses.dataclass
class Entity:
    """A directive's type and its parameters: name -> numbers (an array) or strings (a list)."""
    type: str
    params: dict
    to_world: np.ndarray = None
    kinds: dict = dataclasses.field(default_factory=dict)   # name -> pbrt's type word

    def number(self, name, default):
        value = self.params.get(name)
        return default if value is None or isinstance(value, list) else float(value[0])

    def word(self, name, default=""):
        value = self.params.get(name)
        return value[0] if isinstance(value, list) and value else default

    def flag(self, name, default=False):
        return self.word(name, "true" if default else "false") == "true"

    def rgb(self, name, default):
        """The value, if it is not a texture."""
        value = self.params.get(name)
        if value is None or isinstance(value, list):
            return np.broadcast_to(np.asarray(default, float), 3)
        return np.broadcast_to(np.asarray(value, float), 3)

    def texture(self, name):
        return self.word(name) if self.kinds.get(name) == "texture" else None


@dataclasses.dataclass
class Texture:
    entity: Entity
    is_float: bool


@dataclasses.dataclass
class Shape:
    entity: Entity
    material: str | None        # the name of a named material; None: passed through
    light: Entity | None
    reverse: bool


@dataclasses.dataclass
class Scene:
    """What the text says; matrices are 4 x 4 for columns."""
    folder: pathlib.Path
    dialect: str = "v3"
    world_to_camera: np.ndarray = None
    options: dict = dataclasses.field(default_factory=dict)      # directive -> Entity
    textures: dict = dataclasses.field(default_factory=dict)
    materials: dict = dataclasses.field(default_factory=dict)
    lights: list = dataclasses.field(default_factory=list)
    shapes: list = dataclasses.field(default_factory=list)
    prototypes: dict = dataclasses.field(default_factory=dict)   # name -> shapes
    instances: list = dataclasses.field(default_factory=list)    # (name, matrix)
    left_out: set = dataclasses.field(default_factory=set)


@dataclasses.dataclass
class _State:
    matrix: np.ndarray
    material: str | None = None
    light: Entity | None = None
    reverse: bool = False


OPTIONS = ("Camera", "Film", "Sampler", "PixelFilter", "SurfaceIntegrator", "Integrator", "Renderer", "VolumeIntegrator")


class _Reader:
    def __init__(self, folder):
        self.scene = Scene(pathlib.Path(folder))
        self.state = _State(np.eye(4))
        self.saved = []
        self.inside = None      # the shapes of the prototype that is read
        self.at_start = True    # of something that moves: its end is left out

    def read(self, path):
        text = path.read_text()
        position = 0
        while (found := TOKEN.match(text, position)):
            position = self.directive(found.group(1), text, found.end(), path)
        if text[position:].strip():
            raise TextError(f"{path}: expected a directive, found {text[position:position + 40]!r}")

    def directive(self, word, text, position, path):
        strings = {"Include": 1, "NamedMaterial": 1, "ObjectBegin": 1, "ObjectInstance": 1, "MediumInterface": 2,
                   "Texture": 3, "MakeNamedMaterial": 1, "MakeNamedMedium": 1, "Material": 1, "Shape": 1,
                   "LightSource": 1, "AreaLightSource": 1, "Volume": 1} | {name: 1 for name in OPTIONS}
        names = []
        for _ in range(strings.get(word, 0)):
            found = TOKEN.match(text, position)
            names.append(unquote(found.group(1)))
            position = found.end()
        if word == "Transform":
            end = text.index("]", position)
            if self.at_start:
                self.state.matrix = np.fromstring(text[text.index("[", position) + 1:end], sep=" ").reshape(4, 4).T
            return end + 1
        if word == "ActiveTransform":
            found = TOKEN.match(text, position)
            self.at_start = found.group(1) != "EndTime"
            if not self.at_start:
                self.scene.left_out.add("motion: everything stands where it starts")
            return found.end()
        if word == "TransformTimes":
            return re.compile(r"\s*\S+\s+\S+").match(text, position).end()
        if word in ("AttributeBegin", "TransformBegin"):
            self.saved.append(copy.copy(self.state))
        elif word in ("AttributeEnd", "TransformEnd"):
            self.state = self.saved.pop()
        elif word == "Identity":
            self.state.matrix = np.eye(4)
        elif word == "ReverseOrientation":
            self.state.reverse = not self.state.reverse
        elif word == "WorldBegin":
            self.state = _State(np.eye(4))
        elif word == "Include":
            self.read(self.scene.folder / names[0])
        elif word == "NamedMaterial":
            self.state.material = names[0]
        elif word == "ObjectBegin":
            self.inside = self.scene.prototypes.setdefault(names[0], [])
        elif word == "ObjectEnd":
            self.inside = None
        elif word == "ObjectInstance":
            if self.inside is not None:
                self.scene.left_out.add("instances inside of objects")
            self.scene.instances.append((names[0], self.state.matrix))
        elif word in strings:
            params, kinds, position = parameters(text, position)
            self.entity(word, names, Entity(names[-1], params, self.state.matrix, kinds))
        elif word != "WorldEnd":
            raise TextError(f"{path}: the directive {word} is not one that split --text writes")
        return position

    def entity(self, word, names, entity):
        scene = self.scene
        if word in OPTIONS:
            scene.options["Integrator" if word == "SurfaceIntegrator" else word] = entity
            if word == "SurfaceIntegrator":
                scene.dialect = "v2"
            if word == "Camera":
                scene.world_to_camera = self.state.matrix
        elif word == "Texture":
            entity.type = names[2]
            scene.textures[names[0]] = Texture(entity, names[1] == "float")
        elif word == "MakeNamedMaterial":
            entity.type = entity.word("type")
            scene.materials[names[0]] = entity
        elif word == "Material":
            self.state.material = None if names[0] in ("none", "") else "matte"
            scene.materials.setdefault("matte", Entity("matte", {}))
        elif word == "LightSource":
            scene.lights.append(entity)
        elif word == "AreaLightSource":
            self.state.light = entity
        elif word == "Shape":
            shapes = scene.shapes if self.inside is None else self.inside
            shapes.append(Shape(entity, self.state.material, self.state.light, self.state.reverse))
        elif word in ("MakeNamedMedium", "Volume"):
            scene.left_out.add("media: a vacuum everywhere")


def unquote(word):
    if not word.startswith('"'):
        raise TextError(f"expected a quoted string, found {word!r}")
    return re.sub(r"\\(.)", r"\1", word[1:-1])


def parameters(text, position):
    """Follows the list of parameters; arrays of numbers become numpy's."""
    params, kinds = {}, {}
    while (found := TOKEN.match(text, position)) and found.group(1).startswith('"'):
        kind, name = unquote(found.group(1)).split()
        position = found.end()
        value = TOKEN.match(text, position)
        if value.group(1) == "[":
            end = closing(text, value.end())
            inside = text[value.end():end]
            position = end + 1
        else:
            inside = value.group(1)
            position = value.end()
        if '"' in inside:
            params[name] = [unquote(w) for w in re.findall(r'"(?:[^"\\]|\\.)*"', inside)]
        else:
            params[name] = np.fromstring(inside, sep=" ", dtype=np.int64 if kind == "integer" else np.float64)
        kinds[name] = kind
    return params, kinds, position


def closing(text, position):
    """The bracket that ends an array; strings may hold others."""
    end = text.index("]", position)
    quote = text.find('"', position, end)
    while quote >= 0:
        stop = re.compile(r'(?:[^"\\]|\\.)*"').match(text, quote + 1).end()
        end = text.index("]", stop)
        quote = text.find('"', stop, end)
    return end


def read_scene(folder):
    """Of the folder that `cloudrenderer split --text -o FOLDER` made."""
    reader = _Reader(folder)
    reader.read(pathlib.Path(folder) / "main.pbrt")
    return reader.scene
