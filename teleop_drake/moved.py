"""The modules of earlier versions, under their old names.

`import teleop_drake.kernel` imports teleop_drake.loops.kernel and warns. The names of
teleop_drake and of teleop_drake.blocks have not moved.
"""

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

_PACKAGE = __name__.rpartition(".")[0]

# The new places of rooms and files. A file moves with its room unless it is listed.
_PLACES = {
    "analysis": "loops.linear",
    "analysis.energy": "study.analysis.energy",
    "analysis.latency": "study.analysis.latency",
    "analysis.loop": "study.analysis.loop",
    "analysis.loop_model": "study.analysis.loop_model",
    "analysis.operating_point": "study.analysis.operating_point",
    "analysis.point_stability": "study.analysis.point_stability",
    "analysis.stability": "study.analysis.stability",
    "analysis.stability_chart": "study.analysis.stability_chart",
    "analysis.tool_motion": "study.analysis.tool_motion",
    "analysis.transparency": "study.analysis.transparency",
    "arrays": "loops.framework.arrays",
    "blocks.architectures": "model.blocks.architectures",
    "blocks.channels": "model.channels",
    "blocks.channels.abstract": "loops.delays.abstract",
    "blocks.channels.conveyor": "loops.delays.conveyor",
    "blocks.channels.netem": "loops.delays.netem",
    "blocks.channels.netem_queue": "loops.delays.netem_queue",
    "blocks.channels.packet_network": "loops.delays.packet_network",
    "blocks.channels.packet_options": "loops.delays.packet_options",
    "blocks.channels.packet_random": "loops.delays.packet_random",
    "blocks.channels.packet_statistics": "loops.delays.packet_statistics",
    "blocks.environments": "model.blocks.environments",
    "blocks.environments.surface": "loops.framework.surface",
    "blocks.operators": "model.blocks.operators",
    "blocks.robots": "model.blocks.robots",
    "blocks.systems": "model.blocks.systems",
    "blocks.systems.moving_window": "loops.blocks.moving_window",
    "blocks.systems.plant_tree": "loops.engine.plant_tree",
    "contexts": "loops.framework.contexts",
    "engine": "loops.engine",
    "figures": "study.figures",
    "figures.block_diagram": "loops.draw.block_diagram",
    "figures.delay_wires": "loops.draw.delay_wires",
    "figures.dot_fragments": "loops.draw.dot_fragments",
    "files": "loops.framework.files",
    "jit": "loops.jit",
    "kernel": "loops.kernel",
    "kinds": "model.kinds",
    "laws": "model.laws",
    "link": "study.link",
    "numerics": "loops.numerics",
    "numerics.dead_time": "study.numerics.dead_time",
    "numerics.delay_course": "study.numerics.delay_course",
    "numerics.delay_margin": "study.numerics.delay_margin",
    "numerics.delay_statistics": "study.numerics.delay_statistics",
    "numerics.lagged_signal": "study.numerics.lagged_signal",
    "numerics.piecewise_polynomial": "model.laws.piecewise_polynomial",
    "numerics.signal_pair": "study.numerics.signal_pair",
    "numerics.smoothing": "model.laws.smoothing",
    "numerics.transfer_function": "model.laws.transfer_function",
    "page": "loops.page",
    "page.hand": "study.page.hand",
    "page.page": "study.page.page",
    "page.scenario_model": "study.page.scenario_model",
    "page.scenario_page": "study.page.scenario_page",
    "parameters": "loops.engine.parameters",
    "recording": "loops.run.recording",
    "scenario": "model.scenario",
    "signals": "loops.framework.signals",
    "simulation": "loops.run",
    "simulation.compile": "model.run.compile",
    "simulation.compiled_scenario": "model.run.compiled_scenario",
    "simulation.ending": "model.run.ending",
    "simulation.scenario_run": "model.run.scenario_run",
    "simulation.simulate": "model.run.simulate",
    "solver": "loops.framework.solver",
    "stations": "model.stations",
    "sweep": "study.sweep",
    "tables": "model.tables",
    "task_recording": "model.task_recording",
    "tasks": "model.tasks",
    "teleoperator": "model.teleoperator",
    "validation": "loops.framework.validation",
    "wiring": "loops.framework.wiring",
}

# Rooms whose names in earlier versions are now names of the package.
_NAMES = {
    "page": ("Explore", "MakePage", "WritePage"),
    "simulation": ("MakeDiagram", "MakeSimulator", "simulate"),
}


def NewName(name: str) -> str | None:
    """Returns the new name of a module of an earlier version; None for others."""
    package, _, path = name.partition(".")
    if package != _PACKAGE:
        return None
    parts = path.split(".")
    for size in range(len(parts), 0, -1):
        place = _PLACES.get(".".join(parts[:size]))
        if place is not None:
            return ".".join([package, place, *parts[size:]])
    return None


class _Moved(MetaPathFinder, Loader):
    """Finds and loads modules under their old names."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Returns the specification of a module that has moved."""
        return None if NewName(name) is None else ModuleSpec(name, self)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Imports the module under its new name."""
        new = NewName(spec.name)
        assert new is not None
        room = spec.name.removeprefix(f"{_PACKAGE}.")
        if room in _NAMES:
            new = _PACKAGE
        message = f"{spec.name} has moved: import from {new}"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        module = import_module(new)
        if room not in _NAMES:
            spec.loader_state = module.__spec__
            return module
        room_module = ModuleType(spec.name)
        room_module.__path__ = []
        for name in _NAMES[room]:
            setattr(room_module, name, getattr(module, name))
        return room_module

    def exec_module(self, module: ModuleType) -> None:
        """Restores what the import has changed in a module that was there before."""
        spec = module.__spec__
        if spec is not None and spec.loader_state is not None:
            module.__spec__ = spec.loader_state


def FindMoved() -> None:
    """Lets Python find modules under their old names."""
    sys.meta_path.insert(0, _Moved())
