"""The model of a run in a page: a program, its numbers, the places of signals."""

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import Context, OutputPort, System

from teleop_drake.loops.engine.check import CheckRead
from teleop_drake.loops.engine.components import ComponentFinder
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import AlgebraicLoop, InputsOf, OutputOf, Source
from teleop_drake.loops.engine.parameters import SetNumbers
from teleop_drake.loops.engine.problem import BREAKS, JUMPS, ROWS, Memory
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.signals import (
    PathsIn,
    SignalsOf,
    SystemsByPath,
    VectorOutputs,
    Visible,
)
from teleop_drake.loops.framework.surface import Surface, SurfacesIn
from teleop_drake.loops.framework.wiring import InputPorts
from teleop_drake.loops.kernel.block import LongestStep
from teleop_drake.loops.page.late_wires import LateWires
from teleop_drake.loops.page.levels import Levels
from teleop_drake.loops.page.plants import PlantData, PlantPicture, PlantPictures
from teleop_drake.loops.page.wasm import ConstantsOf, MakeModule
from teleop_drake.loops.run.compiled_run import StartOf
from teleop_drake.loops.run.initial_modes import SetInitialModes
from teleop_drake.loops.run.run import Job

# A row of the port table in a block's docstring: the port's name and its unit.
_ROW = re.compile(r"^\s*\|\s*(?:in|out)\s*\|\s*(\w+)\s*\|[^|]*\|\s*([^|]*?)\s*\|", re.M)

# The units of the ports of a robot and of its plant if its joints turn, and if they
# slide.
_JOINT_UNITS = {
    "joint_position": ("rad", "m"),
    "joint_velocity": ("rad/s", "m/s"),
    "joint_torque": ("N m", "N"),
    "state": ("rad, rad/s", "m, m/s"),
    "desired_state": ("rad, rad/s", "m, m/s"),
    "generalized_acceleration": ("rad/s^2", "m/s^2"),
    "actuation": ("N m", "N"),
    "net_actuation": ("N m", "N"),
    "applied_generalized_force": ("N m", "N"),
}

# The arrays of Memory that do not begin as zeros.
_START = (
    *("clock", "counts", "x", "m", "m_before", "y", "next_packets", "ticks"),
    *("breaks", "row_times", "row_ends", "rows"),
    *("steered.marks", "steered.jumps"),
)

PERIOD = 0.02
"""The time between the sending of two packets that are drawn, s."""

# The arrays of Memory that the page enlarges as a run needs more room.
_GROWING = ("row_times", "row_ends", "rows", "breaks", "steered.jumps")

# Larger signals end a run, because their squares may overflow in a sum.
_LARGEST = 1e150

# The texts in the place of a unit that mean no unit.
_NO_UNIT = ("", "any", "of signal", "-", "1")


