"""Reads UsdLux lights: prims → lamps of LIGHTKILN_scene with the nodes that place them.

In: light prims in stage units. Out: W, sr and metres with +Y up. What the extension has no word for is expressed by
what it has: shaping by profiles, shaped areas by small lamps, cylinders by emissive meshes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdLux

from ..errors import Notes
from ..glb.writer import Json
from .ies import Profile
from .images import ImageFault, linear_texture
from .networks import Texture
from .placement import rotation_and_scale
from .shaping import Shaping, read_shaping
from .stage import Matrix, Scene

Rgb = npt.NDArray[np.float64]

LUMENS_PER_WATT = 683.0
# A shaped area is drawn as this many small lamps along each side.
_GRID = 4


@dataclass
class Lamp:
    """A lamp and where it is."""

    definition: Json
    """Of LIGHTKILN_scene, without its profile."""
    node: Json
    profile: Profile | None = None


@dataclass
class Tube:
    """A cylinder light: an emissive surface."""

    name: str
    radius: float
    length: float
    world: Matrix
    radiance: Rgb


@dataclass
class Lights:
    """What the lights of a scene become."""

    lamps: list[Lamp] = field(default_factory=list)
    tubes: list[Tube] = field(default_factory=list)
    domes: list[tuple[Any, Rgb]] = field(default_factory=list)
    """Dome prims and their radiance."""


def emitted(scene: Scene, prim: Any, to_radiance: float) -> Rgb:
    """A light's radiance before normalize: intensity · 2^exposure · color · temperature · diffuse, W/(m²·sr)."""
    light, time = UsdLux.LightAPI(prim), scene.time
    color = np.array(light.GetColorAttr().Get(time), np.float64)
    # Blender (5.0) switches the temperature on for all lamps, but writes it only if it is not 6500 K, its default.
    is_default = scene.blender and not light.GetColorTemperatureAttr().HasAuthoredValue()
    if light.GetEnableColorTemperatureAttr().Get(time) and not is_default:
        kelvin = float(light.GetColorTemperatureAttr().Get(time))
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin))
    strength = float(light.GetIntensityAttr().Get(time)) * 2.0 ** float(light.GetExposureAttr().Get(time))
    strength *= float(light.GetDiffuseAttr().Get(time))
    return np.asarray(np.maximum(color, 0.0) * max(strength, 0.0) * to_radiance)


