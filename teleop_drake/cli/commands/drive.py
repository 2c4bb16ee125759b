"""The command `teleop-drake drive`: the page, with one's own hand as the operator."""

from teleop_drake.cli.commands.page import AddOptions, Execute

__all__ = ["AddOptions", "Execute"]
