"""Each block of the package, and each System of pydrake, runs by itself."""

import importlib
import pkgutil
from collections.abc import Callable

import numpy as np
import pytest
from drake_systems import WITH_ARGUMENTS, FindClasses, FindSystems
from numpy.testing import assert_allclose
from pydrake.multibody.plant import MultibodyPlant
from pydrake.planning import RobotDiagram
from pydrake.systems.framework import LeafSystem, PortDataType, System
from test_block_table import Scenes

from teleop_drake import loops, model, simulate
from teleop_drake.loops.framework.signals import VectorOutputs
from teleop_drake.loops.framework.wiring import InputPorts


def run(system: System, engine: str):
    """Runs a system alone for 0.1 s, with 0.1 or a default value at each input."""
    context = system.CreateDefaultContext()
    for port in InputPorts(system):
        value = np.full(port.size(), 0.1)
        if port.get_data_type() == PortDataType.kAbstractValued:
            if isinstance(system, MultibodyPlant | RobotDiagram):
                continue  # Left open, as usual.
            value = system.AllocateInputAbstract(port)
        port.FixValue(context, value)
    return simulate(system, context=context, duration=0.1, engine=engine)


def check(system: System, engine: str = "auto"):
    """Compares both engines at the end of a run, if anything is recorded."""
    if not VectorOutputs(system):
        return  # Drake itself fails with empty images and messages at the inputs.
    found = run(system, engine)
    right = run(system, "drake")
    assert (found.termination, right.termination) == ("completed", "completed")
    assert found.final_context.get_time() == pytest.approx(0.1, abs=1e-12)
    for signal in right:
        assert_allclose(
            found[signal][-1], right[signal][-1], rtol=1e-6, atol=1e-6, err_msg=signal
        )


NOT_ALONE = {
    # Drake ends in an error, or crashes, without true values at their inputs.
    *("Accelerometer", "Gyroscope", "PortSwitch", "Wing"),
    *("RgbdSensorAsync", "RgbdSensorDiscrete"),
    "VectorSystem",  # Its subclasses have outputs.
    # Drake keeps its rate although the state changes, if the inputs are fixed.
    "LuenbergerObserver",
}


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", sorted({*FindSystems()} - NOT_ALONE))
def test_a_system_of_drake_runs_alone(name):
    make = WITH_ARGUMENTS.get(name) or FindClasses()[name]
    check(make())


OWN = "teleop_drake."


def BlockModules():
    """Yields the modules of the rooms that have blocks."""
    for room in (loops.blocks, loops.delays, model.blocks):
        for found in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            yield importlib.import_module(found.name)


def block_classes() -> dict[str, type]:
    """Returns the classes of blocks that the package defines, by their names."""
    kinds = {}
    for module in BlockModules():
        for name, kind in vars(module).items():
            is_system = isinstance(kind, type) and issubclass(kind, LeafSystem)
            # Other tests may have defined subclasses, too.
            is_base = is_system and (
                name.startswith("_")
                or any(x.__module__.startswith(OWN) for x in kind.__subclasses__())
            )
            if is_system and not is_base and kind.__module__ == module.__name__:
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


def test_an_observer_runs_alone_as_on_paper():
    """x' = -x + u + (y - x) with u = y = 0.1."""
    recording = run(WITH_ARGUMENTS["LuenbergerObserver"](), "compiled")
    right = 0.1 * (1.0 - np.exp(-2.0 * 0.1))
    assert recording["estimated_state"][-1, 0] == pytest.approx(right, abs=1e-9)


# Its output is no vector.
NO_VECTOR = {"AbstractDelay"}


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", sorted(block_classes().keys() - NO_VECTOR))
def test_a_block_of_the_package_runs_alone(name, makers):
    check(makers[name](), engine="compiled")
