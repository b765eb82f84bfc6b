"""The batch's report: outcomes → report.html and report.json in the output folder, and a page per asset.

Self-contained HTML: thumbnails are embedded.
"""

from __future__ import annotations

import base64
import html
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from .stamp import Stamp, write_atomically

ASSET_PAGE = "batch.html"
_THUMBNAIL = 160
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem }
body { color: #222; background: #fafafa } img { display: block; max-height: 80px }
table { border-collapse: collapse; width: 100% }
td, th { text-align: left; padding: .4rem .8rem; border-bottom: 1px solid #ddd }
.failed { color: #b00020; font-weight: 600 } .baked { color: #1b6e2f } .current { color: #666 }
ul { padding-left: 1.2rem }
@media (prefers-color-scheme: dark) {
  body { color: #ddd; background: #1b1b1b } td, th { border-color: #444 } a { color: #8bf }
}
"""


@dataclass(frozen=True)
class Row:
    """An asset in the report."""

    name: str
    scene: Path
    folder: Path
    state: str
    """baked, current or failed."""
    stamp: Stamp | None
    message: str = ""
    attempts: int = 1


def write_reports(out: Path, rows: Sequence[Row], seconds: float, baker: str) -> None:
    """Writes the pages of what was baked now, and the overall report."""
    out.mkdir(parents=True, exist_ok=True)
    thumbnails = {row.name: _thumbnail(row.folder, fresh=row.state == "baked") for row in rows if row.stamp}
    for row in rows:
        page = row.folder / ASSET_PAGE
        if row.stamp is not None and (row.state == "baked" or not page.is_file()):
            write_atomically(page, _asset_page(row, thumbnails[row.name]))
    write_atomically(out / "report.html", _overview(out, rows, thumbnails, seconds, baker))
    write_atomically(out / "report.json", json.dumps(_data(out, rows, seconds, baker), indent=1, ensure_ascii=False))


def _data(out: Path, rows: Sequence[Row], seconds: float, baker: str) -> dict[str, Any]:
    return {
        "schema": "lightkiln-batch/1",
        "baker": baker,
        "seconds": seconds,
        "assets": [
            {
                "name": row.name,
                "scene": str(row.scene),
                "folder": row.folder.relative_to(out).as_posix(),
                "state": row.state,
                "message": row.message,
                "attempts": row.attempts,
                "seconds": row.stamp.seconds if row.stamp else None,
                "notes": row.stamp.notes if row.stamp else [],
                "facts": row.stamp.facts if row.stamp else {},
            }
            for row in rows
        ],
    }


def _thumbnail(folder: Path, *, fresh: bool) -> str:
    """The first page as a small PNG in base64, kept beside the results; empty if it cannot be made."""
    path = folder / "thumbnail.png"
    page = folder / "lightmap_0.exr"
    if fresh or not path.is_file():
        import OpenImageIO as oiio

        source = oiio.ImageBuf(str(page))
        if source.has_error:
            return ""
        spec = source.spec()
        scale = _THUMBNAIL / max(spec.width, spec.height)
        roi = oiio.ROI(0, max(1, round(spec.width * scale)), 0, max(1, round(spec.height * scale)), 0, 1, 0, 3)
        small = oiio.ImageBufAlgo.resize(oiio.ImageBufAlgo.channels(source, ("R", "G", "B")), roi=roi)
        # Brightness by the mean, so that dim and bright bakes both show their shadows.
        mean = max(sum(oiio.ImageBufAlgo.computePixelStats(small).avg[:3]) / 3, 1e-9)
        shown = oiio.ImageBufAlgo.clamp(oiio.ImageBufAlgo.mul(small, 0.35 / mean), 0.0, 1.0)
        shown = oiio.ImageBufAlgo.pow(shown, 1 / 2.2)
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            made = Path(scratch) / path.name
            shown.set_write_format("uint8")
            if not shown.write(str(made)):
                return ""
            made.replace(path)
    return base64.b64encode(path.read_bytes()).decode()


def _page(title: str, body: str) -> str:
    head = f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
    return f"{head}<style>{_STYLE}</style>\n<h1>{html.escape(title)}</h1>\n{body}</html>\n"


def _overview(out: Path, rows: Sequence[Row], thumbnails: dict[str, str], seconds: float, baker: str) -> str:
    counts = {state: sum(row.state == state for row in rows) for state in ("baked", "current", "failed")}
    done = f"{counts['baked']} baked, {counts['current']} unchanged, {counts['failed']} failed"
    summary = f"{done} in {seconds:.1f} s with {baker}"
    lines = [
        f"<p>{html.escape(summary)}</p>",
        "<table><tr><th>Lightmap<th>Asset<th>State<th>Time<th>Texels<th>Error<th>Aimed for<th>Warnings",
    ]
    # Failures first: they are what one looks for in the morning.
    for row in sorted(rows, key=lambda r: (r.state != "failed", r.name)):
        link = quote(f"{row.folder.relative_to(out).as_posix()}/{ASSET_PAGE}")
        name = html.escape(row.name)
        facts = row.stamp.facts if row.stamp else {}
        cells = [
            _image(thumbnails.get(row.name, "")),
            f'<a href="{link}">{name}</a>' if row.stamp else name,
            f'<span class="{row.state}">{row.state}</span> {html.escape(row.message)}',
            f"{row.stamp.seconds:.1f} s" if row.stamp else "",
            _number(facts.get("texels")),
            _reached(facts),
            _percent(facts.get("error_target")),
            str(len(row.stamp.notes)) if row.stamp else "",
        ]
        lines.append("<tr>" + "".join(f"<td>{cell}" for cell in cells))
    return _page("Lightkiln batch", "\n".join(lines) + "\n</table>")


def _asset_page(row: Row, thumbnail: str) -> str:
    assert row.stamp is not None
    facts = row.stamp.facts
    lines = [
        _image(thumbnail),
        f"<p>{html.escape(str(row.scene))}, baked in {row.stamp.seconds:.1f} s with {html.escape(row.stamp.baker)}: ",
        f"{_number(facts.get('triangles'))} triangles, {_number(facts.get('texels'))} texels, ",
        f"error {_reached(facts)}, aimed for {_percent(facts.get('error_target'))}.</p>",
        '<p><a href="report.html">The baker\'s report</a></p>',
        f"<h2>{len(row.stamp.notes)} warnings</h2><ul>",
        *(f"<li><b>{html.escape(place)}</b>: {html.escape(text)}" for place, text in row.stamp.notes),
        "</ul><h2>Files</h2><ul>",
        *(
            f'<li><a href="{quote(name)}">{html.escape(name)}</a>, {size:,} bytes'
            for name, size in row.stamp.files.items()
        ),
        "</ul>",
    ]
    return _page(row.name, "\n".join(lines))


def _image(data: str) -> str:
    return f'<img alt="lightmap" src="data:image/png;base64,{data}">' if data else ""


def _number(value: Any) -> str:
    return f"{value:,}" if isinstance(value, int) else "–"


def _reached(facts: dict[str, Any]) -> str:
    """What the baker's audit has found, and whether that meets what was aimed for."""
    verdict = facts.get("verdict")
    text = f"{_percent(facts.get('error'))} {html.escape(verdict)}" if verdict else "–"
    return f'<span class="failed">{text}</span>' if verdict == "missed" else text


def _percent(value: Any) -> str:
    return f"{100 * value:.3g} %" if isinstance(value, (int, float)) else "–"
