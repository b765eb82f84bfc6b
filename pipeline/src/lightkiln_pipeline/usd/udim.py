"""Sets of UDIM tiles: a texture whose name has <UDIM> → one picture of all tiles, and where it lies.

Tile 1001 + u + 10 v covers the coordinates from (u, v) to (u + 1, v + 1). What has no tile shows the fallback.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from pxr import UsdShade

if TYPE_CHECKING:
    from .networks import Texture

_FIRST = 1001
_ROW = 10


def resolved(attribute: Any, time: Any) -> str:
    """The resolved name of a set, with <UDIM> in it; empty if there is no such tile."""
    path = attribute.Get(time).path
    opinions = attribute.GetPropertyStack(time)
    return str(UsdShade.UdimUtils.ResolveUdimPath(path, opinions[0].layer)) if opinions else ""


def spread(texture: Texture) -> Texture:
    """The texture with the tiles of its set, placed so that together they fill the unit square; others as they are."""
    if not UsdShade.UdimUtils.IsUdimIdentifier(texture.file):
        return texture
    numbers = {str(file): int(number) - _FIRST for file, number in _tiles(texture.file)}
    places = {file: (number % _ROW, number // _ROW) for file, number in numbers.items()}
    left, low = (min(place[i] for place in places.values()) for i in (0, 1))
    columns = 1 + max(u for u, _ in places.values()) - left
    rows = 1 + max(v for _, v in places.values()) - low
    if texture.rotation:
        # Only a square stays one when the coordinates turn before they are scaled.
        columns = rows = max(columns, rows)
    tiles = tuple((file, u - left, v - low) for file, (u, v) in sorted(places.items()))
    return dataclasses.replace(
        texture,
        tiles=tiles,
        grid=(columns, rows),
        wrap=("clamp", "clamp"),
        uv_scale=(texture.uv_scale[0] / columns, texture.uv_scale[1] / rows),
        shift=((texture.shift[0] - left) / columns, (texture.shift[1] - low) / rows),
    )


def _tiles(file: str) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = UsdShade.UdimUtils.ResolveUdimTilePaths(file, None)
    return found
