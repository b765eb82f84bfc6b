"""Writes binary glTF 2.0: arrays and JSON → one .glb file with one buffer.

The baker reads sky images and IES profiles from buffer views too, so the file refers to nothing outside itself.
"""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Json = dict[str, Any]

EXTENSION = "LIGHTKILN_scene"
"""The vendor extension with lamps, sky and lightmap requests; see docs/guide.md."""

_VERTEX_TARGET, _INDEX_TARGET = 34962, 34963
_COMPONENTS = {np.dtype("<f4"): 5126, np.dtype("<u2"): 5123, np.dtype("<u4"): 5125}
_SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class GlbWriter:
    """A glTF document that grows; items are numbered as they are added."""

    def __init__(self, generator: str) -> None:
        """An empty document with one scene."""
        self.json: Json = {"asset": {"version": "2.0", "generator": generator}, "scene": 0, "scenes": [{"nodes": []}]}
        self.extension: Json = {"version": 1}
        self._buffer = bytearray()
        self._views: dict[bytes, int] = {}

    def push(self, array: str, item: Json) -> int:
        """Adds an item to a top-level array; returns its index."""
        items: list[Json] = self.json.setdefault(array, [])
        items.append(item)
        return len(items) - 1

    def use(self, *extensions: str) -> None:
        """Lists extensions as used."""
        used: list[str] = self.json.setdefault("extensionsUsed", [])
        used.extend(e for e in extensions if e not in used)

    def root(self, node: Json) -> int:
        """Adds a node to the scene; returns its index."""
        index = self.push("nodes", node)
        self.json["scenes"][0]["nodes"].append(index)
        return index

    def lamp(self, lamp: Json, node: Json) -> int:
        """Adds a lamp of the vendor extension and the node that places it; returns the node."""
        lamps: list[Json] = self.extension.setdefault("lights", [])
        lamps.append(lamp)
        return self.root({**node, "extensions": {EXTENSION: {"light": len(lamps) - 1}}})

    def view(self, data: bytes, target: int | None = None) -> int:
        """Adds bytes, or finds the view with the same bytes; returns the buffer view."""
        known = self._views.get(data)
        if known is not None and self.json["bufferViews"][known].get("target") == target:
            return known
        view: Json = {"buffer": 0, "byteOffset": len(self._buffer), "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        self._buffer += data + b"\0" * (-len(data) % 4)
        index = self.push("bufferViews", view)
        self._views[data] = index
        return index

    def attribute(self, values: npt.NDArray[Any], *, bounds: bool = False) -> int:
        """Adds a vertex attribute, one row per vertex; returns the accessor."""
        stored = np.ascontiguousarray(values, dtype="<f4")
        width = 1 if stored.ndim == 1 else stored.shape[1]
        accessor = self._accessor(stored, _SHAPES[width], len(stored), _VERTEX_TARGET)
        if bounds:
            accessor["min"] = [float(x) for x in stored.min(axis=0)]
            accessor["max"] = [float(x) for x in stored.max(axis=0)]
        return self.push("accessors", accessor)

    def indices(self, values: npt.NDArray[Any]) -> int:
        """Adds triangle indices, 16 bits where they suffice (65535 restarts strips); returns the accessor."""
        short = values.size == 0 or int(values.max()) < 65535
        stored = np.ascontiguousarray(values.ravel(), dtype="<u2" if short else "<u4")
        return self.push("accessors", self._accessor(stored, "SCALAR", stored.size, _INDEX_TARGET))

    def _accessor(self, stored: npt.NDArray[Any], kind: str, count: int, target: int) -> Json:
        view = self.view(stored.tobytes(), target)
        return {"bufferView": view, "componentType": _COMPONENTS[stored.dtype], "count": count, "type": kind}

    def write(self, path: Path) -> None:
        """Writes the file; it appears whole."""
        document = dict(self.json)
        self.use(EXTENSION)
        document["extensionsUsed"] = self.json["extensionsUsed"]
        document["extensions"] = {EXTENSION: self.extension}
        if not document["scenes"][0]["nodes"]:
            document["scenes"] = [{}]
        if self._buffer:
            document["buffers"] = [{"byteLength": len(self._buffer)}]
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        if self._buffer:
            chunks += struct.pack("<I4s", len(self._buffer), b"BIN\0") + self._buffer
        partial = path.with_name(f".{path.name}.{os.getpid()}")
        partial.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        partial.replace(path)
