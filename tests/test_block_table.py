"""Which blocks and functions compile, linearise exactly and run in a page.

`python tests/test_block_table.py` tries each and writes docs/blocks.md.
"""

import builtins
import importlib
import math
import pkgutil
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from engines import Compiled, Errors, InWebAssembly
from pydrake.common import RandomDistribution
from pydrake.math import BarycentricMesh, RigidTransform
from pydrake.systems import primitives as drake
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.trajectories import PiecewisePolynomial
from slopes import YES, Ports, Slopes
from wasm_scenarios import AssertSame
from wired import Wired

import teleop_drake
from teleop_drake import (
    AbstractDelay,
    MovingWindow,
    TrajectorySource,
    VariableTransportDelay,
)
from teleop_drake.loops.engine.check import Compare
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.primitives import KERNELS
from teleop_drake.loops.framework.signals import PathsIn, VectorOutputs
from teleop_drake.loops.jit.packing import Place
from teleop_drake.loops.jit.scalar_code import MakeCode, TraceLaw
from teleop_drake.loops.jit.symbols import (
    Untraceable,
)
from teleop_drake.loops.jit.traced_numpy import FUNCTIONS, REPLACED, UFUNCS
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.model.blocks.operators.hand import HandOperator
from teleop_drake.model.run.simulate import MakeDiagram
from teleop_drake.model.scenario import ARCHITECTURES, LoadScenario
from teleop_drake.model.teleoperator import MakeTeleoperator

PAGE = Path(teleop_drake.__file__).parent / "docs" / "blocks.md"
# What one of them compiles, the others find on the disk.
pytestmark = [
    pytest.mark.xdist_group("machine_code"),
    pytest.mark.filterwarnings("ignore"),
]
MODULES = {"numpy": np, "numpy.linalg": np.linalg, "math": math, "Python": builtins}
KNOWN = {*UFUNCS, *FUNCTIONS, *REPLACED}
Rows = Iterator[tuple[str, ...]]
FOLDERS = {
    *("architectures", "blocks", "delays", "environments"),
    *("operators", "robots", "systems"),
}
BEGIN = "<!-- tests/test_block_table.py writes this -->"
END = "<!-- until here -->"
EXTRAS: dict = {
    "forward_channel": {"kind": "network", "delay": 0.1, "sample_period": 0.01},
    "return_channel.kind": "variable",
    "return_channel.sinusoid": {"amplitude": 0.02, "frequency": 3.0},
    "environment": {"kind": "standard_linear_solid", "start": 0.001}
    | {"stiffness": 100.0, "branch_stiffness": 50.0},
    "surgeon": {"kind": "human", "velocity": [0.001]},
    "sensor.force.sample_period": 0.01,
    "actuator.coulomb_friction": 0.001,
}
WALL = {"kind": "hunt_crossley", "start": 0.9, "stiffness": 100.0}

# Scenarios and changes; together they have every block.
SCENES: list[tuple[str, dict]] = [
    ("two_dof_combined", {"environment": WALL, "controller.network.count": [2, 2]}),
    *(("one_dof", {"controller.kind": kind}) for kind in ARCHITECTURES),
    ("one_dof", EXTRAS),
    ("one_dof", {"surgeon.kind": "move_and_wait"}),
    ("puma560_insertion", {}),
    ("puma560_six_axes", {"controller.kind": "direct_force"}),
    *((name, {}) for name in ("needle_insertion", "network_tracking_coupled")),
    ("leader_follower", {}),
    ("one_dof", {"controller.kind": "own_kinds:Damped"}),
]


