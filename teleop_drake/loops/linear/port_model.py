"""A linear model between two ports of a diagram, with exact delays."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array, ComplexArray
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.numerics.delayed_loop import margins_of
from teleop_drake.loops.numerics.margins import Margins
from teleop_drake.loops.numerics.state_space import StateSpace

# The frequencies of a Bode diagram per decade, and the factor by which they extend
# beyond the slowest and the fastest mode.
_POINTS_PER_DECADE = 100
_BEYOND = 10.0

# The largest phase shift by all delays in rad from one frequency to the next. A larger
# one could make the continuous phase ambiguous.
_TURN = 0.5


class BodeDiagram(NamedTuple):
    """A frequency response (M, p, m), or (M,) from one input to one output.

    Attributes:
        frequencies: Frequencies in rad/s (M).
        magnitude: Magnitudes in dB.
        phase: Phases in degrees, continuous.
    """

    frequencies: Array
    magnitude: Array
    phase: Array

    @classmethod
    def Of(cls, frequencies: Array, size: Array, phase: Array) -> "BodeDiagram":
        """Returns the diagram of a response, without axes if it is that of one signal.

        Args:
            frequencies: Frequencies in rad/s (M).
            size: Magnitudes (M, p, m).
            phase: Phases in rad, continuous (M, p, m).
        """
        if size.shape[1:] == (1, 1):
            phase = phase[:, 0, 0]
            size = size[:, 0, 0]
        with np.errstate(divide="ignore"):
            magnitude = 20 * np.log10(size)
        return cls(frequencies, magnitude, np.degrees(phase))


def ImportControl() -> Any:
    """Imports and returns python-control.

    Raises:
        ModuleNotFoundError: If it is not installed.
    """
    try:
        import control
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "to_control() needs python-control: `pip install 'teleop-drake[control]'`"
        ) from None
    return control


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PortModel(StateSpace):
    """The linear model of a diagram from one port to another one, with its delays.

    With small deviations u at the input, y at the output, x of the diagram's continuous
    states in their order, and e and d at the inputs and outputs of the delays T_i,

        dx/dt = A x + B [u, d],    [y, e] = C x + D [u, d],    d_i(t) = e_i(t - T_i)

    Attributes:
        by_differences: Paths of the blocks that do not convert to AutoDiffXd. If there
            is one, all slopes are central differences.
        held: Paths of the blocks whose discrete state, a mode or a layer, is held
            constant.
        is_loop: Whether the model is the loop transfer function L at the input, with
            the sign of negative feedback: the loop is closed by u = -y.
    """

    by_differences: tuple[str, ...]
    held: tuple[str, ...]
    is_loop: bool

    def __repr__(self) -> str:
        """Returns sizes and delays on one line, without matrices."""
        num_outputs, num_inputs = self.num_open
        delays = ", ".join(f"{delay:g}" for delay in sorted(set(self.delays)))
        names = ", ".join(self.by_differences)
        return (
            f"PortModel({num_inputs} -> {num_outputs}, {self.num_states} states, "
            f"delays [{delays}] s, {len(self.held)} held"
            + (f", by differences: {names})" if names else ")")
        )

    def Response(self, frequencies: ArrayLike) -> ComplexArray:
        """Returns the frequency response from u to y (M, size of y, size of u).

        At the frequency of an undamped mode the entries in which it appears are
        infinite, as that of an integrator at 0.

        Args:
            frequencies: Frequencies in rad/s (M,).
        """
        return self.frequency_response(frequencies)

    def bode(self, frequencies: ArrayLike | None = None) -> BodeDiagram:
        """Returns magnitude and phase of the response from u to y, in SciPy's units.

        At the frequency of an undamped mode the magnitude is infinite, and the phase
        that of a slightly higher frequency.

        Args:
            frequencies: Ascending frequencies in rad/s, > 0. By default they cover all
                modes and delays.
        """
        w = self._Frequencies() if frequencies is None else np.asarray(frequencies)
        # Between two given frequencies the delays may turn the phase more than once.
        # The phase is therefore unwrapped on a denser grid.
        parts = np.ceil(np.diff(w) * sum(self.delays) / _TURN).astype(int).clip(1)
        ends = np.concatenate([[0], np.cumsum(parts)])
        dense = np.interp(np.arange(ends[-1] + 1), ends, w)
        phase = np.unwrap(np.angle(self.finite_response(dense)), axis=0)[ends]
        return BodeDiagram.Of(w, np.abs(self.Response(w)), phase)

    def margins(self, *, remedies: bool = True) -> Margins:
        """Returns the margins of the loop, for all signals of the port alike.

        Args:
            remedies: Whether to search for the gains and the additional delays that
                stabilise an unstable loop.

        Raises:
            ValueError: If the model is not that of a loop.
        """
        if not self.is_loop:
            allowed = "a loop, LinearizePorts(diagram, context, port, is_opened=True)"
            Refuse("model", repr(self), allowed)
        return margins_of(self, remedies=remedies)

    def to_control(self, order: int = 5) -> Any:
        """Returns the model from u to y as a control.StateSpace of python-control.

        It has no exact delays: each one becomes a Pade approximant. Without delays the
        model is exact.

        Args:
            order: The order of the approximants.

        Raises:
            ModuleNotFoundError: If python-control is not installed.
        """
        control = ImportControl()
        model = control.ss(self.A, self.B, self.C, self.D)
        if not self.delays:
            return model
        approximants = [
            control.tf2ss(control.tf(*control.pade(delay, order)))
            for delay in self.delays
        ]
        k = len(self.delays)
        return model.lft(control.append(*approximants), k, k)

    def _Frequencies(self) -> Array:
        """Returns frequencies in rad/s that cover all modes and delays."""
        modes = np.abs(np.linalg.eigvals(self.A))
        corners = [*modes[modes > 1e-6 * modes.max(initial=0.0)]]
        corners += [1 / delay for delay in self.delays]
        low = min(corners, default=1.0) / _BEYOND
        high = max(corners, default=1.0) * _BEYOND
        num_points = math.ceil(_POINTS_PER_DECADE * math.log10(high / low))
        return np.geomspace(low, high, num_points)
