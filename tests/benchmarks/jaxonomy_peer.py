"""Jaxonomy: the same block diagram, compiled by JAX.

Its TransportDelay samples on a clock and interpolates linearly, so that steps end on
every tick; PERIOD is the one of the sampled Drake diagram. Puncture and contact are
zero crossings. Solver: its Dopri5, float64.
"""

import functools
import logging
import time

import jax.numpy as jnp
import jaxonomy
import numpy as np
from benchmarks.straightforward import Solution, StartJoints
from jaxonomy.library import TransportDelay
from surfaces import Border

from teleop_drake.scenario import LoadScenario, Scenario

NAME = "jaxonomy, 1 ms TransportDelay, compiled"
SWEEPS = False  # Each delay would be compiled anew.
PERIOD = 0.001
TOLERANCE = 1e-8


logging.getLogger("jaxonomy").setLevel(logging.WARNING)


class _Slave(jaxonomy.LeafSystem):
    """Controller, robot and environment; input [F_h, v_d], mode 1: past the tissue."""

    def __init__(self, scenario: Scenario):
        super().__init__(name="slave")
        self.n = n = scenario.num_axes
        self.scenario = scenario
        self.adaptive = scenario.controller.kind == "adaptive_backstepping"
        layers = scenario.environment.layers
        damped = [i for i, layer in enumerate(layers) if layer.damping > 0]
        self.border = layers[damped[-1] + 1].start if damped else None
        start = [StartJoints(scenario), np.zeros(n)]
        if self.adaptive:
            c = scenario.controller
            self.gains = [
                np.eye(n) * gain if np.ndim(gain) == 0 else np.array(gain)
                for gain in (c.Lambda, c.G1, c.G2, c.P)
            ]
            axes = [
                np.linspace(*axis)
                for axis in zip(
                    c.network.lower, c.network.upper, c.network.count, strict=True
                )
            ]
            grid = np.array(np.meshgrid(*axes, indexing="ij"))
            self.means = jnp.array(grid.reshape(n, -1).T)
            spacing = np.array([axis[1] - axis[0] for axis in axes])
            self.widths = jnp.array(c.network.width * spacing)
            self.Psi0 = np.array(scenario.initial_psi)
            weights = np.zeros(n * len(self.means))
            start += [np.zeros(n), weights, self.Psi0.ravel(), weights]
        self.declare_input_port("received")
        self.declare_default_mode(0)
        self.declare_continuous_state(
            default_value=jnp.array(np.concatenate(start)), ode=self._Rates
        )
        self.declare_output_port(self._Motion, name="motion", requires_inputs=False)
        self.declare_output_port(self._Force, name="force", requires_inputs=False)
        self.declare_output_port(self._Control, name="control")
        if self.border is not None:
            for direction, modes in (
                ("negative_then_non_negative", (0, 1)),
                ("positive_then_non_positive", (1, 0)),
            ):
                self.declare_zero_crossing(
                    lambda t, state, *inputs, **parameters: (
                        self._Tool(state)[0][0] - self.border
                    ),
                    start_mode=modes[0],
                    end_mode=modes[1],
                    direction=direction,
                    name=direction,
                )

    def _Tool(self, state):
        x = state.continuous_state
        q, qdot = x[: self.n], x[self.n : 2 * self.n]
        if self.n == 1:
            return q, qdot
        J = self._Jacobian(q)
        return jnp.array([J[1, 0], -J[0, 0]]), J @ qdot

    def _Jacobian(self, q):
        s1, c1 = 0.75 * jnp.sin(q[0]), 0.75 * jnp.cos(q[0])
        s12, c12 = 0.75 * jnp.sin(q[0] + q[1]), 0.75 * jnp.cos(q[0] + q[1])
        return jnp.array([[-s1 - s12, -s12], [c1 + c12, c12]])

    def _Acceleration(self, q, qdot, force):
        if self.n == 1:
            robot = self.scenario.robot
            return (force - robot.damping * qdot) / robot.mass
        m, L, c, inertia = 0.5, 0.75, 0.375, 0.0234
        outer = m * c * c + inertia
        off = m * L * c * jnp.cos(q[1]) + outer
        inner = m * c * c + m * L * L + inertia + 2 * off - outer
        h = m * L * c * jnp.sin(q[1])
        coriolis = jnp.array([-h * qdot[1] * (2 * qdot[0] + qdot[1]), h * qdot[0] ** 2])
        M = jnp.array([[inner, off], [off, outer]])
        return jnp.linalg.solve(M, self._Jacobian(q).T @ force - coriolis)

    def _EnvironmentForce(self, state):
        p, v = self._Tool(state)
        force = jnp.zeros(())
        for layer in self.scenario.environment.layers:
            law = layer.stiffness * (p[0] - layer.reference) + layer.damping * v[0]
            if self.border is None:
                force = jnp.where(p[0] >= layer.start, law, force)
            elif layer.start < self.border:
                force = jnp.where(state.mode == 0, law, force)
            else:
                inside = (p[0] >= layer.start) | (layer.start == self.border)
                force = jnp.where((state.mode == 1) & inside, law, force)
        return jnp.zeros(self.n).at[0].set(force)

    def _Rates(self, t, state, received, **parameters):
        n, x = self.n, state.continuous_state
        q, qdot = x[:n], x[n : 2 * n]
        F_e = self._EnvironmentForce(state)
        F_h, v_dd = received[:n], received[n:]
        if not self.adaptive:
            qddot = self._Acceleration(q, qdot, F_h - F_e)
            return jnp.concatenate([qdot, qddot])
        p, v = self._Tool(state)
        c, N = self.scenario.controller, len(self.means)
        Lambda, G1, G2, P = self.gains
        F_c, W1, Psi, W3 = jnp.split(x[2 * n :], np.cumsum([n, n * N, n * n]))
        W1, Psi, W3 = W1.reshape(n, N), Psi.reshape(n, n), W3.reshape(n, N)
        d = (p - self.means) / self.widths
        Phi = jnp.exp(-(d * d).sum(axis=1))
        Phi_dot = Phi * (-2 * (d @ (v / self.widths)))
        Psi_inv = jnp.linalg.inv(Psi)
        s = v - v_dd + Lambda @ (F_e - F_h)
        offset = Psi_inv @ (W1 @ Phi + G1 @ s)
        u = F_c - F_e
        z = u + offset
        g = P @ s + G1.T @ Psi_inv.T @ z
        beta, nu = c.adaptation_rate, c.leakage
        W1_dot = beta * (jnp.outer(g, Phi) - nu * W1)
        W3_dot = beta * (-jnp.outer(z, Phi) - nu * W3)
        Psi_dot = beta * (jnp.outer(g, u) + c.supervision * (self.Psi0 - Psi))
        lead_dot = W1_dot @ Phi + W1 @ Phi_dot + G1 @ (Psi @ u + W1 @ Phi)
        alpha_dot = W3 @ Phi + Psi_inv @ (Psi_dot @ offset - lead_dot)
        F_c_dot = alpha_dot - Psi.T @ (P.T @ s) - G2 @ z
        return jnp.concatenate(
            [
                qdot,
                self._Acceleration(q, qdot, u),
                F_c_dot,
                W1_dot.ravel(),
                Psi_dot.ravel(),
                W3_dot.ravel(),
            ]
        )

    def _Motion(self, t, state, *inputs, **parameters):
        return jnp.concatenate(self._Tool(state))

    def _Force(self, t, state, *inputs, **parameters):
        return self._EnvironmentForce(state)

    def _Control(self, t, state, received, **parameters):
        if self.adaptive:
            return state.continuous_state[2 * self.n : 3 * self.n]
        return received[: self.n]


