"""At which delay the loop fails, and why: margins of the linearised loop.

The loop has one delay only, T = T_f + T_r. Everything from the surgeon to the robot
crosses the forward channel and everything back crosses the return channel, each with
the same delay for all entries of a packet. So with slave S(s) and master M(s)

    det(I - S(s) e^(-s T_f) M(s) e^(-s T_r)) = det(I - S(s) M(s) e^(-s T)) = 0,

and unequal delays with the same sum give the same roots. (It holds beyond the linear
model: with the slave's clock set back by T_f, the forward channel has no delay and the
return channel all of it.) Only entries of the packets that the other side listens to
are kept, on that side of the cut where they are fewer: for one axis L is scalar.

Roots at 0 that stay there at every delay are neutral: they say where the tool is, or
how far the surgeon's device has been wound up against a spring, and do not count as an
instability. In velocity mode there is one per axis, because the tool's position and the
device's integral of the felt velocity both integrate v, and their sum stays what it
was. With the thesis's packets it does not show in L and is removed with whatever else
does not; with others, that carry a force back, it does, and laws.delay_margin knows it.
Any other hidden mode on or right of the imaginary axis spoils every delay.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Diagram

from teleop_drake.analysis.linearization import (
    LinearizeLoop,
    LoopModel,
    OperatingPoint,
    OperatingPointAt,
    OperatingPoints,
)
from teleop_drake.laws.characteristic_roots import characteristic_roots
from teleop_drake.laws.delay_margin import (
    Crossing,
    delay_margin,
    find_crossings,
    is_delay_robust,
    neutral_root_count,
    stable_delays,
    unstable_roots,
)
from teleop_drake.laws.state_space import StateSpace, minimal_realization
from teleop_drake.scenario import AnyScenario, LoadScenario, Scenario, ScenarioError

Array = NDArray[np.float64]

MAX_DELAY = 2.0
"""Up to which round-trip delay, in s, intervals are reported unless said otherwise."""

POSITION = "position"
"""Key of StabilityChart that stands for the tool's position along x."""

# Entries of B, C and D smaller than this, relative to the largest, are zero.
_NEGLIGIBLE = 1e-9

