"""The lightmap as a layer over the source: a lit GLB and its pages → one .usda that refers to the source and changes
nothing.

Per lightmapped mesh `primvars:lightmapUV` and `lightkiln:lightmap:*` (file, quantity, unit); on every root a variant
set `lightmap` whose variant `preview` shows it in usdview. Instances become single (`instanceable = false`), and
point instancers a group of references, because every copy has its own part of the lightmap. No geometry is copied.
"""

from __future__ import annotations

import math
import os
import shutil
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils, UsdValidation, Vt

from ..errors import Notes, PipelineError
from .lightmap_uv import LitMesh, LitScene, read_lit
from .lights import LUMENS_PER_WATT
from .stage import is_blenders

UV_PRIMVAR = "lightmapUV"
VARIANT_SET = "lightmap"
_UDIM = "lightmap.<UDIM>.exr"


def write_layer(
    source: Path,
    lit_glb: Path,
    target: Path,
    notes: Notes,
    *,
    time: float | None = None,
    photometric: bool | None = None,
    home: Path | None = None,
) -> None:
    """Writes `target`, which refers to the source and to the pages beside `lit_glb`.

    `time`: the time code that was baked. `photometric`: whether the preview shows nits; none: as the
    stage is read by itself. `home`: the folder that target and
    pages will be moved to.

    Raises PipelineError if the target is a file of the scene, or if the GLB does not come from a USD scene.
    """
    if target.resolve() == source.resolve():
        raise PipelineError(f"{target}: the layer would overwrite its source; give it another name")
    scene = read_lit(lit_glb)
    silence = UsdUtils.CoalescingDiagnosticDelegate()
    partial = target.with_name(f".{os.getpid()}.{target.name}")
    layer = Sdf.Layer.CreateNew(str(partial))
    try:
        layer.subLayerPaths.append(_relative(source, target.parent))
        stage = Usd.Stage.Open(layer, Usd.Stage.LoadAll)
        _copy_metadata(source, stage, scene)
        writer = _LayerWriter(stage, scene, lit_glb.parent, target.parent, notes)
        writer.time = Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)
        writer.photometric = not is_blenders(stage) if photometric is None else photometric
        writer.write()
        if home is not None:
            layer.subLayerPaths[0] = _relative(source, home)
        layer.Save()
        partial.replace(target)
    finally:
        silence.TakeUncoalescedDiagnostics()
        partial.unlink(missing_ok=True)


def validation_errors(path: Path) -> set[str]:
    """What UsdValidation calls errors in a file, without its warnings."""
    silence = UsdUtils.CoalescingDiagnosticDelegate()
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    found = context.Validate(Usd.Stage.Open(str(path.resolve())))
    silence.TakeUncoalescedDiagnostics()
    severe = [e for e in found if e.GetType() == UsdValidation.ValidationErrorType.Error]
    return {f"{e.GetIdentifier()}: {e.GetMessage()}" for e in severe}


def added_errors(source: Path, layer: Path) -> list[str]:
    """Errors of UsdValidation that the layer has and its source has not."""
    return sorted(validation_errors(layer) - validation_errors(source.resolve()))


def _relative(path: Path, folder: Path) -> str:
    """A path as layers have it: relative where that is possible, with forward slashes."""
    try:
        relative = Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return path.resolve().as_posix()
    return relative if relative.startswith(".") else f"./{relative}"


def _copy_metadata(source: Path, stage: Any, scene: LitScene) -> None:
    """Sublayers do not pass on what a root layer says of the whole stage."""
    original = Sdf.Layer.FindOrOpen(str(source))
    root = stage.GetRootLayer()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(Usd.Stage.Open(original, Usd.Stage.LoadNone)))
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(Usd.Stage.Open(original, Usd.Stage.LoadNone)))
    if original.defaultPrim:
        root.defaultPrim = original.defaultPrim
    for key in ("startTimeCode", "endTimeCode", "timeCodesPerSecond", "framesPerSecond"):
        if original.pseudoRoot.HasInfo(key):
            root.pseudoRoot.SetInfo(key, original.pseudoRoot.GetInfo(key))
    root.customLayerData = {"lightkiln": {"quantity": scene.quantity, "unit": scene.unit, "uvPrimvar": UV_PRIMVAR}}


