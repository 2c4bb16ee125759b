"""The blocks of a teleoperator's loop, and the cuts that open the loop."""

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Diagram, System

from teleop_drake.loops.framework.validation import ScenarioError, Within
from teleop_drake.loops.kernel.linear_part import LinearPart, LinearPartOf
from teleop_drake.loops.linear.cut_diagram import Cut, CutDiagram
from teleop_drake.loops.linear.states import States
from teleop_drake.study.analysis.loop_model import AtCuts, Signals

PARTS = ("master", "controller", "environment", "robot")
"""The systems that make up the linear model; the channels between them are cut."""


class LoopBlock(NamedTuple):
    """A block of one of the four systems, and its contribution to the linear model.

    Attributes:
        part: Name of the system that contains the block.
        system: The block.
        described: The linear part that the block declares.
        states: The block's states that are states of the model; None if there are none.
        cut: The cut at the block if it is a delay, otherwise None.
    """

    part: str
    system: System
    described: LinearPart
    states: States | None
    cut: Cut | None


def ReadLoopBlocks(opened: CutDiagram) -> list[LoopBlock]:
    """Returns the blocks of the four systems of a teleoperator.

    Raises:
        ScenarioError: If a block has no linear model, or a state that is not
            continuous.
    """
    found = []
    for block in opened.blocks:
        part = block.path.split("/")[0]
        if part not in PARTS:
            continue
        system = block.system
        context = opened.contexts[system]
        with Within(part):
            described = LinearPartOf(system)
        is_sampled = context.num_discrete_state_groups() and not described.has_modes
        if described.delay is None and (is_sampled or context.num_abstract_states()):
            raise ScenarioError(
                f"{part}.{system.get_name()} = a state that is not continuous: must "
                "be continuous for a linear model"
            )
        size = described.num_states
        if size is None:
            size = context.num_continuous_states()
        states = States(system, context, size) if size else None
        cut = opened.CutAtDelay(system) if described.delay else None
        found.append(LoopBlock(part, system, described, states, cut))
    return found


def StatesOf(blocks: list[LoopBlock], part: str) -> list[States]:
    """Returns the states of the model that belong to one of the four systems."""
    return [x.states for x in blocks if x.part == part and x.states is not None]


LoopCuts = AtCuts[list[Cut]]
"""The cuts that open the loop of a teleoperator."""


def SignalsAt(cuts: LoopCuts) -> Signals:
    """Returns the indices of each group's signals among the signals of all cuts."""
    sizes = [sum(len(cut.value) for cut in group) for group in cuts]
    ends = np.cumsum(sizes)
    return Signals(*np.split(np.arange(ends[-1]), ends[:-1]))


def CutTeleoperator(
    teleoperator: Diagram,
    opened: CutDiagram,
    blocks: list[LoopBlock],
    *,
    at_ports: bool,
) -> LoopCuts:
    """Returns the cuts that open the loop of a teleoperator.

    Args:
        teleoperator: The teleoperator.
        opened: The teleoperator as a function.
        blocks: The result of ReadLoopBlocks().
        at_ports: Whether the teleoperator is also cut at the hand and at the tool.
    """
    master = teleoperator.GetSubsystemByName("master")
    controller = teleoperator.GetSubsystemByName("controller")
    # Forces at the ports are cut where the haptic device and the environment exert
    # them.
    hand = []
    tool = []
    if at_ports:
        device = master.GetSubsystemByName("haptic_device")
        environment = teleoperator.GetSubsystemByName("environment")
        hand = [opened.CutAt(device.GetOutputPort("haptic_force"))]
        tool = [opened.CutAt(environment.GetOutputPort("environment_force"))]
    # A channel is bypassed: its cut is at the receiving station's port, and the signal
    # that enters it is the packet that the other station sends.
    forward = opened.CutAt(
        controller.GetInputPort("forward_packet"),
        master.GetOutputPort("forward_packet"),
    )
    back = opened.CutAt(
        master.GetInputPort("return_packet"),
        controller.GetOutputPort("return_packet"),
    )
    delays = [(x.part == "master", x.cut) for x in blocks if x.cut is not None]
    return LoopCuts(
        hand=hand,
        tool=tool,
        forward=[forward],
        inner_slave=[cut for is_master, cut in delays if not is_master],
        back=[back],
        inner_master=[cut for is_master, cut in delays if is_master],
    )
