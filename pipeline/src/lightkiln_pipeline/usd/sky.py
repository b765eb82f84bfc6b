"""Dome lights → the environment of LIGHTKILN_scene.

UsdLux's picture has its centre at +Z and +X a quarter to the left (OpenEXR's convention); the baker's has its centre
at +X and +Z a quarter to the right. A single untinted dome goes in as the file it is; everything else is drawn into
one picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom, UsdLux

from ..errors import Notes
from ..glb.writer import GlbWriter, Json
from .images import ImageFault, Pixels, file_bytes, image_bytes, linear_texture
from .networks import Texture
from .placement import quaternion, rotation_and_scale
from .stage import Matrix, Scene

Rgb = npt.NDArray[np.float64]

# From the baker's picture to UsdLux's: a turn by −90° about +Y.
_PICTURE = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
_POLE_TO_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_WIDEST = 8192


@dataclass
class _Dome:
    radiance: Rgb
    rotation: Matrix
    """The baker's picture → the world, 3 × 3."""
    file: str
    pixels: Pixels | None


def environment(scene: Scene, domes: list[tuple[Any, Rgb]], glb: GlbWriter, notes: Notes) -> Json | None:
    """The environment of all domes; none without any."""
    read = [_read(scene, prim, radiance, notes) for prim, radiance in domes]
    read = [dome for dome in read if dome.radiance.max() > 0]
    if not read:
        return None
    if all(dome.pixels is None for dome in read):
        return {"radiance": [float(x) for x in np.sum([dome.radiance for dome in read], axis=0)]}
    first = read[0]
    if len(read) == 1 and np.ptp(first.radiance) <= 1e-6 * first.radiance.max() and _is_native(first.file):
        data, strength, rotation = file_bytes(first.file), float(first.radiance[0]), first.rotation
    else:
        data, strength, rotation = image_bytes(_drawn(read), "exr", bits="float"), 1.0, np.eye(3)
    image = {"bufferView": glb.view(data)}
    return {"image": image, "rotation": quaternion(rotation), "strength": strength}


def _is_native(file: str) -> bool:
    return Path(file.rstrip("]")).suffix.lower() in (".exr", ".hdr")


def _read(scene: Scene, prim: Any, radiance: Rgb, notes: Notes) -> _Dome:
    world = scene.world(prim)
    axes, _ = rotation_and_scale(world)
    rotation = _rotation_matrix(axes)
    if prim.IsA(UsdLux.DomeLight_1):
        axis = str(UsdLux.DomeLight_1(prim).GetPoleAxisAttr().Get())
        z_up = UsdGeom.GetStageUpAxis(scene.stage) == UsdGeom.Tokens.z
        if axis == "Z" or (axis == "scene" and z_up):
            rotation = rotation @ _POLE_TO_Z
    dome = UsdLux.DomeLight_1(prim) if prim.IsA(UsdLux.DomeLight_1) else UsdLux.DomeLight(prim)
    file, pixels = _picture(dome, scene.time, notes)
    return _Dome(radiance, rotation @ _PICTURE, file, pixels)


def _picture(dome: Any, time: Any, notes: Notes) -> tuple[str, Pixels | None]:
    asset = dome.GetTextureFileAttr().Get(time)
    if not asset or not asset.path:
        return "", None
    place = dome.GetPath()
    form = str(dome.GetTextureFormatAttr().Get(time))
    if not asset.resolvedPath:
        notes.add(place, f"its texture `{asset.path}` was not found; it shines in its colour alone, put the file there")
        return "", None
    try:
        pixels, _ = linear_texture(Texture(str(asset.resolvedPath), "rgb"))
    except ImageFault as fault:
        notes.add(place, f"its texture `{asset.path}` cannot be read ({fault}); it shines in its colour alone")
        return "", None
    if form not in ("automatic", "latlong"):
        notes.add(place, f"texture format `{form}` is not read: its mean colour is baked; convert it to latlong")
        pixels = np.broadcast_to(pixels.reshape(-1, pixels.shape[2]).mean(axis=0), (8, 16, pixels.shape[2]))
        return "", np.ascontiguousarray(pixels)
    return str(asset.resolvedPath), pixels


def _drawn(domes: list[_Dome]) -> Pixels:
    """The sum of all domes as one picture in the baker's frame."""
    width = min(max(dome.pixels.shape[1] for dome in domes if dome.pixels is not None), _WIDEST)
    height = width // 2
    longitude = 2 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)
    lon, lat = np.meshgrid(longitude, latitude)
    directions = np.stack([np.cos(lon) * np.cos(lat), np.sin(lat), np.sin(lon) * np.cos(lat)], axis=-1)
    total = np.zeros((height, width, 3), np.float32)
    for dome in domes:
        seen = _looked_up(dome.pixels, directions @ dome.rotation) if dome.pixels is not None else 1.0
        total += (seen * dome.radiance).astype(np.float32)
    return total


def _looked_up(pixels: Pixels, directions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """A picture in the baker's layout towards directions, bilinear."""
    height, width = pixels.shape[:2]
    x = (np.arctan2(directions[..., 2], directions[..., 0]) / (2 * np.pi) + 0.5) * width - 0.5
    y = (0.5 - np.arcsin(np.clip(directions[..., 1], -1, 1)) / np.pi) * height - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    s, t = (x - column)[..., None], (y - row)[..., None]
    left, right = column % width, (column + 1) % width
    above, below = np.clip(row, 0, height - 1), np.clip(row + 1, 0, height - 1)
    color = pixels[..., :3].astype(np.float64)
    top = color[above, left] * (1 - s) + color[above, right] * s
    bottom = color[below, left] * (1 - s) + color[below, right] * s
    return np.asarray(top * (1 - t) + bottom * t)


def _rotation_matrix(q: list[float]) -> Matrix:
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
