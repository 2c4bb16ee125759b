"""The ways to simulate a task that are compared, each of which builds it anew."""

from collections.abc import Callable

import numpy as np
from benchmarks import accuracy, straightforward
from benchmarks.straightforward import Solution

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, Scenario

# The loosest setting whose error stays below the target of the comparison.
SCIPY_TOLERANCE = 1e-4
PEER = "JiTCDDE, compiled"


def Load(task: str, controller: str, delay: float, duration: float = 0.0) -> Scenario:
    """Loads a scenario of the package with both delays the same."""
    overrides: dict = {"controller.kind": controller, "delay": delay}
    if duration:
        overrides["duration"] = duration
    return LoadScenario(task, overrides)


def _Package(engine, *case) -> Solution:
    recording = simulate(Load(*case), engine=engine)
    return Solution(
        time=recording.time,
        signals={name: recording[name] for name in accuracy.SIGNALS},
        steps=recording.solver.steps,
        derivative_evaluations=recording.solver.derivative_evaluations,
    )


def _Scipy(*case) -> Solution:
    """The method of steps with scipy's DOP853: the independent solver, but looser."""
    result = accuracy.Solve(*case, rtol=SCIPY_TOLERANCE)
    time = np.array([piece.end for piece in result.pieces])
    sampled = result.sample(time, "left")
    signals = {name: sampled[key] for name, key in accuracy.SIGNALS.items()}
    return Solution(
        time=time, signals=signals, steps=len(time), derivative_evaluations=None
    )


def _Peer(*case) -> Solution:
    from benchmarks import jitcdde_peer

    return jitcdde_peer.Simulate(*case)


# Of a task, a controller, a delay and a duration in s.
CONTENDERS: dict[str, Callable[[str, str, float, float], Solution]] = {
    "package, in Drake's Simulator": lambda *case: _Package("drake", *case),
    "package, compiled": lambda *case: _Package("compiled", *case),
    "straightforward": lambda *case: straightforward.simulate(Load(*case)),
    "1 kHz DiscreteTimeDelay": lambda *x: straightforward.simulate_sampled(Load(*x)),
    "scipy, method of steps": _Scipy,
    PEER: _Peer,
}
