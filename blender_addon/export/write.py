# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts a snapshot, its materials and its places in the lightmap into a GLB that the baker reads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix

from ..errors import Note
from ..places import Page, Receiver
from .axes import CHANGE, placement
from .glb import EXTENSION, Glb, Json
from .lamps import lamp_group, profile_text, read_lamp
from .lit import show_lightmap
from .materials import BakedColors, Materials
from .snapshot import Instance, MeshData, Snapshot
from .world import PANORAMA, environment

GENERATOR = "Lightkiln for Blender"
Floats = npt.NDArray[np.float32]


class Writer:
    """Writes one scene. `collect` needs Blender's main thread, `finish` does not."""

    def __init__(self, snapshot: Snapshot, page: Page, receivers: list[Receiver]) -> None:
        """Starts an empty document."""
        self.notes = list(snapshot.notes)
        self._snapshot = snapshot
        self._page = page
        self._receivers = {r.instance.key: r for r in receivers}
        self._glb = Glb(GENERATOR)
        self._materials = Materials(self._glb)
        # Attributes and indices by mesh, slot, name and, where it matters, matrix.
        self._accessors: dict[tuple[object, ...], int] = {}
        self._unlit: dict[tuple[object, ...], int] = {}
        # Primitives that lie on the lightmap.
        self._lit: list[Json] = []

    def collect(
        self, world: bpy.types.World | None, folder: Path, baked: Mapping[tuple[int, str], BakedColors]
    ) -> None:
        """Reads lamps, world and materials and lays out the document.

        `baked`: colours baked to textures, by (number of the mesh, name of the material).
        """
        for instance in self._snapshot.instances:
            self._add_instance(instance, baked)
        for name, light, matrix, group in self._snapshot.lamps:
            lamp, node, notes = read_lamp(name, light, matrix)
            lamp["group"] = group or lamp_group(light)
            node["extras"] = {"lightkiln": {"object": name}}
            profile = profile_text(light)
            if profile is not None:
                view = self._glb.add_view(profile.encode("latin-1", "replace"))
                lamp["ies"] = {"bufferView": view, "absolute": True, "frame": "blender"}
            self._glb.add_lamp(lamp, node)
            self.notes += notes
        sky = environment(world, folder)
        if sky is not None:
            self._glb.scene_extension["environment"] = sky
        self.notes += self._materials.notes

    def unread(self, mesh: int) -> dict[str, frozenset[str]]:
        """Channels that cannot be read from the nodes, by material of a mesh."""
        data = self._snapshot.meshes[mesh]
        used = {data.materials[slot] for slot in np.unique(data.slots).tolist()}
        surfaces = {m.name_full: self._materials.surface(m) for m in used if m}
        return {name: surface.unread for name, surface in surfaces.items() if surface.unread}

    def is_dark(self) -> bool:
        """True if nothing that was collected gives light."""
        extension = self._glb.scene_extension
        sky = extension.get("environment", {})
        shines = sky and (list(sky) != ["radiance"] or max(sky["radiance"]) > 0)
        return not (shines or extension.get("lights") or "emissiveFactor" in str(self._glb.json.get("materials", "")))

    def show_lightmap(self, radiance: Floats, uri: str) -> None:
        """Lets what lies on the lightmap show it; `radiance` is the page, top row first, `uri` its EXR."""
        self._materials.pending.append(show_lightmap(self._glb, self._lit, radiance, uri))

    def embed_sky(self, folder: Path) -> None:
        """Takes a panorama that `collect` wrote into the document, for a file that goes elsewhere."""
        sky = self._glb.scene_extension.get("environment", {})
        if sky.get("image") == PANORAMA:
            sky["image"] = {"bufferView": self._glb.add_view((folder / PANORAMA).read_bytes())}

    def finish(self, path: Path) -> None:
        """Encodes images and writes the file."""
        self._materials.encode_pending()
        self._glb.write(path)

    def _add_instance(self, instance: Instance, baked: Mapping[tuple[int, str], BakedColors]) -> None:
        place = placement(instance.matrix)
        receiver = self._receivers.get(instance.key)
        extension: Json = {}
        if receiver is None:
            extension["lightmap"] = False
        if not instance.casts_shadow:
            extension["castsShadows"] = False
        if instance.group:
            extension["group"] = instance.group
        node: Json = {"name": instance.name, **(place or {})}
        node["extras"] = {"lightkiln": {"object": instance.name, "instance": list(instance.key[2])}}
        if extension:
            node["extensions"] = {EXTENSION: extension}
        node["mesh"] = self._mesh(instance, receiver, None if place else instance.matrix, baked)
        self._glb.add_root(node)

    def _mesh(
        self,
        instance: Instance,
        receiver: Receiver | None,
        matrix: Matrix | None,
        baked: Mapping[tuple[int, str], BakedColors],
    ) -> int:
        """The mesh of an instance. `matrix` is applied to the vertices; none: the node has it."""
        fixed = tuple(tuple(row) for row in matrix) if matrix else ()
        key = (instance.mesh, fixed)
        if receiver is None and key in self._unlit:
            return self._unlit[key]
        data = self._snapshot.meshes[instance.mesh]
        primitives = [
            self._primitive(instance, data, slot, receiver, matrix, baked) for slot in np.unique(data.slots).tolist()
        ]
        names = [m.name_full if m else "" for m in data.materials]
        mesh = {"name": instance.name, "primitives": primitives, "extras": {"lightkiln": {"slots": names}}}
        index = self._glb.append("meshes", mesh)
        if receiver is None:
            self._unlit[key] = index
        return index

    def _primitive(
        self,
        instance: Instance,
        data: MeshData,
        slot: int,
        receiver: Receiver | None,
        matrix: Matrix | None,
        baked: Mapping[tuple[int, str], BakedColors],
    ) -> Json:
        material = data.materials[slot]
        own = baked.get((instance.mesh, material.name_full if material else ""))
        corners, indices = np.unique(data.triangles[data.slots == slot], return_inverse=True)
        fixed = tuple(tuple(row) for row in matrix) if matrix else ()
        part = (instance.mesh, slot)

        def accessor(name: str, values: Floats, *variant: object, bounds: bool = False) -> int:
            key = (*part, name, *variant)
            if key not in self._accessors:
                self._accessors[key] = self._glb.add_vectors(values[corners], bounds=bounds)
            return self._accessors[key]

        positions, normals = _oriented(data, matrix)
        attributes = {
            "POSITION": accessor("POSITION", positions, fixed, bounds=True),
            "NORMAL": accessor("NORMAL", normals, fixed),
        }
        sets = self._uv_sets(data, material, receiver, own)
        for name, number in sets.items():
            if f"TEXCOORD_{number}" not in attributes and name in data.uv_maps | {"": None}:
                uv = data.uv_maps[name or data.active_map]
                attributes[f"TEXCOORD_{number}"] = accessor(f"uv {name or data.active_map}", _upright(uv))
        if receiver is not None:
            place = self._page.places[instance.key]
            uv = _upright(place.applied(data.uv_maps[receiver.uv_map]))
            attributes["TEXCOORD_1"] = accessor("lightmap", uv, instance.key)
            attributes.setdefault("TEXCOORD_0", attributes["TEXCOORD_1"])
        wanted = self._materials.surface(material).base.attribute
        if wanted is not None:
            colors = data.colors.get(wanted or data.active_color)
            if colors is None:
                message = f"the mesh has no colours named `{wanted}`, which its material uses: white is taken"
                self.notes.append(Note(instance.name, message))
            else:
                attributes["COLOR_0"] = accessor(f"color {wanted}", np.clip(colors, 0.0, 1.0))
        key = (*part, "indices", matrix is not None and matrix.is_negative)
        if key not in self._accessors:
            triangles = indices.reshape(-1, 3)
            # A mirrored matrix that is applied to the vertices turns faces inside out.
            turned = triangles[:, ::-1] if key[-1] else triangles
            self._accessors[key] = self._glb.add_indices(np.ascontiguousarray(turned, np.uint32).ravel())
        written = self._materials.write(material, sets, own)
        primitive = {"attributes": attributes, "indices": self._accessors[key], "material": written}
        if receiver is not None:
            self._lit.append(primitive)
        return primitive

    def _uv_sets(
        self,
        data: MeshData,
        material: bpy.types.Material | None,
        receiver: Receiver | None,
        baked: BakedColors | None,
    ) -> dict[str, int]:
        """UV map → texture coordinate set. Set 1 is kept for the lightmap; "" is the active map."""
        if not data.uv_maps:
            return {}
        surface = self._materials.surface(material)
        textures = (surface.base.texture, surface.emission.texture, surface.opacity.texture)
        names = {t.uv_map for t in textures if t} | ({baked.uv_map} if baked else set())
        sets = {"": 0, data.active_map: 0}
        free = 2 if receiver is not None else 1
        for name in sorted(names - set(sets)):
            if name in data.uv_maps:
                sets[name] = free
                free += 1
        return sets


def _upright(uv: Floats) -> Floats:
    """Blender's v runs up, glTF's down."""
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)


def _oriented(data: MeshData, matrix: Matrix | None) -> tuple[Floats, Floats]:
    """Positions and unit normals in glTF's axes."""
    change = np.array((CHANGE @ matrix) if matrix else CHANGE, np.float64)
    linear = change[:3, :3]
    positions = data.positions @ linear.T + change[:3, 3]
    # Normals follow the inverse transpose; its determinant may be zero for a flattened object.
    cofactor = np.array(
        [np.cross(linear[1], linear[2]), np.cross(linear[2], linear[0]), np.cross(linear[0], linear[1])]
    )
    if np.linalg.det(linear) < 0:
        cofactor = -cofactor
    normals = data.normals @ cofactor.T
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 0, normals / np.maximum(length, 1e-300), (0.0, 1.0, 0.0))
    return positions.astype(np.float32), normals.astype(np.float32)
