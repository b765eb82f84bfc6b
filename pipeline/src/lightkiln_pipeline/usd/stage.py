"""Opens stages: a file of any USD kind → a composed stage, its frame, and the files that it is made of.

In: .usd, .usda, .usdc or .usdz. Out: the stage with metres, up axis and time resolved; notes on what did not compose.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Tf, Usd, UsdGeom, UsdUtils

from ..errors import Notes, PipelineError

Matrix = npt.NDArray[np.float64]

# Rotates +Z up to glTF's +Y up.
_Z_UP = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)


@dataclass
class Scene:
    """A composed stage with what its numbers mean."""

    stage: Any
    path: Path
    time: Any
    """The time code that is baked."""
    frame: Matrix
    """Stage space → metres with +Y up, for column vectors."""
    blender: bool
    """Written by Blender, whose lamps deviate from UsdLux."""
    cache: Any
    """Transforms at `time`."""

    def world(self, prim: Any) -> Matrix:
        """The prim's space → metres with +Y up, for column vectors."""
        return self.frame @ matrix(self.cache.GetLocalToWorldTransform(prim))


def matrix(value: Any) -> Matrix:
    """A Gf matrix, which is for row vectors, for column vectors."""
    return np.array(value, dtype=np.float64).T


def open_scene(path: Path, notes: Notes, *, time: float | None = None, variants: dict[str, str] | None = None) -> Scene:
    """Opens a stage. Raises PipelineError if nothing composes; what is missing becomes notes.

    `variants`: selections as `/Prim/Path{set}` → variant, made in the session layer only.
    """
    if not path.is_file():
        raise PipelineError(f"{path}: no such file; correct the path")
    # What USD would print on its own is noted with its place below.
    silence = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        stage = Usd.Stage.Open(str(path), Usd.Stage.LoadAll)
    except Tf.ErrorException as error:
        raise PipelineError(
            f"{path}: USD cannot open it: {_reason(error)}; mend the layer or export it again"
        ) from error
    finally:
        silence.TakeUncoalescedDiagnostics()
    for key, variant in (variants or {}).items():
        _select(stage, key, variant, notes)
    for fault in stage.GetCompositionErrors():
        notes.add(*_composition_fault(fault, path))
    _check_prims(stage, notes)

    up = str(UsdGeom.GetStageUpAxis(stage))
    metres = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not (np.isfinite(metres) and metres > 0):
        notes.add(path.name, f"metersPerUnit of {metres} is taken as 0.01, USD's default; correct it")
        metres = 0.01
    frame = np.diag([metres, metres, metres, 1.0]) @ (_Z_UP if up == UsdGeom.Tokens.z else np.eye(4))
    code = Usd.TimeCode(time) if time is not None else Usd.TimeCode.EarliestTime()
    return Scene(stage, path, code, frame, is_blenders(stage), UsdGeom.XformCache(code))


def is_blenders(stage: Any) -> bool:
    """True for a stage that Blender wrote, also below a layer over it: it says so in its documentation."""
    root = stage.GetRootLayer()
    below = [Sdf.Layer.FindRelativeToLayer(root, path) for path in root.subLayerPaths]
    return any(str(layer.documentation).startswith("Blender") for layer in (root, *below) if layer)


def _select(stage: Any, key: str, variant: str, notes: Notes) -> None:
    prim_path, _, name = key.rstrip("}").partition("{")
    prim = stage.GetPrimAtPath(prim_path) if Sdf.Path.IsValidPathString(prim_path) else None
    if not prim or variant not in prim.GetVariantSets().GetVariantSet(name).GetVariantNames():
        notes.add(key, f"there is no variant `{variant}` here; the file's own selection is baked")
        return
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        prim.GetVariantSets().GetVariantSet(name).SetVariantSelection(variant)


def _reason(error: Any) -> str:
    """USD's own words, without the places in its source."""
    words = re.findall(r"Error in .*? in file \S+ : '(.*?)\s*'?\s*$", str(error), re.MULTILINE)
    return str(words[0]) if words else str(error).strip()


def _composition_fault(error: Any, path: Path) -> tuple[str, str]:
    place = str(getattr(error, "rootSite", "") or path.name)
    if "<" in place:
        place = place.rsplit("<", 1)[-1].rstrip(">")
    kind = type(error).__name__.removeprefix("ErrorType").removeprefix("PcpError")
    return place, f"does not compose ({kind or 'error'}): {error}; what it would bring is missing"


def _check_prims(stage: Any, notes: Notes) -> None:
    """Notes prims that stand for something unknown to this installation."""
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        name = str(prim.GetTypeName())
        if name and not prim.IsInPrototype() and not Usd.SchemaRegistry.GetTypeFromSchemaTypeName(name):
            notes.add(prim.GetPath(), f"its type `{name}` is unknown; it is skipped, its children are read")


def source_files(path: Path) -> list[Path]:
    """Every file on disk that a scene is made of: layers, textures, profiles. Sorted, without doubles.

    What cannot be found is not listed; when it appears, the list changes, and with it a cache key made of it.
    """
    silence = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        layers, assets, _ = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(path)))
    except Tf.ErrorException:
        # A broken layer: opening the scene will say so.
        layers, assets = [], []
    finally:
        silence.TakeUncoalescedDiagnostics()
    found = {Path(layer.realPath) for layer in layers if layer.realPath}
    for asset in assets:
        # Files inside a package are named package[file].
        found.add(Path(str(asset).partition("[")[0]))
    found.add(path)
    return sorted({p.resolve() for p in found if p.is_file()})
