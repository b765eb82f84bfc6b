"""Spectra to linear Rec.709.

In: values over wavelength (nanometres to a number). Out: linear Rec.709 triples. Standard library only.
Observer: CIE 1931, as fitted by Wyman, Sloan, Shirley, "Simple Analytic Approximations to the CIE XYZ Color
Matching Functions", JCGT 2013 (multi-lobe fit). Illuminant: CIE D65, 10 nm table.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

Rgb = tuple[float, float, float]
Spectrum = Callable[[float], float]

_D65_FIRST, _D65_STEP = 400, 10
_D65 = (
    82.7549, 91.486, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811, 109.354,
    107.802, 104.79, 107.689, 104.405, 104.046, 100.0, 96.3342, 95.788, 88.6856, 90.0062, 89.5991,
    87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091,
)  # fmt: skip
_XYZ_TO_REC709 = (
    (3.2404542, -1.5371385, -0.4985314),
    (-0.9692660, 1.8760108, 0.0415560),
    (0.0556434, -0.2040259, 1.0572252),
)


def piecewise_linear(samples: dict[int, float]) -> Spectrum:
    """The function that is linear between the samples and constant outside them."""
    keys = sorted(samples)

    def value(wavelength: float) -> float:
        if wavelength <= keys[0]:
            return samples[keys[0]]
        for a, b in pairwise(keys):
            if wavelength <= b:
                t = (wavelength - a) / (b - a)
                return samples[a] * (1 - t) + samples[b] * t
        return samples[keys[-1]]

    return value


def reflectance_to_rec709(reflectance: Spectrum) -> Rgb:
    """Linear Rec.709 reflectance: the colour under D65 over that of a perfect white, which is exactly (1, 1, 1)."""
    d65 = piecewise_linear({_D65_FIRST + _D65_STEP * i: v for i, v in enumerate(_D65)})
    lit = _rec709(lambda w: reflectance(w) * d65(w))
    white = _rec709(d65)
    return lit[0] / white[0], lit[1] / white[1], lit[2] / white[2]


def emission_to_rec709(emission: Spectrum) -> Rgb:
    """Linear Rec.709 of an emission, scaled so that a constant spectrum keeps its value as luminance."""
    rgb = _rec709(emission)
    luminance = _integrate(_y, lambda _: 1.0)
    return rgb[0] / luminance, rgb[1] / luminance, rgb[2] / luminance


def _rec709(spectrum: Spectrum) -> Rgb:
    xyz = [_integrate(observer, spectrum) for observer in (_x, _y, _z)]
    r, g, b = (sum(m * c for m, c in zip(row, xyz, strict=True)) for row in _XYZ_TO_REC709)
    return r, g, b


def _integrate(observer: Spectrum, spectrum: Spectrum) -> float:
    # The measurements cover 400 to 700 nm; what lies outside is under 0.2 % of the luminance.
    return sum(observer(w) * spectrum(w) for w in range(400, 701))


def _lobe(wavelength: float, mean: float, below: float, above: float) -> float:
    t = (wavelength - mean) * (below if wavelength < mean else above)
    return math.exp(-0.5 * t * t)


def _x(w: float) -> float:
    return (
        1.056 * _lobe(w, 599.8, 0.0264, 0.0323)
        + 0.362 * _lobe(w, 442.0, 0.0624, 0.0374)
        - 0.065 * _lobe(w, 501.1, 0.0490, 0.0382)
    )


def _y(w: float) -> float:
    return 0.821 * _lobe(w, 568.8, 0.0213, 0.0247) + 0.286 * _lobe(w, 530.9, 0.0613, 0.0322)


def _z(w: float) -> float:
    return 1.217 * _lobe(w, 437.0, 0.0845, 0.0278) + 0.681 * _lobe(w, 459.0, 0.0385, 0.0725)
