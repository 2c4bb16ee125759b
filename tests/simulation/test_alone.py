"""Each block of the package, and each of Drake's that has defaults, runs by itself."""

import importlib
import pkgutil
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from pydrake.common import RandomDistribution
from pydrake.systems import primitives as drake
from pydrake.systems.framework import (
    Diagram,
    LeafSystem,
    PortDataType,
    System,
    VectorSystem,
)
from pydrake.systems.pyplot_visualizer import PyPlotVisualizer
from pydrake.trajectories import PiecewisePolynomial
from test_block_table import Scenes

import teleop_drake.blocks
from teleop_drake import ScenarioError, simulate
from teleop_drake.signals import VectorOutputs
from teleop_drake.wiring import InputPorts

ABSTRACT = System, LeafSystem, VectorSystem, Diagram, PyPlotVisualizer

# The modules of pydrake that define Systems.
MODULES = [
    *("examples", "geometry", "manipulation", "perception", "planning"),
    *("multibody.inverse_kinematics", "multibody.meshcat", "multibody.plant"),
    *("systems.controllers", "systems.estimators", "systems.lcm", "systems.perception"),
    *("systems.planar_scenegraph_visualizer", "systems.primitives"),
    *("systems.pyplot_visualizer", "systems.rendering", "systems.sensors"),
    "visualization",
]

I = np.eye(2)
BREAKS = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], [[0.0, 1.0]])
PRIMITIVES = {
    "adder": lambda: drake.Adder(2, 2),
    "affine": lambda: drake.AffineSystem(-I, I, [0.1, 0.2], I, I, [0.3, 0.4]),
    "constant": lambda: drake.ConstantVectorSource([1.0]),
    "demultiplexer": lambda: drake.Demultiplexer(2, 1),
    "derivative": lambda: drake.DiscreteDerivative(2, 0.02),
    "discrete delay": lambda: drake.DiscreteTimeDelay(0.02, 2, 2),
    "discrete integrator": lambda: drake.DiscreteTimeIntegrator(2, 0.02),
    "filter": lambda: drake.FirstOrderLowPassFilter(0.1, 2),
    "gain": lambda: drake.Gain(2.0, 2),
    "hold": lambda: drake.ZeroOrderHold(0.02, 2),
    "integrator": lambda: drake.Integrator(2),
    "linear": lambda: drake.LinearSystem(-I, I, I, I),
    "matrix": lambda: drake.MatrixGain(I),
    "multiplexer": lambda: drake.Multiplexer(2),
    "pass": lambda: drake.PassThrough(2),
    "random": lambda: drake.RandomSource(RandomDistribution.kGaussian, 2, 0.02),
    "saturation": lambda: drake.Saturation([-1.0], [0.05]),
    "sine": lambda: drake.Sine(1.0, 2.0, 0.0, 2),
    "trajectory": lambda: drake.TrajectorySource(BREAKS),
    "wrap": lambda: drake.WrapToSystem(2),
}


def systems_of(module: str) -> Iterator[tuple[str, Callable[[], System]]]:
    """Yields each System of a module of pydrake that is made without arguments."""
    for name, kind in vars(importlib.import_module(f"pydrake.{module}")).items():
        if isinstance(kind, type) and issubclass(kind, System) and kind not in ABSTRACT:
            try:
                kind()
            except (TypeError, RuntimeError, SystemExit):
                continue
            yield name, kind


def run(system: System, engine: str):
    """Runs a system alone for 0.1 s, with 0.1 or a default value at each input."""
    context = system.CreateDefaultContext()
    for port in InputPorts(system):
        value = np.full(port.size(), 0.1)
        if port.get_data_type() == PortDataType.kAbstractValued:
            value = port.Allocate()
        port.FixValue(context, value)
    return simulate(system, context=context, duration=0.1, engine=engine)


def check(system: System, name: str = "", engine: str = "auto"):
    """Compares both engines at the end of a run, or checks what refuses the run."""
    if not VectorOutputs(system):
        for each in (engine, "drake"):
            with pytest.raises(ScenarioError, match=r"^outputs of .* one vector"):
                run(system, each)
        return
    found = run(system, engine)
    right = run(system, "drake")
    assert (found.termination, right.termination) == ("completed", "completed"), name
    assert found.final_context.get_time() == pytest.approx(0.1, abs=1e-12), name
    for signal in right:
        np.testing.assert_allclose(
            found[signal][-1], right[signal][-1], rtol=1e-6, atol=1e-6, err_msg=name
        )


@pytest.mark.parametrize("module", MODULES)
def test_what_drake_makes_of_nothing_runs_alone(module):
    for name, kind in systems_of(module):
        check(kind(), name)


def systems_in(path: str) -> list[type]:
    """Returns the concrete Systems of a module; none if the module needs a package."""
    try:
        module = importlib.import_module(path)
    except ImportError:
        return []
    public = [x for name, x in vars(module).items() if name[0] != "_"]
    kinds = [x for x in public if isinstance(x, type) and x not in ABSTRACT]
    return [x for x in kinds if issubclass(x, System)]


def test_every_module_of_drake_with_systems_is_named():
    found = set()
    for package in ("pydrake", "pydrake.systems", "pydrake.multibody"):
        folders = importlib.import_module(package).__path__
        names = [module.name for module in pkgutil.iter_modules(folders)]
        public = [name for name in names if name != "all" and name[0] != "_"]
        found |= {f"{package}.{x}" for x in public if systems_in(f"{package}.{x}")}
    assert found <= {f"pydrake.{module}" for module in MODULES}


@pytest.mark.parametrize("make", PRIMITIVES.values(), ids=PRIMITIVES)
def test_a_primitive_runs_alone(make):
    check(make(), engine="compiled")


def block_classes() -> dict[str, type]:
    """Returns the classes of blocks that the package defines, by their names."""
    path = teleop_drake.blocks.__path__
    kinds = {}
    for module in pkgutil.walk_packages(path, "teleop_drake.blocks."):
        for name, kind in vars(importlib.import_module(module.name)).items():
            is_system = isinstance(kind, type) and issubclass(kind, LeafSystem)
            is_base = is_system and (name.startswith("_") or kind.__subclasses__())
            if is_system and not is_base and kind.__module__ == module.name:
                kinds[name] = kind
    return kinds


def record(kind: type, calls: dict[str, Callable], monkeypatch: pytest.MonkeyPatch):
    """Keeps the arguments with which a class is instantiated first."""
    construct = kind.__init__

    def Construct(system, *arguments, **options):
        if type(system) is kind and kind.__name__ not in calls:
            calls[kind.__name__] = lambda: kind(*arguments, **options)
        construct(system, *arguments, **options)

    monkeypatch.setattr(kind, "__init__", Construct)


@pytest.fixture(scope="module")
def makers() -> dict[str, Callable[[], System]]:
    """Returns a maker of each block, as some scenario has it."""
    calls: dict[str, Callable[[], System]] = {}
    with pytest.MonkeyPatch.context() as monkeypatch:
        for kind in block_classes().values():
            record(kind, calls, monkeypatch)
        assert list(Scenes())
    return calls


@pytest.mark.parametrize("name", block_classes())
def test_a_block_of_the_package_runs_alone(name, makers):
    check(makers[name](), engine="compiled")
