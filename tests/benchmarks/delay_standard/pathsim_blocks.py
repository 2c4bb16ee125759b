"""PathSim: blocks with a Delay that draws straight lines between steps."""

from itertools import pairwise

import numpy as np
from benchmarks.delay_standard.simulator import Input, Simulator
from pathsim import Connection, Simulation
from pathsim.blocks import ODE, Delay, Function, Scope, Source
from pathsim.events import ZeroCrossingDown
from pathsim.solvers import RK4, RKDP54

STEP = 0.01


def recorded(scope, times):
    """Returns what a scope has at times, which are among its own."""
    instants, values = scope.read()
    rows = np.searchsorted(instants, times + 1e-9) - 1
    assert np.abs(instants[rows] - times).max() < 1e-9
    return values[0][rows]


class PathSim(Simulator):
    name = "PathSim"

    def echo(self, signal: Input, path, times):
        columns = []
        for i in range(signal.size):
            source = Source(lambda t, i=i: signal(t)[i])
            chain = [source, *(Delay(T) for T in path), Scope()]
            columns.append(self._run(chain, times))
        return np.column_stack(columns)

    def switched_echo(self, signal: Input, delays, times):
        """A Delay whose tau is set anew is made anew; reset() clears the others."""
        chain = [Source(lambda t: signal(t)[0]), Delay(delays[0]), Scope()]
        links = [Connection(a, b) for a, b in pairwise(chain)]
        simulation = Simulation(chain, links, dt=STEP, log=False)
        columns = []
        for T in delays:
            simulation.reset()
            chain[1].tau = T
            simulation.run(times[-1] + STEP)
            columns.append(recorded(chain[-1], times))
        return np.column_stack(columns)

    def bounce(self, times):
        """The ball is PathSim's example; its velocity returns through two Delays."""
        late = [Delay(0.15), Delay(0.15)]

        def impact(_):
            x, v = ball.engine.get()
            ball.engine.set(np.array([abs(x), -0.8 * v]))

        ball = ODE(
            lambda x, u, t: np.array([x[1], -9.81 - 0.5 * u[0]]), np.array([1.0, 0])
        )
        scope = Scope()
        links = [
            Connection(ball[1], late[0]),
            Connection(late[0], late[1], scope[2]),
            Connection(late[1], ball),
            Connection(ball[:2], scope[:2]),
        ]
        hits = ZeroCrossingDown(
            func_evt=lambda _: ball.engine.get()[0], func_act=impact, tolerance=1e-10
        )
        blocks = [ball, *late, scope]
        step = 2e-4
        simulation = Simulation(
            blocks,
            links,
            events=[hits],
            dt=step,
            dt_max=step,
            Solver=RKDP54,
            log=False,
            tolerance_lte_abs=1e-8,
            tolerance_lte_rel=1e-8,
        )
        simulation.run(times[-1] + 0.01, adaptive=True)
        instants, values = scope.read()
        return np.column_stack([np.interp(times, instants, row) for row in values])

    @staticmethod
    def _run(chain, times):
        links = [Connection(a, b) for a, b in pairwise(chain)]
        shortest = min(block.tau for block in chain[1:-1])
        step = STEP if shortest >= STEP else STEP / 5
        Simulation(chain, links, dt=step, log=False).run(times[-1] + STEP)
        return recorded(chain[-1], times)

    @staticmethod
    def _loop(blocks, links, output, times):
        """Runs by RK4 with a fixed step, and records one block's first output."""
        step = 1e-3 if times[-1] > 30 else 2e-4
        scope = Scope()
        every = [Connection(*link) for link in [*links, (output, scope)]]
        simulation = Simulation([*blocks, scope], every, dt=step, Solver=RK4, log=False)
        simulation.run(times[-1] + step, adaptive=False)
        return recorded(scope, times)

    def scalar_loop(self, k, T, times):
        """What comes out of its Delay before T is 0: the state is x - 1."""
        plant = ODE(lambda x, u, t: -k * (u + 1), np.zeros(1))
        late = Delay(T)
        links = [(plant, late), (late, plant)]
        return self._loop([plant, late], links, plant, times) + 1

    def pd(self, sensor, actuator, times):
        plant = ODE(lambda x, u, t: np.array([x[1], u[0]]), np.zeros(2))
        law = Function(lambda x, v: 4 * (1 - x) - 2 * v)
        blocks = [plant, law]
        links = []
        measured = plant
        force = law
        if sensor:
            measured = Delay(sensor)
            blocks.append(measured)
            links.append((plant[:2], measured[:2]))
        if actuator:
            force = Delay(actuator)
            blocks.append(force)
            links.append((law, force))
        links += [(measured[:2], law[:2]), (force, plant)]
        return self._loop(blocks, links, plant, times)