@dataclass(frozen=True, kw_only=True)
class Model:
    """A run of a diagram as a page takes it.

    Attributes:
        job: The specification of the run, with the Context before its initialization
            events; the signals are those that are shown.
        run: The run before its start, with an evaluator that is not compiled.
        numbers: All values that may differ between runs of one program, as flat arrays
            keyed by name: the arrays of Problem, those of Memory that do not begin as
            zeros, and values for the page itself. These are `run` (end, accuracy,
            longest step), `bounds` (for each the first of its columns in a row, their
            number, the least and the largest value; see simulation.ending.Bound),
            `surfaces` (point and normal of each), `command` (the operator's velocity)
            and `command_delay` for metrics, and `forward` and `return` (how long each
            packet is under way that is sent every PERIOD, s; one number if constant).
        surfaces: The surfaces of the environment.
        has_zero_delays: Whether constant delays may be 0 in the program.
        facts: Data for the page's script that no number changes: `reasons` (why a run
            ends at each of the bounds), `metrics` (the function of the script that
            computes them, see Task.page_metrics), `labels` (of the metrics, by name),
            `has_constant_command` (as in Recording), `feed` (begin and size in y of a
            hand's command; None without a hand), the names of `surfaces` and
            `materials`, and `draws` (of random sources: the time in s, the place in
            Memory.y and the new values of each).
        plants: The pictures of the MultibodyPlants; see PlantPictures().
        late: The delays on connections; None: there are none.
        unit_of: The unit of a port by its name and size, of a task; None: no port has
            a unit by its name.
    """

    job: Job
    run: CompiledRun
    numbers: dict[str, Array]
    surfaces: tuple[Surface, ...]
    has_zero_delays: bool
    facts: dict[str, Any]
    plants: dict[str, PlantPicture]
    late: LateWires | None
    unit_of: Callable[[str, int], str | None] | None = None

    @property
    def diagram(self) -> System:
        """The simulated system."""
        return self.job.diagram

    @property
    def structure(self) -> tuple[Any, ...]:
        """The properties that all runs of one module have in common.

        They are the structure of the program, the arrays of indices and the facts.
        """
        program = self.run.evaluator.program
        # Indices define connections, except those of the ranges of delays.
        wiring = [
            x.tolist()
            for name, x in Fields(self.run.problem).items()
            if x.dtype.kind == "i" and not name.endswith("_ranges")
        ]
        return program.structure, wiring, self.facts

    def Module(self) -> bytes:
        """Returns the run as WebAssembly; see wasm.MakeModule()."""
        run = self.run
        return MakeModule(run.evaluator.program, run.problem, run.memory)

    def Data(self) -> dict[str, Any]:
        """Returns the data of a run for the page's script."""
        module = self.Module()
        return {
            **self.facts,
            "module": module,
            "start": ConstantsOf(module),
            "headers": self.Headers(),
            "plants": [PlantData(*plant) for plant in self.plants.items()],
            "width": self.run.evaluator.program.sizes[0],
            "numbers": self.numbers,
            "ports": self.Ports(),
            "components": self.Components(),
            "signals": self.Signals(),
            "references": self.References(),
            "levels": Levels(self.diagram),
        }

    def Headers(self) -> dict[str, list[Any]]:
        """Returns the layout of the arrays of `problem` and of `memory`.

        For each array, in the order of native.Header(), these are its name, its shape,
        whether it has whole numbers, and whether it grows.
        """
        return {
            name: [
                [field, list(array.shape), array.dtype.kind == "i", field in _GROWING]
                for field, array in Fields(value).items()
            ]
            for name, value in (
                ("problem", self.run.problem),
                ("memory", self.run.memory),
            )
        }

    def Ports(self) -> dict[str, tuple[int, int, str]]:
        """Returns begin, size and unit of each port in y, the vector of all signals.

        They are keyed by `path:port`; the path of the diagram itself is empty. Ports
        without a place in y are left out.
        """
        program = self.run.evaluator.program
        blocks = self.run.evaluator.blocks
        numbers = {block.system: i for i, block in enumerate(blocks)}
        result = {}
        for system, path in PathsIn(self.diagram):
            places = {}
            units = {}
            for port in VectorOutputs(system):
                source = OutputOf(blocks, system, int(port.get_index()))
                places[port] = program.signals.get(source)
                # The unit of an exported port is that of its block.
                block = blocks[source.block].system
                units[port] = self._Unit(block, source.port, port.size())
            for port in InputPorts(system):
                leaf, name = InputsOf(system, int(port.get_index()))[0]
                i = numbers[leaf]
                source = blocks[i].inputs.get(name, Source(i, name))
                place = program.signals.get(source, program.fed.get(source))
                places[port] = place
            for port, place in places.items():
                if place is not None:
                    name = port.get_name()
                    size = place.stop - place.start
                    unit = (
                        self._JointUnit(path, name)
                        or self._Unit(system, name, port.size())
                        or units.get(port, "")
                    )
                    result[f"{path}:{Visible(name)}"] = (place.start, size, unit)
        return result

    def _Unit(self, system: System, port: str, size: int) -> str:
        """Returns the unit of a port; "" if neither name nor block defines one."""
        block: Any = type(system)
        named = self.unit_of and self.unit_of(port, size)
        return named or _PortTable(block).get(port, "")

    def Components(self) -> dict[str, list[str]]:
        """Returns the names of the components of each port that has such names."""
        blocks = self.run.evaluator.blocks
        finder = ComponentFinder(blocks)
        numbers = {block.system: i for i, block in enumerate(blocks)}
        result = {}
        for system, path in PathsIn(self.diagram):
            names = {port: finder.Of(port) for port in VectorOutputs(system)}
            for port in InputPorts(system):
                leaf, name = InputsOf(system, int(port.get_index()))[0]
                names[port] = finder.OfInput(numbers[leaf], name)
            for port, own in names.items():
                if own:
                    result[f"{path}:{Visible(port.get_name())}"] = list(own)
        return result

    def _JointUnit(self, path: str, port: str) -> str:
        """Returns the unit of a robot's joints; "" if some turn and others slide."""
        plant = self.plants.get(path) or self.plants.get(f"{path}/plant")
        sorts = set() if plant is None else set(plant.tree.is_prismatic.tolist())
        kinds = [kind for kind in _JOINT_UNITS if f"_{port}".endswith(f"_{kind}")]
        if len(sorts) != 1 or not kinds:
            return ""
        turning, sliding = _JOINT_UNITS[max(kinds, key=len)]
        return sliding if sorts.pop() else turning

    def References(self) -> list[tuple[int, int, int]]:
        """Returns what PID controllers compare, as places in y.

        For each controller these are the begins of the estimated and of the desired
        positions, and their number.
        """
        ports = self.Ports()
        found = []
        for system, path in PathsIn(self.diagram):
            if not isinstance(system, PidController):
                continue
            count = system.get_output_port().size()
            names = ("estimated_state", "desired_state")
            estimated, desired = (ports.get(f"{path}:{name}") for name in names)
            # A projected state has other positions than the reference.
            if estimated and desired and estimated[1] == desired[1] == 2 * count:
                found.append((estimated[0], desired[0], count))
        return found

    def Signals(self) -> dict[str, str]:
        """Returns the port of each recorded signal as `path:port`, keyed by signal."""
        paths = dict(PathsIn(self.diagram))
        return {
            name: f"{paths[port.get_system()]}:{Visible(port.get_name())}"
            for name, port in self.job.signals.items()
        }


