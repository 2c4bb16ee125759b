"""Linear loops of continuous plants, sampled laws and exact delays.

    [dx/dt; q+; e; y] = M [x; q; d; u],    d_i(t) = e_i(t - T_i)                 (1)

x are continuous states. Each discrete state q_j changes to its entry of q+ at the
instants offset_j + k period_j and is constant between them. The delays T_i are exact
and need not be multiples of a period. u and y are the input and the output of a port.

If no delay is in a loop of continuous states and delays only, x(t - tau) and
q(t - tau) occur in (1) for finitely many lags tau. Every x(t - tau) that occurs is
integrated as a state of its own, here called a copy. All held values are constant
between two neighbouring instants of the common period P. The matrix exponential
therefore gives the exact map of the copies and of the held values over P, the lifted
map. The loop is stable if all eigenvalues of the lifted map have a magnitude below 1.

Sources: R. E. Kalman and J. E. Bertram, "A unified approach to the theory of sampling
systems", J. Franklin Inst. 267 (1959); T. Chen and B. A. Francis, "Optimal
Sampled-Data Control Systems", Springer (1995).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import expm

from teleop_drake.loops.framework.arrays import Array, ComplexArray
from teleop_drake.loops.numerics.sample_schedule import (
    DIGITS,
    Clock,
    Lagged,
    Schedule,
    common_period,
)
from teleop_drake.loops.numerics.state_space import close_loops, strong_parts

# Entries of M below this, relative to the largest, are rounding errors of 0.
_NEGLIGIBLE = 1e-13


class ContinuousDelayLoop(ValueError):
    """A delay is in a loop without a discrete state: no finite lifted map exists."""


_Sum = dict[Lagged, Any]
"""A linear combination: the coefficient of each lagged state."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledLoop:
    """The system (1) with n continuous and m discrete states.

    Attributes:
        matrix: M (n + m + k + p, n + m + k + p).
        num_states: The number n of continuous states.
        clocks: When each discrete state changes (m).
        delays: The delays T_i >= 0 in s (k).
    """

    matrix: Array
    num_states: int
    clocks: tuple[Clock, ...]
    delays: tuple[float, ...] = ()

    @property
    def num_held(self) -> int:
        """The number m of discrete states."""
        return len(self.clocks)

    @property
    def num_inner(self) -> int:
        """The number n + m of states."""
        return self.num_states + self.num_held

    @property
    def num_ports(self) -> int:
        """The number p of signals of the port."""
        return len(self.matrix) - self.num_inner - len(self.delays)

    def closed(self, gain: complex = 1.0, delay: float = 0.0) -> "SampledLoop":
        """Returns the loop that u(t) = gain y(t - delay) closes."""
        matrix: Any = self.matrix.astype(np.result_type(self.matrix, gain))
        matrix[len(matrix) - self.num_ports :] *= gain
        delays = (*self.delays, *[delay] * self.num_ports)
        return replace(self, matrix=matrix, delays=delays)

    def settled(self) -> "SampledLoop":
        """Returns the loop without its delays of 0, which are connections.

        Raises:
            ValueError: If such a connection is a loop that is not well posed.
        """
        at = [self.num_inner + i for i, delay in enumerate(self.delays) if delay == 0]
        matrix = close_loops(self.matrix, at)
        matrix = np.delete(np.delete(matrix, at, axis=0), at, axis=1)
        delays = tuple(delay for delay in self.delays if delay > 0)
        return replace(self, matrix=matrix, delays=delays)

    def roots(self) -> ComplexArray:
        """Returns the eigenvalues of the lifted map of a loop without open ports.

        Raises:
            ContinuousDelayLoop: If a delay is in a loop without a discrete state.
            ScenarioError: If the periods are not commensurate.
        """
        return lift(self).roots()


