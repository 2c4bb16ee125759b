"""An operator who moves, and waits until the tool is seen to have stopped."""

from typing import ClassVar, NamedTuple

import numpy as np
from pydrake.systems.framework import Context

from teleop_drake.loops.delays.base import SHORTEST_TIME
from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import (
    CheckVector,
    Config,
    Number,
    Range,
    Refuse,
)
from teleop_drake.loops.kernel import Transition
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.blocks.operators.base import ModalOperator, OperatorConfig
from teleop_drake.model.laws.operator import operator_mode

# The operator's phases: a move is commanded and the tool is not yet seen to move; the
# tool is seen to move; the tool is seen at rest; the tool has reached the goal.
_MOVES = 0.0
_WATCHES = 1.0
_SEES_REST = 2.0
_IS_THERE = 3.0

# A tool counts as at rest if it moves less than this share of the tolerance in a
# reaction time.
_REST = 0.1

# The ratio of the largest to the mean speed of a minimum-jerk move.
_PEAK = 1.875


class Habits(NamedTuple):
    """The parameters of an operator who moves and waits.

    Attributes:
        goal: Position of the goal in m (n).
        speed: Largest speed of a long move in m/s.
        share: Share of the remaining distance that a move covers.
        tolerance: Distance from the goal at which the goal counts as reached, in m.
        reaction_time: Time at rest before the next move, in s.
        shortest_move: Duration of short moves in s.
        rest_speed: Speed below which the tool counts as at rest, in m/s.
    """

    goal: Array
    speed: float
    share: float
    tolerance: float
    reaction_time: float
    shortest_move: float
    rest_speed: float


class MoveAndWaitOperator(ModalOperator):
    """Moves a part of the way, waits until the tool is seen at rest, and moves again.

        v_d = 30 d/T_m tau^2 (1 - tau)^2,   tau = (t - t_0)/T_m in [0, 1]
        d   = share (goal - p_0)

    p_0 is the felt position of the tool at t_0, when the move begins. The next move
    begins after the felt speed has exceeded `rest_speed` and then has been lower for
    a reaction time. Within the tolerance of the goal there is no further move. A move
    takes T_m = max(1.875 |d|/speed, shortest_move), and its largest speed is
    1.875 |d|/T_m.

    Ports, modes and feedthrough are those of ModalOperator, with a further input:

    | port | name          | size | unit                         |
    |------|---------------|------|------------------------------|
    | in   | felt_velocity | n    | m/s, from the return channel |

    | parameter | name          | unit |
    |-----------|---------------|------|
    | 0         | contact_force | N    |
    | 1         | goal          | m    |
    | 2         | speed         | m/s  |
    | 3         | share         | -    |
    | 4         | tolerance     | m    |
    | 5         | reaction_time | s    |
    | 6         | shortest_move | s    |
    | 7         | rest_speed    | m/s  |

    State (discrete, 5 + n): those of ModalOperator; the phase (0 the operator moves,
    1 the tool is seen to move, 2 it is seen at rest, 3 it has reached the goal); t_0;
    the time at which the tool came to rest; p_0. Initial value: the first move begins
    at once.

    The law does not use the delay. If the tool does not move, the operator waits
    without end.

    Source: T. B. Sheridan and W. R. Ferrell, "Remote manipulative control with
    transmission delay", IEEE Trans. Human Factors in Electronics 4 (1963), for the
    strategy; the numbers of this operator are assumed.

    Args:
        config: The parameters of the operator.
        start: p_WT at time 0 in m (n).
        contact_surface: The surface at which contact is perceived; None: never.
    """

    numeric_parameters: ClassVar = {
        "contact_force": Range("N"),
        "goal": Range("m"),
        "speed": Range("m/s", above=0),
        "share": Range(above=0, maximum=1),
        "tolerance": Range("m", above=0),
        "reaction_time": Range("s", minimum=SHORTEST_TIME),
        "shortest_move": Range("s", minimum=SHORTEST_TIME),
        "rest_speed": Range("m/s", above=0),
    }

    def __init__(
        self,
        config: "MoveAndWaitConfig",
        start: ArrayLike,
        contact_surface: Surface | None = None,
    ):
        place = np.array(start, dtype=float)
        ModalOperator.__init__(
            self,
            place.size,
            (move_velocity, "time", "mode", "habits"),
            {"habits": config.MakeHabits(place)},
            inputs={"felt_velocity": place.size},
            memory=[_MOVES, 0.0, 0.0, *place],
            transitions={
                "sees_motion": Transition(
                    guard=(speed_of_new_motion, "mode", "felt_velocity", "habits"),
                    mode=(watching, "mode"),
                ),
                "sees_rest": Transition(
                    guard=(slowness, "mode", "felt_velocity", "habits"),
                    mode=(resting, "mode", "time"),
                ),
                "plans": Transition(
                    guard=(rest_beyond_reaction, "mode", "time", "habits"),
                    mode=(planned, "mode", "time", "felt_position", "habits"),
                ),
            },
            **config.Modes(contact_surface),
        )
        self.longest_step = config.LongestStep()

    def LongestStep(self, context: Context) -> float:
        """Returns a quarter of the shortest move of a Context in s."""
        habits: Habits = self.kernel_parameters.In(context).values["habits"]
        return habits.shortest_move / 4


def _move(mode: Array, habits: Habits) -> tuple[Array, float]:
    """Returns the displacement d of a move in m (n) and its duration T_m in s."""
    d = habits.share * (habits.goal - mode[5:])
    fast = _PEAK * np.sqrt(np.sum(d * d)) / habits.speed
    return d, max(fast, habits.shortest_move)


