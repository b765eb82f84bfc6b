"""What a scene is made of: a scene file → every file on disk that its lightmap depends on."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

USD_KINDS = (".usd", ".usda", ".usdc", ".usdz")
GLTF_KINDS = (".glb", ".gltf")
KINDS = (*USD_KINDS, *GLTF_KINDS, ".blend")


def scene_files(scene: Path) -> list[Path]:
    """The scene and all files that it refers to, those that are there; sorted."""
    kind = scene.suffix.lower()
    if kind in USD_KINDS:
        # USD takes a third of a second to load, so batches without USD do without it.
        from ..usd.stage import source_files

        return source_files(scene)
    if kind in GLTF_KINDS:
        found = {scene.resolve()}
        for uri in _uris(_gltf_json(scene)):
            path = (scene.parent / unquote(uri)).resolve()
            if path.is_file():
                found.add(path)
        return sorted(found)
    return [scene.resolve()]


def _gltf_json(scene: Path) -> Any:
    """The JSON of a glTF file; nothing if it is broken, which the baker will say."""
    try:
        data = scene.read_bytes()
        if data[:4] == b"glTF":
            (length,) = struct.unpack_from("<I", data, 12)
            data = data[20 : 20 + length]
        return json.loads(data)
    except (OSError, ValueError, struct.error):
        return {}


def _uris(value: Any) -> Iterator[str]:
    """Every string under `uri`, `image` and `ies` that is no data URI, at any depth."""
    if isinstance(value, dict):
        for key, item in value.items():
            if key in ("uri", "image", "ies") and isinstance(item, str):
                if not item.startswith("data:"):
                    yield item
            else:
                yield from _uris(item)
    elif isinstance(value, list):
        for item in value:
            yield from _uris(item)
