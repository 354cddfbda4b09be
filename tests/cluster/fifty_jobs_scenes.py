"""Small scenes of many kinds for jobs: textures, a medium, subsurface scattering, a camera that moves."""
import numpy as np
import OpenImageIO as oiio
import support

FLOOR = ('Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point P" [-6 -1 -6  6 -1 -6  6 -1 6  -6 -1 6] '
         '"float uv" [0 0 4 0 4 4 0 4]')


def _head(eye=(0, 1, -6), integrator="path"):
    return (f'Film "image" "integer xresolution" 64 "integer yresolution" 64\nLookAt {eye[0]} {eye[1]} {eye[2]}  0 0 0  0 1 0\n'
            f'Camera "perspective" "float fov" 40\nSampler "halton"\nIntegrator "{integrator}" "integer maxdepth" 5\n')


def _spheres(material, count, seed):
    """Spheres in a heap, so that a small part size gives several parts."""
    rng = np.random.default_rng(seed)
    text = [material]
    for x, y, z, r in np.column_stack((rng.uniform(-2, 2, count), rng.uniform(-1, 1, count), rng.uniform(-2, 2, count),
                                       rng.uniform(.1, .35, count))):
        text.append(f'AttributeBegin Translate {x:.4f} {y:.4f} {z:.4f} Shape "sphere" "float radius" {r:.4f} AttributeEnd')
    return "\n".join(text)


def write(folder):
    """The scenes by name, each a list of the files of its frames."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    image = oiio.ImageBuf(oiio.ImageSpec(64, 64, 3, "uint8"))
    image.set_pixels(oiio.ROI(), np.kron(rng.random((16, 16, 3)), np.ones((4, 4, 1))).astype(np.float32))
    image.write(str(folder / "squares.png"))
    texture = 'Texture "squares" "spectrum" "imagemap" "string filename" "squares.png"\n'
    lights = 'LightSource "infinite" "rgb L" [.7 .8 1]\nLightSource "distant" "point from" [3 5 -4] "point to" [0 0 0] "rgb L" [2 2 2]\n'
    textured = lights + texture + 'Material "matte" "texture Kd" "squares"\n' + FLOOR
    fog = 'MakeNamedMedium "fog" "string type" "homogeneous" "rgb sigma_a" [.02 .02 .02] "rgb sigma_s" [.1 .1 .12]\n'
    texts = {
        "textures": [_head() + "WorldBegin\n" + textured + "\n" + _spheres('Material "plastic" "texture Kd" "squares"', 60, 2)],
        "fog": [fog + 'MediumInterface "" "fog"\n' + _head(integrator="volpath") + 'MediumInterface "" "fog"\nWorldBegin\n'
                'LightSource "point" "point from" [2 4 -3] "rgb I" [40 40 40]\nMaterial "matte"\n' + FLOOR + "\n" + _spheres('Material "glass"', 30, 3)],
        "skin": [_head().replace('Integrator "path"', 'SurfaceIntegrator "path"').replace('"halton"', '"lowdiscrepancy"') + "WorldBegin\n" + lights +
                 'Material "kdsubsurface" "rgb Kd" [.7 .5 .4] "float meanfreepath" [.2] "float index" [1.3]\nShape "sphere" "float radius" [1.2]\n'],
        # Frames of one job, whose parts are the same.
        "turn": [_head((4 * np.sin(a), 1, -6 * np.cos(a))) + "WorldBegin\n" + textured + "\n" + _spheres('Material "metal"', 60, 4)
                 for a in (0.0, 0.4, 0.8)],
    }
    scenes = {"killeroo": [support.SCENE], "cornell": [support.ROOT / "scenes/cornell-box/cornell-small.pbrt"]}
    for name, frames in texts.items():
        scenes[name] = []
        for i, text in enumerate(frames):
            path = folder / (f"{name}{i}.pbrt" if len(frames) > 1 else f"{name}.pbrt")
            path.write_text(text + "\nWorldEnd\n")
            scenes[name].append(path)
    return scenes
