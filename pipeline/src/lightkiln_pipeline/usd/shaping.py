"""UsdLux shaping: cone, focus and IES profile of a lamp → intensity over directions.

Angles in degrees from the lamp's axis. The formulas are those of the UsdLux schema (usd-core 26.11).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdLux

from ..errors import Notes
from .ies import Profile, ProfileFault, parse, rescaled, uniform
from .images import ImageFault, file_bytes

Floats = npt.NDArray[np.float64]

# Steps of a tabulated falloff: linear interpolation is then exact to 1e-5 of the maximum.
_STEPS = 361


@dataclass(frozen=True)
class Shaping:
    """How a lamp's emission depends on direction."""

    cone: float = 180.0
    """Half angle, degrees; nothing leaves beyond it."""
    softness: float = 0.0
    focus: float = 0.0
    tint: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Colour of what focus takes away."""
    profile: Profile | None = None

    @property
    def is_plain(self) -> bool:
        """True if all directions are alike."""
        return self.cone >= 180 and self.focus <= 0 and self.profile is None

    def falloff(self, angles: Floats, *, focused: bool = True) -> Floats:
        """The factor of cone and focus at angles from the axis."""
        start = self.cone * (1.0 - self.softness)
        if self.softness > 0:
            t = np.clip((angles - start) / max(self.cone - start, 1e-9), 0.0, 1.0)
            factor = 1.0 - t * t * (3.0 - 2.0 * t)
        else:
            factor = np.where(angles <= self.cone, 1.0, 0.0)
        if focused and self.focus > 0:
            factor = factor * np.abs(np.cos(np.radians(angles))) ** self.focus
        return np.asarray(factor, np.float64)

    def tabulated(self, *, focused: bool = True, lambert: bool = False) -> Profile:
        """Everything in one profile. `lambert`: times the cosine, for a small flat lamp that shines along its axis."""
        base = self.profile or uniform()
        end = min(self.cone, 90.0 if lambert else 180.0)
        angles = np.unique(np.concatenate([np.linspace(0.0, end, _STEPS), base.vertical[base.vertical <= end]]))
        angles = angles[angles >= 0]
        factor = self.falloff(angles, focused=focused)
        if lambert:
            factor = factor * np.cos(np.radians(angles))
        rows = base.at(angles) * factor
        if end < 180.0:
            # The edge is a hair wide, and darkness lasts to the far pole.
            angles = np.concatenate([angles, [end + 1e-4, 180.0]])
            rows = np.concatenate([rows, np.zeros((len(rows), 2))], axis=1)
        return Profile(angles, base.horizontal, rows)


def read_shaping(prim: Any, time: Any, notes: Notes) -> Shaping:
    """The shaping of a light prim."""
    shaping = UsdLux.ShapingAPI(prim)
    applied = prim.HasAPI(UsdLux.ShapingAPI)

    def value(attribute: Any, default: Any) -> Any:
        return attribute.Get(time) if attribute and (applied or attribute.HasAuthoredValue()) else default

    cone = float(value(shaping.GetShapingConeAngleAttr(), 180.0))
    tint = value(shaping.GetShapingFocusTintAttr(), (0.0, 0.0, 0.0))
    return Shaping(
        min(max(cone, 0.0), 180.0),
        min(max(float(value(shaping.GetShapingConeSoftnessAttr(), 0.0)), 0.0), 1.0),
        max(float(value(shaping.GetShapingFocusAttr(), 0.0)), 0.0),
        (float(tint[0]), float(tint[1]), float(tint[2])),
        _read_profile(prim, shaping, time, notes),
    )


def _read_profile(prim: Any, shaping: Any, time: Any, notes: Notes) -> Profile | None:
    attribute = shaping.GetShapingIesFileAttr()
    asset = attribute.Get(time) if attribute else None
    if not asset or not asset.path:
        return None
    if not asset.resolvedPath:
        notes.add(
            prim.GetPath(), f"its IES profile `{asset.path}` was not found; it shines without, put the file there"
        )
        return None
    try:
        profile = parse(file_bytes(asset.resolvedPath).decode("latin-1"))
    except (ProfileFault, ImageFault) as fault:
        notes.add(prim.GetPath(), f"its IES profile `{asset.path}` cannot be read: {fault}; it shines without")
        return None
    profile = rescaled(profile, float(shaping.GetShapingIesAngleScaleAttr().Get(time) or 0.0))
    if shaping.GetShapingIesNormalizeAttr().Get(time):
        # The same flux as without a profile.
        profile = Profile(profile.vertical, profile.horizontal, profile.candela / max(profile.mean(), 1e-30))
    return profile
