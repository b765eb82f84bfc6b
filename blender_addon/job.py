# SPDX-License-Identifier: GPL-3.0-or-later
"""One run of the baker: a process under a watchdog, its JSON lines in a queue. Nothing here touches Blender's data."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, Any

from .errors import BakeError, Cancelled, Note
from .program import NO_WINDOW

WATCHDOG = Path(__file__).parent / "watchdog.py"
# Lines of the baker's log that an error message quotes.
LOG_LINES = 5
INTERRUPTED = 130


class Job:
    """A running baker. `poll` until `finished`, then `result`."""

    def __init__(self, program: Path, task: str, source: Path, folder: Path, options: list[str]) -> None:
        """Starts `task`, "bake" or "relight", on `source` into `folder`. Raises BakeError if it does not start."""
        command = [str(program), task, str(source), "--out", str(folder), "--force", "--json", *options]
        self.stage = "import"
        self.done = 0.0
        self.eta: float | None = None
        self.notes: list[Note] = []
        # States of a progressive bake so far, and what the last one had reached.
        self.states, self.reached = 0, ""
        self._result: dict[str, Any] | None = None
        self._error = ""
        self._cancelled = False
        self._log: list[str] = []
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        try:
            self._process = subprocess.Popen(
                watched(command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                creationflags=NO_WINDOW,
            )
        except OSError as error:
            raise BakeError(f"The baker `{program}` does not start ({error}): check it in the preferences") from error
        assert self._process.stdout and self._process.stderr
        self._threads = [
            threading.Thread(target=self._read, args=(self._process.stdout, self._lines.put), daemon=True),
            threading.Thread(target=self._read, args=(self._process.stderr, self._log.append), daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @staticmethod
    def _read(stream: IO[bytes], take: Any) -> None:
        for line in stream:
            take(line.decode("utf-8", "replace").rstrip())

    def poll(self) -> bool:
        """Takes in what the baker said since the last call. True once it has ended and everything is read."""
        ended = self._process.poll() is not None and not any(thread.is_alive() for thread in self._threads)
        while not self._lines.empty():
            self._take(self._lines.get())
        return ended

    def _take(self, line: str) -> None:
        try:
            event = json.loads(line)
        except ValueError:
            return
        kind = event.get("event")
        if kind == "progress":
            self.stage = event.get("stage", self.stage)
            self.done = float(event.get("overall") or event.get("done") or 0.0)
            self.eta = event.get("eta_s")
        elif kind == "warning":
            self.notes.append(_note(event))
        elif kind == "state":
            self.states, self.reached = self.states + 1, event.get("reached", "")
        elif kind == "error":
            self._error = event.get("message", "")
        elif kind == "result":
            self._result = event

    def cancel(self) -> None:
        """Asks the baker to end; the watchdog sees to it."""
        self._cancelled = True
        if self._process.stdin and not self._process.stdin.closed:
            self._process.stdin.close()

    def wait(self) -> None:
        """Blocks until the baker has ended."""
        while not self.poll():
            time.sleep(0.02)

    def result(self) -> dict[str, Any]:
        """The baker's result event. Raises Cancelled, or BakeError with the baker's own words."""
        self.cancel_pipe()
        code = self._process.returncode
        if self._cancelled:
            raise Cancelled
        if self._result is not None and code == 0:
            return self._result
        if self._error:
            raise BakeError(f"The baker stopped: {self._error}")
        log = " / ".join(self._log[-LOG_LINES:]) or "it said nothing"
        if code == INTERRUPTED or code > 128:
            raise BakeError(f"The baker was ended from outside (code {code}; {log}): bake again")
        raise BakeError(f"The baker failed with code {code} ({log}): bake again, or report it with the scene")

    def cancel_pipe(self) -> None:
        """Closes the pipes of an ended process."""
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream and not stream.closed:
                stream.close()


# The baker's remedies are flags of its command line; these are the add-on's own, by the warning's code.
_REMEDIES = {
    "texcoord_overlap": "its UV map lies upon itself, so faces share light: unwrap it again, "
    "or Make Copies for Lightmap if a modifier repeats its faces",
    "texcoord_meeting": "faces on different sides of an edge share texels: raise the texel density, "
    "or leave more space between the islands of its UV map",
    "texcoord_outside": "its UV map leaves the page: Make Copies for Lightmap if a modifier moves it there",
    "texcoord_degenerate": "some faces have no area in its UV map and stay dark: unwrap it again",
}


def _note(event: dict[str, Any]) -> Note:
    """A warning of the baker in the words of the add-on."""
    message = _REMEDIES.get(event.get("code", ""), event.get("message", ""))
    return Note(event.get("place", ""), message)


def watched(command: list[str]) -> list[str]:
    """The command under a watchdog, if Blender's Python is a program that can be run."""
    python = sys.executable
    if python and Path(python).name.lower().startswith("python") and os.access(python, os.X_OK):
        return [python, "-I", "-S", str(WATCHDOG), *command]
    return command
