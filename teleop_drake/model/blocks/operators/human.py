"""An operator who reacts to the tool's motion and force: a human in the loop."""

import math
from typing import ClassVar

import numpy as np
from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import Demultiplexer, LinearSystem, Multiplexer

from teleop_drake.loops.delays.base import SHORTEST_TIME, CheckDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.validation import (
    CheckChoice,
    Config,
    Number,
    Range,
    Refuse,
)
from teleop_drake.loops.framework.wiring import Wire
from teleop_drake.loops.kernel import Term
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.blocks.operators.base import ModalOperator, OperatorConfig
from teleop_drake.model.laws.operator import (
    HumanOperator,
    intended_velocity,
    rate_to_position,
    rate_to_velocity,
)
from teleop_drake.model.laws.transfer_function import all_pass_of_delay

GOALS = ("position", "velocity")
"""The quantities that a human may track."""

# Order of the Pade approximation of exp(-s tau), which is right to 0.11 % up to
# |s| tau = 6.
_PADE_ORDER = 6


class HumanHand(ModalOperator):
    """The law of a human without the reaction delay; see laws.operator.

    The inputs felt_position and perceived_motion are delayed already.

    | port | name             | size | unit                                     |
    |------|------------------|------|------------------------------------------|
    | in   | haptic_force     | n    | N                                        |
    | in   | felt_position    | n    | m, as it is perceived: a reaction delay ago |
    | in   | perceived_motion | 2n   | [p, v] in m and m/s, likewise            |
    | out  | velocity_command | n    | m/s                                      |
    | out  | force_command    | n    | N                                        |
    | out  | mode             | 1    | 0, 1 or 2; see ModalOperator             |

    | parameter | name          | unit  |
    |-----------|---------------|-------|
    | 0         | velocity      | m/s   |
    | 1         | contact_force | N     |
    | 2         | crossover     | rad/s |
    | 3         | mass          | kg    |
    | 4         | damping       | N s/m |
    | 5         | stiffness     | N/m   |

    State (continuous): [v_i, y, w] (3n), and e (n) if the goal is a velocity. The
    discrete state is that of ModalOperator.

    Initial value: at rest.

    Direct feedthrough: haptic_force to force_command; nothing else.

    It models no remnant (the noise of a human), and does not adapt to the dynamics of
    the haptic device.

    Args:
        human: The parameters of the law.
        goal: One of GOALS.
        contact_force: Force after contact in N (n); None: contact is never perceived.
        contact_surface: The surface at which contact is perceived; None: never.
        stop_time: The time of the stop in s; None: never.
    """

    numeric_parameters: ClassVar = {
        "velocity": Range("m/s"),
        "contact_force": Range("N"),
        "crossover": Range("rad/s", above=0),
        "mass": Range("kg", above=0),
        "damping": Range("N s/m", minimum=0),
        "stiffness": Range("N/m", minimum=0),
    }

    def __init__(
        self,
        human: HumanOperator,
        goal: str,
        *,
        contact_force: ArrayLike | None = None,
        contact_surface: Surface | None = None,
        stop_time: float | None = None,
    ):
        CheckChoice("goal", goal, GOALS)
        n = human.velocity.size
        # The state is [v_i, y, w], followed by e if the goal is a velocity.
        inputs = ("perceived_motion", "haptic_force", "human")
        rate: Term = (rate_to_velocity, "state", *inputs)
        num_states = 4 * n
        if goal == "position":
            rate = (rate_to_position, "state", "time", *inputs)
            num_states = 3 * n
        ModalOperator.__init__(
            self,
            n,
            (intended_velocity, "state", "human"),
            {"human": human},
            inputs={"perceived_motion": 2 * n},
            rate=rate,
            state=np.zeros(num_states),
            contact_force=contact_force,
            contact_surface=contact_surface,
            stop_time=stop_time,
        )


