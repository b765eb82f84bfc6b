# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's images as glTF images: taken from the file where that is what glTF wants, else encoded as PNG.

Reading pixels needs Blender's main thread; encoding does not, and waits until the file is written.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt

from ..errors import BakeError

Pixels = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]


@dataclass
class Picture:
    """An image on its way into the file: bytes of a PNG or JPEG, or 8-bit pixels, top row first."""

    name: str
    encoded: bytes = b""
    mime: str = "image/png"
    pixels: Bytes | None = None

    def data(self) -> bytes:
        """The bytes for the file."""
        return self.encoded if self.pixels is None else encode_png(self.pixels)


def encode_png(pixels: Bytes) -> bytes:
    """8-bit pixels of shape (height, width, 3 or 4), top row first, as a PNG."""
    height, width, channels = pixels.shape
    rows = np.zeros((height, 1 + width * channels), np.uint8)
    rows[:, 1:] = pixels.reshape(height, -1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 3)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def color_picture(image: bpy.types.Image) -> tuple[Picture, float]:
    """An image as sRGB, and the number that its white stands for: above 1 for images that are brighter than white."""
    original = _original_file(image)
    if original is not None:
        return original, 1.0
    pixels = read_pixels(image)
    if _is_srgb_bytes(image):
        return Picture(image.name, pixels=to_bytes(pixels)), 1.0
    white = max(float(pixels[..., :3].max(initial=0.0)), 1.0)
    pixels[..., :3] = linear_to_srgb(pixels[..., :3] / white)
    return Picture(image.name, pixels=to_bytes(pixels)), white


def masked_picture(image: bpy.types.Image | None, mask: bpy.types.Image, from_alpha: bool) -> Picture:
    """The colour of one image (white for none) with the mask's alpha, or its brightness, as alpha."""
    alpha = read_pixels(mask)
    channel = alpha[..., 3] if from_alpha else _gray(mask, alpha)
    height, width = channel.shape
    result = np.ones((height, width, 4), np.float32)
    if image is not None:
        color = read_pixels(image)
        if not _is_srgb_bytes(image):
            color[..., :3] = linear_to_srgb(np.clip(color[..., :3], 0.0, 1.0))
        rows = np.arange(height) * color.shape[0] // height
        columns = np.arange(width) * color.shape[1] // width
        result[..., :3] = color[rows][:, columns, :3]
    result[..., 3] = channel
    return Picture(image.name if image else mask.name, pixels=to_bytes(result))


def _gray(image: bpy.types.Image, pixels: Pixels) -> Pixels:
    rgb = srgb_to_linear(pixels[..., :3]) if _is_srgb_bytes(image) else pixels[..., :3]
    luminance: Pixels = rgb @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    return luminance


def read_pixels(image: bpy.types.Image) -> Pixels:
    """All pixels, top row first. Raises BakeError if the image's file is missing."""
    width, height = image.size
    if width == 0 or height == 0:
        raise BakeError(f"The image `{image.name}` has no pixels: find its file or remove it from the material")
    flat = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(flat)
    pixels = flat.reshape(height, width, image.channels)[::-1]
    if image.channels == 4:
        return pixels.copy()
    result = np.ones((height, width, 4), np.float32)
    result[..., :3] = pixels[..., :3] if image.channels >= 3 else pixels[..., :1]
    return result


def _is_srgb_bytes(image: bpy.types.Image) -> bool:
    return not image.is_float and image.colorspace_settings.name == "sRGB"


def _original_file(image: bpy.types.Image) -> Picture | None:
    """The image's own file, if it is one that glTF takes and Blender shows unchanged."""
    mimes = {"PNG": "image/png", "JPEG": "image/jpeg"}
    if image.is_dirty or not _is_srgb_bytes(image) or image.file_format not in mimes or image.source != "FILE":
        return None
    if image.packed_file:
        data = bytes(image.packed_file.data)
    else:
        path = Path(bpy.path.abspath(image.filepath, library=image.library))
        if not path.is_file():
            return None
        data = path.read_bytes()
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        # Only eight bits per channel are the same in every reader.
        return Picture(image.name, data) if data[24] == 8 else None
    return Picture(image.name, data, "image/jpeg") if data.startswith(b"\xff\xd8\xff") else None


def to_bytes(pixels: Pixels) -> Bytes:
    """Numbers from 0 to 1 as bytes."""
    return np.rint(np.clip(np.nan_to_num(pixels), 0.0, 1.0) * 255.0).astype(np.uint8)


def linear_to_srgb(linear: Pixels) -> Pixels:
    """The sRGB transfer function."""
    low = linear * 12.92
    high = 1.055 * np.power(np.maximum(linear, 1e-8), 1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, low, high).astype(np.float32)


def srgb_to_linear(encoded: Pixels) -> Pixels:
    """Its inverse."""
    high = np.power((encoded + 0.055) / 1.055, 2.4)
    return np.where(encoded <= 0.04045, encoded / 12.92, high).astype(np.float32)