class LightReader:
    """Reads the lights of one scene."""

    def __init__(self, scene: Scene, to_radiance: float, notes: Notes) -> None:
        """`to_radiance`: from the stage's unit, nits unless said otherwise, to W/(m²·sr)."""
        self._scene, self._to_radiance, self._notes = scene, to_radiance, notes
        self.lights = Lights()

    def read(self, prim: Any, world: Matrix, name: str) -> None:
        """Adds a light prim that is placed at `world`."""
        self._check(prim)
        if prim.IsA(UsdLux.DomeLight) or prim.IsA(UsdLux.DomeLight_1):
            self.lights.domes.append((prim, self._radiance(prim)))
        elif prim.IsA(UsdLux.DistantLight):
            self._distant(UsdLux.DistantLight(prim), world, name)
        elif prim.IsA(UsdLux.SphereLight):
            self._sphere(UsdLux.SphereLight(prim), world, name)
        elif prim.IsA(UsdLux.RectLight) or prim.IsA(UsdLux.DiskLight):
            self._area(prim, world, name)
        elif prim.IsA(UsdLux.CylinderLight):
            self._cylinder(UsdLux.CylinderLight(prim), world, name)
        elif not prim.IsA(UsdLux.PortalLight):
            self._notes.add(prim.GetPath(), f"`{prim.GetTypeName()}` is not read; it gives no light, use another type")

    def _check(self, prim: Any) -> None:
        light = UsdLux.LightAPI(prim)
        if light.GetFiltersRel().GetTargets():
            self._notes.add(prim.GetPath(), "its light filters are left out; it shines unfiltered")
        for linking in (light.GetLightLinkCollectionAPI(), light.GetShadowLinkCollectionAPI()):
            if linking.GetIncludesRel().GetTargets() or linking.GetExcludesRel().GetTargets():
                self._notes.add(prim.GetPath(), "light and shadow linking are left out; it lights everything")

    def _radiance(self, prim: Any) -> Rgb:
        return emitted(self._scene, prim, self._to_radiance)

    def _normalized(self, prim: Any) -> bool:
        return bool(UsdLux.LightAPI(prim).GetNormalizeAttr().Get(self._scene.time))

    def _casts(self, prim: Any) -> Json:
        shadow = UsdLux.ShadowAPI(prim).GetShadowEnableAttr()
        value = shadow.Get(self._scene.time) if shadow else None
        return {"castsShadows": False} if value is False else {}

    def _add(self, prim: Any, node: Json, lamp: Json, profile: Profile | None = None) -> None:
        lamp = {"name": node["name"], **lamp, **self._casts(prim)}
        self.lights.lamps.append(Lamp(lamp, node, profile))

    def _node(self, world: Matrix, name: str, shift: tuple[float, float] = (0.0, 0.0)) -> Json:
        """A node without scale. `shift`: along the light's own X and Y, in its units."""
        quaternion, _ = rotation_and_scale(world)
        position = world @ np.array([shift[0], shift[1], 0.0, 1.0])
        return {"name": name, "translation": [float(x) for x in position[:3]], "rotation": quaternion}

    def _distant(self, light: Any, world: Matrix, name: str) -> None:
        prim, time = light.GetPrim(), self._scene.time
        angle = math.radians(min(max(float(light.GetAngleAttr().Get(time)), 0.0), 360.0))
        radiance = self._radiance(prim)
        if self._scene.blender:
            # Blender writes a quarter of the strength and half of the angle, and reads them back the same way.
            irradiance, angle = 4.0 * radiance, 2.0 * angle
        elif self._normalized(prim) or angle == 0:
            irradiance = radiance
        else:
            sine = math.sin(min(angle, math.pi) / 2) ** 2
            irradiance = radiance * math.pi * (sine if angle <= math.pi else 2 - math.sin(angle / 2) ** 2)
        if angle > math.pi:
            self._notes.add(prim.GetPath(), "a distant light wider than 180° is baked as 180°; use a dome light")
        if not read_shaping(prim, time, self._notes).is_plain and prim.HasAPI(UsdLux.ShapingAPI):
            self._notes.add(prim.GetPath(), "shaping of a distant light is left out")
        lamp = {"type": "sun", "irradiance": _list(irradiance), "angle": min(angle, math.pi)}
        self._add(prim, self._node(world, name), lamp)

    def _sphere(self, light: Any, world: Matrix, name: str) -> None:
        prim, time = light.GetPrim(), self._scene.time
        _, scale = rotation_and_scale(world)
        if scale.max() - scale.min() > 1e-3 * scale.max():
            self._notes.add(prim.GetPath(), "a sphere light that is stretched is baked as a sphere of the mean radius")
        radius = float(light.GetRadiusAttr().Get(time)) * float(np.cbrt(scale.prod()))
        # Seen from anywhere the sphere shows πr²; divided by its surface 4πr² that is a quarter.
        area = 0.25 if self._normalized(prim) else math.pi * radius**2
        intensity = self._radiance(prim) * area
        if light.GetTreatAsPointAttr().Get(time):
            radius = 0.0
        shaping = read_shaping(prim, time, self._notes)
        self._shaped(prim, self._node(world, name), intensity, radius, shaping)

    def _shaped(
        self, prim: Any, node: Json, intensity: Rgb, radius: float, shaping: Shaping, *, lambert: bool = False
    ) -> None:
        """A small lamp of `intensity` W/sr along its axis, before shaping."""
        lamp: Json = {"type": "point", "intensity": _list(intensity), "radius": radius}
        if shaping.is_plain and not lambert:
            self._add(prim, node, lamp)
            return
        plain_cone = shaping.focus <= 0 and shaping.profile is None and shaping.cone <= 90 and not lambert
        if plain_cone and (shaping.softness <= 0 or self._scene.blender):
            # Blender's softness is that of the extension, not UsdLux's.
            cone = {"type": "spot", "outerConeAngle": math.radians(shaping.cone), "blend": shaping.softness}
            self._add(prim, node, lamp | cone)
            return
        # With a tint, focus only takes away a part of the colour; the rest is a second lamp without focus.
        tint = np.clip(np.array(shaping.tint), 0.0, 1.0) if shaping.focus > 0 else np.zeros(3)
        for color, focused in ((intensity * (1 - tint), True), (intensity * tint, False)):
            profile = shaping.tabulated(focused=focused, lambert=lambert)
            peak = float(profile.candela.max())
            if color.max() > 0 and peak > 0:
                self._add(prim, node, lamp | {"intensity": _list(color * peak)}, profile)

    def _area(self, prim: Any, world: Matrix, name: str) -> None:
        time = self._scene.time
        _, scale = rotation_and_scale(world)
        is_rect = prim.IsA(UsdLux.RectLight)
        if is_rect:
            rect = UsdLux.RectLight(prim)
            own = [float(rect.GetWidthAttr().Get(time)), float(rect.GetHeightAttr().Get(time))]
        else:
            own = [2.0 * float(UsdLux.DiskLight(prim).GetRadiusAttr().Get(time))] * 2
        size = [own[0] * float(scale[0]), own[1] * float(scale[1])]
        area = size[0] * size[1] * (1.0 if is_rect else math.pi / 4)
        if area <= 0:
            self._notes.add(prim.GetPath(), "its size is zero; it gives no light")
            return
        radiance = self._radiance(prim) / (area if self._normalized(prim) else 1.0)
        radiance = radiance * self._mean_of_texture(prim)
        shaping = read_shaping(prim, time, self._notes)
        if shaping.focus <= 0 and shaping.profile is None and shaping.cone >= 90 and shaping.softness <= 0:
            lamp = {"type": "rect" if is_rect else "disk", "radiance": _list(radiance), "size": size}
            self._add(prim, self._node(world, name), lamp)
            return
        self._notes.add(prim.GetPath(), f"its shaping is baked with up to {_GRID * _GRID} small lamps over its area")
        places = [(i + 0.5) / _GRID - 0.5 for i in range(_GRID)]
        cells = [(x, y) for x in places for y in places if is_rect or x * x + y * y < 0.25]
        radius = math.sqrt(area / len(cells) / math.pi)
        for i, (x, y) in enumerate(cells):
            node = self._node(world, f"{name}.{i}", (x * own[0], y * own[1]))
            self._shaped(prim, node, radiance * area / len(cells), radius, shaping, lambert=True)

    def _mean_of_texture(self, prim: Any) -> Rgb:
        """The mean colour of a rectangle's texture: the baker's lamps are of one colour."""
        attribute = UsdLux.RectLight(prim).GetTextureFileAttr() if prim.IsA(UsdLux.RectLight) else None
        asset = attribute.Get(self._scene.time) if attribute else None
        if not asset or not asset.path:
            return np.ones(3)
        try:
            if not asset.resolvedPath:
                raise ImageFault("it was not found")
            pixels, _ = linear_texture(Texture(str(asset.resolvedPath), "rgb"))
        except ImageFault as fault:
            self._notes.add(
                prim.GetPath(), f"its texture `{asset.path}` cannot be read ({fault}); it shines in its colour"
            )
            return np.ones(3)
        self._notes.add(prim.GetPath(), "its texture is baked as its mean colour")
        return np.asarray(pixels[..., :3].reshape(-1, 3).mean(axis=0), np.float64)

    def _cylinder(self, light: Any, world: Matrix, name: str) -> None:
        prim, time = light.GetPrim(), self._scene.time
        radius, length = float(light.GetRadiusAttr().Get(time)), float(light.GetLengthAttr().Get(time))
        _, scale = rotation_and_scale(world)
        area = 2 * math.pi * radius * math.sqrt(float(scale[1] * scale[2])) * length * float(scale[0])
        if area <= 0:
            self._notes.add(prim.GetPath(), "its size is zero; it gives no light")
            return
        if not read_shaping(prim, time, self._notes).is_plain:
            self._notes.add(prim.GetPath(), "shaping of a cylinder light is left out; it shines to all sides")
        radiance = self._radiance(prim) / (area if self._normalized(prim) else 1.0)
        self.lights.tubes.append(Tube(name, radius, length, world, radiance))


def _list(values: Rgb) -> list[float]:
    return [float(x) for x in values]
