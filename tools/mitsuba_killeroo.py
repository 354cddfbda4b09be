"""Renders the killeroo scene with Mitsuba 3; run by bench_mitsuba.py inside its virtual environment.

usage: mitsuba_killeroo.py VARIANT GEOMETRY.pbrt WIDTH SPP THREADS OUT.npy

Camera, lights and shapes are those of killeroo-path.pbrt, one level of Loop subdivision moved to the limit surface
(Loop 1987; limit masks as in the SIGGRAPH 2000 subdivision course). Plastic becomes roughplastic with the Beckmann
width that belongs to the Blinn exponent (Walter et al. 2007: alpha^2 = 2 / (e + 2)). Prints one JSON object.
"""
import json
import re
import resource
import sys
import time

import numpy as np


def read_mesh(path):
    text = open(path).read()
    arrays = dict(re.findall(r'"\w+ (\w+)"\s*\[([^\]]*)\]', text))
    faces = np.array(arrays["indices"].split(), dtype=np.int64).reshape(-1, 3)
    points = np.array(arrays["P"].split(), dtype=np.float64).reshape(-1, 3)
    return faces, points, int(arrays.get("nlevels", "3"))


def edges_of(faces):
    """Unique undirected edges, the edge number of every face side, and the opposite vertices summed up by edge."""
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, number, count = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    return edges, number.reshape(-1, 3), count


def ring_sums(edges, count, points):
    """For every vertex: is it on the border, its valence, the sum of its neighbours (border: border neighbours)."""
    n = len(points)
    border_edges = edges[count == 1]
    border = np.zeros(n, bool)
    border[border_edges] = True
    valence, total, border_total = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3))
    for a, b in ((0, 1), (1, 0)):
        np.add.at(valence, edges[:, a], 1)
        np.add.at(total, edges[:, a], points[edges[:, b]])
        np.add.at(border_total, border_edges[:, a], points[border_edges[:, b]])
    return border, valence[:, None], total, border_total


def subdivide(faces, points):
    edges, number, count = edges_of(faces)
    border, valence, total, border_total = ring_sums(edges, count, points)
    beta = np.where(valence == 3, 3 / 16, 3 / (8 * np.maximum(valence, 1)))
    old = np.where(border[:, None], 0.75 * points + border_total / 8, (1 - valence * beta) * points + beta * total)
    opposite = np.zeros((len(edges), 3))
    for side in range(3):
        np.add.at(opposite, number[:, side], points[faces[:, (side + 2) % 3]])
    ends = points[edges[:, 0]] + points[edges[:, 1]]
    new = np.where((count == 1)[:, None], ends / 2, 3 / 8 * ends + opposite / 8)
    a, b, c = faces.T
    ab, bc, ca = (number + len(points)).T
    children = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return children, np.concatenate([old, new])


def to_limit(faces, points):
    edges, _, count = edges_of(faces)
    border, valence, total, border_total = ring_sums(edges, count, points)
    beta = np.where(valence == 3, 3 / 16, 3 / (8 * np.maximum(valence, 1)))
    gamma = 1 / (valence + 3 / (8 * beta))
    return np.where(border[:, None], 3 / 5 * points + border_total / 5, (1 - valence * gamma) * points + gamma * total)


def make_scene(mi, faces, points, width, spp):
    transform = mi.ScalarTransform4f

    def mesh(to_world, kd, ks, roughness):
        world = (np.array(to_world.matrix, dtype=np.float64) @ np.c_[points, np.ones(len(points))].T).T[:, :3]
        bsdf = mi.load_dict({
            "type": "roughplastic", "distribution": "beckmann", "alpha": (2 / (1 / roughness + 2)) ** 0.5,
            "int_ior": 1.5, "diffuse_reflectance": {"type": "rgb", "value": kd},
            "specular_reflectance": {"type": "rgb", "value": ks}})
        props = mi.Properties()
        props["mesh_bsdf"] = bsdf
        result = mi.Mesh("killeroo", len(world), len(faces), has_vertex_normals=True, props=props)
        params = mi.traverse(result)
        params["vertex_positions"] = world.astype(np.float32).ravel()
        params["faces"] = faces.astype(np.uint32).ravel()
        sides = [world[faces[:, k]] for k in range(3)]
        flat = np.cross(sides[1] - sides[0], sides[2] - sides[0])
        normals = np.zeros_like(world)
        for k in range(3):
            np.add.at(normals, faces[:, k], flat)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        params["vertex_normals"] = normals.astype(np.float32).ravel()
        params.update()
        return result

    def quad(to_world):
        return {"type": "rectangle", "to_world": to_world, "bsdf": {
            "type": "twosided", "nested": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [.5, .5, .8]}}}}

    base = transform().scale(0.5) @ transform().rotate([0, 0, 1], -60) @ transform().translate([100, 200, -140])
    camera = transform().rotate([0, 0, 1], 5) @ transform().look_at(
        origin=[400, 20, 30], target=[0, 63, -110], up=[0, 0, 1]) @ transform().scale([-1, 1, 1])
    walls = transform().translate([0, 0, -140])
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 7, "rr_depth": 4},
        "sensor": {
            "type": "perspective", "fov": 39, "to_world": camera,
            "sampler": {"type": "independent", "sample_count": spp},
            "film": {"type": "hdrfilm", "width": width, "height": width, "rfilter": {"type": "box"}}},
        "light": {
            "type": "sphere", "radius": 3, "to_world": transform().translate([150, 120, 20]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [2000, 2000, 2000]}},
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0, 0, 0]}}},
        "floor": quad(walls @ transform().scale([1000, 1000, 1])),
        "back": quad(walls @ transform().translate([-400, 0, 0]) @ transform().rotate([0, 1, 0], 90)
                     @ transform().scale([1000, 1000, 1])),
        "red": mesh(base, [.4, .2, .2], [.5, .5, .5], .025),
        "green": mesh(base @ transform().translate([-200, 0, 0]), [.4, .5, .4], [.3, .3, .3], .15)})


def seconds():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return time.monotonic(), usage.ru_utime + usage.ru_stime


def main():
    variant, geometry, width, spp, threads, out = sys.argv[1:]
    import drjit as dr
    import mitsuba as mi
    mi.set_variant(variant)
    dr.set_thread_count(int(threads))
    faces, points, levels = read_mesh(geometry)
    for _ in range(levels):
        faces, points = subdivide(faces, points)
    points = to_limit(faces, points)
    marks = [seconds()]
    scene = make_scene(mi, faces, points, int(width), int(spp))
    marks.append(seconds())
    if variant.startswith("llvm"):  # one sample a pixel: tracing and compiling the kernel, told apart
        np.array(mi.render(scene, spp=1))
    marks.append(seconds())
    image = np.array(mi.render(scene, spp=int(spp)))
    marks.append(seconds())
    np.save(out, image[:, :, :3])
    spans = [[round(b[k] - a[k], 3) for k in (0, 1)] for a, b in zip(marks, marks[1:])]
    print(json.dumps({"triangles": 2 * len(faces) + 4, "load": spans[0], "compile": spans[1], "render": spans[2]}))


if __name__ == "__main__":
    main()
