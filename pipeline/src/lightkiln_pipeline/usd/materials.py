"""Writes surfaces as glTF materials: channels of a surface → factors, textures and images of a document.

Pictures that glTF can hold as they are go in byte for byte; the others are evaluated and stored as 8-bit PNG.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import Notes
from ..glb.writer import GlbWriter, Json
from .images import ImageFault, Pixels, encode_srgb, file_bytes, image_bytes, linear_texture, picked, resized
from .networks import Texture
from .surfaces import Channel, Color, Surface

_WRAPS = {"repeat": 10497, "mirror": 33648, "clamp": 33071, "black": 33071, "useMetadata": 10497}


@dataclass(frozen=True)
class WrittenMaterial:
    """A material in the document and what it wants of a mesh."""

    index: int
    uv_sets: tuple[str, ...]
    """Primvars of texture coordinates; their place is their number in TEXCOORD, set 1 left out."""
    color_primvar: str | None
    """Primvar that goes into COLOR_0."""


class Materials:
    """Materials of one document, each written once."""

    def __init__(self, glb: GlbWriter, to_radiance: float, notes: Notes) -> None:
        """`to_radiance`: from the stage's unit to W/(m²·sr)."""
        self._glb, self._to_radiance, self._notes = glb, to_radiance, notes
        self._written: dict[tuple[str, bool, bool], WrittenMaterial] = {}
        self._images: dict[tuple[object, ...], int] = {}
        self._samplers: dict[tuple[str, str], int] = {}

    def write(self, surface: Surface, *, double_sided: bool, light: Color | None = None) -> WrittenMaterial:
        """The material of a surface. `light`: emission in W/(m²·sr) that comes on top, of a mesh light."""
        key = (f"{surface.name} {light}", double_sided, surface.base.primvar is not None)
        if key not in self._written:
            self._written[key] = self._new(surface, double_sided, light)
        return self._written[key]

    def _new(self, surface: Surface, double_sided: bool, light: Color | None) -> WrittenMaterial:
        pbr: Json = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
        material: Json = {"name": surface.name, "doubleSided": double_sided, "pbrMetallicRoughness": pbr}
        uv_sets: list[str] = []
        self._base(surface, material, pbr, uv_sets)
        self._metallic(surface, pbr, uv_sets)
        self._emission(surface, material, uv_sets, light)
        index = self._glb.push("materials", material)
        return WrittenMaterial(index, tuple(uv_sets), surface.base.primvar)

    def _base(self, surface: Surface, material: Json, pbr: Json, uv_sets: list[str]) -> None:
        color, opacity = surface.base, surface.opacity
        factor = [1.0, 1.0, 1.0] if color.primvar else [_share(c) for c in color.value]
        alpha = 1.0 if opacity.texture else _share(opacity.value[0])
        if color.texture is not None and self._fits(color.texture) and opacity.texture is None:
            info = self._plain_image(color.texture, uv_sets)
            factor = [_share(s) for s in color.texture.scale[:3]]
        else:
            info = self._evaluated_base(color, opacity, uv_sets)
            if info is not None and color.texture is not None:
                factor = [1.0, 1.0, 1.0]
        if info is not None:
            pbr["baseColorTexture"] = info
        elif color.texture is not None:
            factor = [_share(c) for c in color.texture.fallback[:3]]
        pbr["baseColorFactor"] = [*factor, alpha]
        if surface.opacity_threshold > 0 and (opacity.texture is not None or alpha < 1):
            material |= {"alphaMode": "MASK", "alphaCutoff": surface.opacity_threshold}
        elif alpha < 1 or (opacity.texture is not None and info is not None):
            material["alphaMode"] = "BLEND"

    def _fits(self, texture: Texture) -> bool:
        """True if glTF's own rules give the same values from the file as it is."""
        kind = Path(texture.file.rstrip("]")).suffix.lower()
        plain = (
            not texture.tiles
            and texture.output == "rgb"
            and not any(texture.bias[:3])
            and all(0 <= s <= 1 for s in texture.scale[:3])
        )
        return plain and texture.color_space in ("auto", "sRGB") and kind in (".jpg", ".jpeg")

    def _plain_image(self, texture: Texture, uv_sets: list[str]) -> Json | None:
        key = ("file", texture.file)
        if key not in self._images:
            try:
                data = file_bytes(texture.file)
            except ImageFault as fault:
                self._unreadable(texture, fault)
                return None
            self._images[key] = self._image(data, "image/jpeg", texture.file)
        return self._info(texture, self._images[key], uv_sets)

    def _evaluated_base(self, color: Channel, opacity: Channel, uv_sets: list[str]) -> Json | None:
        """An image of colour and coverage; none if neither has a texture that can be read."""
        parts: list[tuple[Texture, Pixels]] = []
        for channel in (color, opacity):
            pixels = self._pixels(channel.texture)
            if channel.texture is not None and pixels is not None:
                parts.append((channel.texture, pixels))
        if not parts:
            return None
        placing = parts[0][0]
        if len(parts) == 2 and _place(parts[0][0]) != _place(parts[1][0]):
            message = "colour and opacity have different texture coordinates; those of the colour serve both"
            self._notes.add(parts[1][0].file, message)
        height = max(p.shape[0] for _, p in parts)
        width = max(p.shape[1] for _, p in parts)
        rgba = np.ones((height, width, 4), np.float32)
        for texture, pixels in parts:
            values = picked(resized(pixels, width, height), texture.output)
            if texture is color.texture:
                rgba[..., :3] = encode_srgb(values)
            if texture is opacity.texture:
                rgba[..., 3] = np.clip(values[..., 0], 0, 1)
        key = ("base", color.texture, opacity.texture)
        if key not in self._images:
            kept = rgba if opacity.texture is not None else rgba[..., :3]
            self._images[key] = self._image(image_bytes(kept, "png"), "image/png", placing.file)
        return self._info(placing, self._images[key], uv_sets)

    def _metallic(self, surface: Surface, pbr: Json, uv_sets: list[str]) -> None:
        """The metallic share reflects nothing diffusely."""
        texture = surface.metallic.texture
        pixels = self._pixels(texture)
        if texture is None or pixels is None:
            pbr["metallicFactor"] = _share(surface.metallic.value[0])
            return
        key = ("metallic", texture)
        if key not in self._images:
            values = np.clip(picked(pixels, texture.output), 0, 1)
            self._images[key] = self._image(image_bytes(values, "png"), "image/png", texture.file)
        pbr["metallicFactor"] = 1.0
        pbr["metallicRoughnessTexture"] = self._info(texture, self._images[key], uv_sets)

    def _emission(self, surface: Surface, material: Json, uv_sets: list[str], light: Color | None) -> None:
        texture = surface.emission.texture
        pixels = self._pixels(texture)
        radiance = np.array(surface.emission.value) * self._to_radiance
        if surface.emission.primvar:
            self._notes.add(
                surface.name, f"emission from primvars:{surface.emission.primvar} is not baked; use a texture"
            )
        if texture is not None and pixels is not None:
            values = np.maximum(picked(pixels, texture.output), 0)
            peak = float(values.max())
            if peak > 0:
                key = ("emission", texture)
                if key not in self._images:
                    data = image_bytes(encode_srgb((values / peak).astype(np.float32)), "png")
                    self._images[key] = self._image(data, "image/png", texture.file)
                material["emissiveTexture"] = self._info(texture, self._images[key], uv_sets)
            radiance = np.full(3, peak * self._to_radiance)
        if light is not None:
            radiance = radiance + np.array(light)
            if material.pop("emissiveTexture", None) is not None:
                self._notes.add(
                    surface.name, "a mesh light's material has textured emission; only the light's is baked"
                )
                radiance = np.array(light)
        strength = float(radiance.max())
        if strength > 0:
            material["emissiveFactor"] = [float(c) / strength for c in radiance]
            material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
            self._glb.use("KHR_materials_emissive_strength")

    def _pixels(self, texture: Texture | None) -> Pixels | None:
        if texture is None:
            return None
        try:
            return linear_texture(texture)[0]
        except ImageFault as fault:
            self._unreadable(texture, fault)
            return None

    def _unreadable(self, texture: Texture, fault: ImageFault) -> None:
        self._notes.add(texture.file, f"the picture cannot be read ({fault}); its fallback is baked, export it again")

    def _image(self, data: bytes, mime: str, name: str) -> int:
        view = self._glb.view(data)
        return self._glb.push("images", {"bufferView": view, "mimeType": mime, "name": Path(name.rstrip("]")).name})

    def _info(self, texture: Texture, image: int, uv_sets: list[str]) -> Json:
        if texture.wrap not in self._samplers:
            wrap = [_WRAPS.get(w, 10497) for w in texture.wrap]
            self._samplers[texture.wrap] = self._glb.push("samplers", {"wrapS": wrap[0], "wrapT": wrap[1]})
        sampler = self._samplers[texture.wrap]
        known = ("texture", image, sampler)
        if known not in self._images:
            self._images[known] = self._glb.push("textures", {"source": image, "sampler": sampler})
        if texture.uv not in uv_sets:
            uv_sets.append(texture.uv)
        place = uv_sets.index(texture.uv)
        # Set 1 is the lightmap's.
        info: Json = {"index": self._images[known], "texCoord": place if place == 0 else place + 1}
        transform = _transform(texture)
        if transform is not None:
            info["extensions"] = {"KHR_texture_transform": transform}
            self._glb.use("KHR_texture_transform")
        return info


def _place(texture: Texture) -> tuple[object, ...]:
    return texture.uv, texture.rotation, texture.uv_scale, texture.shift, texture.wrap


def _transform(texture: Texture) -> Json | None:
    """UsdTransform2d, whose v runs up, as KHR_texture_transform, whose v runs down; none for the identity."""
    if (texture.rotation, texture.uv_scale, texture.shift) == (0.0, (1.0, 1.0), (0.0, 0.0)):
        return None
    angle = math.radians(texture.rotation)
    cos, sin = math.cos(angle), math.sin(angle)
    (sx, sy), (tx, ty) = texture.uv_scale, texture.shift
    # With v = 1 − t: u' = cos·sx·u − sin·sy·(1 − v) + tx, v' = 1 − (sin·sx·u + cos·sy·(1 − v) + ty).
    offset = [tx - sin * sy, 1.0 - ty - cos * sy]
    return {"offset": offset, "rotation": angle, "scale": [sx, sy]}


def _share(value: float) -> float:
    return min(max(float(value), 0.0), 1.0)