@dataclass(frozen=True, kw_only=True, eq=False)
class LiftedMap:
    """The map of a loop over its common period, z = [copies; histories of q].

        z' = A z + B w,    v = C z + D w

    w are values that are added to the updates of some discrete states, at each of their
    instants in the period, and v the port's outputs just before these instants.

    Attributes:
        A: The matrix from z to z'.
        B: The matrix from w to z'.
        C: The matrix from z to v.
        D: The matrix from w to v.
        period: The common period P in s.
        spurious: Eigenvalues of A that are no roots of the loop. A copy x(t - tau)
            starts with any value, and its error follows the rates of the copies with
            the same lag.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    period: float
    spurious: ComplexArray

    def roots(self) -> ComplexArray:
        """Returns the characteristic roots: the eigenvalues less the spurious ones."""
        roots = np.linalg.eigvals(self.A).astype(complex)
        for known in self.spurious:
            roots = np.delete(roots, np.argmin(np.abs(roots - known)))
        return roots

    def response(self, angles: Array) -> ComplexArray:
        """Returns the response from w to v at z = exp(j angle) (K, p, p)."""
        z = np.exp(1j * np.asarray(angles))[:, np.newaxis, np.newaxis]
        inner = np.linalg.solve(z * np.eye(len(self.A)) - self.A, self.B + 0j)
        return np.asarray(self.C @ inner + self.D)


def check_finite(loop: SampledLoop) -> None:
    """Checks that no delay is in a loop of continuous states and delays only.

    Args:
        loop: A loop without delays of 0.

    Raises:
        ContinuousDelayLoop: If there is one.
    """
    if not loop.delays:
        return
    n = loop.num_states
    nodes = np.r_[0:n, loop.num_inner : loop.num_inner + len(loop.delays)]
    is_used = np.abs(loop.matrix) > _NEGLIGIBLE * np.abs(loop.matrix).max()
    parts = strong_parts(is_used[np.ix_(nodes, nodes)])
    found = np.flatnonzero(np.any([part[n:] for part in parts], axis=0))
    if len(found):
        times = sorted({loop.delays[i] for i in found})
        text = ", ".join(f"{time:g}" for time in times)
        raise ContinuousDelayLoop(
            f"delays = {text} (s): must not be in a loop without a hold, whose sampled "
            "model has infinitely many states; a run shows its stability"
        )


class _Terms:
    """The rows of (1) as linear combinations of lagged states.

    Attributes:
        rates: The rate of each copy, by the copy. The copies with a lag of 0, which are
            the states themselves, come first.
        updates: The new value of each discrete state, at the lag 0.
        outputs: The outputs y, at the lag 0.
        held: All lagged discrete states that occur, in a fixed order.
    """

    def __init__(self, loop: SampledLoop, period: float):
        self._loop = loop
        self._period = period
        self._least = _NEGLIGIBLE * np.abs(loop.matrix).max()
        n = loop.num_states
        first_output = loop.num_inner + len(loop.delays)
        self.updates = [self._row(n + j) for j in range(loop.num_held)]
        rows = range(first_output, len(loop.matrix))
        self.outputs = [self._row(row) for row in rows]
        self.rates: dict[Lagged, _Sum] = {}
        missing = [Lagged(False, i, 0.0) for i in range(n)]
        for terms in (*self.updates, *self.outputs):
            missing += [term for term in terms if not term.is_held]
        while missing:
            copy = missing.pop(0)
            if copy in self.rates:
                continue
            self.rates[copy] = self._row(copy.number, copy.lag * period)
            missing += [term for term in self.rates[copy] if not term.is_held]
        held = {Lagged(True, j, 0.0) for j in range(loop.num_held)}
        for terms in (*self.rates.values(), *self.updates, *self.outputs):
            held |= {term for term in terms if term.is_held}
        self.held = sorted(held)

    def _row(self, row: int, lag: float = 0.0, factor: Any = 1.0) -> _Sum:
        """Returns a row of (1) at t - lag, in s, times a factor.

        Each delayed signal is replaced by its row at an earlier time.
        """
        matrix = self._loop.matrix
        n = self._loop.num_states
        inner = self._loop.num_inner
        share = round(lag / self._period, DIGITS)
        terms: _Sum = {}
        for j in np.flatnonzero(np.abs(matrix[row, :inner]) > self._least).tolist():
            term = Lagged(j >= n, j - n if j >= n else j, share)
            terms[term] = terms.get(term, 0.0) + factor * matrix[row, j]
        for i, delay in enumerate(self._loop.delays):
            weight = matrix[row, inner + i]
            if abs(weight) <= self._least:
                continue
            for term, x in self._row(inner + i, lag + delay, factor * weight).items():
                terms[term] = terms.get(term, 0.0) + x
        return terms


def lift(loop: SampledLoop, sampled: Iterable[int] = ()) -> LiftedMap:
    """Returns the exact map of a loop over its common period.

    Args:
        loop: The loop.
        sampled: The discrete states into whose updates the port's input enters; see
            LiftedMap. Empty: the ports are left out.

    Raises:
        ContinuousDelayLoop: If a delay is in a loop without a discrete state.
        ScenarioError: If the periods are not commensurate.
    """
    return _Lifting(loop, frozenset(sampled)).lifted_map()


class _Lifting:
    """The computation of a lifted map.

    The state at a time is a matrix: its row for each copy, and for each value in the
    history of a discrete state, by the entries of z and w at the start of the period.
    """

    def __init__(self, loop: SampledLoop, sampled: frozenset[int]):
        self._loop = loop.settled()
        check_finite(self._loop)
        self._sampled = sampled
        self._period = common_period(loop.clocks)
        self._terms = _Terms(self._loop, self._period)
        self._schedule = Schedule(loop.clocks, self._terms.held, self._period)
        self._copies = {copy: i for i, copy in enumerate(self._terms.rates)}
        ends = np.cumsum([len(self._copies), *self._schedule.lengths])
        # The place of the newest value of each discrete state, and the end of the last.
        self._places = ends.tolist()
        self._hits = [
            instant
            for instant in self._schedule.instants
            if sampled & set(self._schedule.updates.get(instant, ()))
        ]

    def lifted_map(self) -> LiftedMap:
        """Returns the lifted map."""
        rates = self._rates()
        num_held = len(self._terms.held)
        num_copies = len(self._copies)
        still = np.zeros((num_held, num_copies + num_held))
        generator = np.vstack([rates, still]) * self._period
        size = self._places[-1]
        num_ports = self._loop.num_ports
        num_inputs = num_ports * len(self._hits)
        state = np.eye(size, size + num_inputs).astype(rates.dtype)
        outputs = []
        last = len(self._schedule.instants) - 1
        before = self._schedule.middle(last) - 1
        for k, instant in enumerate(self._schedule.instants):
            after = self._schedule.middle(k)
            sides = before, after
            if instant in self._hits:
                outputs += [self._read(x, state, sides) for x in self._terms.outputs]
            self._update(state, instant, sides)
            held = [self._held(x, after, after) for x in self._terms.held]
            length = self._schedule.end(k) - instant
            step = expm(generator * length)[:num_copies]
            moved = step @ np.vstack([state[:num_copies], state[held]])
            state[:num_copies] = moved
            before = after
        shown = np.reshape(outputs, (num_inputs, size + num_inputs))
        return LiftedMap(
            A=state[:, :size],
            B=state[:, size:],
            C=shown[:, :size],
            D=shown[:, size:],
            period=self._period,
            spurious=self._eigenvalues_of_copies(rates),
        )

    def _rates(self) -> Array:
        """Returns the rates of the copies by copies and held values."""
        held = {term: i for i, term in enumerate(self._terms.held, len(self._copies))}
        columns = self._copies | held
        rates = np.zeros((len(self._copies), len(columns)), self._loop.matrix.dtype)
        for copy, terms in self._terms.rates.items():
            for term, weight in terms.items():
                rates[self._copies[copy], columns[term]] += weight
        return rates

    def _held(self, term: Lagged, now: float, seen: float) -> int:
        """Returns the place of a lagged discrete state; see Schedule.age()."""
        return self._places[term.number] + self._schedule.age(term, now, seen)

    def _read(
        self, terms: Mapping[Lagged, Any], state: Array, sides: tuple[float, float]
    ) -> Array:
        """Returns a linear combination as an update at an instant reads it.

        An update reads the values before all updates of its instant. A delayed jump
        that arrives at the instant has arrived, as in a run.

        Args:
            sides: A time between the instant and the one before it, and a time between
                the instant and the next one.
        """
        before, after = sides
        total = np.zeros(state.shape[1], state.dtype)
        for term, weight in terms.items():
            place = self._copies.get(term, -1)
            if term.is_held:
                place = self._held(term, before, after if term.lag > 0 else before)
            total += weight * state[place]
        return total

    def _update(self, state: Array, instant: float, sides: tuple[float, float]) -> None:
        """Executes the updates of an instant in place; for `sides`, see _read()."""
        changed = self._schedule.updates.get(instant, [])
        new = {j: self._read(self._terms.updates[j], state, sides) for j in changed}
        loop = self._loop
        if instant in self._hits:
            first = self._places[-1] + self._hits.index(instant) * loop.num_ports
            row = loop.num_states + np.array(changed)
            inputs = loop.matrix[row, len(loop.matrix) - loop.num_ports :]
            for j, weights in zip(changed, inputs, strict=True):
                new[j][first : first + loop.num_ports] += weights
        for j, value in new.items():
            first = self._places[j]
            end = self._places[j + 1]
            state[first + 1 : end] = state[first : end - 1].copy()
            state[first] = value

    def _eigenvalues_of_copies(self, rates: Array) -> ComplexArray:
        """Returns the eigenvalues that free starts of the copies add to the map."""
        spurious = [np.empty(0, complex)]
        for lag in sorted({copy.lag for copy in self._copies} - {0.0}):
            own = [i for copy, i in self._copies.items() if copy.lag == lag]
            modes = np.linalg.eigvals(rates[np.ix_(own, own)])
            spurious.append(np.exp(modes * self._period))
        return np.concatenate(spurious)
