"""Runs the command `teleop-drake` as `python -m teleop_drake`."""

import sys

from teleop_drake.cli import main

if __name__ == "__main__":
    sys.exit(main())
