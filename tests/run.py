"""Runs every check of the project and installs what the checks need.

    python3 tests/run.py

In: a machine with Rust, a C++ compiler, Python 3.11 with pip, and Node 18 with npm. Chromium is installed with apt
where that is possible. Everything else goes into .deps/ inside the repository. Out: the checks' own output, a summary,
and exit code 0 only if all passed.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DEPS = ROOT / ".deps"
VENV_PYTHON = DEPS / "venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
PIPELINE = DEPS / "pipeline"
REQUIREMENTS = ROOT / "tests" / "python" / "requirements.txt"
NPM_FILES = [ROOT / "tests" / "web" / name for name in ("package.json", "package-lock.json", ".npmrc")]
# No command takes a third of it, so that one that hangs is named before whoever runs the checks gives up.
LIMIT_S = 40 * 60
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


class Failed(Exception):
    """A check did not pass, or cannot run; the message says what to do."""


@dataclass
class Outcome:
    """How a section ended."""

    title: str
    seconds: float
    failure: str | None


def call(*command: str | Path, cwd: Path = ROOT) -> None:
    """Runs a command with its output shown. Raises Failed if it is missing, fails or does not end."""
    print("$", *command, flush=True)
    if not shutil.which(str(command[0])):
        raise Failed(f"`{command[0]}` is not installed")
    name = f"{Path(command[0]).name} {command[1]}"
    process = subprocess.Popen(command, cwd=cwd, start_new_session=True)
    try:
        code = process.wait(LIMIT_S)
    except subprocess.TimeoutExpired as error:
        raise Failed(f"`{name}` had not ended after {LIMIT_S} s") from error
    finally:
        if process.poll() is None:
            end(process)
    if code != 0:
        raise Failed(f"`{name}` ended with exit code {code}")


def end(process: subprocess.Popen[bytes]) -> None:
    """Ends a process and what it has started."""
    if os.name == "posix":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()


def install_once(folder: Path, inputs: list[Path], install: Callable[[], None]) -> None:
    """Runs `install` unless the folder holds the stamp of the same inputs."""
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in inputs)).hexdigest()
    stamp = folder / ".installed"
    if stamp.is_file() and stamp.read_text() == digest:
        return
    install()
    stamp.write_text(digest)


def prepare_build() -> None:
    """Libclang and headers for the binding of xatlas."""
    call(sys.executable, ROOT / "bootstrap.py")


def prepare_python() -> None:
    """A virtual environment with the Python tools. Needs neither ensurepip nor a writable system Python."""

    def install() -> None:
        call(sys.executable, "-m", "venv", "--clear", "--without-pip", DEPS / "venv")
        call(sys.executable, "-m", "pip", "--python", VENV_PYTHON, "install", "--quiet", "-r", REQUIREMENTS)

    install_once(DEPS / "venv", [REQUIREMENTS], install)


def prepare_web() -> None:
    """The Khronos validator, three.js and the browser's driver."""
    folder = DEPS / "npm"

    def install() -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for path in NPM_FILES:
            shutil.copy(path, folder)
        call("npm", "ci", "--ignore-scripts", cwd=folder)

    install_once(folder, NPM_FILES, install)


def prepare_browser() -> None:
    """Chromium, from the system or with apt."""
    if os.environ.get("CHROMIUM") or any(shutil.which(name) for name in BROWSERS):
        return
    if not (shutil.which("apt-get") and hasattr(os, "geteuid") and os.geteuid() == 0):
        raise Failed("no Chromium: install it (Debian: `apt-get install chromium`) or name its program in CHROMIUM")
    call("apt-get", "update", "--quiet")
    call("apt-get", "install", "--yes", "--quiet", "--no-install-recommends", "chromium")


def pipeline_tests() -> None:
    """The Python package with the packages that it needs: types and tests."""
    python = PIPELINE / VENV_PYTHON.relative_to(DEPS / "venv")
    requirements = ROOT / "tests" / "pipeline" / "requirements.txt"

    def install() -> None:
        call(sys.executable, "-m", "venv", "--clear", "--without-pip", PIPELINE)
        pip = (sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet")
        call(*pip, "-r", requirements)

    install_once(PIPELINE, [requirements], install)
    call(python, "-m", "mypy", cwd=ROOT / "pipeline")
    call(python, "-m", "pytest", "-q", cwd=ROOT / "pipeline")


def blender_tests() -> None:
    """The add-on's tests in bpy, or word that this machine cannot have it."""
    command = [sys.executable, str(ROOT / "tests" / "blender" / "run.py")]
    print("$", *command, flush=True)
    code = subprocess.run(command, cwd=ROOT, check=False).returncode
    # 77 says that bpy cannot be installed here, which the script has explained.
    if code not in {0, 77}:
        raise Failed(f"the add-on's tests ended with exit code {code}")


# In this order: what is quick to fail comes first, and the tests use what the build has compiled.
SECTIONS: list[tuple[str, Callable[[], None]]] = [
    ("Prepare the build", prepare_build),
    ("Prepare Python", prepare_python),
    ("Prepare the web tools", prepare_web),
    ("Prepare a browser", prepare_browser),
    ("Rust format", lambda: call("cargo", "fmt", "--check")),
    ("Python style", lambda: call(VENV_PYTHON, "-m", "ruff", "check", ".")),
    ("Python format", lambda: call(VENV_PYTHON, "-m", "ruff", "format", "--check", ".")),
    ("Python types", lambda: call(VENV_PYTHON, "-m", "mypy")),
    ("Build", lambda: call("cargo", "build", "--release", "--locked")),
    ("Rust tests", lambda: call("cargo", "test", "--release", "--locked")),
    ("Python tests", lambda: call(VENV_PYTHON, "-m", "pytest")),
    ("Pipeline", pipeline_tests),
    ("Blender tests", blender_tests),
    ("Rust lints", lambda: call("cargo", "clippy", "--release", "--locked", "--all-targets", "--", "-D", "warnings")),
]


def run_section(title: str, check: Callable[[], None]) -> Outcome:
    """Runs one section under its heading."""
    print(f"\n=== {title}", flush=True)
    start = time.monotonic()
    failure: str | None = None
    try:
        check()
    except Failed as error:
        failure = str(error)
        print(f"FAILED: {failure}", flush=True)
    return Outcome(title, time.monotonic() - start, failure)


def main() -> int:
    """Runs all sections, whatever fails, and sums up."""
    # Started in the background, it is told to ignore interrupts, and so would be the programs whose tests send them.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    outcomes = [run_section(title, check) for title, check in SECTIONS]
    print("\n=== Summary")
    for outcome in outcomes:
        verdict = "ok" if outcome.failure is None else f"FAILED: {outcome.failure}"
        print(f"{outcome.title:<22} {outcome.seconds:6.0f} s  {verdict}")
    failures = sum(outcome.failure is not None for outcome in outcomes)
    print("All checks passed." if failures == 0 else f"{failures} of {len(outcomes)} sections failed.")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