def Primitives() -> Diagram:
    """Returns a diagram with the blocks and primitives that no scenario has."""
    I = np.eye(2)
    zero = np.zeros((2, 2))
    builder = DiagramBuilder()
    row = [
        drake.Sine([1.0, 0.5], [3.0, 5.0], [0.1, 0.2], True),
        drake.AffineSystem(-I, I, [0.1, 0.2], I, zero, [0.3, 0.4]),
        drake.MatrixGain(0.5 * I),
        drake.ZeroOrderHold(0.1, 2),
        drake.DiscreteTimeDelay(0.1, 2, 2),
        drake.Integrator(2),
        drake.FirstOrderLowPassFilter(0.2, 2),
        drake.PassThrough(2),
        drake.WrapToSystem(2),
        MovingWindow(0.2, 2),
        drake.VectorLogSink(2, 0.1),
    ]
    ramp = PiecewisePolynomial.FirstOrderHold([0.05, 0.3], [[0.0, 1.0]])
    builder.AddNamedSystem("ramp", TrajectorySource(ramp, 1))
    noise = drake.RandomSource(RandomDistribution.kGaussian, 2, 0.1)
    builder.AddNamedSystem("noise", noise)
    for i, system in enumerate(row):
        builder.AddNamedSystem(f"block_{i}", system)
        if i:
            last = row[i - 1].get_output_port(0)
            builder.Connect(last, system.get_input_port())
    conveyor = builder.AddNamedSystem("conveyor", VariableTransportDelay(0.2))
    speed = builder.AddNamedSystem("speed", drake.ConstantVectorSource([1.0]))
    for i in range(2):
        builder.Connect(speed.get_output_port(), conveyor.get_input_port(i))
    grid = BarycentricMesh([{-1.0, 0.3, 1.0}, {-1.0, 1.0}])
    table = drake.BarycentricMeshSystem(grid, np.array([[0.0, 1, -1, 2, 0, 3]]))
    builder.AddNamedSystem("table", table)
    builder.Connect(row[0].get_output_port(0), table.get_input_port())
    pid = builder.AddNamedSystem("pid", PidController([2.0], [0.5], [1.0]))
    for i in range(pid.num_input_ports()):
        builder.Connect(row[0].get_output_port(0), pid.get_input_port(i))
    return builder.Build()


def Poses() -> Diagram:
    """Returns a diagram with a delay of poses."""
    return Wired(
        {
            "delay": AbstractDelay(0.1, 0.02, RigidTransform()),
            "number": drake.ConstantVectorSource([1.0]),
        },
        {},
    )


def Scenes() -> Iterator[tuple[str, Diagram, Callable[[], object]]]:
    """Yields the kind of the robot, a diagram, and what runs it in a page."""
    for name, changes in SCENES:
        scenario = LoadScenario(name, {**changes, "duration": 2.0})
        kind = getattr(scenario.robot, "kind", "")
        yield kind, MakeDiagram(scenario), partial(AssertSame, scenario)
    hand = HandOperator(num_axes=1)
    loop = MakeTeleoperator(LoadScenario("one_dof"), operator=hand)
    for diagram in (loop, Primitives(), Poses()):
        yield "slider", diagram, partial(AssertRuns, diagram)


def AssertRuns(diagram: Diagram) -> None:
    """Compares a diagram in a page with its native run."""
    config = SimulatorConfig(max_step_size=0.01, accuracy=1e-9)
    times = np.arange(1, 5)
    native = Compiled(diagram, config, times / 4, as_machine_code=True)
    assert (
        max(Errors(InWebAssembly(diagram, config, times / 4), native).values()) < 1e-6
    )


def Code(system: System) -> str:
    """Returns "yes", or why a block does not compile; it computes what Drake's does."""
    rng = np.random.default_rng(0)
    context = system.CreateDefaultContext()
    context.SetAccuracy(1e-4)
    for port in Ports(system, "input"):
        port.FixValue(context, rng.uniform(0.1, 0.2, port.size()))
    try:
        recorded = VectorOutputs(system)
        evaluator = Evaluator(system, context, as_machine_code=True, recorded=recorded)
    except UnsupportedSystem as error:
        return str(error).partition("cannot be compiled: ")[2]
    Compare(evaluator, system, context)
    return YES


def InPage(run: Callable[[], object]) -> str:
    """Returns "yes", or why a diagram does not run in a page."""
    try:
        run()
    except UnsupportedSystem as error:
        return str(error).partition("cannot be compiled: ")[2]
    return YES


def Blocks() -> Rows:
    """Yields folder and name of each block and kind of robot, with what it can do."""
    seen = {"Diagram", ""}
    for robot, diagram, run in Scenes():
        inside = {path: system for system, path in PathsIn(diagram)}
        in_page = InPage(run)
        for path, system in inside.items():
            module = type(system).__module__
            name = type(system).__name__
            if path == "robot" and name == "Diagram":
                module = "teleop_drake.model.blocks.robots.base"
                name = robot
            if name not in seen and not name.startswith("_"):
                seen.add(name)
                own = r"^teleop_drake\.(loops|model)\.(blocks\.(?=\w+\.))?"
                folder = re.sub(own, "", module).partition(".")[0]
                group = {"pydrake": "Drake"}.get(folder, folder)
                yield group, name, Code(system), Slopes(system), in_page


