# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes binary glTF 2.0: arrays and JSON → one .glb file with one buffer."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Json = dict[str, Any]
Floats = npt.NDArray[np.float32]

EXTENSION = "LIGHTKILN_scene"
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_FLOAT, _UNSIGNED_SHORT, _UNSIGNED_INT = 5126, 5123, 5125
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
# The largest index is reserved for restarting primitives.
_MOST_SHORT = 65535


class Glb:
    """A glTF document that grows."""

    def __init__(self, generator: str) -> None:
        """An empty document with one empty scene."""
        self.json: Json = {"asset": {"version": "2.0", "generator": generator}, "scene": 0}
        self.json["scenes"] = [{"name": "Scene", "nodes": []}]
        self.scene_extension: Json = {"version": 1}
        self._chunks: list[bytes] = []
        self._length = 0

    def append(self, array: str, item: Json) -> int:
        """Adds an item to a top-level array; returns its index."""
        items = self.json.setdefault(array, [])
        items.append(item)
        return len(items) - 1

    def use(self, extension: str) -> None:
        """Lists an extension as used."""
        used = self.json.setdefault("extensionsUsed", [])
        if extension not in used:
            used.append(extension)

    def add_view(self, data: bytes, target: int | None = None) -> int:
        """Adds bytes to the buffer; returns the buffer view."""
        view: Json = {"buffer": 0, "byteOffset": self._length, "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        padded = data + b"\0" * (-len(data) % 4)
        self._chunks.append(padded)
        self._length += len(padded)
        return self.append("bufferViews", view)

    def add_vectors(self, values: Floats, *, bounds: bool = False) -> int:
        """Adds a vertex attribute, one row per vertex; returns the accessor."""
        stored = np.ascontiguousarray(values, dtype="<f4")
        accessor: Json = {
            "bufferView": self.add_view(stored.tobytes(), _ARRAY_BUFFER),
            "componentType": _FLOAT,
            "count": len(stored),
            "type": _TYPES[stored.shape[1]],
        }
        if bounds:
            accessor["min"] = [float(x) for x in stored.min(axis=0)]
            accessor["max"] = [float(x) for x in stored.max(axis=0)]
        return self.append("accessors", accessor)

    def add_indices(self, indices: npt.NDArray[np.uint32]) -> int:
        """Adds triangle indices, 16 bit where they suffice; returns the accessor."""
        short = int(indices.max()) < _MOST_SHORT
        data = np.ascontiguousarray(indices, dtype="<u2" if short else "<u4")
        accessor = {
            "bufferView": self.add_view(data.tobytes(), _ELEMENT_ARRAY_BUFFER),
            "componentType": _UNSIGNED_SHORT if short else _UNSIGNED_INT,
            "count": data.size,
            "type": "SCALAR",
        }
        return self.append("accessors", accessor)

    def add_root(self, node: Json) -> int:
        """Adds a node to the scene; returns its index."""
        index = self.append("nodes", node)
        self.json["scenes"][0]["nodes"].append(index)
        return index

    def add_lamp(self, lamp: Json, node: Json) -> None:
        """Adds a lamp of LIGHTKILN_scene and the node that places it."""
        lamps = self.scene_extension.setdefault("lights", [])
        lamps.append(lamp)
        self.add_root({**node, "extensions": {EXTENSION: {"light": len(lamps) - 1}}})

    def write(self, path: Path) -> None:
        """Writes the file."""
        self.use(EXTENSION)
        self.json["extensions"] = {EXTENSION: self.scene_extension}
        if not self.json["scenes"][0]["nodes"]:
            del self.json["scenes"][0]["nodes"]
        if self._length:
            self.json["buffers"] = [{"byteLength": self._length}]
        text = json.dumps(self.json, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        length = 12 + 8 + len(text) + (8 + self._length if self._length else 0)
        with path.open("wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, length))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            if self._length:
                file.write(struct.pack("<I4s", self._length, b"BIN\0"))
                file.writelines(self._chunks)
