"""The living diagram: one HTML file in which a block diagram simulates."""

from teleop_drake.page.page import DiagramPage, Explore, MakePage, WritePage

__all__ = ["DiagramPage", "Explore", "MakePage", "WritePage"]
