"""Checks of a system before a run: its inputs, and its initialization events."""

from collections.abc import Collection, Mapping

from pydrake.systems.framework import (
    Context,
    InputPort,
    OutputPort,
    PortDataType,
    System,
)

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import Flatten, InputsOf
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.signals import IsPlainLeaf, IsPlant, NameOf
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.framework.wiring import InputPorts

_ALLOWED = "connected to a source, or fixed: port.FixValue(context, value)"


def CheckInputs(system: System, context: Context) -> None:
    """Refuses an input of a system that is neither connected nor fixed, by name.

    Args:
        context: The Context of the system.

    Raises:
        ScenarioError: If an input that the system, or a block in it, needs has no
            value.
    """
    _CheckPorts(NameOf(system), system, context)
    contexts = ContextsIn(system, context)
    for block in Flatten(system):
        if _NeedsInputs(block.system):
            _CheckPorts(block.path, block.system, contexts[block.system], block.inputs)


def CheckInitialization(
    diagram: System, context: Context | None, signals: Mapping[str, OutputPort]
) -> None:
    """Refuses a diagram that cannot be compiled, before a user's initialization events.

    They may have effects outside of the Context, and are executed only once.

    Raises:
        UnsupportedSystem: If a block cannot be compiled.
    """
    own = [x.system for x in Flatten(diagram) if IsPlainLeaf(x.system)]
    if not own:
        return
    # Systems without a block of a user's in Python need none of this.
    from teleop_drake.loops.engine.leaf_tracing import HasInitialization

    if any(map(HasInitialization, own)):
        start = diagram.CreateDefaultContext() if context is None else context
        Evaluator(diagram, start, recorded=signals.values())


def _CheckPorts(
    name: str, system: System, context: Context, connected: Collection[str] = ()
) -> None:
    """Refuses an input of one system that has neither a source nor a value.

    Args:
        name: The name of the system, for messages.
        connected: The names of the inputs that have a source in the Diagram.
    """
    for port in InputPorts(system):
        has_value = port.get_name() in connected or port.HasValue(context)
        if not (has_value or _IsOptional(port)):
            Refuse(f"input of {name}", port.get_name(), _ALLOWED)


def _NeedsInputs(block: System) -> bool:
    """Returns whether it is known which inputs a block requires."""
    is_primitive = type(block).__module__ == "pydrake.systems.primitives"
    return is_primitive or hasattr(block, "Kernel")


def _IsOptional(port: InputPort) -> bool:
    """Returns whether no block requires a value of an input."""
    return all(
        IsPlant(leaf.get_system())
        or leaf.get_data_type() == PortDataType.kAbstractValued
        or leaf.get_name() in getattr(leaf.get_system(), "optional_inputs", ())
        for leaf in LeafInputs(port)
    )


def LeafInputs(port: InputPort) -> list[InputPort]:
    """Returns the inputs of blocks to which an input is connected inside a Diagram."""
    found = InputsOf(port.get_system(), int(port.get_index()))
    return [system.GetInputPort(name) for system, name in found]
