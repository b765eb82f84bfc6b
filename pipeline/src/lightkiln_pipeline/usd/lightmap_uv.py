"""The lightmap's coordinates on their way back: a lit GLB → coordinates per corner of the USD prims that it was made
of.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..errors import PipelineError
from ..glb.reader import GlbReader
from ..glb.writer import Json
from .mesh_writer import CORNER

Floats = npt.NDArray[np.float64]


@dataclass
class LitMesh:
    """Where one placed mesh lies in the lightmap."""

    prim: str
    instancer: str
    """Path of the point instancer that places it, or empty."""
    instance: int
    pages: dict[str, tuple[npt.NDArray[np.int64], Floats]] = field(default_factory=dict)
    """By page's file name: numbers of source corners, and their coordinates with v upwards."""
    reflectance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Colour of the diffuse reflection if it is one for the whole mesh, else white."""


@dataclass(frozen=True)
class LitScene:
    """What a lit GLB says."""

    meshes: list[LitMesh]
    quantity: str
    unit: str


def read_lit(path: Path) -> LitScene:
    """Reads a lit GLB that came from a USD scene. Raises PipelineError if it did not."""
    glb = GlbReader(path)
    found, quantity, unit = [], "irradiance", "W/m^2"
    for image in glb.items("images"):
        lightmap = image.get("extras", {}).get("lightmap")
        if lightmap:
            quantity, unit = str(lightmap["quantity"]), str(lightmap["unit"])
    for node in glb.items("nodes"):
        origin = node.get("extras", {}).get("lightkiln")
        if origin and "mesh" in node:
            mesh = _mesh(glb, glb.items("meshes")[node["mesh"]], origin)
            if mesh.pages:
                found.append(mesh)
    if not found and not any("lightkiln" in n.get("extras", {}) for n in glb.items("nodes")):
        raise PipelineError(f"{path}: it does not come from a USD scene; bake what `lightkiln-usd convert` writes")
    return LitScene(found, quantity, unit)


def _mesh(glb: GlbReader, mesh: Json, origin: Json) -> LitMesh:
    lit = LitMesh(str(origin["prim"]), str(origin.get("instancer", "")), int(origin.get("instance", -1)))
    parts: dict[str, list[tuple[npt.NDArray[np.int64], Floats]]] = {}
    colors: set[tuple[float, float, float]] = set()
    for primitive in mesh["primitives"]:
        attributes, material = primitive["attributes"], glb.items("materials")[primitive["material"]]
        lightmap = material.get("extensions", {}).get("MOZ_lightmap")
        if lightmap is None or CORNER not in attributes:
            continue
        image = glb.items("images")[glb.items("textures")[lightmap["index"]]["source"]]
        high_low = glb.values(attributes[CORNER]).astype(np.int64)
        numbers = high_low[:, 0] * 65536 + high_low[:, 1] - 1
        uv = glb.values(attributes[f"TEXCOORD_{lightmap.get('texCoord', 1)}"]).astype(np.float64)
        kept = numbers >= 0
        parts.setdefault(str(image["extras"]["lightmap"]["uri"]), []).append(
            (numbers[kept], np.stack([uv[kept, 0], 1.0 - uv[kept, 1]], axis=1))
        )
        colors.add(_color(material))
    lit.pages = {
        page: (np.concatenate([n for n, _ in p]), np.concatenate([u for _, u in p])) for page, p in parts.items()
    }
    if len(colors) == 1:
        lit.reflectance = colors.pop()
    return lit


def _color(material: Json) -> tuple[float, float, float]:
    pbr = material.get("pbrMetallicRoughness", {})
    if "baseColorTexture" in pbr:
        return (1.0, 1.0, 1.0)
    r, g, b = pbr.get("baseColorFactor", (1, 1, 1, 1))[:3]
    share = 1.0 - float(pbr.get("metallicFactor", 1.0))
    return (float(r) * share, float(g) * share, float(b) * share)
