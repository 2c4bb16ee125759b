"""One side of the loop between its cuts, as something to take differences of."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from teleop_drake.analysis.cut_diagram import (
    STEP,
    Concatenate,
    FixedInput,
    InnerDelay,
    SetStates,
    States,
)
from teleop_drake.analysis.tool_motion import ToolMotion
from teleop_drake.numerics.differences import differentiate
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.validation import ScenarioError

Array = NDArray[np.float64]

LinearSide = tuple[StateSpace, StateSpace]
"""A model and the estimated error of each of its entries."""

# Slopes on both sides that differ by more than this share of the largest are a bend.
_BEND = 1e-4


class SideOfLoop:
    """The master, or controller, robot and environment.

    Args:
        name: What it is called in messages.
        inputs: What is set.
        outputs: What is seen.
        states: Those of the model, without the robot's.
        delays: Those inside, which become inputs and outputs behind the others.
        motion: Of the robot, whose coordinates come before the other states; None:
            there is no robot.
        input_scale: How far inputs may change for it to be nearly linear.
    """

    def __init__(
        self,
        name: str,
        *,
        inputs: Sequence[FixedInput],
        outputs: Sequence[Callable[[], Array]],
        states: Sequence[States],
        delays: Sequence[InnerDelay],
        motion: ToolMotion | None = None,
        input_scale: float = math.inf,
    ):
        self._name = name
        self._input_step = STEP * min(1.0, input_scale)
        self._inputs: list[FixedInput | InnerDelay] = [*inputs, *delays]
        self._outputs = [*outputs, *(delay.GetInput for delay in delays)]
        self._states, self._motion = states, motion
        self._all_states = [motion.states, *states] if motion else [*states]

    def Linearize(self, point_name: str, steps: Sequence[Array] = ()) -> LinearSide:
        """Returns the model at what the Context holds, and its error.

        Args:
            point_name: What the operating point is called in messages.
            steps: The longest steps of the robot's states.

        Raises:
            ScenarioError: If the side has no linear model there.
        """
        x0 = Concatenate([x.Get() for x in self._all_states])
        u0 = Concatenate([x.Get() for x in self._inputs])
        x_steps = Concatenate([*steps, *(x.Steps() for x in self._states)])
        by_x, error_x, bend_x = differentiate(self._OfState, x0, x_steps)
        SetStates(self._all_states, x0)
        u_steps = np.full(len(u0), self._input_step)
        by_u, error_u, bend_u = differentiate(self._OfInput, u0, u_steps)
        self._OfInput(u0)
        for bend, slope in ((bend_x, by_x), (bend_u, by_u)):
            if bend.size and bend.max() > _BEND * np.abs(slope).max():
                raise ScenarioError(
                    f"{self._name} = a law that bends at the operating point "
                    f"{point_name!r}, as one that switches there: must have one linear "
                    "model"
                )
        # The coordinates are a function of the state: d/d(coordinates).
        size = len(x0)
        to_coordinates = np.linalg.inv(by_x[:size])
        by_z = by_x[size:] @ to_coordinates
        error_z = error_x[size:] + np.abs(by_z) @ error_x[:size]
        error_z = error_z @ np.abs(to_coordinates)
        model, error = (
            StateSpace(A=z[:size], B=u[:size], C=z[size:], D=u[size:])
            for z, u in ((by_z, by_u[size:]), (error_z, error_u[size:]))
        )
        return model, error

    def _OfState(self, x: Array) -> Array:
        SetStates(self._all_states, x)
        return self._Evaluate()

    def _OfInput(self, u: Array) -> Array:
        ends = np.cumsum([len(x.Get()) for x in self._inputs])[:-1]
        for port, value in zip(self._inputs, np.split(u, ends), strict=True):
            port.Set(value)
        return self._Evaluate()

    def _Evaluate(self) -> Array:
        """Returns [coordinates, their rates, outputs]."""
        motion = self._motion
        return Concatenate(
            [
                *([motion.Coordinates()] if motion else []),
                *(x.Get() for x in self._states),
                *([motion.Rates()] if motion else []),
                *(x.GetRates() for x in self._states),
                *(Output() for Output in self._outputs),
            ]
        )