class _LayerWriter:
    """Writes one layer; the stage's edit target is the layer itself."""

    def __init__(self, stage: Any, scene: LitScene, pages: Path, folder: Path, notes: Notes) -> None:
        self._stage, self._scene, self._pages, self._folder, self._notes = stage, scene, pages, folder, notes
        self.time = Usd.TimeCode.EarliestTime()
        self.photometric = True
        self._copies: dict[str, Any] = {}
        # Meshes that one preview material shows, by root, page and colour.
        self._shown: dict[tuple[str, str, tuple[float, float, float]], list[Any]] = defaultdict(list)

    def write(self) -> None:
        """Writes everything."""
        for mesh in self._scene.meshes:
            prim = self._prim_of(mesh)
            if prim is None:
                continue
            asset = self._write_mesh(prim, mesh)
            if asset:
                root = str(prim.GetPath().GetPrefixes()[0])
                color = (1.0, 1.0, 1.0) if self._scene.quantity == "radiosity" else mesh.reflectance
                self._shown[root, asset, color].append(prim.GetPath())
        self._write_previews()

    def _prim_of(self, mesh: LitMesh) -> Any | None:
        """The prim that takes the coordinates: of its own, where it was shared."""
        if not mesh.instancer:
            return self._single(mesh.prim)
        copies = self._copies_of(mesh.instancer)
        instancer = UsdGeom.PointInstancer(self._stage.GetPrimAtPath(mesh.instancer))
        number = instancer.GetProtoIndicesAttr().Get(self.time)[mesh.instance]
        prototype = instancer.GetPrototypesRel().GetForwardedTargets()[number]
        place = copies.AppendChild(f"instance_{mesh.instance}")
        root = place.AppendChild("prototype")
        if not self._stage.GetPrimAtPath(place):
            transforms = instancer.ComputeInstanceTransformsAtTime(
                self.time, self.time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
            )
            group = UsdGeom.Xform.Define(self._stage, place)
            group.AddTransformOp().Set(Gf.Matrix4d(transforms[mesh.instance]))
            copy = self._stage.DefinePrim(root)
            copy.GetReferences().AddInternalReference(prototype)
            copy.SetInstanceable(False)
        return self._single(str(Sdf.Path(mesh.prim).ReplacePrefix(prototype, root)))

    def _copies_of(self, path: str) -> Any:
        """The group that stands for a point instancer, which is hidden."""
        if path not in self._copies:
            instancer = self._single(path)
            own = UsdGeom.Xformable(instancer)
            group = UsdGeom.Xform.Define(self._stage, Sdf.Path(f"{path}_lightmapped"))
            group.AddTransformOp().Set(own.GetLocalTransformation(self.time))
            group.SetResetXformStack(own.GetResetXformStack())
            UsdGeom.Imageable(instancer).CreateVisibilityAttr().Set(UsdGeom.Tokens.invisible)
            self._copies[path] = group.GetPath()
        return self._copies[path]

    def _single(self, path: str) -> Any | None:
        """The prim at a path, with all instances on the way made single so that it can be changed."""
        for prefix in Sdf.Path(path).GetPrefixes():
            prim = self._stage.GetPrimAtPath(prefix)
            if prim and prim.IsInstance():
                prim.SetInstanceable(False)
        prim = self._stage.GetPrimAtPath(path)
        if not prim:
            self._notes.add(path, "the source no longer has this prim; it gets no lightmap, bake again")
            return None
        return self._stage.OverridePrim(path)

    def _write_mesh(self, prim: Any, mesh: LitMesh) -> str:
        """Coordinates and metadata; returns the lightmap's file as the layer names it, empty if there is none."""
        if not prim.IsA(UsdGeom.Mesh):
            message = "a solid has no corners of its own: it is baked but gets no coordinates; make it a Mesh"
            self._notes.add(prim.GetPath(), message)
            return ""
        count = len(UsdGeom.Mesh(prim).GetFaceVertexIndicesAttr().Get(self.time) or [])
        uv = np.zeros((count, 2), np.float32)
        several = len(mesh.pages) > 1
        for page, (corners, values) in mesh.pages.items():
            if len(corners) and corners.max() >= count:
                self._notes.add(
                    prim.GetPath(), "its faces have changed since the bake; it gets no lightmap, bake again"
                )
                return ""
            number = _page_number(page)
            uv[corners] = values + ((number % 10, number // 10) if several else (0, 0))
        asset = self._udim() if several else _relative(self._pages / next(iter(mesh.pages)), self._folder)
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
            UV_PRIMVAR, Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        )
        primvar.Set(Vt.Vec2fArray.FromNumpy(uv))
        attributes = {
            "file": (Sdf.ValueTypeNames.Asset, Sdf.AssetPath(asset)),
            "quantity": (Sdf.ValueTypeNames.String, self._scene.quantity),
            "unit": (Sdf.ValueTypeNames.String, self._scene.unit),
            "uvPrimvar": (Sdf.ValueTypeNames.String, UV_PRIMVAR),
        }
        for name, (kind, value) in attributes.items():
            prim.CreateAttribute(f"lightkiln:lightmap:{name}", kind, custom=True).Set(value)
        return asset

    def _udim(self) -> str:
        """Pages under UDIM names, for meshes that lie on several of them."""
        for page in sorted(self._pages.glob("lightmap_*.exr")):
            tile = self._folder / _UDIM.replace("<UDIM>", str(1001 + _page_number(page.name)))
            tile.unlink(missing_ok=True)
            try:
                os.link(page, tile)
            except OSError:
                shutil.copyfile(page, tile)
        return f"./{_UDIM}"

    def _write_previews(self) -> None:
        """Variant sets and the materials that they bind, through collections, which need no change to the meshes."""
        bindings: dict[str, list[tuple[Any, list[Any]]]] = defaultdict(list)
        for number, ((root, asset, color), paths) in enumerate(sorted(self._shown.items())):
            material = self._material(f"{root}/LightkilnPreview/lightmap_{number}", asset, color)
            bindings[root].append((material, paths))
        for root, materials in bindings.items():
            prim = self._stage.GetPrimAtPath(root)
            variants = prim.GetVariantSets().AddVariantSet(VARIANT_SET)
            for name in ("off", "preview"):
                variants.AddVariant(name)
            variants.SetVariantSelection("preview")
            with variants.GetVariantEditContext():
                binding = UsdShade.MaterialBindingAPI.Apply(prim)
                for number, (material, paths) in enumerate(materials):
                    collection = Usd.CollectionAPI.Apply(prim, f"lightkiln{number}")
                    collection.CreateIncludesRel().SetTargets(paths)
                    name = f"lightkiln{number}"
                    binding.Bind(collection, material, name, UsdShade.Tokens.strongerThanDescendants)
            variants.SetVariantSelection("off")

    def _material(self, path: str, asset: str, color: tuple[float, float, float]) -> Any:
        """A surface that emits reflectance × lightmap as radiance and reflects nothing itself."""
        UsdGeom.Scope.Define(self._stage, Sdf.Path(path).GetParentPath())
        material = UsdShade.Material.Define(self._stage, path)
        reader = UsdShade.Shader.Define(self._stage, f"{path}/coordinates")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(UV_PRIMVAR)
        st = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        texture = UsdShade.Shader.Define(self._stage, f"{path}/lightmap")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(asset))
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(st)
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")
        for wrap in ("wrapS", "wrapT"):
            texture.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("clamp")
        per_texel = 1.0 if self._scene.quantity == "radiance" else 1.0 / math.pi
        shown = per_texel * (LUMENS_PER_WATT if self.photometric else 1.0)
        scale = Gf.Vec4f(*(c * shown for c in color), 1.0)
        texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(scale)
        rgb = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        surface = UsdShade.Shader.Define(self._stage, f"{path}/surface")
        surface.CreateIdAttr("UsdPreviewSurface")
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0.0))
        surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(rgb)
        surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
        surface.CreateInput("specularColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0.0))
        surface.CreateInput("useSpecularWorkflow", Sdf.ValueTypeNames.Int).Set(1)
        output = surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        material.CreateSurfaceOutput().ConnectToSource(output)
        return material


def _page_number(page: str) -> int:
    return int(Path(page).stem.rsplit("_", 1)[-1])
