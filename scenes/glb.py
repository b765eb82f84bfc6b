"""Reads and writes binary glTF 2.0 files (.glb) for the scripts that make the bundled scenes.

In: a .glb file, or lists of numbers. Out: a .glb file with one buffer. Standard library only.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Json = dict[str, Any]
Vector = tuple[float, ...]

ARRAY_BUFFER = 34962
ELEMENT_ARRAY_BUFFER = 34963
_FLOAT, _UNSIGNED_SHORT, _UNSIGNED_INT, _UNSIGNED_BYTE = 5126, 5123, 5125, 5121
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_FORMATS = {_FLOAT: "f", _UNSIGNED_SHORT: "H", _UNSIGNED_INT: "I", _UNSIGNED_BYTE: "B"}

EXTENSION = "LIGHTKILN_scene"


@dataclass
class Geometry:
    """Triangles with one material. All vertex lists have the same length."""

    positions: list[Vector]
    normals: list[Vector]
    texcoords: list[list[Vector]]
    indices: list[int]


@dataclass
class Glb:
    """A glTF document and its binary chunk."""

    json: Json
    binary: bytearray = field(default_factory=bytearray)

    @staticmethod
    def new(generator: str, rights: str) -> Glb:
        """An empty document with one empty scene."""
        asset = {"version": "2.0", "generator": generator, "copyright": rights}
        return Glb({"asset": asset, "scene": 0, "scenes": [{"nodes": []}], "nodes": []})

    @staticmethod
    def read(path: Path) -> Glb:
        """Reads a .glb file. Raises ValueError if it is none."""
        data = path.read_bytes()
        if data[:4] != b"glTF":
            raise ValueError(f"{path}: not a binary glTF file")
        (length,) = struct.unpack_from("<I", data, 12)
        document = json.loads(data[20 : 20 + length])
        return Glb(document, bytearray(data[28 + length :]))

    def write(self, path: Path) -> None:
        """Writes the file; the same content gives the same bytes."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        if self.binary:
            self.json["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        if self.binary:
            chunks += struct.pack("<II", len(self.binary), 0x004E4942) + self.binary
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)

    def append(self, kind: str, item: Json) -> int:
        """Adds an item to a top-level array such as "meshes"; returns its index."""
        items = self.json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def add_view(self, data: bytes, target: int | None = None) -> int:
        """Adds bytes to the buffer, aligned to four; returns the buffer view."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        view: Json = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        self.binary += data
        return self.append("bufferViews", view)

    def view_bytes(self, view: int) -> bytes:
        """The bytes of a buffer view."""
        v = self.json["bufferViews"][view]
        start = v.get("byteOffset", 0)
        return bytes(self.binary[start : start + v["byteLength"]])

    def add_vectors(self, values: Sequence[Vector], *, bounds: bool = False) -> int:
        """Adds a vertex attribute of 32-bit floats; returns the accessor."""
        width = len(values[0])
        data = struct.pack(f"<{width * len(values)}f", *(x for v in values for x in v))
        accessor: Json = {
            "bufferView": self.add_view(data, ARRAY_BUFFER),
            "componentType": _FLOAT,
            "count": len(values),
            "type": f"VEC{width}",
        }
        if bounds:
            stored = list(struct.iter_unpack(f"<{width}f", data))
            accessor["min"] = [min(v[k] for v in stored) for k in range(width)]
            accessor["max"] = [max(v[k] for v in stored) for k in range(width)]
        return self.append("accessors", accessor)

    def add_indices(self, indices: Sequence[int]) -> int:
        """Adds triangle indices, 16 bit where they suffice; returns the accessor."""
        short = max(indices) < 65535
        data = struct.pack(f"<{len(indices)}{'H' if short else 'I'}", *indices)
        return self.append(
            "accessors",
            {
                "bufferView": self.add_view(data, ELEMENT_ARRAY_BUFFER),
                "componentType": _UNSIGNED_SHORT if short else _UNSIGNED_INT,
                "count": len(indices),
                "type": "SCALAR",
            },
        )

    def add_primitive(self, geometry: Geometry, material: int) -> Json:
        """Adds the geometry to the buffer; returns the primitive for a mesh."""
        attributes = {"POSITION": self.add_vectors(geometry.positions, bounds=True)}
        attributes["NORMAL"] = self.add_vectors([_unit(n) for n in geometry.normals])
        for i, texcoord in enumerate(geometry.texcoords):
            attributes[f"TEXCOORD_{i}"] = self.add_vectors(texcoord)
        return {"attributes": attributes, "indices": self.add_indices(geometry.indices), "material": material}

    def values(self, accessor: int) -> list[Vector]:
        """The elements of an accessor (sparse and normalized ones are not supported)."""
        a = self.json["accessors"][accessor]
        width, code = _WIDTHS[a["type"]], _FORMATS[a["componentType"]]
        view = self.json["bufferViews"][a["bufferView"]]
        size = struct.calcsize(f"<{width}{code}")
        stride = view.get("byteStride", size)
        start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
        return [struct.unpack_from(f"<{width}{code}", self.binary, start + i * stride) for i in range(a["count"])]

    def geometry(self, primitive: Json) -> Geometry:
        """The triangles of a primitive."""
        attributes = primitive["attributes"]
        sets = [self.values(attributes[k]) for k in sorted(attributes) if k.startswith("TEXCOORD_")]
        return Geometry(
            positions=self.values(attributes["POSITION"]),
            normals=self.values(attributes["NORMAL"]),
            texcoords=sets,
            indices=[int(v[0]) for v in self.values(primitive["indices"])],
        )

    def add_root(self, node: Json) -> int:
        """Adds a node to the scene; returns its index."""
        index = self.append("nodes", node)
        self.json["scenes"][self.json.get("scene", 0)]["nodes"].append(index)
        return index

    def set_environment(self, environment: Json) -> None:
        """Sets the sky of the LIGHTKILN_scene extension."""
        self._extension()["environment"] = environment

    def add_light(self, light: Json, node: Json) -> int:
        """Adds a lamp and the node that places it; the lamp shines along the node's -Z."""
        lights = self._extension().setdefault("lights", [])
        lights.append(light)
        return self.add_root({**node, "extensions": {EXTENSION: {"light": len(lights) - 1}}})

    def use_extension(self, name: str) -> None:
        """Lists an extension as used."""
        used = set(self.json.get("extensionsUsed", []))
        self.json["extensionsUsed"] = sorted(used | {name})

    def _extension(self) -> Json:
        self.use_extension(EXTENSION)
        root: Json = self.json.setdefault("extensions", {}).setdefault(EXTENSION, {"version": 1})
        return root