# A root this close to 0, relative to the fastest mode, may be a neutral one.
_NEUTRAL = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class PointStability:
    """Stability of the loop at one operating point.

    Attributes:
        model: The linear models of both ends.
        loop: L, minimal: the roots are those of det(I + L(s) e^(-s T)).
        delay: Round-trip delay of the scenario in s.
        max_delay: Up to which round-trip delay stable_delays reaches, in s.
        crossings: Where roots cross the imaginary axis, by ascending frequency.
        margin: The crossing at which the loop first becomes unstable as the delay
            grows from 0; None if there is none, or the loop is unstable without delay.
        stable_delays: Every interval of round-trip delays at which the loop is stable,
            in s; one that ends at max_delay goes on.
        hidden_modes: Modes that do not show in L, in 1/s, neutral ones apart.
        num_neutral: Number of roots at 0, at every delay, hidden ones included.
        slave_root: The slave's rightmost root on its own, neutral ones apart, in 1/s:
            the loop after the surgeon has switched to a force. None: it has no other.
    """

    model: LoopModel
    loop: StateSpace
    delay: float
    max_delay: float
    crossings: list[Crossing]
    margin: Crossing | None
    stable_delays: list[tuple[float, float]]
    hidden_modes: NDArray[np.complex128]
    num_neutral: int
    slave_root: complex | None

    @property
    def _slow(self) -> float:
        """Below which size in 1/s a root may be a neutral one."""
        return _NEUTRAL * max(float(np.linalg.norm(self.loop.A)), 1e-300)

    @property
    def is_stable(self) -> bool:
        """Whether the loop is stable at the scenario's delay."""
        return self.IsStableWith(self.delay)

    def IsStableWith(self, delay: float) -> bool:
        """Returns whether the loop is stable with a delay, by counting crossings.

        Args:
            delay: Round-trip delay in s.
        """
        if np.any(self.hidden_modes.real >= 0):
            return False
        if delay > 0 and not is_delay_robust(self.loop):
            return False
        return int(unstable_roots(self.loop, delay, self.crossings)[1][-1]) == 0

    def Roots(self, delay: float, count: int = 8) -> NDArray[np.complex128]:
        """Returns the rightmost characteristic roots, by descending real part.

        They come from collocation (laws.characteristic_roots), not from the frequency
        response, and include the hidden modes but not the neutral roots.

        Args:
            delay: Round-trip delay in s.
            count: How many.
        """
        loop = self.loop
        num_neutral = neutral_root_count(loop)
        roots = characteristic_roots(
            loop.A, loop.B, -loop.C, -loop.D, delay=delay, count=count + num_neutral
        )
        is_neutral = np.zeros(len(roots), dtype=bool)
        is_neutral[np.argsort(np.abs(roots))[:num_neutral]] = True
        roots = roots[~(is_neutral & (np.abs(roots) < self._slow))]
        roots = np.concatenate([roots, self.hidden_modes])
        return roots[np.lexsort((-roots.imag, -roots.real.round(12)))][:count]

    def RightmostRoot(self, delay: float) -> complex | None:
        """Returns the rightmost characteristic root in 1/s; of a pair, the upper one.

        None if there is none, if D lets roots tend to infinity, or if it is too fast
        for collocation: it then has the wrong sign.

        Args:
            delay: Round-trip delay in s.
        """
        if delay > 0 and not is_delay_robust(self.loop):
            return None
        roots = self.Roots(delay, count=2)
        if not len(roots):
            return None
        root = complex(roots[0])
        is_clear = abs(root.real) > _NEUTRAL * max(abs(root), 1e-300)
        if is_clear and (root.real < 0) != self.IsStableWith(delay):
            return None
        return root

    def ToRecord(self) -> dict[str, Any]:
        """Returns what `teleop-drake analyze` writes as JSON, plain and without NaN."""
        point = self.model.point
        root = self.RightmostRoot(self.delay)
        margin = self.margin
        return {
            "name": point.name,
            "position": point.position.tolist(),
            "velocity": point.velocity.tolist(),
            "layer": point.layer,
            "frozen_weights": self.model.frozen_weights,
            "gain_crossovers": [crossing.frequency for crossing in self.crossings],
            "crossing_delays": [crossing.delay for crossing in self.crossings],
            "crossing_directions": [crossing.direction for crossing in self.crossings],
            "phase_margin": None if margin is None else margin.phase_margin,
            "delay_margin": None if margin is None else margin.delay,
            "stable_delays": [list(interval) for interval in self.stable_delays],
            "stable": self.is_stable,
            "rightmost_root": None if root is None else [root.real, root.imag],
            "slave_root": (
                None
                if self.slave_root is None
                else [self.slave_root.real, self.slave_root.imag]
            ),
            "hidden_modes": [[s.real, s.imag] for s in self.hidden_modes.tolist()],
            "neutral_roots": self.num_neutral,
            "loop_order": self.loop.num_states,
            "linearization_error": self.model.error,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityAnalysis:
    """Stability of a scenario's loop at its operating points.

    Attributes:
        scenario: The scenario.
        max_delay: Up to which round-trip delay the intervals reach, in s.
        points: One for each operating point, in the order in which the tool comes to
            them.
    """

    scenario: Scenario
    max_delay: float
    points: list[PointStability]

    def __getitem__(self, name: str) -> PointStability:
        """Returns the operating point with that name.

        Raises:
            KeyError: If there is none.
        """
        for point in self.points:
            if point.model.point.name == name:
                return point
        raise KeyError(name)

    def ToRecord(self) -> dict[str, Any]:
        """Returns what `teleop-drake analyze` writes as JSON."""
        forward, back = self.scenario.forward_channel, self.scenario.return_channel
        return {
            "scenario": self.scenario.name,
            "controller": self.scenario.controller.kind,
            "forward_delay": forward.delay,
            "return_delay": back.delay,
            "max_delay": self.max_delay,
            "operating_points": [point.ToRecord() for point in self.points],
        }


def CutLoop(model: LoopModel) -> StateSpace:
    """Returns L, such that the loop has the roots of det(I + L(s) e^(-s T)).

    The loop is cut where fewer signals cross: among the entries of the return packet
    that the master listens to, or those of the forward packet that depend on them and
    act on the slave.

    Args:
        model: The loop at an operating point.

    Returns:
        L, not minimal: its states are those of the slave and of the master.
    """
    slave, master = model.slave, model.master
    heard = _Nonzero(np.vstack([master.B, master.D]), axis=0)
    sent = np.intersect1d(
        _Nonzero(np.hstack([master.C, master.D]), axis=1),
        _Nonzero(np.vstack([slave.B, slave.D]), axis=0),
    )
    if len(heard) <= len(sent):
        # From the return packet received to the one sent: first the master.
        first, second, ports = master, slave, heard
    else:
        first, second, ports = slave, master, sent
    zeros = np.zeros((first.num_states, second.num_states))
    return StateSpace(
        A=np.block([[second.A, second.B @ first.C], [zeros, first.A]]),
        B=np.vstack([second.B @ first.D, first.B])[:, ports],
        C=-np.hstack([second.C, second.D @ first.C])[ports],
        D=-(second.D @ first.D)[np.ix_(ports, ports)],
    )


def AnalyzeModel(
    model: LoopModel, *, delay: float, max_delay: float = MAX_DELAY
) -> PointStability:
    """Analyses the loop at an operating point.

    Args:
        model: From LinearizeLoop.
        delay: Round-trip delay of the scenario in s.
        max_delay: Up to which round-trip delay intervals are wanted, in s, > 0.
    """
    cut = CutLoop(model)
    loop, hidden = minimal_realization(cut)
    slow = _NEUTRAL * np.abs(np.linalg.eigvals(cut.A)).max(initial=0.0)
    is_neutral = np.abs(hidden) < slow
    # Which modes are hidden does not depend on the delay, and what is not a decaying
    # one among them spoils every delay.
    modes = hidden[~is_neutral]
    crossings = find_crossings(loop)
    intervals = stable_delays(loop, max_delay, crossings)
    margin = delay_margin(loop, crossings)
    if np.any(modes.real >= 0):
        intervals, margin = [], None
    slave_roots = np.linalg.eigvals(model.slave.A).astype(complex)
    slave_roots = slave_roots[np.abs(slave_roots) >= slow]
    slave_roots = slave_roots[np.lexsort((-slave_roots.imag, -slave_roots.real))]
    return PointStability(
        model=model,
        loop=loop,
        delay=delay,
        max_delay=max_delay,
        crossings=crossings,
        margin=margin,
        stable_delays=intervals,
        hidden_modes=modes,
        num_neutral=int(is_neutral.sum()) + neutral_root_count(loop),
        slave_root=complex(slave_roots[0]) if len(slave_roots) else None,
    )


def AnalyzeStability(
    scenario: AnyScenario,
    *,
    points: Iterable[OperatingPoint] | None = None,
    max_delay: float = MAX_DELAY,
    teleoperator: Diagram | None = None,
) -> StabilityAnalysis:
    """Analyses the stability of a scenario's loop against its delay.

    Args:
        scenario: A teleoperation whose channels have a constant delay.
        points: Operating points; None: those of OperatingPoints(scenario).
        max_delay: Up to which round-trip delay intervals are wanted, in s, > 0.
        teleoperator: The Diagram, made by MakeTeleoperator for this scenario, with
            systems of your own perhaps; None makes the scenario's.

    Raises:
        ScenarioError: If the scenario is not valid, is not a teleoperation, or a
            channel is not of kind transport.
        ValueError: If max_delay is not allowed or LinearizeLoop refuses a point.
    """
    if not isinstance(scenario, Scenario):
        raise ScenarioError(
            f"scenario = {scenario.name!r}: must be a teleoperation; tracking has no "
            "loop with a delay"
        )
    scenario.Validate()
    for path in ("forward_channel", "return_channel"):
        kind = getattr(scenario, path).kind
        if kind != "transport":
            raise ScenarioError(
                f"{path}.kind = {kind!r}: must be transport, the only kind with one "
                "exact, constant delay"
            )
    if not 0 < max_delay < np.inf:
        raise ValueError(f"max_delay = {max_delay}: must be a finite number > 0 (s)")
    if points is None:
        points = OperatingPoints(scenario)
    return StabilityAnalysis(
        scenario=scenario,
        max_delay=max_delay,
        points=[
            AnalyzeModel(
                LinearizeLoop(scenario, point, teleoperator=teleoperator),
                delay=scenario.forward_channel.delay + scenario.return_channel.delay,
                max_delay=max_delay,
            )
            for point in points
        ],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityChart:
    """Stable delays against the values of a key of the scenario.

    Attributes:
        key: What varies: a dotted path, or POSITION.
        values: Its values, ascending.
        analyses: One for each value.
        max_delay: Up to which round-trip delay the intervals reach, in s.
    """

    key: str
    values: Array
    analyses: list[StabilityAnalysis]
    max_delay: float

    def PointNames(self) -> list[str]:
        """Returns the names of the operating points that any of the analyses has."""
        names: dict[str, None] = {}
        for analysis in self.analyses:
            names |= dict.fromkeys(point.model.point.name for point in analysis.points)
        return list(names)

    def StableDelays(self, name: str) -> list[list[tuple[float, float]] | None]:
        """Returns the stable intervals in s at each value; None: no such point.

        Args:
            name: Name of an operating point.
        """
        result: list[list[tuple[float, float]] | None] = []
        for analysis in self.analyses:
            found = [p for p in analysis.points if p.model.point.name == name]
            result.append(found[0].stable_delays if found else None)
        return result

    def ToRecord(self) -> dict[str, Any]:
        """Returns what `teleop-drake analyze --vary` writes as JSON."""
        return {
            "key": self.key,
            "values": self.values.tolist(),
            "analyses": [analysis.ToRecord() for analysis in self.analyses],
        }


def ChartStability(
    name_or_path: str,
    key: str,
    values: ArrayLike,
    *,
    overrides: Mapping[str, Any] | Sequence[str] = (),
    max_delay: float = MAX_DELAY,
    progress: Callable[[int, int], None] | None = None,
) -> StabilityChart:
    """Analyses a scenario for many values of a key.

    Args:
        name_or_path: As for LoadScenario.
        key: A dotted path to a number, for example environment.layers.bone.stiffness;
            or POSITION, the tool's position along x in m, all along its path, instead
            of one operating point in each layer.
        values: Values of the key, at least one.
        overrides: As for LoadScenario; the key comes after them.
        max_delay: Up to which round-trip delay intervals are wanted, in s, > 0.
        progress: Called with the number of finished values and their number.

    Raises:
        ScenarioError: If a value is not allowed.
        ValueError: As AnalyzeStability, or if there is no value.
    """
    points = np.unique(np.asarray(values, dtype=float))
    if points.size == 0:
        raise ValueError(f"{key}: no value; allowed: at least one")
    if not isinstance(overrides, Mapping):
        pairs: list[str] = [overrides] if isinstance(overrides, str) else [*overrides]
    analyses = []
    for i, value in enumerate(points.tolist()):
        if key == POSITION:
            scenario = LoadScenario(name_or_path, overrides)
            chosen = (
                [OperatingPointAt(scenario, value)]
                if isinstance(scenario, Scenario)
                else []
            )
        else:
            chosen = None
            if isinstance(overrides, Mapping):
                scenario = LoadScenario(name_or_path, {**overrides, key: value})
            else:
                scenario = LoadScenario(name_or_path, [*pairs, f"{key}={value!r}"])
        analyses.append(AnalyzeStability(scenario, points=chosen, max_delay=max_delay))
        if progress is not None:
            progress(i + 1, len(points))
    return StabilityChart(
        key=key, values=points, analyses=analyses, max_delay=max_delay
    )


def _Nonzero(matrix: Array, axis: int) -> NDArray[np.int_]:
    """Returns which columns (axis 0) or rows (axis 1) are not zero."""
    size = np.abs(matrix).max(axis=axis, initial=0.0)
    return np.flatnonzero(size > _NEGLIGIBLE * np.abs(matrix).max(initial=1e-300))
