"""Reads binary glTF 2.0 files as the baker writes them: a .glb file → JSON and arrays."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import PipelineError
from .writer import Json

_TYPES = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class GlbReader:
    """A .glb file in memory."""

    def __init__(self, path: Path) -> None:
        """Reads the file. Raises PipelineError if it is no GLB."""
        self.path = path
        data = path.read_bytes()
        try:
            magic, version, _ = struct.unpack_from("<4sII", data)
            length, kind = struct.unpack_from("<I4s", data, 12)
            if magic != b"glTF" or version != 2 or kind != b"JSON":
                raise ValueError("it has another header")
            self.json: Json = json.loads(data[20 : 20 + length])
        except (struct.error, ValueError) as error:
            raise PipelineError(f"{path}: not a binary glTF 2.0 file ({error}); bake the scene again") from error
        self._binary = memoryview(data)[20 + length + 8 :]

    def items(self, array: str) -> list[Json]:
        """A top-level array, empty if there is none."""
        items: list[Json] = self.json.get(array, [])
        return items

    def view(self, index: int) -> memoryview:
        """The bytes of a buffer view."""
        view = self.items("bufferViews")[index]
        start = view.get("byteOffset", 0)
        return self._binary[start : start + view["byteLength"]]

    def values(self, accessor: int) -> npt.NDArray[Any]:
        """An accessor's elements, one row each; scalars as a flat array."""
        item = self.items("accessors")[accessor]
        view = self.items("bufferViews")[item["bufferView"]]
        width, dtype = _WIDTHS[item["type"]], np.dtype(_TYPES[item["componentType"]])
        size = width * dtype.itemsize
        rows = np.ndarray(
            (item["count"], width),
            dtype,
            self._binary,
            view.get("byteOffset", 0) + item.get("byteOffset", 0),
            (view.get("byteStride", size), dtype.itemsize),
        )
        return rows[:, 0] if width == 1 else rows