class HumanStation(Diagram):
    """A human: a reaction delay, followed by the law.

    It has all ports of OperatorConfig.MakeOperator.

    Args:
        hand: The law.
        reaction: The delay of [p, v] (2n), or a linear approximation of it.
    """

    def __init__(self, hand: HumanHand, reaction: System):
        Diagram.__init__(self)
        n = hand.GetInputPort("felt_position").size()
        hand.set_name("hand")
        reaction.set_name("reaction")
        Wire(
            self,
            "human",
            {
                "motion": Multiplexer([n, n]),
                "reaction": reaction,
                "parts": Demultiplexer([n, n]),
                "hand": hand,
            },
            inputs={
                "haptic_force": ["hand.haptic_force"],
                "felt_position": ["motion.u0"],
                "felt_velocity": ["motion.u1"],
            },
            connections={
                "reaction": "motion",
                "hand.perceived_motion": "reaction",
                "parts": "reaction",
                "hand.felt_position": "parts.y0",
            },
            outputs={
                "velocity_command": "hand.velocity_command",
                "force_command": "hand.force_command",
                "mode": "hand.mode",
            },
        )


@Config
class HumanConfig(OperatorConfig):
    """A human who closes the loop: crossover model, reaction delay, yielding arm.

    The human makes the tool follow a goal that moves with `velocity` from the tool's
    start, or makes it keep that velocity. Contact is perceived a reaction delay after
    it is felt. See laws.operator for the equations and their sources.
    """

    kind = "human"

    # One of GOALS.
    goal: str = "position"
    # omega_c, rad/s, > 0. Assumed: McRuer and Jex 1967 report 3 to 5 without delay, and
    # humans lower it if there is a delay. With 1, the adaptive controller is stable in
    # the thesis's tasks.
    crossover_frequency: float = Number(1.0, "rad/s", above=0)
    # tau, s, >= 0. Assumed: McRuer and Jex 1967 report 0.1 to 0.2.
    reaction_delay: float = 0.15
    # T_N, s, > 0. Assumed: McRuer and Jex 1967 report about 0.1.
    neuromuscular_lag: float = Number(0.1, "s", minimum=SHORTEST_TIME)
    # Mass of the arm, kg, > 0. Assumed: of the order of Tsuji et al. 1995.
    arm_mass: float = Number(1.0, "kg", above=0)
    # Damping of the arm, N s/m, >= 0. Assumed: likewise.
    arm_damping: float = Number(20.0, "N s/m", minimum=0)
    # Stiffness of the arm, N/m, >= 0. Assumed: likewise.
    arm_stiffness: float = Number(200.0, "N/m", minimum=0)

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field; see OperatorConfig.Check."""
        super().Check(path, num_axes)
        if num_axes == 6:
            Refuse(f"{path}.kind", self.kind, "one without an arm for six axes")
        CheckChoice(f"{path}.goal", self.goal, GOALS)
        CheckDelay(f"{path}.reaction_delay", self.reaction_delay)

    def MakeOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> HumanStation:
        """Makes the block; see OperatorConfig.MakeOperator."""
        n = np.size(start)
        reaction = TransportDelay(
            delay=self.reaction_delay,
            size=2 * n,
            initial_value=[*np.asarray(start, dtype=float).tolist(), *[0.0] * n],
            max_sample_interval=math.inf,
        )
        return HumanStation(self._MakeHand(start, contact_surface), reaction)

    def MakeLinearOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> HumanStation:
        """Makes the block with an all-pass of order 6 as the reaction delay."""
        if self.reaction_delay == 0:
            return self.MakeOperator(start=start, contact_surface=contact_surface)
        matrices = all_pass_of_delay(
            self.reaction_delay, order=_PADE_ORDER, num_axes=2 * np.size(start)
        )
        hand = self._MakeHand(start, contact_surface)
        return HumanStation(hand, LinearSystem(*matrices))

    def LinearNote(self) -> str | None:
        """Returns a sentence on the approximation of the reaction delay, or None."""
        if self.reaction_delay == 0:
            return None
        return (
            f"The human's reaction delay of {self.reaction_delay:g} s is a Pade "
            f"approximation of order {_PADE_ORDER}, which is right to 0.11 % up to "
            f"{6 / self.reaction_delay:.3g} rad/s."
        )

    def LongestStep(self) -> float:
        """Returns the reaction delay in s, or infinity if there is none."""
        return self.reaction_delay or math.inf

    def _MakeHand(self, start: ArrayLike, contact_surface: Surface | None) -> HumanHand:
        return HumanHand(
            human=HumanOperator(
                start=np.array(start, dtype=float),
                velocity=np.array(self.velocity, dtype=float),
                crossover=float(self.crossover_frequency),
                lag=float(self.neuromuscular_lag),
                mass=float(self.arm_mass),
                damping=float(self.arm_damping),
                stiffness=float(self.arm_stiffness),
            ),
            goal=self.goal,
            **self.Modes(contact_surface),
        )
