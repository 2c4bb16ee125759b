"""The robot's state in the coordinates of the linear model.

A robot of m joints has the state [q; dq/dt]. The model uses the coordinates

    [r; s; v; w],   v = dr/dt = J(q) dq/dt,   s = N^T q,   w = ds/dt = N^T dq/dt

with the n coordinates r of the tool and, if m > n, m - n coordinates s of the free
joint motion. The columns of N span the joint rates that do not move the tool at the
operating point. N is constant, so that w is the rate of s also for small deviations.
For a tool that rotates, v is its twist and dr/dt = E(r) v; see laws.task_space.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.systems.framework import Context, OutputPort, System

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Refuse, ScenarioError, Show
from teleop_drake.loops.linear.states import States
from teleop_drake.model.blocks.robots import RobotConfig
from teleop_drake.model.laws.task_space import position_rate

# The largest distance in m of the tool from the position that the joints should reach.
_TOLERANCE = 1e-6


class ToolMotion:
    """Places a robot at an operating point and computes slopes of its coordinates.

    Attributes:
        states: The robot's continuous states [q; dq/dt].

    Args:
        config: The robot's config, which returns its joint positions.
        robot: The robot's system.
        context: The robot's Context.
        states: The continuous states of the robot's parts.
        num_axes: Number n of task axes.

    Raises:
        ScenarioError: If the states are not the positions and velocities of n or more
            joints in one block.
    """

    def __init__(
        self,
        *,
        config: RobotConfig,
        robot: System,
        context: Context,
        states: Sequence[States],
        num_axes: int,
    ):
        num_states = sum(part.size for part in states)
        if len(states) != 1 or num_states % 2 or num_states < 2 * num_axes:
            Refuse(
                "robot.num_continuous_states",
                num_states,
                f"position and velocity of {num_axes} joints or more, in one block",
            )
        (self.states,) = states
        self._config = config
        self._robot = robot
        self._context = context
        self._n = num_axes
        self._m = num_states // 2

    def _Eval(self, name: str) -> Array:
        """Returns the value of an output port of the robot."""
        return self._robot.GetOutputPort(name).Eval(self._context)

    def Place(self, p_WT: Array, v_WT: Array) -> None:
        """Sets the joints such that the tool has a given position and velocity.

        If m > n, the joint rates are those to which forces on the tool would accelerate
        a robot at rest.

        Args:
            p_WT: Position of the tool in m (n).
            v_WT: Velocity of the tool in m/s (n).

        Raises:
            ScenarioError: If the joint positions of the config do not put the tool at
                this position.
        """
        q = self._config.JointPositions(p_WT)
        if q.shape != (self._m,):
            allowed = f"{self._m} numbers, as many as the robot has joints"
            Refuse("robot.JointPositions", q, allowed)
        columns = []
        for unit in np.eye(self._m):
            self.states.Set(np.concatenate([q, unit]))
            columns.append(self._Eval("tool_velocity"))
        reached = self._Eval("tool_position")
        if not np.allclose(reached, p_WT, rtol=0, atol=_TOLERANCE):
            raise ScenarioError(
                f"robot.JointPositions = {Show(q)}: must put the tool at "
                f"{Show(p_WT)}, not at {Show(reached)}"
            )
        J = np.array(columns).T
        # The null space of J is spanned by its last right singular vectors.
        self._free = np.linalg.svd(J)[2][self._n :].T
        if self._m == self._n:
            rates = np.linalg.solve(J, v_WT).astype(float)
        else:
            by_force = self._AccelerationsByForce(q)
            rates = by_force @ np.linalg.solve(J @ by_force, v_WT)
        self.states.Set(np.concatenate([q, rates]))
        self._place = np.concatenate([reached, v_WT])

    def _AccelerationsByForce(self, q: Array) -> Array:
        """Returns the joint accelerations per force on the tool, M^-1 J^T (m, n)."""
        robot = self._robot
        context = robot.CreateDefaultContext()
        at_rest = np.zeros(self._n)
        robot.GetInputPort("environment_force").FixValue(context, at_rest)
        context.SetContinuousState(np.concatenate([q, np.zeros(self._m)]))

        def Accelerations(force: Array) -> Array:
            robot.GetInputPort("control_force").FixValue(context, force)
            rates: Array = robot.EvalTimeDerivatives(context).CopyToVector()
            return rates[self._m :]

        without = Accelerations(at_rest)
        return np.array([Accelerations(F) - without for F in np.eye(self._n)]).T

    def Seen(self) -> list[OutputPort]:
        """Returns the output ports whose slopes Coordinates() requires."""
        names = ("tool_position", "tool_velocity", "tool_acceleration")
        return [self._robot.GetOutputPort(name) for name in names]

    def Coordinates(self, rates: Array, seen: Array) -> tuple[Array, Array]:
        """Returns the slopes of [r; s; v; w] and those of their rates, (2m, N) each.

        The N variables of all slopes begin with the robot's state.

        Args:
            rates: Slopes of the rates of the robot's state (2m, N).
            seen: Slopes of the ports of Seen(), possibly followed by others (>= 3n, N).
        """
        r, v, a = np.split(seen[: 3 * self._n], 3)
        m = self._m
        free = self._free.T
        place = InitializeAutoDiff(self._place, np.vstack([r, v]))[:, 0]
        r_dot = ExtractGradient(position_rate(*np.split(place, 2)))
        q, q_dot = np.split(np.eye(2 * m, r.shape[1]), 2)
        coordinates = np.vstack([r, free @ q, v, free @ q_dot])
        their_rates = np.vstack([r_dot, free @ q_dot, a, free @ rates[m:]])
        return coordinates, their_rates