def Calls(v: np.ndarray) -> list[tuple]:
    """Returns what a function may be called with; the first that works counts.

    At last come constants.
    """
    M = v.reshape(2, 2)
    some = v > 0.4
    return [
        *[(v,), (M,), (v, v[::-1]), (M, M.T), (v[0],), (v[0], v[1])],
        *[(some, v < 0.65), (some,), (v, 2), (M, 0), ([v, v],), (v[:3], v[1:])],
        *[(M, (2, 2)), ("i,i->i", v, v), (v, [0, 1, 2], v[:3]), (v, 0.3, 0.6)],
        *[(v, 1, v[0]), (some, v, v * v), (M, 0, 1), (v, np.ndarray), (2, v[0])],
        *[(2,), (0, 1), ([0.0, 1.0],)],
    ]


# Of numbers these return one of them to AutoDiffXd: they start with comparisons.
OF_COMPARISONS = {np.logical_and: 6, np.logical_or: 6}


def Functions() -> Rows:
    """Yields module and name of each function, with what it can do."""
    builder = DiagramBuilder()
    u = np.array([0.3, 0.6, 0.2, 0.7])
    source = builder.AddNamedSystem("u", drake.ConstantVectorSource(u))
    rows = []
    for title, module in MODULES.items():
        for name, function in sorted(vars(module).items()):
            is_type = module is np and isinstance(function, type)
            if is_type or getattr(function, "__name__", "") != name:
                continue
            if function in KNOWN:
                block = OfFunction(function, u)
                builder.AddNamedSystem(f"{title} {name}", block)
                builder.Connect(source.get_output_port(), block.get_input_port())
                try:
                    slopes = Slopes(block)
                except (TypeError, AttributeError, RuntimeError):
                    slopes = "no"
                rows.append((title, name, YES, slopes))
    in_page = InPage(partial(AssertRuns, builder.Build()))
    yield from ((*row, in_page) for row in rows)


def OfFunction(function: Callable, u: np.ndarray) -> FixedBlock:
    """Returns a block that calls a function, and which compiles."""
    refused = []
    for k in range(OF_COMPARISONS.get(function, 0), len(Calls(u))):
        try:
            are_many = isinstance(function(*Calls(u)[k]), (list, tuple))

            def law(u, k=k, are_many=are_many):
                result = function(*Calls(u)[k])
                parts = result if are_many else [result]
                return np.concatenate([np.ravel(part) * 1.0 for part in parts])

            kernel = Kernel(outputs={"y": (law, "u")})
            size = len(law(u))
        except (TypeError, ValueError, IndexError, np.linalg.LinAlgError):
            continue  # Numpy takes something else.
        try:
            MakeCode(TraceLaw(law, [Place(0, u.shape)], u.size))
        except Untraceable as error:
            refused.append(str(error))
            continue
        return FixedBlock("f", kernel, inputs={"u": len(u)}, outputs={"y": size})
    raise AssertionError(f"{function.__name__}: no call compiles: {refused}")


def Table() -> str:
    """Returns the table in markdown, a row for all that can do the same."""
    names: dict[tuple[str, ...], list[str]] = {}
    for group, name, *can in [*sorted(Blocks()), *Functions()]:
        names.setdefault((group, *can), []).append(f"`{name}`")
    lines = ["| | | machine code | AutoDiffXd | page |", "|---|---|---|---|---|"]
    for (group, *can), members in names.items():
        lines.append(f"| {group} | {', '.join(members)} | {' | '.join(can)} |")
    return "\n".join([BEGIN, *lines, END])


def Written() -> tuple[str, str, str]:
    """Returns the page before the table, the table, and the page behind it."""
    before, text = PAGE.read_text("utf-8").split(BEGIN)
    table, after = text.split(END)
    return before, BEGIN + table + END, after


@pytest.mark.slow
def test_the_table_is_what_the_code_gives():
    assert Table() == Written()[1]


def test_every_block_is_in_the_table():
    names = set(KERNELS)
    for module in pkgutil.walk_packages(teleop_drake.__path__, "teleop_drake."):
        if FOLDERS & set(module.name.split(".")[2:-1]):
            for name, kind in vars(importlib.import_module(module.name)).items():
                if isinstance(kind, type) and issubclass(kind, System):
                    is_base = name.startswith("_") or kind.__subclasses__()
                    is_own = kind.__module__ == module.name
                    names |= {name} if is_own and not is_base else set()
    assert names <= set(re.findall(r"`(\w+)`", Written()[1]))


if __name__ == "__main__":
    before, _, after = Written()
    PAGE.write_text(before + Table() + after, "utf-8")
