"""Finds what a stage shows: prims → placed shapes and lights, with instancing, visibility and purpose resolved.

Every placement knows the prim that holds its data (shared by instances) and the way to name it when the lightmap
returns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdLux

from ..errors import Notes
from .stage import Matrix, Scene, matrix

_SHOWN = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
_SOLIDS = (UsdGeom.Cube, UsdGeom.Sphere, UsdGeom.Cylinder, UsdGeom.Cone, UsdGeom.Capsule, UsdGeom.Plane)


@dataclass(frozen=True)
class Placement:
    """A shape or light in the world."""

    prim: Any
    world: Matrix
    """The prim's space → metres with +Y up."""
    instancer: str = ""
    """Path of the point instancer that places it, empty if none does."""
    instance: int = -1
    """Index of the instancer's point."""

    @property
    def path(self) -> str:
        """The prim's path; with an instancer also its point."""
        return str(self.prim.GetPath()) + (f"[{self.instancer}#{self.instance}]" if self.instancer else "")


@dataclass
class Walk:
    """Traverses one scene."""

    scene: Scene
    purposes: tuple[str, ...]
    notes: Notes

    def placements(self) -> Iterator[Placement]:
        """Everything that the stage shows."""
        yield from self._below(self.scene.stage.GetPseudoRoot(), None, "", -1)

    def _below(self, root: Any, base: Matrix | None, instancer: str, instance: int) -> Iterator[Placement]:
        """Shapes and lights at and below `root`. `base`: the space of root's parent, where an instancer places it."""
        walk = iter(Usd.PrimRange(root, _SHOWN))
        for prim in walk:
            if not prim.IsA(UsdGeom.Imageable):
                continue
            imageable = UsdGeom.Imageable(prim)
            if imageable.GetVisibilityAttr().Get(self.scene.time) == UsdGeom.Tokens.invisible:
                walk.PruneChildren()
                continue
            if str(imageable.ComputePurpose()) not in self.purposes:
                continue
            world = self.scene.world(prim) if base is None else base @ self._relative(prim, root)
            if prim.IsA(UsdGeom.PointInstancer):
                walk.PruneChildren()
                if instancer:
                    message = "a point instancer inside another's prototype is left out; flatten it"
                    self.notes.add(prim.GetPath(), message)
                else:
                    yield from self._instances(UsdGeom.PointInstancer(prim), world)
            elif prim.IsA(UsdGeom.Mesh) or any(prim.IsA(s) for s in _SOLIDS) or prim.HasAPI(UsdLux.LightAPI):
                yield Placement(prim, world, instancer, instance)
            elif prim.IsA(UsdGeom.Gprim):
                message = f"a `{prim.GetTypeName()}` is no surface that can be baked; it is skipped"
                self.notes.add(prim.GetPath(), message)

    def _relative(self, prim: Any, root: Any) -> Matrix:
        """From the prim to the space that holds `root`."""
        to_world = self.scene.cache.GetLocalToWorldTransform(prim)
        return matrix(to_world * self.scene.cache.GetParentToWorldTransform(root).GetInverse())

    def _instances(self, instancer: Any, world: Matrix) -> Iterator[Placement]:
        path, time = instancer.GetPath(), self.scene.time
        prototypes = instancer.GetPrototypesRel().GetForwardedTargets()
        indices = np.array(instancer.GetProtoIndicesAttr().Get(time) or [], dtype=np.int64)
        places = instancer.ComputeInstanceTransformsAtTime(
            time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        )
        if len(places) != len(indices):
            self.notes.add(path, "positions and protoIndices do not match; its instances are left out")
            return
        mask = instancer.ComputeMaskAtTime(time) or [True] * len(indices)
        beyond = int(((indices < 0) | (indices >= len(prototypes))).sum())
        if beyond:
            self.notes.add(path, f"{beyond} instances refer to prototypes that do not exist; they are left out")
        for i, (place, number) in enumerate(zip(places, indices, strict=True)):
            if not mask[i] or not 0 <= number < len(prototypes):
                continue
            root = self.scene.stage.GetPrimAtPath(prototypes[number])
            if not root:
                self.notes.add(path, f"its prototype {prototypes[number]} does not exist; its instances are left out")
                continue
            yield from self._below(root, world @ matrix(place), str(path), i)


def inherited(prim: Any, name: str, time: Any) -> Any:
    """The value of the primvar `lightkiln:name` on the prim or the nearest ancestor that has it, or none."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(f"lightkiln:{name}")
    return primvar.Get(time) if primvar and primvar.HasValue() else None


def data_key(prim: Any, time: Any) -> object:
    """What a mesh's data depends on: prims with equal keys share one mesh.

    For instances that is the prototype's prim and the primvars that the instance hands down to it.
    """
    if not prim.IsInstanceProxy():
        return prim.GetPath()
    instance = prim.GetParent()
    while instance.IsInstanceProxy():
        instance = instance.GetParent()
    handed_down = UsdGeom.PrimvarsAPI(instance).FindPrimvarsWithInheritance()
    own = {str(p.GetName()): str(p.Get(time)) for p in handed_down}
    kept = sorted(item for item in own.items() if not item[0].startswith("primvars:lightkiln:"))
    return prim.GetPrimInPrototype().GetPath(), tuple(kept)