def _excess(felt_velocity: Array, habits: Habits) -> Array:
    """Returns the excess of the squared felt speed over that of rest, (m/s)^2 (1)."""
    speed_squared = np.sum(felt_velocity * felt_velocity)
    return np.array([speed_squared - habits.rest_speed**2])


def _does(mode: Array, phase: float) -> bool:
    """Returns whether the operator is in mode 0 and in a given phase."""
    return bool(operator_mode(mode) == 0 and mode[2] == phase)


def move_velocity(time: float, mode: Array, habits: Habits) -> Array:
    """Returns v_d in m/s (n)."""
    d, duration = _move(mode, habits)
    tau = min(max((time - mode[3]) / duration, 0.0), 1.0)
    shape = 30 * tau**2 * (1 - tau) ** 2 / duration
    return d * shape if mode[2] != _IS_THERE else 0 * d


def speed_of_new_motion(mode: Array, felt_velocity: Array, habits: Habits) -> Array:
    """Returns the guard of a tool that starts to move, (m/s)^2 (1); see _excess.

    It is -1 in the other phases.
    """
    if _does(mode, _MOVES) or _does(mode, _SEES_REST):
        return _excess(felt_velocity, habits)
    return np.full(1, -1.0)


def slowness(mode: Array, felt_velocity: Array, habits: Habits) -> Array:
    """Returns the guard of a moving tool that comes to rest, (m/s)^2 (1).

    It is the negative of _excess, and -1 in the other phases.
    """
    if _does(mode, _WATCHES):
        return -_excess(felt_velocity, habits)
    return np.full(1, -1.0)


def rest_beyond_reaction(mode: Array, time: float, habits: Habits) -> Array:
    """Returns the time at rest less the reaction time, in s (1).

    It is -1 in the other phases.
    """
    if _does(mode, _SEES_REST):
        return np.array([time - mode[4] - habits.reaction_time])
    return np.full(1, -1.0)


def watching(mode: Array) -> Array:
    """Returns the mode after the tool is seen to move."""
    return np.concatenate((mode[:2], [_WATCHES], mode[3:]))


def resting(mode: Array, time: float) -> Array:
    """Returns the mode after the tool is seen to come to rest, at `time`."""
    return np.concatenate((mode[:2], [_SEES_REST, mode[3], time], mode[5:]))


def planned(mode: Array, time: float, felt_position: Array, habits: Habits) -> Array:
    """Returns the mode after a rest: a move begins, or the goal is reached."""
    way = habits.goal - felt_position
    is_there = np.sum(way * way) <= habits.tolerance**2
    does = _IS_THERE if is_there else _MOVES
    return np.concatenate((mode[:2], [does, time, mode[4]], felt_position))


@Config
class MoveAndWaitConfig(OperatorConfig):
    """An operator who moves in parts of the remaining way, and waits after each.

    |velocity| is the largest speed of a move. If there is a goal, the direction of
    `velocity` has no effect. See MoveAndWaitOperator.
    """

    kind = "move_and_wait"

    # Goal relative to the start, m, n entries. Null: the displacement of `velocity` in
    # 1 s.
    goal: np.ndarray | None = None
    # Distance at which the goal counts as reached, as a share of the whole way, > 0 to
    # 0.99. Assumed.
    tolerance: float = Number(0.02, above=0, maximum=0.99)
    # Share of the remaining way that a move covers, > 0 and <= 1. Assumed.
    share: float = Number(0.8, above=0, maximum=1)
    # Time for which the tool is seen at rest before the next move, s, > 0. Assumed.
    reaction_time: float = Number(0.2, "s", minimum=SHORTEST_TIME)
    # Duration of short moves, s. Assumed.
    shortest_move: float = Number(0.3, "s", minimum=SHORTEST_TIME)

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field; see OperatorConfig.Check."""
        super().Check(path, num_axes)
        if num_axes == 6:
            Refuse(f"{path}.kind", self.kind, "one that can turn a tool, for six axes")
        if self.goal is not None:
            CheckVector(f"{path}.goal", self.goal, num_axes, "m")
            if not np.any(self.goal):
                Refuse(f"{path}.goal", self.goal, "non-zero on at least one axis (m)")

    def MakeHabits(self, start: Array) -> Habits:
        """Returns the operator's parameters; `start` is p_WT at time 0 in m (n)."""
        velocity = np.array(self.velocity, dtype=float)
        way = velocity if self.goal is None else np.array(self.goal, dtype=float)
        tolerance = float(self.tolerance * np.linalg.norm(way))
        return Habits(
            goal=start + way,
            speed=float(np.linalg.norm(velocity)),
            share=float(self.share),
            tolerance=tolerance,
            reaction_time=float(self.reaction_time),
            shortest_move=float(self.shortest_move),
            rest_speed=_REST * tolerance / float(self.reaction_time),
        )

    def MakeOperator(
        self, *, start: ArrayLike, contact_surface: Surface | None = None
    ) -> MoveAndWaitOperator:
        """Makes the block; see OperatorConfig.MakeOperator."""
        return MoveAndWaitOperator(self, start, contact_surface)

    def LinearNote(self) -> str:
        """Returns the sentence on what the linear model leaves out."""
        return "The operator moves or waits: the plan of a next move is not modelled."

    def LongestStep(self) -> float:
        """Returns a quarter of the shortest move in s, so that no step skips a move."""
        return self.shortest_move / 4