def turn_y(degrees: float) -> list[float]:
    """Rotation about +Y as a glTF quaternion."""
    half = math.radians(degrees) / 2
    return [0.0, math.sin(half), 0.0, math.cos(half)]


def turn_x(degrees: float) -> list[float]:
    """Rotation about +X as a glTF quaternion."""
    half = math.radians(degrees) / 2
    return [math.sin(half), 0.0, 0.0, math.cos(half)]


def point_along(direction: Vector) -> list[float]:
    """The shortest rotation that turns -Z to `direction`, as a glTF quaternion."""
    x, y, z = _unit(direction)
    if z > 1 - 1e-12:
        return [0.0, 1.0, 0.0, 0.0]
    quaternion = (y, -x, 0.0, 1 - z)
    length = math.sqrt(sum(c * c for c in quaternion))
    return [c / length for c in quaternion]


def look_along(direction: Vector) -> list[float]:
    """The rotation that turns -Z to `direction` and keeps the horizon level (for cameras), as a glTF quaternion."""
    x, y, z = _unit(direction)
    _, yaw, _, yaw_w = turn_y(math.degrees(math.atan2(-x, -z)))
    pitch, _, _, pitch_w = turn_x(math.degrees(math.asin(y)))
    return [yaw_w * pitch, yaw * pitch_w, -yaw * pitch, yaw_w * pitch_w]


def _unit(v: Vector) -> Vector:
    length = math.sqrt(sum(c * c for c in v))
    return tuple(c / length for c in v) if length > 0 else (0.0, 1.0, 0.0)
