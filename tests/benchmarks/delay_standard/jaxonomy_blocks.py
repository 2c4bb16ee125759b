"""Jaxonomy: hybrid block diagrams compiled by JAX; its delays interpolate samples."""

import jax
import jaxonomy
import numpy as np
from benchmarks.delay_standard.simulator import Input, Simulator
from jax import numpy as jnp
from jaxonomy import library

# Between the samples of an echo, and of a loop, s.
STEP = 0.01
LOOP_STEP = 1e-3


def source(signal: Input):
    """Returns a block with the signal, which stays a function of NumPy."""
    shape = jax.ShapeDtypeStruct((signal.size,), float)

    def value(t):
        return jax.pure_callback(lambda t: np.asarray(signal(float(t))), shape, t)

    return library.SourceBlock(value)


class Jaxonomy(Simulator):
    name = "Jaxonomy"

    @staticmethod
    def _simulate(system, context, port, times, step):
        """Returns a port at times, which are among the instants of the samples."""
        run = jaxonomy.simulate(
            system,
            context,
            (0.0, times[-1] + step),
            options=jaxonomy.SimulatorOptions(
                max_major_step_length=step, rtol=1e-9, atol=1e-9
            ),
            recorded_signals={"answer": port},
        )
        rows = np.searchsorted(run.time, times + 1e-9) - 1
        assert np.abs(run.time[rows] - times).max() < 1e-9
        return np.asarray(run.outputs["answer"])[rows]

    def _run(self, builder, port, times, step):
        system = builder.build()
        return self._simulate(system, system.create_context(), port, times, step)

    def echo(self, signal: Input, path, times):
        step = STEP if min(path) >= STEP else STEP / 5
        builder = jaxonomy.DiagramBuilder()
        port = builder.add(source(signal)).output_ports[0]
        for T in path:
            late = library.TransportDelay(
                dt=step, delay_seconds=T, initial_output=jnp.zeros(signal.size)
            )
            builder.add(late)
            builder.connect(port, late.input_ports[0])
            port = late.output_ports[0]
        return self._run(builder, port, times, step)

    def varying_echo(self, signal: Input, T, times):
        builder = jaxonomy.DiagramBuilder()
        sender = builder.add(source(signal))
        delay = builder.add(source(Input(1, lambda z: np.array([T(z[0])]))))
        late = library.VariableTransportDelay(
            dt=STEP, max_delay_seconds=0.16, initial_output=jnp.zeros(1)
        )
        builder.add(late)
        builder.connect(sender.output_ports[0], late.input_ports[0])
        builder.connect(delay.output_ports[0], late.input_ports[1])
        return self._run(builder, late.output_ports[0], times, STEP)

    def switched_echo(self, signal: Input, delays, times):
        """Runs of one system, each in a new context with another delay."""
        builder = jaxonomy.DiagramBuilder()
        sender = builder.add(source(signal))
        late = library.TransportDelay(
            dt=STEP, delay_seconds=max(delays), initial_output=jnp.zeros(1)
        )
        builder.add(late)
        builder.connect(sender.output_ports[0], late.input_ports[0])
        system = builder.build()
        columns = []
        for T in delays:
            context = system.create_context()
            own = context[late.system_id].with_parameter("delay_seconds", T)
            context = context.with_subcontext(late.system_id, own)
            port = late.output_ports[0]
            columns.append(self._simulate(system, context, port, times, STEP)[:, 0])
        return np.column_stack(columns)

    def _loop(self, blocks, times):
        """Returns the first block's first output; the blocks form a ring."""
        builder = jaxonomy.DiagramBuilder()
        for block in blocks:
            builder.add(block)
        for block, after in zip(blocks, [*blocks[1:], blocks[0]], strict=True):
            builder.connect(block.output_ports[0], after.input_ports[0])
        return self._run(builder, blocks[0].output_ports[0], times, LOOP_STEP)[:, 0]

    def scalar_loop(self, k, T, times):
        return self._loop(
            [
                library.Integrator(initial_state=jnp.ones(1)),
                _delay(T, jnp.ones(1)),
                library.FeedthroughBlock(lambda x: -k * x),
            ],
            times,
        )

    def pd(self, sensor, actuator, times):
        A = np.array([[0.0, 1.0], [0.0, 0.0]])
        B = np.array([[0.0], [1.0]])
        plant = library.LTISystem(A, B, np.eye(2), np.zeros((2, 1)))
        law = library.FeedthroughBlock(lambda x: jnp.array([4 * (1 - x[0]) - 2 * x[1]]))
        ring = [plant]
        if sensor:
            ring.append(_delay(sensor, jnp.zeros(2)))
        ring.append(law)
        if actuator:
            ring.append(_delay(actuator, jnp.zeros(1)))
        return self._loop(ring, times)


def _delay(T: float, initial):
    return library.TransportDelay(dt=LOOP_STEP, delay_seconds=T, initial_output=initial)
