"""Prepares the build: puts into .deps/ what the binding of xatlas needs and a machine may lack.

    python3 bootstrap.py

In: Python 3.11 with pip, a C++ compiler. Out: .deps/libclang (the library that bindgen loads, from PyPI) and
.deps/include (a link to the compiler's own headers). .cargo/config.toml names both, so that plain cargo commands work
from then on. Nothing outside the repository changes; a second run does nothing.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent
DEPS = ROOT / ".deps"
LIBCLANG = "libclang==18.1.1"


def compiler_headers() -> Path:
    """The folder of the compiler's own headers. Exits with the remedy if there is no compiler."""
    queries = {"gcc": ["-print-file-name=include"], "clang": ["-print-file-name=include"]}
    for compiler, arguments in queries.items():
        if shutil.which(compiler):
            answer = subprocess.run([compiler, *arguments], capture_output=True, text=True, check=True)
            folder = Path(answer.stdout.strip())
            if (folder / "stddef.h").is_file():
                return folder
    sys.exit("bootstrap: no C++ compiler found. Install one, e.g. `apt-get install g++`.")


def install_libclang() -> None:
    """Installs libclang from PyPI into .deps/, which also works where Python is externally managed."""
    target = DEPS / "libclang"
    if (target / "clang" / "native").is_dir():
        return
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(target), LIBCLANG]
    if subprocess.run(command, check=False).returncode != 0:
        sys.exit("bootstrap: pip could not install libclang. Is pip there? `apt-get install python3-pip` installs it.")


def link_headers() -> None:
    """Links .deps/include to the compiler's headers, anew if they moved."""
    link, headers = DEPS / "include", compiler_headers()
    if link.is_symlink() and link.resolve() == headers.resolve():
        return
    link.unlink(missing_ok=True)
    link.symlink_to(headers, target_is_directory=True)


def main() -> None:
    """Prepares the build."""
    DEPS.mkdir(exist_ok=True)
    install_libclang()
    link_headers()


if __name__ == "__main__":
    main()
