"""The four systems between the channels, and the cuts that open their loop."""

from dataclasses import dataclass, field
from itertools import chain
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Diagram, System

from teleop_drake.analysis.cut_diagram import Cut, CutDiagram, States
from teleop_drake.analysis.loop_model import Signals
from teleop_drake.engine.flatten import Block
from teleop_drake.kernel.linear_part import LinearPartOf
from teleop_drake.validation import ScenarioError, Within

SLAVE = ("controller", "environment", "robot")
PARTS = ("master", *SLAVE)
"""The systems that a linear model is made of; the channels are cut."""


@dataclass(eq=False)
class LoopPart:
    """The blocks of one of the four systems, as they describe themselves.

    Attributes:
        blocks: The blocks.
        states: Those of their states that are states of the model.
        delays: Cuts at constant delays inside.
        delay_times: Their delays in s, an entry for each signal.
        assumptions: What the linear model takes for granted, see linear_part.
    """

    blocks: list[System] = field(default_factory=list)
    states: list[States] = field(default_factory=list)
    delays: list[Cut] = field(default_factory=list)
    delay_times: list[float] = field(default_factory=list)
    assumptions: set[str] = field(default_factory=set)


def ReadLoopParts(opened: CutDiagram) -> dict[str, LoopPart]:
    """Returns the four systems of a teleoperator by their names.

    Raises:
        ScenarioError: If a block has no linear model, or a state that is not
            continuous.
    """
    parts = {name: LoopPart() for name in PARTS}
    for block in opened.blocks:
        name = block.path.split("/")[0]
        if name in parts:
            _AddBlock(parts[name], name, block, opened)
    return parts


def _AddBlock(part: LoopPart, name: str, block: Block, opened: CutDiagram) -> None:
    """Adds what a block describes itself to be."""
    system = block.system
    context = opened.contexts[system]
    with Within(name):
        described = LinearPartOf(system)
    part.blocks.append(system)
    part.assumptions.add(described.assumption)
    if described.delay:
        cut = opened.CutAtDelay(system)
        part.delays.append(cut)
        part.delay_times += [described.delay] * len(cut.value)
    is_sampled = context.num_discrete_state_groups() and not described.has_modes
    if described.delay is None and (is_sampled or context.num_abstract_states()):
        raise ScenarioError(
            f"{name}.{system.get_name()} = a state that is not continuous: must "
            "be continuous for a linear model"
        )
    size = described.num_states
    if size is None:
        size = context.num_continuous_states()
    if size:
        part.states.append(States(system, context, size))


class LoopCuts(NamedTuple):
    """The cuts that open the loop, in the order of the signals of its model.

    Attributes:
        hand: The force at the operator's hand; empty for the loop.
        tool: The force at the tool; empty for the loop.
        forward: The forward channel.
        inner_slave: Delays in the slave.
        back: The return channel.
        inner_master: Delays in the master.
    """

    hand: list[Cut]
    tool: list[Cut]
    forward: list[Cut]
    inner_slave: list[Cut]
    back: list[Cut]
    inner_master: list[Cut]

    def Signals(self) -> Signals:
        """Returns the places of what each of the cuts delivers among all signals."""
        sizes = [sum(len(cut.value) for cut in cuts) for cuts in self]
        ends = np.cumsum(sizes)
        return Signals(*np.split(np.arange(ends[-1]), ends[:-1]))


def CutTeleoperator(
    teleoperator: Diagram,
    opened: CutDiagram,
    parts: dict[str, LoopPart],
    *,
    at_ports: bool,
) -> LoopCuts:
    """Returns the cuts that open the loop of a teleoperator.

    Args:
        opened: The teleoperator.
        parts: Its parts, by ReadLoopParts().
        at_ports: Whether it is cut at the hand and at the tool, too.
    """
    master = teleoperator.GetSubsystemByName("master")
    controller = teleoperator.GetSubsystemByName("controller")
    hand = []
    tool = []
    if at_ports:
        device = master.GetSubsystemByName("haptic_device")
        environment = teleoperator.GetSubsystemByName("environment")
        hand = [opened.CutAt(device.GetOutputPort("haptic_force"))]
        tool = [opened.CutAt(environment.GetOutputPort("environment_force"))]
    forward = opened.CutAt(
        controller.GetInputPort("forward_packet"),
        master.GetOutputPort("forward_packet"),
    )
    back = opened.CutAt(
        master.GetInputPort("return_packet"),
        controller.GetOutputPort("return_packet"),
    )
    return LoopCuts(
        hand=hand,
        tool=tool,
        forward=[forward],
        inner_slave=list(chain.from_iterable(parts[name].delays for name in SLAVE)),
        back=[back],
        inner_master=parts["master"].delays,
    )
