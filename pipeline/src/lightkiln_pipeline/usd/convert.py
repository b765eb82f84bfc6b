"""A USD scene → the GLB that the baker reads, and notes on what was left out.

In: a stage on disk and settings. Out: one file with meshes, materials, lamps and sky in the LIGHTKILN_scene contract.
Mesh nodes carry `extras.lightkiln` with the prim that they come from, and vertices the corner of it, so that the
lightmap's coordinates find their way back (see layer.py).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom, UsdLux, UsdShade

from .. import __version__
from ..errors import Note, Notes
from ..glb.writer import EXTENSION, GlbWriter, Json
from .layout import Charts
from .lights import LUMENS_PER_WATT, LightReader, emitted
from .materials import Materials
from .mesh import MeshData, read_mesh
from .mesh_writer import MeshWriter
from .placement import node_transform
from .sky import environment
from .stage import Scene, open_scene
from .surfaces import UNBOUND, UNBOUND_IN_BLENDER, Color, Surface, read_surface, unbound_surface
from .walk import Placement, Walk, data_key, inherited


@dataclass(frozen=True)
class UsdSettings:
    """How a stage is read."""

    level: int = 1
    """Refinements of subdivision surfaces."""
    purposes: tuple[str, ...] = ("default", "render")
    time: float | None = None
    """Time code; none is the earliest."""
    light_units: str = "auto"
    """`photometric`: intensities are nits; `radiometric`: W/(m²·sr); `auto`: as the program that wrote the stage."""
    variants: dict[str, str] = field(default_factory=dict)
    """`/Prim{set}` → variant."""
    sky_if_unlit: float = 1.0
    """Radiance of the sky of a scene without light, W/(m²·sr)."""


@dataclass(frozen=True)
class Conversion:
    """What became of a scene."""

    meshes: int
    instances: int
    triangles: int
    lamps: int
    notes: list[Note]


def convert(source: Path, target: Path, settings: UsdSettings) -> Conversion:
    """Converts a USD file. Raises PipelineError if it cannot be opened."""
    notes = Notes()
    scene = open_scene(source, notes, time=settings.time, variants=settings.variants)
    converter = _Converter(scene, settings, notes)
    return converter.run(target)


class _Converter:
    """Puts one scene into one document."""

    def __init__(self, scene: Scene, settings: UsdSettings, notes: Notes) -> None:
        self._scene, self._settings, self._notes = scene, settings, notes
        radiometric = settings.light_units == "radiometric" or (settings.light_units == "auto" and scene.blender)
        self._to_radiance = 1.0 if radiometric else 1.0 / LUMENS_PER_WATT
        self._glb = GlbWriter(f"lightkiln-pipeline {__version__}")
        self._materials = Materials(self._glb, self._to_radiance, notes)
        self._writer = MeshWriter(self._glb, self._materials, scene, notes)
        self._lights = LightReader(scene, self._to_radiance, notes)
        self._charts = Charts()
        self._read: dict[object, MeshData | None] = {}
        self._meshes: dict[object, int] = {}
        self._surfaces: dict[tuple[str, bool], Surface] = {}
        self._triangles = 0

    def run(self, target: Path) -> Conversion:
        instances = 0
        walk = Walk(self._scene, self._settings.purposes, self._notes)
        for placement in walk.placements():
            is_shape = placement.prim.IsA(UsdGeom.Gprim)
            if placement.prim.HasAPI(UsdLux.LightAPI) and not is_shape:
                self._lights.read(placement.prim, placement.world, placement.path)
            elif is_shape:
                instances += self._add_shape(placement)
        self._add_lights()
        if not instances:
            self._notes.add(
                self._scene.path.name, "nothing in it can be baked: no mesh is visible in the chosen purposes"
            )
        lamps = len(self._lights.lights.lamps) + len(self._lights.lights.tubes)
        self._light_the_unlit(lamps)
        self._glb.write(target)
        return Conversion(len(self._meshes), instances, self._triangles, lamps, self._notes.list())

    def _light_the_unlit(self, lamps: int) -> None:
        """A scene without any light gets a sky, as viewers give it a lamp: its lightmap then shows its shading."""
        glows = any("emissiveFactor" in material for material in self._glb.json.get("materials", []))
        radiance = self._settings.sky_if_unlit
        if lamps or glows or radiance <= 0 or "environment" in self._glb.extension:
            return
        self._glb.extension["environment"] = {"radiance": [radiance] * 3}
        message = f"it has no light at all: a uniform sky of {radiance:g} W/(m²·sr) is baked; add a light"
        self._notes.add(self._scene.path.name, message)

    def _add_lights(self) -> None:
        found = self._lights.lights
        for lamp in found.lamps:
            definition = dict(lamp.definition)
            if lamp.profile is not None:
                definition["ies"] = {"bufferView": self._glb.view(lamp.profile.text().encode())}
            self._glb.lamp(definition, lamp.node)
        for cylinder in found.tubes:
            self._writer.tube(cylinder)
        sky = environment(self._scene, found.domes, self._glb, self._notes)
        if sky is not None:
            self._glb.extension["environment"] = sky

    def _add_shape(self, placement: Placement) -> bool:
        prim = placement.prim
        request = self._request(prim)
        wants_map = request.get("lightmap") is not False
        data = self._data(prim, wants_map)
        if data is None or len(data.triangles) == 0:
            return False
        node = node_transform(placement.world)
        light = self._mesh_light(placement, data) if prim.HasAPI(UsdLux.LightAPI) else None
        parts = self._parts(prim, data)
        # A sheared matrix is no node transform: the vertices take it.
        fixed = placement.world if node is None else None
        key = (
            data_key(prim, self._scene.time),
            wants_map,
            tuple(s.name for s, _ in parts),
            light,
            None if node else placement.path,
        )
        if key not in self._meshes:
            self._meshes[key] = self._writer.mesh(prim, data, parts, light, fixed)
        extras: Json = {"prim": str(prim.GetPath())}
        if placement.instancer:
            extras |= {"instancer": placement.instancer, "instance": placement.instance}
        item: Json = {"name": placement.path, **(node or {}), "mesh": self._meshes[key]}
        item["extras"] = {"lightkiln": extras}
        if request:
            item["extensions"] = {EXTENSION: request}
        self._glb.root(item)
        self._triangles += len(data.triangles)
        return True

    def _request(self, prim: Any) -> Json:
        """What `primvars:lightkiln:*` ask for."""
        time = self._scene.time
        request: Json = {}
        density, resolution = inherited(prim, "texelsPerMetre", time), inherited(prim, "resolution", time)
        if inherited(prim, "lightmap", time) is False:
            request["lightmap"] = False
        elif resolution:
            request["lightmap"] = {"resolution": int(resolution)}
        elif density:
            request["lightmap"] = {"texelsPerMetre": float(density)}
        if inherited(prim, "castsShadows", time) is False:
            request["castsShadows"] = False
        group = inherited(prim, "group", time)
        if group:
            request["group"] = str(group)
        return request

    def _data(self, prim: Any, charts: bool) -> MeshData | None:
        key = (data_key(prim, self._scene.time), charts)
        if key not in self._read:
            layout = self._charts if charts else None
            self._read[key] = read_mesh(prim, self._scene.time, self._settings.level, self._notes, layout)
        return self._read[key]

    def _parts(self, prim: Any, data: MeshData) -> list[tuple[Surface, npt.NDArray[np.int64]]]:
        """Surfaces with the triangles that they cover: subsets first, the rest with the prim's own."""
        painted = "displayColor" in data.colors
        owner = np.full(len(data.triangles), -1)
        surfaces: list[Surface] = []
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            faces = np.array(subset.GetIndicesAttr().Get(self._scene.time) or [], np.int64)
            owner[np.isin(data.faces, faces) & (owner < 0)] = len(surfaces)
            surfaces.append(self._surface(subset.GetPrim(), painted))
        surfaces.append(self._surface(prim, painted))
        owner[owner < 0] = len(surfaces) - 1
        return [(s, data.triangles[owner == i]) for i, s in enumerate(surfaces) if (owner == i).any()]

    def _surface(self, prim: Any, painted: bool) -> Surface:
        binding = UsdShade.MaterialBindingAPI(prim)
        material = binding.ComputeBoundMaterial(UsdShade.Tokens.full)[0]
        if not material:
            direct = UsdShade.MaterialBindingAPI(prim).GetDirectBindingRel()
            if direct and direct.GetTargets():
                target = direct.GetTargets()[0]
                self._notes.add(prim.GetPath(), f"its material {target} does not exist; the display colour is baked")
            return unbound_surface(painted, UNBOUND_IN_BLENDER if self._scene.blender else UNBOUND)
        key = (str(material.GetPath()), painted)
        if key not in self._surfaces:
            self._surfaces[key] = read_surface(material, self._scene.time, self._notes, has_display_color=painted)
        return self._surfaces[key]

    def _mesh_light(self, placement: Placement, data: MeshData) -> Color:
        """Radiance of a mesh light, W/(m²·sr)."""
        prim = placement.prim
        radiance = emitted(self._scene, prim, self._to_radiance)
        if UsdLux.LightAPI(prim).GetNormalizeAttr().Get(self._scene.time):
            world = data.points @ placement.world[:3, :3].T
            a, b, c = (world[data.corner_points[data.triangles[:, i]]] for i in range(3))
            radiance = radiance / max(float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2, 1e-30)
        return (float(radiance[0]), float(radiance[1]), float(radiance[2]))
