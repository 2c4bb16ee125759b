"""This package: the same diagrams by machine code and in Drake's Simulator."""

import math

import numpy as np
from benchmarks.delay_standard.packet_tasks import (
    SEND_PERIOD,
    jittered_packets,
    stale_packets,
)
from benchmarks.delay_standard.simulator import Input, Simulator
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.primitives import Integrator
from signal_delays import Conveyor, Loop, Source, TimeDelay
from wired import Wired

from teleop_drake import Compile
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import VariableDelay
from teleop_drake.loops.engine.parameters import SetNumbers
from teleop_drake.loops.kernel import Delay, FixedBlock, Kernel, Transition
from teleop_drake.model.run.simulate import simulate

STALE = stale_packets()

# The first fall of the sawtooth, and how long after the one before each other is, s.
FIRST_FALL = 0.195
SAW_PERIOD = 0.2


def source(signal: Input) -> FixedBlock:
    """Returns a block with the signal, whose jump is an event."""
    jump = Transition(mode=(lambda on: 1 - on, "mode"), offset=signal.jump)
    function = signal.function  # Machine code follows what a law refers to by name.
    kernel = Kernel(
        outputs={"u": (lambda t, on: function(np.append(t, on)), "time", "mode")},
        transitions={"jump": jump},
    )
    block = FixedBlock("source", kernel, inputs={}, outputs={"u": signal.size})
    block.DeclareDiscreteState([0.0])
    return block


def sawtooth(start: float) -> FixedBlock:
    """Returns a block whose output rises by half of the time, and falls at events."""
    fall = Transition(
        mode=(lambda falls: falls + 1, "mode"), period=SAW_PERIOD, offset=FIRST_FALL
    )

    def delay(t, falls):
        return start + (t - SAW_PERIOD * falls) / 2

    kernel = Kernel(outputs={"T": (delay, "time", "mode")}, transitions={"fall": fall})
    block = FixedBlock("sawtooth", kernel, inputs={}, outputs={"T": 1})
    block.DeclareDiscreteState([0.0])
    return block


def receiver(delay: Delay) -> FixedBlock:
    """Returns a block that shows what arrives of its input."""
    ports = {"inputs": {"u": 1}, "outputs": {"shown": 1}}
    return FixedBlock("receiver", Kernel(delays=[delay]), **ports)


