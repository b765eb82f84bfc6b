"""A batch as an Open Job Description: plan → a job template that render farms and `openjd run` execute, a task per
asset.

Every task is `lightkiln-batch asset MANIFEST NAME`, which skips what is current: a job that broke off can be sent
again. Specification: https://github.com/OpenJobDescription/openjd-specifications, jobtemplate-2023-09.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..errors import UsageError
from .plan import Plan
from .stamp import write_atomically

TEMPLATE = "template.json"
# The specification's largest number of values of a task parameter.
_MOST = 1024


def write_bundle(plan: Plan, manifest: Path, folder: Path) -> Path:
    """Writes the template; returns it. Raises UsageError if an asset cannot be a task."""
    names = [asset.name for asset in plan.assets if not asset.fault]
    awkward = next((name for name in names if len(name) > 1024 or "{{" in name), None)
    if awkward is not None:
        raise UsageError(f"`{awkward}` cannot be a task of Open Job Description: shorten the name or remove `{{{{`")
    parts = [names[i : i + _MOST] for i in range(0, len(names), _MOST)]
    steps = [_bake_step("Bake" if i == 0 else f"Bake{i + 1}", part) for i, part in enumerate(parts)]
    report = _step("Report", ["report", "{{Param.Manifest}}"])
    report["dependencies"] = [{"dependsOn": step["name"]} for step in steps]
    template = {
        "specificationVersion": "jobtemplate-2023-09",
        "name": f"Lightkiln {manifest.stem}"[:128],
        "parameterDefinitions": [
            {
                "name": "Manifest",
                "type": "PATH",
                "objectType": "FILE",
                "dataFlow": "NONE",
                "description": "The manifest of the batch, as workers see it.",
            }
        ],
        "steps": [*steps, report],
    }
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / TEMPLATE
    write_atomically(target, json.dumps(template, indent=2, ensure_ascii=False))
    return target


def _bake_step(name: str, assets: list[str]) -> dict[str, Any]:
    step = _step(name, ["asset", "{{Param.Manifest}}", "{{Task.Param.Asset}}", "--openjd"])
    step["parameterSpace"] = {"taskParameterDefinitions": [{"name": "Asset", "type": "STRING", "range": assets}]}
    return step


def _step(name: str, arguments: list[str]) -> dict[str, Any]:
    return {"name": name, "script": {"actions": {"onRun": {"command": "lightkiln-batch", "args": arguments}}}}
