"""An operator who moves, and waits until the move is seen to have ended."""

from typing import ClassVar, NamedTuple

import numpy as np

from teleop_drake.arrays import Array, ArrayLike
from teleop_drake.blocks.channels.base import SHORTEST_TIME
from teleop_drake.blocks.environments import Surface
from teleop_drake.blocks.operators.base import ModalOperator, OperatorConfig
from teleop_drake.kernel import Transition
from teleop_drake.laws.operator import operator_mode
from teleop_drake.validation import CheckVector, Config, Number, Refuse

# What the operator does: moves and looks for the motion, watches it, sees the tool at
# rest, is at the goal.
_MOVES = 0.0
_WATCHES = 1.0
_SEES_REST = 2.0
_IS_THERE = 3.0

# A tool that covers less than this share of the tolerance in a reaction time rests.
_REST = 0.1

# The largest speed of a move of least jerk, in multiples of its mean.
_PEAK = 1.875


class Habits(NamedTuple):
    """How an operator moves and waits.

    Attributes:
        goal: Where to, in m (n).
        speed: Largest speed of a long move in m/s.
        share: Part of the distance that a move covers.
        tolerance: Distance from the goal that suffices, in m.
        reaction_time: For how long the tool rests before the next move, in s.
        shortest_move: Duration of short moves in s.
        rest_speed: Speed below which the tool rests, in m/s.
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

    p_0 is where the tool was seen when the move began at t_0. The next move begins when
    the tool has been seen to move faster than `rest_speed`, and then to be slower for a
    reaction time. Within the tolerance of the goal there is no further move. A move
    takes T_m, with the largest speed 1.875 |d|/T_m, and at least `shortest_move`.

    Ports, modes and feedthrough are those of ModalOperator, and another input:

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

    State (discrete, 5 + n): those of ModalOperator; what the operator does (0 moves, 1
    watches, 2 sees the tool at rest, 3 is at the goal); t_0; since when the tool has
    been at rest; p_0. Initial value: the first move begins at once.

    The operator knows nothing of the delay, and waits without end for a tool that does
    not move.

    Source: T. B. Sheridan and W. R. Ferrell, "Remote manipulative control with
    transmission delay", IEEE Trans. Human Factors in Electronics 4 (1963), for the
    strategy; the numbers of this operator are assumed.

    Args:
        config: How the operator moves and waits.
        start: p_WT at time 0 in m (n).
        contact_surface: Where contact is perceived; None: never.
    """

    numeric_parameters: ClassVar = {
        "contact_force": "N",
        "goal": "m",
        "speed": "m/s",
        "share": "",
        "tolerance": "m",
        "reaction_time": "s",
        "shortest_move": "s",
        "rest_speed": "m/s",
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


def _move(mode: Array, habits: Habits) -> tuple[Array, float]:
    """Returns d in m (n) and T_m in s."""
    d = habits.share * (habits.goal - mode[5:])
    fast = _PEAK * np.sqrt(np.sum(d * d)) / habits.speed
    return d, max(fast, habits.shortest_move)


def _excess(felt_velocity: Array, habits: Habits) -> Array:
    """Returns how far the tool is seen above the speed of rest, (m/s)^2 (1)."""
    speed_squared = np.sum(felt_velocity * felt_velocity)
    return np.array([speed_squared - habits.rest_speed**2])


def _does(mode: Array, phase: float) -> bool:
    """Returns whether the operator commands velocities and is in a phase."""
    return bool(operator_mode(mode) == 0 and mode[2] == phase)


def move_velocity(time: float, mode: Array, habits: Habits) -> Array:
    """Returns v_d in m/s (n)."""
    d, duration = _move(mode, habits)
    tau = min(max((time - mode[3]) / duration, 0.0), 1.0)
    shape = 30 * tau**2 * (1 - tau) ** 2 / duration
    return d * shape if mode[2] != _IS_THERE else 0 * d


def speed_of_new_motion(mode: Array, felt_velocity: Array, habits: Habits) -> Array:
    """Returns how far an unwatched tool is above the speed of rest; else -1 (1)."""
    if _does(mode, _MOVES) or _does(mode, _SEES_REST):
        return _excess(felt_velocity, habits)
    return np.full(1, -1.0)


def slowness(mode: Array, felt_velocity: Array, habits: Habits) -> Array:
    """Returns how far a watched tool is below the speed of rest; else -1 (1)."""
    if _does(mode, _WATCHES):
        return -_excess(felt_velocity, habits)
    return np.full(1, -1.0)


def rest_beyond_reaction(mode: Array, time: float, habits: Habits) -> Array:
    """Returns by how much the rest is longer than a reaction time, s; else -1 (1)."""
    if _does(mode, _SEES_REST):
        return np.array([time - mode[4] - habits.reaction_time])
    return np.full(1, -1.0)


def watching(mode: Array) -> Array:
    """Returns the mode of an operator who watches the tool move."""
    return np.concatenate((mode[:2], [_WATCHES], mode[3:]))


def resting(mode: Array, time: float) -> Array:
    """Returns the mode of an operator who sees the tool at rest from now on."""
    return np.concatenate((mode[:2], [_SEES_REST, mode[3], time], mode[5:]))


def planned(mode: Array, time: float, felt_position: Array, habits: Habits) -> Array:
    """Returns the mode after a rest: the next move begins, or there is none."""
    way = habits.goal - felt_position
    is_there = np.sum(way * way) <= habits.tolerance**2
    does = _IS_THERE if is_there else _MOVES
    return np.concatenate((mode[:2], [does, time, mode[4]], felt_position))


@Config
class MoveAndWaitConfig(OperatorConfig):
    """Moves in parts of the remaining way, and waits after each; see the operator.

    |velocity| is the largest speed of a move. The direction has no effect where there
    is a goal.
    """

    kind = "move_and_wait"

    # Where to, m from the start, n entries; null: where `velocity` comes in 1 s.
    goal: np.ndarray | None = None
    # Distance from the goal that suffices, as a share of the whole way, > 0 to 0.99.
    # Assumed.
    tolerance: float = Number(0.02, above=0, maximum=0.99)
    # Part of the remaining way that a move covers, > 0 and <= 1. Assumed.
    share: float = Number(0.8, above=0, maximum=1)
    # For how long the tool is seen at rest before the next move, s, > 0. Assumed.
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
        """Returns what the operator does, from the start p_WT in m (n)."""
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
        """Returns what the linear model leaves out."""
        return "The operator moves or waits: the plan of a next move is not modelled."

    def LongestStep(self) -> float:
        """Returns a quarter of the shortest move in s: no step passes over one."""
        return self.shortest_move / 4
