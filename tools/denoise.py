#!/usr/bin/env python3
"""Denoises pictures of `cloudrenderer render --layers albedo,normal` with Open Image Denoise (PyPI: pyoidn).

    python3 tools/denoise.py noisy.exr clean.exr
    python3 tools/denoise.py noisy.exr clean.exr --reference converged.exr     and what it gained, with and without layers
"""
import argparse

import numpy as np
import OpenImageIO as oiio


def read(path):
    """{channel: rows x columns}"""
    file = oiio.ImageInput.open(str(path))
    if not file:
        raise SystemExit(f"cannot read {path}: {oiio.geterror()}")
    spec = file.spec()
    pixels = np.array(file.read_image(0, 0, 0, spec.nchannels, "float"), dtype=np.float32).reshape(spec.height, spec.width, -1)
    return {name: pixels[..., i] for i, name in enumerate(spec.channelnames)}


def three(channels, names, path):
    if missing := [n for n in names if n not in channels]:
        raise SystemExit(f"{path} has no channel {missing[0]}: render it with --layers albedo,normal")
    return np.ascontiguousarray(np.stack([channels[n] for n in names], axis=-1))


def apply(images, **options):
    """The filter for ray-traced pictures; images: {"color" and what helps, or one layer alone}."""
    from pyoidn import Device, Filter
    first = next(iter(images.values()))
    result = np.zeros_like(first)
    with Device() as device:
        device.commit()
        with Filter(device, "RT") as rt:
            for name, image in (*images.items(), ("output", result)):
                rt.set_image(name, image, 3, image.shape[1], image.shape[0])  # 3: OIDN_FORMAT_FLOAT3
            for name, value in options.items():
                rt.set_bool(name, value)
            rt.commit()
            rt.execute()
        if error := device.get_error():
            raise SystemExit(f"Open Image Denoise: {error}")
    return result


def denoise(color, albedo=None, normal=None):
    """With layers, which are denoised first: few samples leave noise at edges and behind lenses in them, too."""
    if albedo is None:
        return apply({"color": color}, hdr=True)
    return apply({"color": color, "albedo": apply({"albedo": albedo}), "normal": apply({"normal": normal})}, hdr=True, cleanAux=True)


def relmse(a, b):
    """Of all pixels, and without the worst 0.1 % of them, as `cloudrenderer compare` has it."""
    each = np.sort(np.mean((a.astype(np.float64) - b) ** 2 / (b.astype(np.float64) ** 2 + 0.01), axis=2).ravel())
    return each.mean(), each[:max(1, len(each) * 999 // 1000)].mean()


def write(path, pixels):
    out = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, "float"))
    out.set_pixels(oiio.ROI(0, pixels.shape[1], 0, pixels.shape[0], 0, 1, 0, 3), np.ascontiguousarray(pixels))
    if not out.write(str(path)):
        raise SystemExit(f"cannot write {path}: {out.geterror()}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("noisy")
    parser.add_argument("clean")
    parser.add_argument("--reference")
    options = parser.parse_args()
    channels = read(options.noisy)
    color = three(channels, "RGB", options.noisy)
    albedo = three(channels, [f"albedo.{c}" for c in "RGB"], options.noisy)
    normal = three(channels, [f"N.{c}" for c in "XYZ"], options.noisy)
    clean = denoise(color, albedo, normal)
    write(options.clean, clean)
    if options.reference:
        wanted = three(read(options.reference), "RGB", options.reference)
        for name, picture in (("noisy", color), ("denoised without layers", denoise(color)), ("denoised with layers", clean)):
            print("%s: relMSE %.5f, without the worst 0.1 %% of the pixels %.5f" % (name, *relmse(picture, wanted)))


if __name__ == "__main__":
    main()
