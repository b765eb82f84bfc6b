"""Primvars of a prim, its own and inherited: values of every interpolation → values per corner."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

from ..errors import Notes
from .faces import Faces

Floats = npt.NDArray[np.float64]


class PrimValues:
    """The primvars of a prim, its own and inherited, per corner of the sound faces."""

    def __init__(self, prim: Any, time: Any, source: Faces, notes: Notes) -> None:
        """Reads at a time code, for the sound faces of the prim."""
        self._prim, self._time, self._source, self._notes = prim, time, source, notes
        self._primvars = UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance()

    def uv_sets(self) -> dict[str, Floats]:
        """Texture coordinates by name: primvars with two floats."""
        found = {}
        for primvar in self._primvars:
            kind = str(primvar.GetTypeName())
            if kind.rstrip("[]") in ("texCoord2f", "texCoord2d", "texCoord2h", "float2", "double2", "half2"):
                values = self._per_corner(primvar, 2)
                if values is not None:
                    found[str(primvar.GetPrimvarName())] = values
        return found

    def colors(self) -> dict[str, Floats]:
        """Colour primvars by name."""
        found = {}
        for primvar in self._primvars:
            if str(primvar.GetTypeName()).startswith("color3"):
                values = self._per_corner(primvar, 3)
                if values is not None:
                    found[str(primvar.GetPrimvarName())] = values
        return found

    def normals(self) -> Floats | None:
        """Authored normals: the primvar, else the attribute."""
        for primvar in self._primvars:
            if str(primvar.GetPrimvarName()) == "normals":
                return self._per_corner(primvar, 3)
        mesh = UsdGeom.Mesh(self._prim)
        values = mesh.GetNormalsAttr().Get(self._time)
        if not values:
            return None
        return self._spread(np.array(values, np.float64), str(mesh.GetNormalsInterpolation()), "normals")

    def _per_corner(self, primvar: Any, width: int) -> Floats | None:
        name = str(primvar.GetPrimvarName())
        value = primvar.ComputeFlattened(self._time)
        if value is None:
            if primvar.HasValue():
                self._notes.add(self._prim.GetPath(), f"primvars:{name} has indices beyond its values; it is left out")
            return None
        values = np.array(value, np.float64)
        return self._spread(values.reshape(-1, width), str(primvar.GetInterpolation()), f"primvars:{name}")

    def _spread(self, values: Floats, interpolation: str, name: str) -> Floats | None:
        """Values of any interpolation, per corner."""
        source = self._source
        counts = source.authored_counts if source.authored_counts is not None else source.counts
        expected = {
            "constant": 1,
            "uniform": len(counts),
            "varying": len(source.points),
            "vertex": len(source.points),
            "faceVarying": int(counts.sum()),
        }[interpolation]
        if len(values) < expected or not np.isfinite(values).all():
            fault = f"{len(values)} values where {interpolation} needs {expected}, or some that are not finite"
            self._notes.add(self._prim.GetPath(), f"{name} has {fault}; it is left out")
            return None
        if interpolation == "constant":
            return np.repeat(values[:1], len(source.indices), axis=0)
        if interpolation == "uniform":
            return np.repeat(values[source.face_numbers], source.counts, axis=0)
        if interpolation == "faceVarying":
            return values[source.corner_numbers]
        return values[source.indices]
