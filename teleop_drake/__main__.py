"""Lets `python -m teleop_drake` do what the command `teleop-drake` does."""

import sys

from teleop_drake.cli import main

if __name__ == "__main__":
    sys.exit(main())
