# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows a lightmap in a glTF document: a page and the primitives that lie on it → materials with `MOZ_lightmap`.

The texture is a linear 8-bit PNG; times the extension's `intensity` it is irradiance in W/m². TEXCOORD_1 holds the
coordinates. It is what the baker itself writes beside a bake.
"""

from __future__ import annotations

import copy
import math

import numpy as np
import numpy.typing as npt

from .glb import Glb, Json
from .textures import Picture, to_bytes

MOZ_LIGHTMAP = "MOZ_lightmap"
# Share of the texels that may be brighter than the texture's white, where they outshine all others by far.
CLIPPED = 1e-3
_LINEAR, _CLAMP = 9729, 33071


def show_lightmap(glb: Glb, primitives: list[Json], radiance: npt.NDArray[np.float32], uri: str) -> tuple[int, Picture]:
    """Gives the primitives lit materials. Returns the image's index and its picture, which is still to be encoded.

    `radiance`: the page as the materials in Blender show it (W/(m²·sr)), top row first. `uri`: the EXR of full range.
    """
    irradiance = radiance[..., :3] * math.pi
    scale = white(irradiance)
    extras = {"lightmap": {"uri": uri, "quantity": "radiance", "unit": "W/(m^2*sr)"}}
    image = glb.append("images", {"name": "lightmap_0", "mimeType": "image/png", "extras": extras})
    # Mip levels would mix charts, so the lightmap is filtered linearly and never shrunk.
    filtered = {"magFilter": _LINEAR, "minFilter": _LINEAR, "wrapS": _CLAMP, "wrapT": _CLAMP}
    sampler = glb.append("samplers", filtered)
    texture = glb.append("textures", {"name": "lightmap_0", "sampler": sampler, "source": image})
    glb.use(MOZ_LIGHTMAP)
    extension = {"index": texture, "texCoord": 1, "intensity": scale}
    lit = {id(primitive) for primitive in primitives}
    every = [p for mesh in glb.json.get("meshes", []) for p in mesh["primitives"]]
    elsewhere = {p["material"] for p in every if id(p) not in lit}
    made: dict[int, int] = {}
    for primitive in primitives:
        source = primitive["material"]
        if source not in made:
            # A material that unlit meshes show stays as it is.
            made[source] = source
            if source in elsewhere:
                made[source] = glb.append("materials", copy.deepcopy(glb.json["materials"][source]))
            glb.json["materials"][made[source]].setdefault("extensions", {})[MOZ_LIGHTMAP] = dict(extension)
        primitive["material"] = made[source]
    return image, Picture("lightmap_0", pixels=to_bytes(irradiance / scale))


def white(irradiance: npt.NDArray[np.float32]) -> float:
    """Irradiance that the texture's white stands for: the largest, unless a few texels outshine all others by far."""
    brightest = irradiance.max(axis=2).ravel()
    lit = np.sort(brightest[brightest > 0])
    if not len(lit):
        return 1.0
    high, most = float(lit[len(lit) - 1 - int(len(lit) * CLIPPED)]), float(lit[-1])
    return most if most <= 2 * high else high
