"""Follows the connections of shading networks: an input → its constant, texture or primvar.

Knows UsdUVTexture with UsdTransform2d and UsdPrimvarReader, and MaterialX's image nodes; everything else is noted.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from pxr import Sdf, UsdShade

from ..errors import Notes
from . import udim

Vector4 = tuple[float, float, float, float]


@dataclass(frozen=True)
class Texture:
    """A file as a shader reads it."""

    file: str
    """Resolved path, inside a package as package[file]; empty if it was not found."""
    output: str
    """Channels that are read: rgb, r, g, b or a."""
    uv: str = "st"
    """Primvar of the coordinates."""
    color_space: str = "auto"
    wrap: tuple[str, str] = ("useMetadata", "useMetadata")
    scale: Vector4 = (1.0, 1.0, 1.0, 1.0)
    bias: Vector4 = (0.0, 0.0, 0.0, 0.0)
    fallback: Vector4 = (0.0, 0.0, 0.0, 1.0)
    rotation: float = 0.0
    """Of the coordinates, degrees, counter-clockwise with v upwards; after the scale, before the shift."""
    uv_scale: tuple[float, float] = (1.0, 1.0)
    shift: tuple[float, float] = (0.0, 0.0)
    tiles: tuple[tuple[str, int, int], ...] = ()
    """Of a set of UDIM tiles: files with their column and row, row 0 at v = 0."""
    grid: tuple[int, int] = (1, 1)
    """Columns and rows of tiles that the picture has."""

    def scaled(self, factor: float) -> Texture:
        """The texture with all values multiplied."""

        def times(v: Vector4) -> Vector4:
            return (v[0] * factor, v[1] * factor, v[2] * factor, v[3])

        return dataclasses.replace(self, scale=times(self.scale), bias=times(self.bias))


@dataclass(frozen=True)
class Input:
    """What feeds an input. All none: nothing was authored."""

    value: Any = None
    texture: Texture | None = None
    primvar: str | None = None


def follow(shader: Any, key: str, time: Any, notes: Notes) -> Input:
    """What feeds the input `key` of a shader."""
    wanted = shader.GetInput(key)
    if not wanted:
        return Input()
    sources = wanted.GetValueProducingAttributes()
    if not sources:
        return Input()
    attribute = sources[0]
    if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Input:
        return Input(attribute.Get(time))
    node = UsdShade.Shader(attribute.GetPrim())
    kind, output = str(node.GetIdAttr().Get()), str(attribute.GetBaseName())
    if kind == "UsdUVTexture":
        return _uv_texture(node, output, time, notes)
    if kind.startswith("UsdPrimvarReader"):
        return Input(_constant(node, "fallback", time), None, str(_constant(node, "varname", time) or "") or None)
    if kind.startswith(("ND_image_", "ND_tiledimage_")):
        return _materialx_image(node, time, notes)
    if kind == "ND_convert_vector3_color3":
        return follow(node, "in", time, notes)
    if kind == "ND_constant_color3":
        return Input(_constant(node, "value", time))
    notes.add(node.GetPath(), f"`{kind}` into `{key}` is not read; a constant is baked instead, bake it to a texture")
    return Input()


def _constant(node: Any, key: str, time: Any) -> Any:
    """An input's value through interfaces, none if it is fed by a shader or not authored."""
    wanted = node.GetInput(key)
    sources = wanted.GetValueProducingAttributes() if wanted else []
    if not sources or UsdShade.Utils.GetType(sources[0].GetName()) != UsdShade.AttributeType.Input:
        return None
    return sources[0].Get(time)


def _uv_texture(node: Any, output: str, time: Any, notes: Notes) -> Input:
    fallback = _vector(_constant(node, "fallback", time), (0.0, 0.0, 0.0, 1.0))
    file = _file(node, time, notes)
    if not file:
        return Input(fallback[:3] if output == "rgb" else fallback["rgba".index(output)])
    wrap = tuple(str(_constant(node, k, time) or "useMetadata") for k in ("wrapS", "wrapT"))
    texture = Texture(
        file,
        output,
        color_space=str(_constant(node, "sourceColorSpace", time) or "auto"),
        wrap=(wrap[0], wrap[1]),
        scale=_vector(_constant(node, "scale", time), (1.0, 1.0, 1.0, 1.0)),
        bias=_vector(_constant(node, "bias", time), (0.0, 0.0, 0.0, 0.0)),
        fallback=fallback,
    )
    return Input(None, udim.spread(_coordinates(node, "st", texture, time, notes)))


def _materialx_image(node: Any, time: Any, notes: Notes) -> Input:
    file = _file(node, time, notes)
    if not file:
        return Input(_constant(node, "default", time))
    space = str(node.GetInput("file").GetAttr().GetColorSpace() or "")
    encoded = {"srgb_texture": "sRGB", "lin_rec709": "raw", "": "auto"}.get(space)
    if encoded is None:
        notes.add(node.GetPath(), f"colour space `{space}` is taken as linear Rec.709; convert the image")
    scalar = "float" in str(node.GetIdAttr().Get())
    texture = Texture(file, "r" if scalar else "rgb", color_space=encoded or "raw", wrap=("repeat", "repeat"))
    return Input(None, udim.spread(texture))


def _file(node: Any, time: Any, notes: Notes) -> str:
    """The resolved file of a texture node; empty, with a note, if there is none."""
    asset = _constant(node, "file", time)
    if not isinstance(asset, Sdf.AssetPath) or not asset.path:
        notes.add(node.GetPath(), "it names no file; its fallback is baked")
        return ""
    found = str(asset.resolvedPath)
    if UsdShade.UdimUtils.IsUdimIdentifier(asset.path):
        found = udim.resolved(node.GetInput("file").GetValueProducingAttributes()[0], time)
    if not found:
        notes.add(node.GetPath(), f"`{asset.path}` was not found; its fallback is baked, put the file there")
    return found


def _coordinates(node: Any, key: str, texture: Texture, time: Any, notes: Notes) -> Texture:
    """The texture with the coordinates that feed `key`."""
    wanted = node.GetInput(key)
    sources = wanted.GetValueProducingAttributes() if wanted else []
    if not sources:
        return texture
    reader = UsdShade.Shader(sources[0].GetPrim())
    kind = str(reader.GetIdAttr().Get()) if reader else ""
    if kind.startswith("UsdPrimvarReader"):
        return dataclasses.replace(texture, uv=str(_constant(reader, "varname", time) or "st"))
    if kind == "UsdTransform2d":
        if texture.rotation or texture.shift != (0.0, 0.0) or texture.uv_scale != (1.0, 1.0):
            notes.add(reader.GetPath(), "of several transforms in a row only the first is baked; merge them")
            return _coordinates(reader, "in", texture, time, notes)
        scale, shift = _constant(reader, "scale", time), _constant(reader, "translation", time)
        moved = dataclasses.replace(
            texture,
            rotation=float(_constant(reader, "rotation", time) or 0.0),
            uv_scale=(1.0, 1.0) if scale is None else (float(scale[0]), float(scale[1])),
            shift=(0.0, 0.0) if shift is None else (float(shift[0]), float(shift[1])),
        )
        return _coordinates(reader, "in", moved, time, notes)
    notes.add(node.GetPath(), f"its coordinates come from `{kind or 'a constant'}`, which is not read; `st` is used")
    return texture


def _vector(value: Any, default: Vector4) -> Vector4:
    return default if value is None else (float(value[0]), float(value[1]), float(value[2]), float(value[3]))
