"""The command `lightkiln-batch`: a manifest → lightmaps for what changed.

Standard output: with --json one object per line. Standard error: text for people. Exit codes: 0 done, 1 some assets
failed, 2 arguments or manifest, 3 environment, 130 interrupted.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from .. import program
from ..errors import PipelineError, UsageError
from .bundle import write_bundle
from .executors import DaskExecutor, Executor, LocalExecutor
from .manifest import Manifest, load_manifest
from .plan import Asset, Plan, make_plan
from .report import Row, write_reports
from .run import Selection, run, select
from .task import Task, in_parts, run_task
from .tiles import gather_asset, merge_asset, solve_asset

app = typer.Typer(
    no_args_is_help=True, add_completion=False, help="Bakes lightmaps for many scenes, those that changed."
)
_err = Console(stderr=True)

Tiles = Annotated[
    int | None, typer.Option(min=1, max=1024, help="Parts in which every asset is gathered; overrules the manifest.")
]
ManifestPath = Annotated[Path, typer.Argument(help="The manifest, a TOML file.", metavar="MANIFEST")]


class _Voice:
    """Says what happens: JSON lines for programs, a bar and lines for people."""

    def __init__(self, as_json: bool) -> None:
        self._json = as_json
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[stage]}"),
            TimeElapsedColumn(),
        )
        self._progress = Progress(*columns, console=_err, transient=True, disable=as_json or not _err.is_terminal)
        self._bars: dict[str, Any] = {}

    def __enter__(self) -> _Voice:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def say(self, event: dict[str, Any]) -> None:
        """One event."""
        if self._json:
            print(json.dumps(event, ensure_ascii=False), flush=True)
        elif event["event"] == "progress":
            name = event["asset"]
            if name not in self._bars:
                self._bars[name] = self._progress.add_task(name, total=1.0, stage="")
            self._progress.update(self._bars[name], completed=event["done"], stage=event["stage"])
        elif event["event"] == "asset" and event["state"] != "stale":
            bar = self._bars.pop(event["name"], None)
            if bar is not None:
                self._progress.remove_task(bar)
            detail = event.get("message") or _details(event)
            _print(f"{event['state']:>8}  {event['name']}{'  ' if detail else ''}{detail}")


def _details(event: dict[str, Any]) -> str:
    if "seconds" not in event:
        return ""
    warnings = f", {event['warnings']} warnings" if event["warnings"] else ""
    return f"{event['seconds']:.1f} s{warnings}"


def _print(text: str) -> None:
    _err.print(text, markup=False, highlight=False, soft_wrap=True)


@app.command(name="run")
def run_command(
    manifest: ManifestPath,
    jobs: Annotated[int | None, typer.Option(min=1, max=256, help="Assets at a time; overrules the manifest.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be baked and bake nothing.")] = False,
    keep_going: Annotated[bool, typer.Option("--keep-going", help="Go on with the others after a failure.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Bake again whenever a file changes, until Ctrl-C.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object per line on the standard output.")] = False,
    executor: Annotated[Literal["local", "dask"], typer.Option(help="Where assets are baked.")] = "local",
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler, tcp://host:port; else one is started here.")
    ] = None,
    tiles: Tiles = None,
) -> None:
    """Bake what changed since the last run."""
    if tiles is not None and executor != "dask":
        raise typer.BadParameter("--tiles goes with --executor dask: one machine bakes an asset faster in one piece")
    if watch and (dry_run or executor == "dask"):
        raise typer.BadParameter("--watch goes with neither --dry-run nor --executor dask")
    with _Voice(as_json) as voice:
        while True:
            read = load_manifest(manifest)
            plan = make_plan(read, manifest)
            # Before anything is hashed, so that no change is missed while it bakes.
            before = _look(plan)
            selection = select(plan, voice.say)
            if tiles is not None:
                selection.tasks = [in_parts(task, tiles) for task in selection.tasks]
            failed = any(row.state == "failed" for row in selection.rows)
            if dry_run:
                for task in selection.tasks:
                    voice.say({"event": "asset", "name": task.name, "state": "would bake"})
            elif selection.tasks or not watch:
                # A cluster takes seconds to start: not for nothing.
                kind = executor if selection.tasks else "local"
                where = _executor(kind, scheduler, jobs or read.jobs)
                rows = run(plan, selection, where, voice.say, keep_going=keep_going or watch)
                failed = any(row.state == "failed" for row in rows)
            if not watch:
                break
            _print(f"watching {plan.root}, Ctrl-C ends")
            while _look(plan) == before and manifest.is_file():
                time.sleep(1.0)
    if failed:
        raise typer.Exit(1)


def _executor(kind: str, scheduler: str | None, jobs: int) -> Executor:
    return DaskExecutor(scheduler, jobs) if kind == "dask" else LocalExecutor(jobs)


def _look(plan: Plan) -> dict[str, tuple[int, int]]:
    """Times and sizes of the files below the manifest's folder. Whether a change matters, the hashes decide."""
    seen = {}
    for folder, _, names in os.walk(plan.root):
        inside = Path(folder)
        if inside == plan.out or plan.out in inside.parents:
            continue
        for name in names:
            try:
                stat = (inside / name).stat()
            except OSError:
                continue
            seen[str(inside / name)] = (stat.st_mtime_ns, stat.st_size)
    return seen


AssetName = Annotated[str, typer.Argument(help="Name of the asset, as `run --dry-run` lists it.")]
OpenJd = Annotated[bool, typer.Option("--openjd", help="Report progress as Open Job Description wants it.")]


