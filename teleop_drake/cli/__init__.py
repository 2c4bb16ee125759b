"""The command line."""

from teleop_drake.cli.main import main

__all__ = ["main"]
