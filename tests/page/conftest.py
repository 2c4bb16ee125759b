"""A browser that runs the scripts of this folder in pages."""

from browsers import browser, look

__all__ = ["browser", "look"]
