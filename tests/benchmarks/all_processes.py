"""Runs a program and waits for every process that it leaves behind.

    python -m benchmarks.all_processes MODULE ARGUMENTS

So their CPU time is that of a child of whoever started this. A server from which
workers are forked ends a moment after the program, and nobody would count it.
"""

import contextlib
import ctypes
import os
import subprocess
import sys

_PR_SET_CHILD_SUBREAPER = 36


def main() -> int:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    done = subprocess.run([sys.executable, "-m", *sys.argv[1:]], check=False)
    with contextlib.suppress(ChildProcessError):
        while True:
            os.wait()
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
