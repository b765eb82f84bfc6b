# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs a program, and ends it when the standard input closes: that is, when Blender asks for it, quits or dies.

    python watchdog.py PROGRAM ARGUMENT...

The program's output goes where the watchdog's goes; its exit code becomes the watchdog's.
"""

import os
import subprocess
import sys
import threading

# Seconds that the program has to end in its own way.
GRACE = 3.0


def main() -> int:
    """Runs the program to its end."""
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)
    child = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL, creationflags=flags)

    def end_with_blender() -> None:
        while os.read(0, 4096):
            pass
        child.terminate()
        try:
            child.wait(GRACE)
        except subprocess.TimeoutExpired:
            child.kill()

    threading.Thread(target=end_with_blender, daemon=True).start()
    code = child.wait()
    # A daemon thread that blocks in a read must not hold up the exit.
    os._exit(code if code >= 0 else 128 - code)


if __name__ == "__main__":
    main()
