# SPDX-License-Identifier: GPL-3.0-or-later
"""A lightmap as a USD layer over a scene that Blender wrote: coordinates, where the page lies, and a variant to see it.

It follows the convention of the Lightkiln pipeline: per mesh `primvars:lightmapUV` and `lightkiln:lightmap:*`, and on
the root a variant set `lightmap` with `off` and `preview`. Nothing of the scene's own file is changed or copied.
Blender's build of USD brings the module `pxr`; this file must only be imported where it is there.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

UV_PRIMVAR, VARIANT_SET = "lightmapUV", "lightmap"
QUANTITY, UNIT = "radiance", "W/(m^2*sr)"
_PROPERTIES = "userProperties:"


@dataclass(frozen=True)
class LitObject:
    """What is known of a lightmapped object in Blender."""

    uv_map: str
    # Custom property with its place, on the object or on the empty that instances it.
    attribute: str
    # What it reflects, for the preview.
    reflectance: tuple[float, float, float]


def write_layer(source: Path, target: Path, page: str, known: Callable[[str], LitObject | None]) -> int:
    """Writes `target` over `source`, a file that Blender exported with custom properties and object names.

    `page`: the EXR, relative to `target`. `known`: tells about an object by its name in Blender. Returns the number of
    meshes that show the lightmap.
    """
    partial = target.with_name(f".{os.getpid()}.{target.name}")
    layer = Sdf.Layer.CreateNew(str(partial))
    try:
        layer.subLayerPaths.append(f"./{source.name}")
        stage = Usd.Stage.Open(layer, Usd.Stage.LoadAll)
        below = Usd.Stage.Open(str(source))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(below))
        UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(below))
        layer.defaultPrim = below.GetRootLayer().defaultPrim
        layer.customLayerData = {"lightkiln": {"quantity": QUANTITY, "unit": UNIT, "uvPrimvar": UV_PRIMVAR}}
        shown: dict[tuple[str, tuple[float, float, float]], list[Any]] = defaultdict(list)
        for prim in stage.Traverse():
            lit = known(_object_name(prim)) if prim.IsA(UsdGeom.Mesh) else None
            place = _property(prim, lit.attribute) if lit else None
            if lit and place is not None and _write_mesh(stage, prim, lit, place, page):
                shown[str(prim.GetPath().GetPrefixes()[0]), lit.reflectance].append(prim.GetPath())
        _write_previews(stage, shown, page)
        layer.Save()
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)
    return sum(len(paths) for paths in shown.values())


def _object_name(prim: Any) -> str:
    """The name in Blender of the object that a mesh belongs to."""
    name = _property(prim, "blender:object_name")
    return name if isinstance(name, str) else ""


def _property(prim: Any, name: str) -> Any:
    """A custom property of the nearest object that has it."""
    while prim and not prim.IsPseudoRoot():
        attribute = prim.GetAttribute(f"{_PROPERTIES}{name}")
        if attribute:
            return attribute.Get()
        prim = prim.GetParent()
    return None


def _write_mesh(stage: Any, prim: Any, lit: LitObject, place: Any, page: str) -> bool:
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(Tf.MakeValidIdentifier(lit.uv_map))
    own = np.array(primvar.ComputeFlattened() or []) if primvar else np.empty(0)
    if own.ndim != 2 or primvar.GetInterpolation() != UsdGeom.Tokens.faceVarying:
        return False
    scale_x, scale_y, offset_x, offset_y = place
    uv = np.ascontiguousarray(own * (scale_x, scale_y) + (offset_x, offset_y), np.float32)
    over = stage.OverridePrim(prim.GetPath())
    kind = Sdf.ValueTypeNames.TexCoord2fArray
    UsdGeom.PrimvarsAPI(over).CreatePrimvar(UV_PRIMVAR, kind, UsdGeom.Tokens.faceVarying).Set(
        Vt.Vec2fArray.FromNumpy(uv)
    )
    attributes = {
        "file": (Sdf.ValueTypeNames.Asset, Sdf.AssetPath(page)),
        "quantity": (Sdf.ValueTypeNames.String, QUANTITY),
        "unit": (Sdf.ValueTypeNames.String, UNIT),
        "uvPrimvar": (Sdf.ValueTypeNames.String, UV_PRIMVAR),
    }
    for name, (value_type, value) in attributes.items():
        over.CreateAttribute(f"lightkiln:lightmap:{name}", value_type, custom=True).Set(value)
    return True


def _write_previews(stage: Any, shown: dict[tuple[str, tuple[float, float, float]], list[Any]], page: str) -> None:
    """The variant set, whose materials are bound through collections: that needs no change to the meshes."""
    bindings: dict[str, list[tuple[Any, list[Any]]]] = defaultdict(list)
    for number, ((root, color), paths) in enumerate(sorted(shown.items())):
        bindings[root].append((_material(stage, f"{root}/LightkilnPreview/lightmap_{number}", page, color), paths))
    for root, materials in bindings.items():
        prim = stage.GetPrimAtPath(root)
        variants = prim.GetVariantSets().AddVariantSet(VARIANT_SET)
        for name in ("off", "preview"):
            variants.AddVariant(name)
        variants.SetVariantSelection("preview")
        with variants.GetVariantEditContext():
            binding = UsdShade.MaterialBindingAPI.Apply(prim)
            for number, (material, paths) in enumerate(materials):
                name = f"lightkiln{number}"
                collection = Usd.CollectionAPI.Apply(prim, name)
                collection.CreateIncludesRel().SetTargets(paths)
                binding.Bind(collection, material, name, UsdShade.Tokens.strongerThanDescendants)
        variants.SetVariantSelection("off")


def _material(stage: Any, path: str, page: str, color: tuple[float, float, float]) -> Any:
    """A surface that emits reflectance × lightmap and reflects nothing itself."""
    UsdGeom.Scope.Define(stage, Sdf.Path(path).GetParentPath())
    material = UsdShade.Material.Define(stage, path)

    def shader(name: str, kind: str, **inputs: tuple[Any, Any]) -> Any:
        made = UsdShade.Shader.Define(stage, f"{path}/{name}")
        made.CreateIdAttr(kind)
        for key, (value_type, value) in inputs.items():
            made.CreateInput(key, value_type).Set(value)
        return made

    types = Sdf.ValueTypeNames
    reader = shader("coordinates", "UsdPrimvarReader_float2", varname=(types.String, UV_PRIMVAR))
    texture = shader(
        "lightmap",
        "UsdUVTexture",
        file=(types.Asset, Sdf.AssetPath(page)),
        sourceColorSpace=(types.Token, "raw"),
        wrapS=(types.Token, "clamp"),
        wrapT=(types.Token, "clamp"),
        scale=(types.Float4, Gf.Vec4f(*color, 1.0)),
    )
    texture.CreateInput("st", types.Float2).ConnectToSource(reader.CreateOutput("result", types.Float2))
    surface = shader(
        "surface",
        "UsdPreviewSurface",
        diffuseColor=(types.Color3f, Gf.Vec3f(0.0)),
        roughness=(types.Float, 1.0),
        specularColor=(types.Color3f, Gf.Vec3f(0.0)),
        useSpecularWorkflow=(types.Int, 1),
    )
    surface.CreateInput("emissiveColor", types.Color3f).ConnectToSource(texture.CreateOutput("rgb", types.Float3))
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", types.Token))
    return material
