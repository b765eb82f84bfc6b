"""Runs a plan: what changed is baked, what did not costs its hash; the report says how it went."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from .. import program
from ..errors import PipelineError
from .executors import Executor, Outcome
from .plan import Asset, Plan, cache_key, forget_files
from .report import Row, write_reports
from .stamp import is_current, read_stamp
from .task import Task

Say = Callable[[dict[str, Any]], None]


@dataclass
class Selection:
    """What a batch has to do."""

    tasks: list[Task] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    """Assets that need no bake, or cannot have one."""


def select(plan: Plan, say: Say) -> Selection:
    """Compares every asset with its stamp."""
    forget_files()
    baker = program.version(program.program())
    selection = Selection()
    for asset in plan.assets:
        try:
            if asset.fault:
                raise PipelineError(asset.fault)
            key = cache_key(asset, baker)
        except (PipelineError, OSError) as error:
            selection.rows.append(_row(asset, "failed", str(error)))
            say({"event": "asset", "name": asset.name, "state": "failed", "message": str(error)})
            continue
        if is_current(asset.folder, key):
            selection.rows.append(_row(asset, "current"))
            say({"event": "asset", "name": asset.name, "state": "current"})
        else:
            settings = asset.settings.model_dump(mode="json")
            task = Task(asset.name, str(asset.scene), str(asset.folder), key, baker, settings)
            selection.tasks.append(task)
            say({"event": "asset", "name": asset.name, "state": "stale"})
    return selection


def run(plan: Plan, selection: Selection, executor: Executor, say: Say, *, keep_going: bool) -> list[Row]:
    """Bakes what is selected, writes the report and returns a row per asset that was looked at."""
    start = time.monotonic()
    assets = {asset.name: asset for asset in plan.assets}
    rows = list(selection.rows)
    tasks = selection.tasks
    if not keep_going and any(row.state == "failed" for row in rows):
        tasks = []
    try:
        with contextlib.closing(executor.run(tasks, not keep_going)) as items:
            for item in items:
                if isinstance(item, Outcome):
                    row = _finished(assets[item.task.name], item)
                    rows.append(row)
                    say(_summary(row))
                else:
                    task, event = item
                    if event.get("event") in ("progress", "warning"):
                        say({**event, "asset": task.name})
    finally:
        # Also after Ctrl-C: the report tells what was finished.
        done = {row.name for row in rows}
        rows += [_row(assets[t.name], "failed", "not started") for t in selection.tasks if t.name not in done]
        write_reports(plan.out, rows, time.monotonic() - start, program.version(program.program()))
    return rows


def _row(asset: Asset, state: str, message: str = "") -> Row:
    stamp = read_stamp(asset.folder) if state == "current" else None
    return Row(asset.name, asset.scene, asset.folder, state, stamp, message)


def _finished(asset: Asset, outcome: Outcome) -> Row:
    state = "failed" if outcome.stamp is None else "baked"
    return Row(asset.name, asset.scene, asset.folder, state, outcome.stamp, outcome.message, outcome.attempts)


def _summary(row: Row) -> dict[str, Any]:
    event: dict[str, Any] = {"event": "asset", "name": row.name, "state": row.state}
    if row.stamp is not None:
        event |= {"seconds": row.stamp.seconds, "warnings": len(row.stamp.notes), "folder": str(row.folder)}
    if row.message:
        event["message"] = row.message
    return event
