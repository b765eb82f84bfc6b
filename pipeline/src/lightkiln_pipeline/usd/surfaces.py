"""Reads materials: UsdShade networks → what diffuse light sees of a surface.

In: a bound material. Out: reflected, emitted and covered channels, each a constant, a texture or a primvar.
UsdPreviewSurface is read whole; of MaterialX surfaces the constants and plain image nodes. The rest falls back to a
constant and is noted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pxr import Gf, UsdShade

from ..errors import Notes
from .networks import Input, Texture, follow

Color = tuple[float, float, float]

# What UsdPreviewSurface's specification says of inputs that are not authored.
_PREVIEW_DEFAULTS: dict[str, Any] = {
    "diffuseColor": (0.18, 0.18, 0.18),
    "emissiveColor": (0.0, 0.0, 0.0),
    "metallic": 0.0,
    "opacity": 1.0,
    "opacityThreshold": 0.0,
    "useSpecularWorkflow": 0,
}
# Colours of surfaces that say nothing: Hydra's, and Blender's, which does not write its default material.
UNBOUND = (0.5, 0.5, 0.5)
UNBOUND_IN_BLENDER = (0.8, 0.8, 0.8)


@dataclass
class Channel:
    """One property of a surface: a texture or primvar if there is one, else the constant."""

    value: Color
    texture: Texture | None = None
    primvar: str | None = None


@dataclass
class Surface:
    """What diffuse light sees of a material."""

    name: str
    base: Channel
    emission: Channel = field(default_factory=lambda: Channel((0.0, 0.0, 0.0)))
    """In the stage's unit of radiance."""
    opacity: Channel = field(default_factory=lambda: Channel((1.0, 1.0, 1.0)))
    metallic: Channel = field(default_factory=lambda: Channel((0.0, 0.0, 0.0)))
    opacity_threshold: float = 0.0


def unbound_surface(has_display_color: bool, color: Color = UNBOUND) -> Surface:
    """The surface of a prim without material: its display colour, else `color`."""
    return Surface("displayColor", Channel(color, primvar="displayColor" if has_display_color else None))


def read_surface(material: Any, time: Any, notes: Notes, *, has_display_color: bool) -> Surface:
    """The surface of a material."""
    path = material.GetPath()
    shader = _surface_shader(material)
    if shader is None:
        notes.add(path, "it has no surface that can be read; the display colour is baked, give it a UsdPreviewSurface")
        surface = unbound_surface(has_display_color)
        surface.name = str(path)
        return surface
    kind = str(shader.GetIdAttr().Get())
    if kind in ("UsdPreviewSurface", "ND_UsdPreviewSurface_surfaceshader"):
        return _preview_surface(str(path), shader, time, notes)
    if kind in _MATERIALX:
        return _materialx_surface(str(path), shader, kind, time, notes)
    notes.add(path, f"its surface `{kind}` is not read; the display colour is baked, give it a UsdPreviewSurface")
    surface = unbound_surface(has_display_color)
    surface.name = str(path)
    return surface


def _surface_shader(material: Any) -> Any | None:
    """The shader that feeds the surface, the universal output first."""
    for contexts in (UsdShade.Tokens.universalRenderContext, "mtlx"):
        source = material.ComputeSurfaceSource(contexts)[0]
        if source and source.GetIdAttr().Get():
            return source
    return None


def _preview_surface(name: str, shader: Any, time: Any, notes: Notes) -> Surface:
    def channel(key: str) -> Channel:
        return _channel(follow(shader, key, time, notes), _PREVIEW_DEFAULTS[key], shader, notes)

    surface = Surface(name, channel("diffuseColor"), channel("emissiveColor"), channel("opacity"), channel("metallic"))
    if int(_number(shader, "useSpecularWorkflow", time, 0)):
        # The specular workflow has no metals: its diffuse colour is what reflects diffusely.
        surface.metallic = Channel((0.0, 0.0, 0.0))
    surface.opacity_threshold = float(_number(shader, "opacityThreshold", time, 0.0))
    return surface


@dataclass(frozen=True)
class _Names:
    """What a MaterialX surface calls its inputs, with defaults; weights multiply."""

    base: tuple[str, float]
    base_color: tuple[str, Color]
    metallic: str
    emission: tuple[str, float]
    emission_color: str
    opacity: str
    transmission: str


_MATERIALX = {
    "ND_standard_surface_surfaceshader": _Names(
        ("base", 1.0),
        ("base_color", (0.8, 0.8, 0.8)),
        "metalness",
        ("emission", 0.0),
        "emission_color",
        "opacity",
        "transmission",
    ),
    "ND_open_pbr_surface_surfaceshader": _Names(
        ("base_weight", 1.0),
        ("base_color", (0.8, 0.8, 0.8)),
        "base_metalness",
        ("emission_luminance", 0.0),
        "emission_color",
        "geometry_opacity",
        "transmission_weight",
    ),
}


def _materialx_surface(name: str, shader: Any, kind: str, time: Any, notes: Notes) -> Surface:
    names = _MATERIALX[kind]
    notes.add(
        name, f"of its `{kind}` only constants and plain images are baked; give it a UsdPreviewSurface for the rest"
    )

    def channel(key: str, default: Any) -> Channel:
        return _channel(follow(shader, key, time, notes), default, shader, notes)

    base = channel(*names.base_color)
    weight = _number(shader, names.base[0], time, names.base[1])
    base.value = _scaled(base.value, weight)
    emission = channel(names.emission_color, (1.0, 1.0, 1.0))
    strength = _number(shader, names.emission[0], time, names.emission[1])
    emission.value = _scaled(emission.value, strength)
    for textured, factor in ((base, weight), (emission, strength)):
        if textured.texture is not None:
            textured.texture = textured.texture.scaled(factor)
    surface = Surface(name, base, emission, channel(names.opacity, 1.0), channel(names.metallic, 0.0))
    transmission = _number(shader, names.transmission, time, 0.0)
    if transmission > 0:
        # What passes does not reflect; the way of the light through the body is not modelled.
        surface.opacity = Channel(_scaled(surface.opacity.value, 1.0 - transmission), surface.opacity.texture)
    return surface


def _channel(found: Input, default: Any, shader: Any, notes: Notes) -> Channel:
    value = default if found.value is None else found.value
    constant = _color(value)
    if constant is None:
        notes.add(shader.GetPath(), f"a value of {value!r} is no colour; the default is taken")
        constant = _color(default) or (0.0, 0.0, 0.0)
    return Channel(constant, found.texture, found.primvar)


def _color(value: Any) -> Color | None:
    """A number or vector as a colour."""
    if isinstance(value, (int, float)):
        return (float(value),) * 3
    if isinstance(value, (tuple, list, Gf.Vec3f, Gf.Vec3d, Gf.Vec3h, Gf.Vec4f, Gf.Vec4d)) and len(value) >= 3:
        return (float(value[0]), float(value[1]), float(value[2]))
    return None


def _scaled(color: Color, factor: float) -> Color:
    return (color[0] * factor, color[1] * factor, color[2] * factor)


def _number(shader: Any, key: str, time: Any, default: float) -> float:
    """A constant input, through the interfaces of the material."""
    value = follow(shader, key, time, Notes()).value
    return float(value) if isinstance(value, (int, float)) else default
