"""A batch as an Open Job Description: plan → a job template that render farms and `openjd run` execute.

An asset is a task; one whose tiles are gathered apart is a task of a step Solve, several of a step Gather, and one of a
step Merge. Every task is a command of `lightkiln-batch` that skips what is there: a job that broke off can be sent
again.
Specification: https://github.com/OpenJobDescription/openjd-specifications, jobtemplate-2023-09 with TASK_CHUNKING.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import UsageError
from .plan import Plan
from .stamp import write_atomically

TEMPLATE = "template.json"
# The specification's largest number of values of a task parameter.
_MOST = 1024
_STRINGS = "taskParameterDefinitions"

Step = dict[str, Any]


def write_bundle(plan: Plan, manifest: Path, folder: Path, tiles: int | None = None) -> Path:
    """Writes the template; returns it. `tiles` overrules in how many parts assets are gathered.

    Raises UsageError if an asset cannot be a task.
    """
    assets = {asset.name: tiles or asset.settings.tiles for asset in plan.assets if not asset.fault}
    awkward = next((name for name in assets if len(name) > 1024 or "{{" in name), None)
    if awkward is not None:
        raise UsageError(f"`{awkward}` cannot be a task of Open Job Description: shorten the name or remove `{{{{`")
    whole = [name for name, of in assets.items() if of == 1]
    steps = _steps("Bake", "asset", whole, [])
    for of in sorted(set(assets.values()) - {1}):
        steps += _tiled_steps([name for name, parts in assets.items() if parts == of], of)
    report = _step("Report", ["report", "{{Param.Manifest}}"], steps)
    template = {
        "specificationVersion": "jobtemplate-2023-09",
        "extensions": ["TASK_CHUNKING"],
        "name": f"Lightkiln {manifest.stem}"[:128],
        "parameterDefinitions": [
            {
                "name": "Manifest",
                "type": "PATH",
                "objectType": "FILE",
                "dataFlow": "NONE",
                "description": "The manifest of the batch, as workers see it.",
            },
            {
                "name": "PartsPerTask",
                "type": "INT",
                "default": 1,
                "minValue": 1,
                "description": "Parts of an asset's tiles that one task gathers.",
            },
        ],
        "steps": [*steps, report],
    }
    if set(assets.values()) <= {1}:
        # Farms that know no chunks take the batch as well.
        del template["extensions"]
        template["parameterDefinitions"] = template["parameterDefinitions"][:1]
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / TEMPLATE
    write_atomically(target, json.dumps(template, indent=2, ensure_ascii=False))
    return target


def _tiled_steps(assets: list[str], of: int) -> list[Step]:
    """Solve, gather in so many parts, merge."""
    solve = _steps(f"Solve{of}x", "solve", assets, [])
    gather = _steps(f"Gather{of}x", "gather", assets, solve, ["--part", "{{Task.Param.Part}}", "--of", str(of)])
    chunks = {"defaultTaskCount": "{{Param.PartsPerTask}}", "rangeConstraint": "CONTIGUOUS"}
    for step in gather:
        part = {"name": "Part", "type": "CHUNK[INT]", "range": f"0-{of - 1}", "chunks": chunks}
        step["parameterSpace"][_STRINGS].append(part)
    return [*solve, *gather, *_steps(f"Merge{of}x", "merge", assets, gather)]


def _steps(
    name: str, command: str, assets: list[str], after: Sequence[Step], options: Sequence[str] = ()
) -> list[Step]:
    """A command for every asset, in as many steps as it takes."""
    arguments = [command, "{{Param.Manifest}}", "{{Task.Param.Asset}}", "--openjd", *options]
    steps = []
    for i in range(0, len(assets), _MOST):
        step = _step(name if i == 0 else f"{name}_{i // _MOST + 1}", arguments, after)
        space = [{"name": "Asset", "type": "STRING", "range": assets[i : i + _MOST]}]
        steps.append({**step, "parameterSpace": {_STRINGS: space}})
    return steps


def _step(name: str, arguments: list[str], after: Sequence[Step]) -> Step:
    step: Step = {"name": name, "script": {"actions": {"onRun": {"command": "lightkiln-batch", "args": arguments}}}}
    if after:
        step["dependencies"] = [{"dependsOn": other["name"]} for other in after]
    return step
