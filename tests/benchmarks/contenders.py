"""The ways to simulate a task that are compared, each of which builds it anew."""

from collections.abc import Callable

import numpy as np
from benchmarks import accuracy, straightforward
from benchmarks.straightforward import Solution

from teleop_drake.recording import Recording
from teleop_drake.scenario import LoadScenario, Scenario
from teleop_drake.simulation import simulate

TARGETS = {1: 1e-5, 2: 1e-4}
"""Largest error, relative to the signal's range, by the number of axes."""

# The loosest setting whose error stays below TARGETS.
SCIPY_TOLERANCE = 1e-4
PEER = "JiTCDDE, compiled"


def Load(
    task: str,
    controller: str = "adaptive_backstepping",
    delay: float = 0.1,
    duration: float | None = None,
) -> Scenario:
    """Loads a scenario of the package with both delays the same."""
    overrides: dict = {
        "controller.kind": controller,
        "forward_channel.delay": delay,
        "return_channel.delay": delay,
    }
    if duration is not None:
        overrides["duration"] = duration
    return LoadScenario(task, overrides)


def FromRecording(recording: Recording) -> Solution:
    """Returns what the package recorded as a Solution."""
    return Solution(
        time=recording.time,
        signals={name: recording[name] for name in accuracy.SIGNALS},
        steps=recording.solver.steps,
        derivative_evaluations=recording.solver.derivative_evaluations,
    )


def Package(task, controller, delay, duration) -> Solution:
    scenario = Load(task, controller, delay, duration)
    return FromRecording(simulate(scenario, engine="drake"))


def Compiled(task, controller, delay, duration) -> Solution:
    """The package's scenario as it is, as machine code."""
    scenario = Load(task, controller, delay, duration)
    return FromRecording(simulate(scenario, engine="compiled"))


def Straightforward(task, controller, delay, duration) -> Solution:
    return straightforward.simulate(Load(task, controller, delay, duration))


def Sampled(task, controller, delay, duration) -> Solution:
    return straightforward.simulate_sampled(Load(task, controller, delay, duration))


def Scipy(task, controller, delay, duration) -> Solution:
    """The method of steps with scipy's DOP853: the independent solver, but looser."""
    result = accuracy.Solve(task, controller, delay, duration, rtol=SCIPY_TOLERANCE)
    time = np.array([piece.end for piece in result.pieces])
    sampled = result.sample(time, "left")
    return Solution(
        time=time,
        signals={name: sampled[key] for name, key in accuracy.SIGNALS.items()},
        steps=len(time),
        derivative_evaluations=None,
    )


CONTENDERS: dict[str, Callable[[str, str, float, float], Solution]] = {
    "package, in Drake's Simulator": Package,
    "package, compiled": Compiled,
    "straightforward": Straightforward,
    "1 kHz DiscreteTimeDelay": Sampled,
    "scipy, method of steps": Scipy,
}


def Find(name: str) -> Callable[[str, str, float, float], Solution]:
    """Returns a contender, or JiTCDDE, by its name."""
    if name == PEER:
        from benchmarks import jitcdde_peer

        return jitcdde_peer.Simulate
    return CONTENDERS[name]
