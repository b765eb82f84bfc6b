"""The command `lightkiln-usd`: one USD scene to GLB, and its lightmap back as a layer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from ..errors import Notes, PipelineError, UsageError
from .convert import UsdSettings
from .convert import convert as convert_scene
from .layer import added_errors, write_layer

app = typer.Typer(no_args_is_help=True, add_completion=False, help="USD scenes in, lightmaps out as a layer.")
_err = Console(stderr=True)

Time = Annotated[float | None, typer.Option(help="Time code; the earliest if none is given.")]


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(help="Scene: .usd, .usda, .usdc or .usdz.")],
    target: Annotated[Path, typer.Argument(help="The .glb to write.")],
    level: Annotated[int, typer.Option(min=0, max=6, help="Refinements of subdivision surfaces.")] = 1,
    purpose: Annotated[list[str] | None, typer.Option(help="Purposes that are baked; default and render.")] = None,
    time: Time = None,
    light_units: Annotated[str, typer.Option(help="photometric, radiometric or auto.")] = "auto",
    variant: Annotated[list[str] | None, typer.Option(help="/Prim{set}=name; repeatable.")] = None,
) -> None:
    """Convert a scene to what the baker reads; bake it with `--uv pack`."""
    chosen = dict(_pair(v) for v in variant or [])
    settings = UsdSettings(level, tuple(purpose or ("default", "render")), time, _units(light_units), chosen)
    done = convert_scene(source, target, settings)
    for note in done.notes:
        _err.print(f"warning: {note}", markup=False, highlight=False, soft_wrap=True)
    summary = f"{done.instances} meshes, {done.triangles} triangles, {done.lamps} lamps"
    _err.print(f"{target}: {summary}", markup=False, highlight=False, soft_wrap=True)


@app.command()
def layer(
    source: Annotated[Path, typer.Argument(help="The scene that was converted.")],
    lit: Annotated[Path, typer.Argument(help="The .lit.glb that the baker wrote, with its pages beside it.")],
    target: Annotated[Path, typer.Argument(help="The layer to write: .usda, .usdc or .usd.")],
    time: Time = None,
    light_units: Annotated[str, typer.Option(help="As for convert: what the preview shows.")] = "auto",
) -> None:
    """Write the lightmap as a layer over the scene, which stays as it is."""
    notes = Notes()
    units = _units(light_units)
    photometric = None if units == "auto" else units == "photometric"
    write_layer(source, lit, target, notes, time=time, photometric=photometric)
    for note in notes.list():
        _err.print(f"warning: {note}", markup=False, highlight=False, soft_wrap=True)
    for error in added_errors(source, target):
        _err.print(f"warning: UsdValidation: {error}", markup=False, highlight=False, soft_wrap=True)


def _units(text: str) -> str:
    if text not in ("photometric", "radiometric", "auto"):
        raise UsageError(f"--light-units {text} is unknown; give photometric, radiometric or auto")
    return text


def _pair(text: str) -> tuple[str, str]:
    key, mark, value = text.rpartition("=")
    if not mark or not key:
        raise UsageError(f"--variant {text} is no variant; write /Prim{{set}}=name")
    return key, value


def main() -> None:
    """Runs the command; ends with 0, 1, 2, 3 or 130."""
    try:
        app()
    except PipelineError as error:
        _err.print(f"error: {error}", markup=False, highlight=False, soft_wrap=True)
        raise SystemExit(error.exit_code) from error
    except OSError as error:
        _err.print(f"error: {error}", markup=False, highlight=False, soft_wrap=True)
        raise SystemExit(3) from error