@functools.cache
def _PortTable(block: Any) -> dict[str, str]:
    """Returns the units in the port tables of a class and of its bases, by port."""
    units: dict[str, str] = {}
    for kind in reversed(block.__mro__):
        units |= dict(_ROW.findall(kind.__doc__ or ""))
    return {port: unit for port, unit in units.items() if unit not in _NO_UNIT}


def Fields(value: Any, path: str = "") -> dict[str, NDArray[Any]]:
    """Returns the arrays in nested named tuples, keyed by their dotted names.

    A field that is None has none.
    """
    if value is None:
        return {}
    if isinstance(value, np.ndarray):
        return {path: value}
    return {
        name: array
        for field in value._fields
        for name, array in Fields(
            getattr(value, field), f"{path}.{field}" if path else field
        ).items()
    }


def Flat(numbers: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Returns numbers as flat arrays of doubles, for the page's script."""
    return {name: np.array(x, float).ravel() for name, x in numbers.items()}


def _Begun(memory: Memory) -> dict[str, Array]:
    """Returns what does not begin as zeros, the filled part of arrays that grow."""
    num_rows = memory.counts[ROWS]
    filled = dict.fromkeys(("row_times", "row_ends", "rows"), num_rows)
    filled["breaks"] = memory.counts[BREAKS]
    if memory.steered is not None:
        filled["steered.jumps"] = memory.steered.marks[JUMPS]
    fields = Fields(memory)
    return {
        f"memory.{name}": fields[name][: filled.get(name)]
        for name in _START
        if name in fields
    }


def MakeModel(
    diagram: System,
    config: SimulatorConfig,
    duration: float,
    context: Context | None = None,
    *,
    signals: Mapping[str, OutputPort] | None = None,
    suppress_initialization_events: bool = False,
    late: LateWires | None = None,
) -> Model:
    """Returns the model of a diagram's run, without metrics.

    Args:
        diagram: The system to simulate.
        config: The accuracy and the longest step.
        duration: The simulated time, s.
        context: The initial Context, which is not changed; None: the default Context.
        signals: The output port of each shown signal, by name; None: those of
            SignalsOf() that have elements.
        suppress_initialization_events: As for simulate().
        late: The delays on connections; None: there are none.

    Raises:
        UnsupportedSystem: If a block has no kernel; the message names the block.
    """
    suppress = suppress_initialization_events
    if signals is None:
        signals = {name: x for name, x in SignalsOf(diagram).items() if x.size()}
    job = Job(
        diagram=diagram,
        context=context or diagram.CreateDefaultContext(),
        config=config,
        duration=duration,
        signals=signals,
        suppress_initialization_events=suppress,
    )
    start = StartOf(diagram, job.context, suppress_initialization_events=suppress)
    evaluator, has_zero_delays = _MakeEvaluator(diagram, start, job.signals, late)
    model = _ModelAt(job, start, evaluator, late, has_zero_delays=has_zero_delays)
    CheckRead(evaluator, start)
    return model


def WithNumbers(model: Model, values: Mapping[str, float]) -> Model:
    """Returns the model of a run with other numbers; see SetNumbers().

    Its program is kept if possible. Bounds, packets and facts do not depend on numbers.
    """
    job = model.job
    context = job.context.Clone()
    constants: dict[System, dict[str, Array]] = {}
    late = model.late and model.late.With(values)
    own = {x: v for x, v in values.items() if late is None or not late.Has(x)}
    changed = SetNumbers(job.diagram, context, own, constants)
    suppress = job.suppress_initialization_events
    start = StartOf(job.diagram, context, suppress_initialization_events=suppress)
    evaluator = model.run.evaluator.With(
        start, changed, constants=constants, inserted=late
    )
    if constants and not suppress:
        SetInitialModes(evaluator, start)
    has_zero_delays = model.has_zero_delays
    other = _ModelAt(job, start, evaluator, late, has_zero_delays=has_zero_delays)
    is_of_run = ("problem.", "memory.", "run")
    kept = {x: z for x, z in model.numbers.items() if not x.startswith(is_of_run)}
    return replace(
        other,
        numbers=other.numbers | kept,
        facts=model.facts,
        unit_of=model.unit_of,
    )


def _ModelAt(
    job: Job,
    start: Context,
    evaluator: Evaluator,
    late: LateWires | None,
    *,
    has_zero_delays: bool,
) -> Model:
    """Returns the model of a run that begins at a Context.

    Args:
        start: The Context, after its initialization events.
        evaluator: The evaluator with the numbers of the Context.
    """
    diagram = job.diagram
    longest = LongestStep(diagram, start, of_delays=False)
    max_step = min(job.config.max_step_size, longest)
    end = start.get_time() + job.duration
    accuracy = job.config.accuracy
    run = CompiledRun(evaluator, start, end=end, accuracy=accuracy, max_step=max_step)
    surfaces = SurfacesIn(SystemsByPath(diagram)) or ()
    # The run ends when a signal is not finite, or is too large.
    width = evaluator.program.sizes[0]
    planes = [x for s in surfaces for x in (*s.point_W, *s.normal_W)]
    numbers: dict[str, ArrayLike] = {
        **{f"problem.{name}": x for name, x in Fields(run.problem).items()},
        **_Begun(run.memory),
        "run": [end, accuracy, max_step],
        "bounds": [0.0, width, -_LARGEST, _LARGEST],
        "surfaces": planes,
    }
    return Model(
        job=job,
        run=run,
        has_zero_delays=has_zero_delays,
        numbers=Flat(numbers),
        surfaces=surfaces,
        facts=_FactsOf(run, surfaces),
        late=late,
        plants=PlantPictures(diagram, start, evaluator.left_out),
    )


def _FactsOf(run: CompiledRun, surfaces: Sequence[Surface]) -> dict[str, Any]:
    """Returns the facts of a run without a task; see Model."""
    return {
        "reasons": ["the run is not finite"],
        "metrics": "",
        "labels": {},
        "feed": None,
        "draws": [[x.time, x.place.start, *x.value] for x in run.draws],
        "surfaces": [surface.name for surface in surfaces],
        "materials": [getattr(x.material, "name", "") for x in surfaces],
    }


def _MakeEvaluator(
    diagram: System,
    context: Context,
    signals: Mapping[str, OutputPort],
    late: LateWires | None,
) -> tuple[Evaluator, bool]:
    """Returns the evaluator of a diagram, and whether constant delays may be 0.

    They may be 0 unless an algebraic loop would result.
    """

    def Read(*, has_zero_delays: bool) -> Evaluator:
        return Evaluator(
            diagram,
            context,
            has_zero_delays=has_zero_delays,
            recorded=signals.values(),
            needs_states=False,
            inserted=late,
        )

    try:
        return Read(has_zero_delays=True), True
    except AlgebraicLoop:
        return Read(has_zero_delays=False), False
