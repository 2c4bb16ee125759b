"""bdsim: blocks in Python, integrated by scipy between the ticks of a clock.

P. Corke's bdsim does not tell a block when a step of the solver is accepted, so an
exact delay cannot be written for it: each channel is a shift register on a clock of
PERIOD, as in the sampled Drake diagram, and its error is that of such a diagram. The
equations inside its FUNCTION block are the independent solver's, in numpy.
"""

import bdsim
import numpy as np
from bdsim.components import SampledBlock
from benchmarks.accuracy import ThesisTask
from benchmarks.straightforward import Solution
from independent_solver import Result

NAME = "bdsim, 1 kHz shift registers"
SWEEPS = False  # Slower than the straightforward variant, and not exact.
PERIOD = 0.001


class _Register(SampledBlock):
    """Delays a vector by whole ticks; remembers whether entry 0 reached a border."""

    nin = 1
    nout = 1

    def __init__(self, clock, start, ticks, border):
        self.size, self.border = len(start), border
        start = np.concatenate([np.tile(start, ticks), [0.0]])
        super().__init__(clock=clock, nin=1, nout=1, x0=start, name=f"delay{border}")

    def output(self, t, inputs, x):
        return [np.append(x[-1 - self.size : -1], x[-1])]

    def next(self, t, inputs, x):
        shifted = np.concatenate([np.asarray(inputs[0]), x[: -1 - self.size]])
        reached = x[-1] or shifted[-self.size] >= self.border
        return np.append(shifted, float(reached))


def Prepare(task: str, controller: str, delay: float, duration: float) -> None:
    """Nothing is compiled."""


def Simulate(task: str, controller: str, delay: float, duration: float) -> Solution:
    """Simulates a task."""
    problem = ThesisTask(task, controller, delay)
    equations = Result(problem)
    n, law = equations.n, equations.law
    _, a1, a0 = problem.denominator
    surface = np.inf
    if equations.perceives:
        surface = problem.layers[problem.contact_index()].start
    velocity = np.array(problem.velocity)

    def Rates(state, received, felt):
        q, qdot, x1, x2 = state[: 4 * n].reshape(4, n)
        p, v = problem.robot.tool(q, qdot)
        F_e = equations.environment_force(problem.layer_at(p[0]), p, v)
        F_h, v_dd = received[:n], received[n : 2 * n]
        F_c = F_h if law is None else state[4 * n : 5 * n]
        v_d = velocity * (felt[-1] == 0)
        rates = [
            qdot,
            problem.robot.acceleration(q, qdot, F_c - F_e),
            x2,
            v_d - felt[n : 2 * n] - a1 * x2 - a0 * x1,
        ]
        if law is not None:
            rates.append(law.rates(state[4 * n :], p, v, F_e, F_h, v_dd))
        return np.concatenate(rates)

    def Packet(state, felt):
        if felt[-1] == 0:
            return np.concatenate([equations.device_force(state), velocity])
        return np.concatenate([problem.contact_force, np.zeros(n)])

    def Motion(state):
        return np.concatenate(problem.robot.tool(state[:n], state[n : 2 * n]))

    # Without sysargs=False it would take the options of the benchmarks for its own.
    simulation = bdsim.BDSim(
        sysargs=False, graphics=False, progress=False, banner=False, quiet=True
    )
    diagram = simulation.blockdiagram()
    clock = diagram.clock(PERIOD, "s")
    ticks = round(delay / PERIOD)
    state = diagram.INTEGRATOR(x0=equations.start_state)
    rates = diagram.FUNCTION(Rates, nin=3)
    packet = diagram.FUNCTION(Packet, nin=2)
    motion = diagram.FUNCTION(Motion, nin=1)
    forward = _Register(clock, np.zeros(2 * n), ticks, np.inf)
    start = np.concatenate([equations.p_start, np.zeros(n)])
    backward = _Register(clock, start, ticks, surface)
    diagram.add_block(forward)
    diagram.add_block(backward)
    diagram.connect(state, rates[0], packet[0], motion)
    diagram.connect(forward, rates[1])
    diagram.connect(backward, rates[2], packet[1])
    diagram.connect(packet, forward)
    diagram.connect(motion, backward)
    diagram.connect(rates, state)
    diagram.compile(report=False)
    out = simulation.run(diagram, T=duration, max_step=PERIOD)
    times, states = np.array(out.t), np.array(out.x)
    rows = []
    for row in states:
        p, v = problem.robot.tool(row[:n], row[n : 2 * n])
        F_e = equations.environment_force(problem.layer_at(p[0]), p, v)
        rows.append((p, v, F_e, row[4 * n : 5 * n]))
    names = ("tool_position", "tool_velocity", "environment_force", "control_force")
    signals = {name: np.array([row[i] for row in rows]) for i, name in enumerate(names)}
    if law is None:
        del signals["control_force"]  # A received value, which is not recorded.
    return Solution(
        time=times, signals=signals, steps=None, derivative_evaluations=None
    )
