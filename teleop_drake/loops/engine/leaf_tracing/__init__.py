"""Reads LeafSystems that users wrote in Python, as they stand; see reader."""

from teleop_drake.loops.engine.leaf_tracing.handlers import HasInitialization
from teleop_drake.loops.engine.leaf_tracing.reader import LeafReader
from teleop_drake.loops.engine.leaf_tracing.sinks import CheckSink

__all__ = ["CheckSink", "HasInitialization", "LeafReader"]
