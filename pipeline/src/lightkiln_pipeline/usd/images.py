"""Reads pictures through OpenImageIO and writes the PNGs that glTF wants: texture files → linear arrays → bytes.

Arrays are (height, width, channels), row 0 at the top, linear Rec.709 where they hold colour.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio
from pxr import Ar

from .networks import Texture

Pixels = npt.NDArray[np.float32]

# More than a lightmap's texels can tell of reflectance.
_LARGEST_SET = 4096


class ImageFault(Exception):
    """A picture cannot be read; the message says why."""


def file_bytes(file: str) -> bytes:
    """The content of a file on disk or inside a package. Raises ImageFault."""
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(file))
    if asset is None:
        raise ImageFault("it cannot be opened")
    return bytes(asset.GetBuffer())


def read_pixels(file: str) -> tuple[Pixels, bool]:
    """All pixels as stored, and whether they have 8 bits per channel. Raises ImageFault."""
    if "[" not in file:
        return _read(file)
    with tempfile.TemporaryDirectory() as folder:
        extracted = Path(folder) / Path(file.rstrip("]")).name
        extracted.write_bytes(file_bytes(file))
        return _read(str(extracted))


def _read(file: str) -> tuple[Pixels, bool]:
    source = oiio.ImageBuf(file)
    pixels = source.get_pixels(oiio.FLOAT)
    if source.has_error or pixels is None:
        raise ImageFault(str(source.geterror()).splitlines()[0] or "it cannot be decoded")
    is_byte = source.spec().format == oiio.UINT8
    values = np.asarray(pixels, np.float32).reshape(source.spec().height, source.spec().width, -1)
    return np.nan_to_num(values, nan=0.0, posinf=65504.0, neginf=0.0), is_byte


def linear_texture(texture: Texture) -> tuple[Pixels, bool]:
    """What a UsdUVTexture gives: RGBA with its scale and bias, and whether there is an alpha. Raises ImageFault."""
    rgba, has_alpha = _set(texture) if texture.tiles else _stored(texture.file, texture.color_space)
    return np.asarray(rgba * np.array(texture.scale) + np.array(texture.bias), np.float32), has_alpha


def _stored(file: str, color_space: str) -> tuple[Pixels, bool]:
    """RGBA of a file, linear, and whether there is an alpha."""
    pixels, is_byte = read_pixels(file)
    channels = pixels.shape[2]
    color = np.repeat(pixels[..., :1], 3, axis=2) if channels < 3 else pixels[..., :3]
    has_alpha = channels in (2, 4)
    alpha = pixels[..., -1:] if has_alpha else np.ones_like(pixels[..., :1])
    if color_space == "sRGB" or (color_space == "auto" and is_byte and channels >= 3):
        color = decode_srgb(color)
    return np.concatenate([color, alpha], axis=2), has_alpha


def _set(texture: Texture) -> tuple[Pixels, bool]:
    """The same of a set of tiles, side by side; the fallback where there is no tile."""
    columns, rows = texture.grid
    read = [(*_stored(file, texture.color_space), column, row) for file, column, row in texture.tiles]
    # All tiles as large as the largest, within bounds.
    height = min(max(tile.shape[0] for tile, *_ in read), _LARGEST_SET // rows)
    width = min(max(tile.shape[1] for tile, *_ in read), _LARGEST_SET // columns)
    whole = np.empty((rows * height, columns * width, 4), np.float32)
    # Scale and bias, which come after, are no part of the fallback.
    scale = np.where(np.array(texture.scale) == 0, 1.0, texture.scale)
    whole[:] = (np.array(texture.fallback) - np.array(texture.bias)) / scale
    for tile, _, column, row in read:
        top, left = (rows - 1 - row) * height, column * width
        whole[top : top + height, left : left + width] = resized(tile, width, height)
    return whole, any(has_alpha for _, has_alpha, *_ in read)


def picked(rgba: Pixels, output: str) -> Pixels:
    """The three channels that an output of a texture gives: a single one three times."""
    return rgba[..., :3] if output == "rgb" else np.repeat(rgba[..., ["rgba".index(output)]], 3, axis=2)


def decode_srgb(values: Pixels) -> Pixels:
    """The sRGB transfer function's way to linear values."""
    return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0) + 0.055) / 1.055) ** 2.4).astype(
        np.float32
    )


def encode_srgb(values: Pixels) -> Pixels:
    """Linear values to the sRGB transfer function, clipped to 0..1."""
    clipped = np.clip(values, 0.0, 1.0)
    encoded = np.where(clipped <= 0.0031308, clipped * 12.92, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return encoded.astype(np.float32)


def resized(pixels: Pixels, width: int, height: int) -> Pixels:
    """Pixels at another size."""
    if pixels.shape[:2] == (height, width):
        return pixels
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    source = oiio.ImageBuf(spec)
    source.set_pixels(spec.roi, np.ascontiguousarray(pixels))
    out = oiio.ImageBufAlgo.resize(source, roi=oiio.ROI(0, width, 0, height, 0, 1, 0, pixels.shape[2]))
    return np.asarray(out.get_pixels(oiio.FLOAT), np.float32).reshape(height, width, -1)


def image_bytes(pixels: Pixels, kind: str, *, bits: str = "uint8") -> bytes:
    """Pixels as a file of a kind such as png or exr, values as they are."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"image.{kind}"
        spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], bits)
        spec.attribute("oiio:ColorSpace", "lin_rec709" if kind == "exr" else "srgb_rec709_scene")
        target = oiio.ImageBuf(spec)
        target.set_pixels(spec.roi, np.ascontiguousarray(pixels, np.float32))
        if not target.write(str(path)):
            raise ImageFault(str(target.geterror()))
        return path.read_bytes()