class _Master(jaxonomy.LeafSystem):
    """Surgeon and haptic device; input [p, v] as felt, mode 1: contact perceived."""

    def __init__(self, scenario: Scenario):
        super().__init__(name="master")
        self.n = n = scenario.num_axes
        self.b1, self.b0 = scenario.haptic_device.numerator
        _, self.a1, self.a0 = scenario.haptic_device.denominator
        self.velocity = jnp.array(scenario.surgeon.velocity)
        force, surface = scenario.surgeon.contact_force, Border(scenario, "contact")
        self.contact_force = jnp.zeros(n) if force is None else jnp.array(force)
        self.declare_input_port("felt")
        self.declare_default_mode(0)
        self.declare_continuous_state(default_value=jnp.zeros(2 * n), ode=self._Rates)
        self.declare_output_port(self._Packet, name="packet", requires_inputs=False)
        if force is not None and surface is not None:
            self.declare_zero_crossing(
                lambda t, state, felt, **parameters: felt[0] - surface,
                start_mode=0,
                end_mode=1,
                direction="negative_then_non_negative",
                name="contact",
            )

    def _Velocity(self, state):
        return jnp.where(state.mode == 0, self.velocity, 0.0)

    def _Rates(self, t, state, felt, **parameters):
        x1, x2 = jnp.split(state.continuous_state, 2)
        error = self._Velocity(state) - felt[self.n :]
        return jnp.concatenate([x2, error - self.a1 * x2 - self.a0 * x1])

    def _Packet(self, t, state, *inputs, **parameters):
        x1, x2 = jnp.split(state.continuous_state, 2)
        haptic = self.b0 * x1 + self.b1 * x2
        force = jnp.where(state.mode == 0, haptic, self.contact_force)
        return jnp.concatenate([force, self._Velocity(state)])