class Package(Simulator):
    """Delays whose jumps and their echoes end steps."""

    def __init__(self, engine: str):
        self.name = f"teleop-drake, {engine}"
        self._engine = engine

    def _simulate(self, systems, connections, answer, times, longest=0.01):
        """Returns an output at times; the state is integrated to an error of 1e-10."""
        config = SimulatorConfig(
            integration_scheme="runge_kutta5", accuracy=1e-10, max_step_size=longest
        )
        run = simulate(
            Wired(systems, connections, {"answer": answer}),
            duration=times[-1] + 0.01,
            engine=self._engine,
            simulator=config,
        )
        assert run.solver.engine == self._engine
        return run.Interpolate("answer", times)

    def echo(self, signal: Input, path, times):
        systems = {"source": source(signal)}
        for i, T in enumerate(path):
            systems[f"delay_{i}"] = TransportDelay(delay=T, size=signal.size)
        names = [*systems]
        connections = dict(zip(names[1:], names, strict=False))
        longest = min(0.01, *path, 0.01)
        return self._simulate(systems, connections, names[-1], times, longest)

    def _loop(self, law, start, history, sensor, actuator, times):
        """x' = [the other states, force], the force is a law of x; both delayed."""
        n = len(start)
        control = Kernel(outputs={"force": (law, "x")})
        law_block = FixedBlock("law", control, inputs={"x": n}, outputs={"force": 1})
        rate = Kernel(
            outputs={"rate": (lambda x, force: np.append(x[1:], force), "x", "force")}
        )
        inputs = {"x": n, "force": 1}
        rates = FixedBlock("rates", rate, inputs=inputs, outputs={"rate": n})
        systems = {"law": law_block, "rates": rates, "plant": Integrator(start)}
        connections = {"plant": "rates", "rates.x": "plant"}
        links = (
            ("sensor", sensor, "plant", "law.x", history),
            ("actuator", actuator, "law", "rates.force", [0.0]),
        )
        for name, T, sender, target, initial in links:
            if T > 0:
                systems[name] = TransportDelay(
                    delay=T,
                    size=len(initial),
                    initial_value=initial,
                    max_sample_interval=math.inf,
                )
                connections |= {name: sender, target: name}
            else:
                connections[target] = sender
        longest = min(T for T in (sensor, actuator, 0.05) if T > 0)
        return self._simulate(systems, connections, "plant", times, longest)[:, 0]

    def scalar_loop(self, k, T, times):
        return self._loop(lambda x: -k * x, [1.0], [1.0], T, 0.0, times)

    def pd(self, sensor, actuator, times):
        def law(x):
            return np.array([4 * (1 - x[0]) - 2 * x[1]])

        rest = [0.0, 0.0]
        return self._loop(law, rest, rest, sensor, actuator, times)

    def packets(self, times):
        """The signal counts the packets: 1 + t / 0.02 s."""
        arrivals = [float(packet.arrival) for packet in jittered_packets()]
        count = Input(1, lambda z: 1 + z[:1] / 0.02)
        delay = Delay(
            signal="u",
            output="shown",
            initial_value=[0.0],
            period=0.02,
            shown=lambda k: arrivals[k] if k < len(arrivals) else math.inf,
            end=1.0,
        )
        return self._packets(count, delay, times)

    def _packets(self, signal, delay, times):
        systems = {"sender": source(signal), "receiver": receiver(delay)}
        wires = {"receiver": "sender"}
        return self._simulate(systems, wires, "receiver", times)[:, 0]

    def stale_command(self, times):
        """The mode is the last packet's number, when it expires, and if it counts."""
        arrivals = {
            round(packet.sent / SEND_PERIOD): packet.arrival for packet in STALE
        }
        number = Input(1, lambda z: 1 + z[:1] / 0.02)
        delay = Delay(
            signal="u",
            output="shown",
            initial_value=[0.0],
            period=float(SEND_PERIOD),
            shown=lambda k: float(arrivals.get(k, math.inf)),
            end=1.0,
        )
        arrives = Transition(
            guard=(lambda shown, mode: shown - mode[:1] - 0.5, "shown", "mode"),
            mode=(
                lambda t, shown: np.array([shown[0], t + 0.1, 1.0]),
                "time",
                "shown",
            ),
        )
        expires = Transition(
            guard=(lambda t, m: t - m[1:2] - 100 * (1 - m[2:]), "time", "mode"),
            mode=(lambda m: np.array([m[0], m[1], 0.0]), "mode"),
        )

        def command(m):
            """Returns 1 + (k mod 3), k = number - 1."""
            k = np.floor(m[:1] - 0.5)
            return m[2:] * (1 + k - 3 * np.floor((k + 0.5) / 3))

        law = Kernel(
            rate=(command, "mode"),
            outputs={"both": (lambda x, m: np.append(command(m), x), "state", "mode")},
            transitions={"arrives": arrives, "expires": expires},
        )
        watchdog = FixedBlock(
            "watchdog", law, inputs={"shown": 1}, outputs={"both": 2}, state=[0.0]
        )
        watchdog.DeclareDiscreteState([0.0, 0.0, 0.0])
        systems = {
            "sender": source(number),
            "receiver": receiver(delay),
            "watchdog": watchdog,
        }
        wires = {"receiver": "sender", "watchdog": "receiver"}
        return self._simulate(systems, wires, "watchdog", times)

    def varying_echo(self, signal, T, times):
        """T rises for 0.2 s and falls at once; the signal goes forward there."""
        systems = {
            "sender": source(signal),
            "steering": sawtooth(float(T(0.0))),
            "late": VariableDelay(size=1, maximum_delay=0.2),
        }
        wires = {"late.signal": "sender", "late.delay": "steering"}
        return self._simulate(systems, wires, "late", times)

    def signal_delay(self, times):
        def wave(t):
            return np.array([np.sin(3 * t)])

        def swings(t):
            return np.array([0.12 + 0.08 * np.cos(20 * t)])

        diagram = TimeDelay(Source(wave), Source(swings))
        return self._out(diagram, times)

    def _out(self, diagram, times, name="out"):
        config = SimulatorConfig(
            integration_scheme="runge_kutta5", accuracy=1e-10, max_step_size=0.01
        )
        end = times[-1] + 0.01
        run = simulate(diagram, duration=end, engine=self._engine, simulator=config)
        return run.Interpolate(name, times)[:, 0]

    def state_delay(self, times):
        diagram, _ = Loop(
            lambda t, late: late / (2 * np.sqrt(1 + t)),
            lambda t, x: t - x + np.sqrt(2.0),
            (0.0, 1.0),
            maximum_delay=3.0,
        )
        return self._out(diagram, times, "x")

    def conveyor(self, times):
        def clock(t):
            return np.array([t])

        def velocity(t):
            return np.array([0.5 + np.sin(2 * t)])

        return self._out(Conveyor(Source(clock), Source(velocity), 0.3), times)

    def sampled(self, times):
        """The last sample is a mode, which the delay of 0.04 s delivers."""
        sample = Transition(mode=(lambda x: x, "x"), period=0.1)
        hold = FixedBlock(
            "hold",
            Kernel(
                outputs={"held": (lambda m: -4 * m, "mode")},
                transitions={"sample": sample},
            ),
            inputs={"x": 1},
            outputs={"held": 1},
            mode=[0.0],
        )
        systems = {
            "hold": hold,
            "plant": Integrator([1.0]),
            "late": TransportDelay(0.04, 1),
        }
        wires = {"hold": "plant", "late": "hold", "plant": "late"}
        return self._simulate(systems, wires, "plant", times)[:, 0]

    def switched_echo(self, signal, delays, times):
        """Runs of one program, or of one Diagram with another Context each."""
        diagram = Wired(
            {"sender": source(signal), "late": TransportDelay(delays[0], 1)},
            {"late": "sender"},
            {"answer": "late"},
        )
        end = times[-1] + 0.01
        if self._engine == "compiled":
            program = Compile(diagram, duration=end)
            runs = [program.Run(**{"late.delay": T}) for T in delays]
        else:
            runs = []
            for T in delays:
                context = diagram.CreateDefaultContext()
                SetNumbers(diagram, context, {"late.delay": T})
                run = simulate(diagram, context=context, duration=end, engine="drake")
                runs.append(run)
        return np.column_stack([run.Interpolate("answer", times) for run in runs])

    def bounce(self, times):
        """The mode is what impacts have added to the velocity, and 1 before the next.

        Behind an impact, x = 0 is no impact until the ball falls again.
        """

        def speed(x, mode):
            return x[1] + mode[0]

        hit = Transition(
            guard=(lambda x, mode: mode[1:] - 1 - x[:1], "state", "mode"),
            mode=(
                lambda x, mode: np.array([-0.8 * speed(x, mode) - x[1], 0.0]),
                "state",
                "mode",
            ),
        )
        fall = Transition(
            guard=(
                lambda x, mode: -x[1:] - mode[:1] - mode[1:] * 100,
                "state",
                "mode",
            ),
            mode=(lambda mode: np.array([mode[0], 1.0]), "mode"),
        )
        law = Kernel(
            rate=(
                lambda x, mode, felt: np.array([speed(x, mode), -9.81 - 0.5 * felt[0]]),
                "state",
                "mode",
                "felt",
            ),
            outputs={
                "velocity": (
                    lambda x, mode: np.array([speed(x, mode)]),
                    "state",
                    "mode",
                ),
                "height": (lambda x: x[:1], "state"),
            },
            transitions={"hit": hit, "fall": fall},
        )
        outputs = {"velocity": 1, "height": 1}
        ball = FixedBlock(
            "ball", law, inputs={"felt": 1}, outputs=outputs, state=[1, 0]
        )
        ball.DeclareDiscreteState([0.0, 1.0])
        systems = {
            "ball": ball,
            "to_hand": TransportDelay(delay=0.15, size=1),
            "to_ball": TransportDelay(delay=0.15, size=1),
        }
        diagram = Wired(
            systems,
            {"to_hand": "ball.velocity", "to_ball": "to_hand", "ball": "to_ball"},
            {"height": "ball.height", "velocity": "ball.velocity", "felt": "to_hand"},
        )
        config = SimulatorConfig(
            integration_scheme="runge_kutta5", accuracy=1e-8, max_step_size=0.01
        )
        run = simulate(diagram, duration=1.6, engine=self._engine, simulator=config)
        assert run.solver.engine == self._engine
        names = ("height", "velocity", "felt")
        return np.column_stack([run.Interpolate(name, times)[:, 0] for name in names])
