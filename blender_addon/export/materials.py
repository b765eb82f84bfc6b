# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces as glTF materials: reflectance, emission, opacity and their images, each written once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import bpy
import numpy as np

from ..errors import BakeError, Note
from .glb import Glb, Json
from .nodes import Color, Rgb, Texture
from .surfaces import Opacity, Surface, read_surface
from .textures import Picture, color_picture, masked_picture

_WRAPS = {"REPEAT": 10497, "EXTEND": 33071, "CLIP": 33071, "MIRROR": 33648}
_LINEAR, _NEAREST = 9729, 9728
# What a texture coordinate set that the mesh lacks is taken from.
_FIRST_SET = 0


@dataclass(frozen=True)
class BakedColors:
    """Colours that were baked because they cannot be read, by channel, and the UV map that they lie in."""

    images: Mapping[str, bpy.types.Image]
    uv_map: str


class Materials:
    """Writes materials and remembers them."""

    def __init__(self, glb: Glb) -> None:
        """Starts with no material."""
        self.notes: list[Note] = []
        self._glb = glb
        self._surfaces: dict[str, Surface] = {}
        self._written: dict[tuple[object, ...], int] = {}
        self._pictures: dict[tuple[object, ...], tuple[int, float]] = {}
        self._samplers: dict[tuple[int, int, int], int] = {}
        # Pictures whose pixels are read and that are to be encoded when the file is written.
        self.pending: list[tuple[int, Picture]] = []

    def surface(self, material: bpy.types.Material | None) -> Surface:
        """What the material does to light."""
        key = material.name_full if material else ""
        if key not in self._surfaces:
            self._surfaces[key] = read_surface(material)
        return self._surfaces[key]

    def write(self, material: bpy.types.Material | None, sets: Mapping[str, int], baked: BakedColors | None) -> int:
        """The glTF material for a mesh with the given UV maps (name → set, "" for the active one)."""
        surface = self.surface(material)
        name = material.name_full if material else "Default"
        used = [c.texture for c in (surface.base, surface.emission) if c.texture] + [surface.opacity.texture]
        textures = tuple((t.uv_map, sets.get(t.uv_map)) for t in used if t)
        own = tuple((k, i.name_full) for k, i in sorted(baked.images.items())) if baked else ()
        key = (name, textures, own, sets.get(baked.uv_map) if baked else None)
        if key not in self._written:
            self._note(name, surface, baked)
            self._written[key] = self._glb.append("materials", self._json(name, surface, sets, baked))
        return self._written[key]

    def _note(self, name: str, surface: Surface, baked: BakedColors | None) -> None:
        for fault in surface.faults:
            if baked and "comes from" in fault:
                fault = fault.replace("is taken as its mean colour", "was baked to a texture")
            note = Note(name, fault, "APPROXIMATED")
            if note not in self.notes:
                self.notes.append(note)

    def _json(self, name: str, surface: Surface, sets: Mapping[str, int], baked: BakedColors | None) -> Json:
        base, emission = surface.base, surface.emission
        if baked:
            lie = {channel: Texture(image, baked.uv_map, extension="EXTEND") for channel, image in baked.images.items()}
            base = Color(texture=lie["base"]) if "base" in lie else base
            emission = Color(texture=lie["emission"]) if "emission" in lie else emission
        self._missing_sets(name, base, emission, sets)
        pbr: Json = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
        material: Json = {
            "name": name.strip() or "Material",
            "doubleSided": True,
            "extras": {"lightkiln": {"material": name}},
        }
        factor = base.factor
        if surface.opacity.texture:
            pbr["baseColorTexture"] = self._masked(base, surface.opacity, sets)
        elif base.texture:
            pbr["baseColorTexture"], white = self._texture(base.texture, sets)
            factor = (factor[0] * white, factor[1] * white, factor[2] * white)
        opacity = 1.0 if surface.opacity.texture else surface.opacity.value
        pbr["baseColorFactor"] = [*(min(max(c, 0.0), 1.0) for c in factor), opacity]
        material["pbrMetallicRoughness"] = pbr
        self._opacity(material, surface.opacity)
        self._emission(material, emission, sets)
        if surface.transmission > 0:
            self._glb.use("KHR_materials_transmission")
            extension = {"transmissionFactor": surface.transmission}
            material.setdefault("extensions", {})["KHR_materials_transmission"] = extension
        return material

    def _missing_sets(self, name: str, base: Color, emission: Color, sets: Mapping[str, int]) -> None:
        for texture in (base.texture, emission.texture):
            if texture and texture.uv_map not in sets:
                message = f"it uses the UV map `{texture.uv_map}`, which a mesh lacks; the active one is taken: add it"
                self.notes.append(Note(name, message))

    @staticmethod
    def _opacity(material: Json, opacity: Opacity) -> None:
        if opacity.cutoff is not None:
            material |= {"alphaMode": "MASK", "alphaCutoff": opacity.cutoff}
        elif opacity.texture or opacity.value < 1.0:
            material["alphaMode"] = "BLEND"

    def _emission(self, material: Json, emission: Color, sets: Mapping[str, int]) -> None:
        factor: Rgb = emission.factor
        if max(factor) <= 0.0:
            return
        if emission.texture:
            material["emissiveTexture"], white = self._texture(emission.texture, sets)
            factor = (factor[0] * white, factor[1] * white, factor[2] * white)
        strength = max(*factor, 0.0)
        material["emissiveFactor"] = [max(c, 0.0) / strength for c in factor]
        self._glb.use("KHR_materials_emissive_strength")
        extension = {"emissiveStrength": strength}
        material.setdefault("extensions", {})["KHR_materials_emissive_strength"] = extension

    def _texture(self, texture: Texture, sets: Mapping[str, int]) -> tuple[Json, float]:
        key = ("color", texture.image.name_full)
        if key not in self._pictures:
            try:
                picture, white = color_picture(texture.image)
            except BakeError as error:
                self.notes.append(Note(texture.image.name, f"{error}; white stands for it"))
                picture, white = _white(), 1.0
            self._pictures[key] = (self._add_picture(picture), white)
        image, white = self._pictures[key]
        return self._info(texture, image, sets), white

    def _masked(self, base: Color, opacity: Opacity, sets: Mapping[str, int]) -> Json:
        """A base texture whose alpha is the opacity."""
        mask = opacity.texture
        assert mask is not None
        below = base.texture.image if base.texture else None
        if below == mask.image and opacity.from_alpha:
            return self._texture(mask, sets)[0]
        key = ("masked", below.name_full if below else "", mask.image.name_full, opacity.from_alpha)
        if key not in self._pictures:
            picture = masked_picture(below, mask.image, opacity.from_alpha)
            self._pictures[key] = (self._add_picture(picture), 1.0)
        return self._info(mask, self._pictures[key][0], sets)

    def _add_picture(self, picture: Picture) -> int:
        index = self._glb.append("images", {"name": picture.name, "mimeType": picture.mime})
        self.pending.append((index, picture))
        return index

    def encode_pending(self) -> None:
        """Puts the pictures into the file. Needs no Blender data, so any thread may do it."""
        for index, picture in self.pending:
            self._glb.json["images"][index]["bufferView"] = self._glb.add_view(picture.data())
        self.pending.clear()

    def _info(self, texture: Texture, image: int, sets: Mapping[str, int]) -> Json:
        wrap = _WRAPS.get(texture.extension, 10497)
        filter_ = _NEAREST if texture.interpolation == "Closest" else _LINEAR
        key = (wrap, filter_, 0)
        if key not in self._samplers:
            sampler = {"wrapS": wrap, "wrapT": wrap, "magFilter": filter_, "minFilter": filter_}
            self._samplers[key] = self._glb.append("samplers", sampler)
        entry = {"sampler": self._samplers[key], "source": image}
        textures = self._glb.json.setdefault("textures", [])
        index = textures.index(entry) if entry in textures else self._glb.append("textures", entry)
        info: Json = {"index": index, "texCoord": sets.get(texture.uv_map, _FIRST_SET)}
        transform: Json = {}
        if texture.offset != (0.0, 0.0):
            transform["offset"] = list(texture.offset)
        if texture.rotation:
            transform["rotation"] = texture.rotation
        if texture.scale != (1.0, 1.0):
            transform["scale"] = list(texture.scale)
        if transform:
            self._glb.use("KHR_texture_transform")
            info["extensions"] = {"KHR_texture_transform": transform}
        return info


def _white() -> Picture:
    return Picture("white", pixels=np.full((1, 1, 4), 255, np.uint8))