@functools.cache
def _Model(task: str, controller: str, delay: float, duration: float):
    scenario = LoadScenario(task, {"controller.kind": controller})
    n = scenario.num_axes
    builder = jaxonomy.DiagramBuilder()
    slave, master = builder.add(_Slave(scenario), _Master(scenario))
    start = np.concatenate([scenario.robot.start, np.zeros(n)])
    forward = builder.add(
        TransportDelay(PERIOD, delay, np.zeros(2 * n), name="forward")
    )
    backward = builder.add(TransportDelay(PERIOD, delay, start, name="return"))
    builder.connect(master.output_ports[0], forward.input_ports[0])
    builder.connect(forward.output_ports[0], slave.input_ports[0])
    builder.connect(slave.output_ports[0], backward.input_ports[0])
    builder.connect(backward.output_ports[0], master.input_ports[0])
    diagram = builder.build()
    ports = {
        name: slave.output_ports[i]
        for i, name in enumerate(("motion", "force", "control"))
    }
    options = jaxonomy.SimulatorOptions(
        rtol=TOLERANCE,
        atol=TOLERANCE * float(np.linalg.norm(scenario.surgeon.velocity)),
        ode_solver_method="dopri5",
        max_major_steps=int(4 * duration / PERIOD) + 1000,
        buffer_length=int(4 * duration / PERIOD) + 1000,
        return_context=False,
    )
    return diagram, diagram.create_context(), ports, options, n


def Prepare(task: str, controller: str, delay: float, duration: float) -> float:
    """Compiles by a first run; returns how much longer that took in s."""
    times = [time.perf_counter()]
    for _ in range(2):
        Simulate(task, controller, delay, duration)
        times.append(time.perf_counter())
    first, second = np.diff(times)
    return float(first - second)


def Simulate(task: str, controller: str, delay: float, duration: float) -> Solution:
    """Simulates a task; the first time with the same arguments it is compiled."""
    diagram, context, ports, options, n = _Model(task, controller, delay, duration)
    results = jaxonomy.simulate(
        diagram, context, (0.0, duration), options=options, recorded_signals=ports
    )
    motion = np.array(results.outputs["motion"])
    return Solution(
        time=np.array(results.time),
        signals={
            "tool_position": motion[:, :n],
            "tool_velocity": motion[:, n:],
            "environment_force": np.array(results.outputs["force"]),
            "control_force": np.array(results.outputs["control"]),
        },
        steps=None,
        derivative_evaluations=None,
    )
