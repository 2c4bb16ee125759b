"""The signals that are recorded, and the names and paths of systems."""

import itertools
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from types import FunctionType
from typing import Any

from pydrake.systems.framework import (
    Context,
    Diagram,
    LeafSystem,
    OutputPort,
    PortDataType,
    System,
    VectorSystem,
)

from teleop_drake.loops.framework.validation import (
    CheckChoice,
    CheckKind,
    CheckNames,
    Refuse,
)
from teleop_drake.loops.framework.wiring import OutputPorts

# The name that Drake gives to a system without one, as drake/systems/Adder@0000a1b2.
_ADDRESS = re.compile(r"@[0-9a-f]{8,}$")

# Characters that XML does not allow, or that break a line or a label, and the pictures
# of those that have one.
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ufffe\uffff]")
_PICTURES = {chr(code): chr(0x2400 + code) for code in range(32)} | {"\x7f": "\u2421"}


def SignalsOf(system: System) -> dict[str, OutputPort]:
    """Returns the output ports that are recorded for a system, by signal name.

    They are its vector outputs or, for a Diagram that exports none, all vector outputs
    of its systems, named `system.port`. A system without a name is named after its
    class, with a number if there are several.
    """
    parts: list[System] = system.GetSystems() if isinstance(system, Diagram) else []
    return {port.get_name(): port for port in VectorOutputs(system)} or {
        f"{name}.{port.get_name()}": port
        for part, name in zip(parts, NamesOf(parts), strict=True)
        for port in VectorOutputs(part)
    }


Signals = Sequence[str] | Mapping[str, OutputPort]
"""Signals to record: names, or output ports by the names that they get."""


def SelectSignals(system: System, signals: Signals | None) -> Mapping[str, OutputPort]:
    """Returns the output ports to record, by the name of the signal.

    Args:
        signals: The names of signals: those of SignalsOf(), or `path/system.port` for a
            vector output of any system at any depth; or output ports by names of your
            own; None: those of SignalsOf().

    Raises:
        ScenarioError: If there is no such signal.
    """
    if signals is None:
        return SignalsOf(system)
    if isinstance(signals, Mapping):
        return dict(signals)
    CheckNames("signals", signals)
    known = {
        f"{path}.{port.get_name()}" if path else port.get_name(): port
        for part, path in PathsIn(system)
        for port in VectorOutputs(part)
    }
    for name in signals:
        CheckChoice("signals", name, known)
    return {name: known[name] for name in signals}


def Visible(name: str) -> str:
    """Returns a name in which each control character is replaced by its picture."""
    return _CONTROL.sub(lambda found: _PICTURES.get(found[0], "\ufffd"), name)


def NameOf(system: System) -> str:
    """Returns the name of a system, or the name of its class if it has none."""
    return Visible(system.get_name()) if HasName(system) else ClassOf(system)


def CheckSystem(path: str, value: Any) -> None:
    """Refuses an argument that is not a System of Drake's.

    Raises:
        WrongKind: If it is not.
    """
    allowed = "a System of Drake's, such as a Diagram; MakeDiagram(scenario) makes one"
    CheckKind(path, value, System, allowed)


def CheckContext(system: System, context: Any) -> None:
    """Refuses what is no Context of a System.

    Raises:
        ScenarioError: If it is something else, or a Context of another System.
    """
    allowed = f"one of {NameOf(system)}, as diagram.CreateDefaultContext() makes it"
    CheckKind("context", context, Context, allowed)
    try:
        system.ValidateContext(context)
    except (RuntimeError, SystemExit):
        Refuse("context", "a Context", f"one of {NameOf(system)}")


def ClassOf(system: System) -> str:
    """Returns the name of a system's class, also of one that pydrake does not define.

    An example is the InertiaVisualizer of AddDefaultVisualization().
    """
    if type(system) is not System:
        return type(system).__name__
    of_cpp: str = system.GetSystemType()
    return of_cpp.partition("<")[0].rpartition("::")[2]


def IsPlainLeaf(system: Any) -> bool:
    """Returns whether a system is a user's LeafSystem in Python without a kernel.

    A subclass of another class in C++ is none: parts of it are not in Python.
    """
    if not isinstance(system, LeafSystem) or hasattr(system, "Kernel"):
        return False
    own = type(system)
    if own in (LeafSystem, VectorSystem):
        return True
    if own.__module__.startswith(("teleop_drake.", "pydrake.")):
        return False
    in_cpp = [
        x
        for x in own.__mro__
        if x.__module__.startswith("pydrake")
        and not isinstance(vars(x).get("__init__"), FunctionType)
    ]
    return in_cpp[0] in (LeafSystem, VectorSystem)


def IsOfDrake(system: System) -> bool:
    """Returns whether pydrake defines a system's class; false for a user's subclass."""
    return type(system).__module__.partition(".")[0] == "pydrake"


def IsPlant(system: System) -> bool:
    """Returns whether a system is a MultibodyPlant, whose import takes a while."""
    loaded = sys.modules.get("pydrake.multibody.plant")
    return loaded is not None and isinstance(system, loaded.MultibodyPlant)


def PathsIn(system: System, path: str = "") -> Iterator[tuple[System, str]]:
    """Yields a system and all systems in it, each with its path as `robot/plant`.

    A system without a name is named after its class, as in SignalsOf().
    """
    yield system, path
    if isinstance(system, Diagram):
        parts = system.GetSystems()
        for part, name in zip(parts, NamesOf(parts), strict=True):
            own = name.replace("/", "_")
            yield from PathsIn(part, f"{path}/{own}" if path else own)


def SystemsByPath(system: System, path: str = "") -> dict[str, System]:
    """Returns a system and all systems in it by their paths; see PathsIn()."""
    return {own: part for part, own in PathsIn(system, path)}


def HasName(system: System) -> bool:
    """Returns whether a user has named a system."""
    name = system.get_name()
    return bool(name) and not _ADDRESS.search(name)


def NamesOf(systems: Sequence[System]) -> list[str]:
    """Returns a name for each system; unnamed systems of one class are numbered."""
    given: list[str] = [system.get_name() for system in systems]
    if all(x and x.isprintable() and "@" not in x for x in given):
        return given  # The rest takes four times as long.
    taken = set(given)
    classes = Counter(NameOf(system) for system in systems if not HasName(system))
    names = []
    for system in systems:
        name = NameOf(system)
        if not HasName(system) and (classes[name] > 1 or name in taken):
            numbered = (f"{name}{k}" for k in itertools.count(1))
            name = next(x for x in numbered if x not in taken)
        taken.add(name)
        names.append(name)
    return names


def VectorOutputs(system: System) -> list[OutputPort]:
    """Returns the vector-valued output ports of a system."""
    ports = OutputPorts(system)
    return [x for x in ports if x.get_data_type() == PortDataType.kVectorValued]
