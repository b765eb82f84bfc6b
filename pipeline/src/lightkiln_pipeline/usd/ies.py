"""Photometric profiles for shaped lamps: LM-63 files and UsdLux shaping → one LM-63 text that the baker reads.

Angles in degrees, type C: vertical 0 is the lamp's axis (−Z), horizontal 0 is +X, counter-clockwise towards +Y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


class ProfileFault(Exception):
    """A profile cannot be read; the message says why."""


@dataclass(frozen=True)
class Profile:
    """Relative intensities over directions, bilinear between angles and zero beyond them."""

    vertical: Floats
    horizontal: Floats
    candela: Floats
    """A row of verticals per horizontal angle."""

    def at(self, vertical: Floats) -> Floats:
        """Rows at other vertical angles, zero where nothing was measured."""
        rows = [np.interp(vertical, self.vertical, row, left=0.0, right=0.0) for row in self.candela]
        return np.array(rows)

    def mean(self) -> float:
        """Mean over the whole sphere of directions: the flux divided by 4π."""
        fine = np.unique(np.concatenate([self.vertical, np.linspace(self.vertical[0], self.vertical[-1], 2001)]))
        rows = self.at(fine)
        if len(self.horizontal) > 1:
            # The given part of the circle stands for all of it, by symmetry.
            span = self.horizontal[-1] - self.horizontal[0]
            weights = np.gradient(self.horizontal) if len(self.horizontal) > 2 else np.ones(2) * span / 2
            weights[[0, -1]] = np.diff(self.horizontal)[[0, -1]] / 2
            row = (rows * weights[:, None]).sum(axis=0) / weights.sum()
        else:
            row = rows[0]
        angles = np.radians(fine)
        return float(np.trapezoid(row * np.sin(angles), angles) / 2)

    def text(self) -> str:
        """The profile as LM-63-2002."""
        head = "IESNA:LM-63-2002\n[MANUFAC] Lightkiln\nTILT=NONE\n"
        numbers = f"1 -1 1 {len(self.vertical)} {len(self.horizontal)} 1 2 0 0 0\n1 1 0\n"
        rows = [self.vertical, self.horizontal, *self.candela]
        return head + numbers + "".join(" ".join(f"{x:.9g}" for x in row) + "\n" for row in rows)


def uniform() -> Profile:
    """The same in all directions."""
    return Profile(np.array([0.0, 180.0]), np.array([0.0]), np.ones((1, 2)))


def parse(text: str) -> Profile:
    """Reads an LM-63 file of type C. Raises ProfileFault."""
    _, mark, rest = text.partition("TILT=")
    if not mark:
        raise ProfileFault("it has no line `TILT=`, so it is no LM-63 file")
    tilt, _, body = rest.partition("\n")
    try:
        numbers = iter([float(word) for word in body.replace(",", " ").split()])
        if tilt.strip().upper() == "INCLUDE":
            next(numbers)
            for _ in range(2 * int(next(numbers))):
                next(numbers)
        head = [next(numbers) for _ in range(13)]
        verticals, horizontals, kind = int(head[3]), int(head[4]), int(head[5])
        if kind != 1:
            raise ProfileFault("it is not photometry of type C, the only one that UsdLux shaping is applied to")
        vertical = np.array([next(numbers) for _ in range(verticals)])
        horizontal = np.array([next(numbers) for _ in range(horizontals)])
        values = np.array([next(numbers) for _ in range(verticals * horizontals)])
    except (StopIteration, ValueError) as error:
        raise ProfileFault("it ends too early or has words where numbers should be") from error
    if verticals < 2 or horizontals < 1 or (np.diff(vertical) <= 0).any() or (np.diff(horizontal) <= 0).any():
        raise ProfileFault("its angles are not in ascending order")
    if not np.isfinite(values).all() or (values < 0).any() or values.max() <= 0:
        raise ProfileFault("its intensities are negative, not finite or all zero")
    candela = values.reshape(horizontals, verticals) * head[2] * head[10]
    return Profile(vertical, horizontal, candela)


def rescaled(profile: Profile, angle_scale: float) -> Profile:
    """The profile with UsdLux's angleScale: its vertical angles spread from the axis, if negative from behind."""
    if angle_scale == 0:
        return profile
    if angle_scale > 0:
        return Profile(profile.vertical * angle_scale, profile.horizontal, profile.candela)
    return Profile((profile.vertical - 180.0) * -angle_scale + 180.0, profile.horizontal, profile.candela)