@app.command()
def asset(manifest: ManifestPath, name: AssetName, openjd: OpenJd = False) -> None:
    """Bake one asset if it changed: a task of a farm."""
    if task := _stale(manifest, name):
        run_task(task, _progress(openjd))
        _print(f"{name}: baked")


@app.command()
def solve(manifest: ManifestPath, name: AssetName, openjd: OpenJd = False) -> None:
    """Solve one asset if it changed, so that its tiles can be gathered: a task of a farm."""
    if task := _stale(manifest, name):
        solve_asset(task, _progress(openjd))
        _print(f"{name}: solved")


@app.command()
def gather(
    manifest: ManifestPath,
    name: AssetName,
    part: Annotated[str, typer.Option(help="Which parts of the tiles: A-B, or A; the first is 0.")],
    of: Annotated[int, typer.Option(min=1, max=1024, help="How many parts there are.")],
    openjd: OpenJd = False,
) -> None:
    """Gather parts of a solved asset's tiles, those that are missing: a task of a farm."""
    parts = _parts(part, of)
    if task := _stale(manifest, name):
        gather_asset(task, parts, of, _progress(openjd))
        _print(f"{name}: parts {part} of {of} gathered")


@app.command()
def merge(manifest: ManifestPath, name: AssetName, openjd: OpenJd = False) -> None:
    """Merge the tiles of an asset to its results: a task of a farm."""
    if task := _stale(manifest, name):
        merge_asset(task, _progress(openjd))
        _print(f"{name}: baked")


def _stale(manifest: Path, name: str) -> Task | None:
    """The task of an asset, none if it is current. Raises PipelineError if it cannot be baked."""
    plan = make_plan(load_manifest(manifest), manifest)
    chosen = [a for a in plan.assets if a.name == name]
    if not chosen:
        raise UsageError(f"{manifest}: there is no asset `{name}`; those that there are: {_names(plan)}")
    selection = select(Plan(plan.root, plan.out, chosen), lambda _: None)
    for row in selection.rows:
        if row.state == "failed":
            raise PipelineError(row.message)
    if not selection.tasks:
        _print(f"{name}: current")
    return next(iter(selection.tasks), None)


def _parts(text: str, of: int) -> range:
    first, _, last = text.partition("-")
    if first.isdecimal() and (last or first).isdecimal():
        parts = range(int(first), int(last or first) + 1)
        if parts and parts.stop <= of:
            return parts
    raise typer.BadParameter(f"--part `{text}` is not like 3 or 0-3, within 0-{of - 1}")


def _progress(openjd: bool) -> Callable[[dict[str, Any]], None]:
    return _openjd_progress if openjd else lambda _: None


def _openjd_progress(event: dict[str, Any]) -> None:
    """Stages follow each other at about these shares of a bake."""
    if event.get("event") == "progress":
        begin, end = _SHARES.get(str(event["stage"]), (0.0, 0.0))
        print(f"openjd_progress: {100 * (begin + (end - begin) * float(event['done'])):.1f}", flush=True)
        print(f"openjd_status: {event['stage']}", flush=True)


_SHARES = {
    "convert": (0.0, 0.1),
    "direct": (0.2, 0.4),
    "solve": (0.4, 0.5),
    "gather": (0.5, 0.95),
    "layer": (0.95, 1.0),
}


@app.command()
def report(manifest: ManifestPath) -> None:
    """Write the report of what is there, without baking: the last task of a farm."""
    plan = make_plan(load_manifest(manifest), manifest)
    selection = select(plan, lambda _: None)
    missing = [
        Row(a.name, a.scene, a.folder, "failed", None, "not baked") for a in plan.assets if _is_stale(a, selection)
    ]
    write_reports(plan.out, [*selection.rows, *missing], 0.0, program.version(program.program()))
    if missing or any(row.state == "failed" for row in selection.rows):
        raise typer.Exit(1)


def _is_stale(asset: Asset, selection: Selection) -> bool:
    return any(task.name == asset.name for task in selection.tasks)


def _names(plan: Plan) -> str:
    names = [a.name for a in plan.assets]
    return ", ".join(names[:10]) + (" …" if len(names) > 10 else "")


@app.command()
def bundle(
    manifest: ManifestPath,
    folder: Annotated[Path, typer.Argument(help="Folder for the job template.")],
    tiles: Tiles = None,
) -> None:
    """Write the batch as an Open Job Description, for render farms."""
    target = write_bundle(make_plan(load_manifest(manifest), manifest), manifest, folder, tiles)
    _print(f"{target}: submit its folder to a farm, or run it here:")
    _print(f"openjd run {target} -p Manifest={manifest.resolve()}")


@app.command()
def schema() -> None:
    """Print the JSON Schema of the manifest."""
    print(manifest_schema())


def manifest_schema() -> str:
    """The JSON Schema of the manifest."""
    return json.dumps(
        {"$schema": "https://json-schema.org/draft/2020-12/schema", **Manifest.model_json_schema()}, indent=2
    )


def main() -> None:
    """Runs the command; ends with 0, 1, 2, 3 or 130."""
    try:
        app()
    except PipelineError as error:
        _print(f"error: {error}")
        sys.exit(error.exit_code)
    except OSError as error:
        _print(f"error: {error}; correct the path, or free space")
        sys.exit(3)
    except KeyboardInterrupt:
        _print("interrupted; what was finished is kept")
        sys.exit(130)
