"""The four systems between the channels, and the cuts that open their loop."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import Diagram, System

from teleop_drake.analysis.cut_diagram import (
    Contexts,
    Cut,
    CutAtDelay,
    CutBehind,
    States,
)
from teleop_drake.analysis.loop_model import Signals
from teleop_drake.arrays import Indices
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


def ReadLoopParts(blocks: list[Block], contexts: Contexts) -> dict[str, LoopPart]:
    """Returns the four systems of a teleoperator by their names.

    Args:
        blocks: Those of the teleoperator.
        contexts: Of every system in it.

    Raises:
        ScenarioError: If a block has no linear model, or a state that is not
            continuous.
    """
    parts = {name: LoopPart() for name in PARTS}
    for block in blocks:
        name = block.path.split("/")[0]
        if name in parts:
            _AddBlock(parts[name], name, block, blocks, contexts)
    return parts


def _AddBlock(
    part: LoopPart, name: str, block: Block, blocks: list[Block], contexts: Contexts
) -> None:
    """Adds what a block describes itself to be."""
    system = block.system
    context = contexts[system]
    with Within(name):
        described = LinearPartOf(system)
    part.blocks.append(system)
    part.assumptions.add(described.assumption)
    if described.delay:
        cut = CutAtDelay(blocks, system, contexts)
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


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopCuts:
    """The cuts that open the loop, in the order of the signals of its model.

    Attributes:
        ports: Cuts at the operator's hand and at the tool; empty for the loop.
        forward: The forward channel.
        inner_slave: Delays in the slave.
        back: The return channel.
        inner_master: Delays in the master.
    """

    ports: Sequence[Cut]
    forward: Cut
    inner_slave: Sequence[Cut]
    back: Cut
    inner_master: Sequence[Cut]

    @property
    def all(self) -> list[Cut]:
        """All cuts, in their order."""
        delays = [self.forward, *self.inner_slave, self.back, *self.inner_master]
        return [*self.ports, *delays]

    @property
    def num_signals(self) -> int:
        """How many signals are delivered at all cuts."""
        return sum(len(cut.value) for cut in self.all)

    def Places(self, *cuts: Cut) -> Indices:
        """Returns the places of what some cuts deliver among all signals."""
        places: list[int] = []
        first = 0
        for cut in self.all:
            end = first + len(cut.value)
            if cut in cuts:
                places += range(first, end)
            first = end
        return np.array(places, dtype=np.intp)

    def Signals(self) -> Signals:
        """Returns which of the delayed signals pass which delay."""
        first = self.Places(self.forward)[0]
        return Signals(
            forward=self.Places(self.forward) - first,
            inner_slave=self.Places(*self.inner_slave) - first,
            back=self.Places(self.back) - first,
            inner_master=self.Places(*self.inner_master) - first,
        )


def CutTeleoperator(
    teleoperator: Diagram,
    parts: dict[str, LoopPart],
    contexts: Contexts,
    *,
    at_ports: bool,
) -> LoopCuts:
    """Returns the cuts that open the loop of a teleoperator.

    Args:
        parts: Its parts, by ReadLoopParts().
        contexts: Of every system in it.
        at_ports: Whether it is cut at the hand and at the tool, too.
    """
    master, controller, environment, robot = (
        teleoperator.GetSubsystemByName(name)
        for name in ("master", "controller", "environment", "robot")
    )
    ports = []
    if at_ports:
        device = master.GetSubsystemByName("haptic_device")
        operator = master.GetSubsystemByName("surgeon")
        hand = CutBehind(
            device.GetOutputPort("haptic_force"),
            [operator.GetInputPort("haptic_force")],
            contexts,
        )
        tool = CutBehind(
            environment.GetOutputPort("environment_force"),
            [x.GetInputPort("environment_force") for x in (robot, controller)],
            contexts,
        )
        ports = [hand, tool]
    return LoopCuts(
        ports=ports,
        forward=CutBehind(
            master.GetOutputPort("forward_packet"),
            [controller.GetInputPort("forward_packet")],
            contexts,
        ),
        inner_slave=[cut for name in SLAVE for cut in parts[name].delays],
        back=CutBehind(
            controller.GetOutputPort("return_packet"),
            [master.GetInputPort("return_packet")],
            contexts,
        ),
        inner_master=parts["master"].delays,
    )
