"""JiTCDDE: the same delay differential equation, compiled from its symbols."""

import contextlib
import itertools
import math
import tempfile
import time
from pathlib import Path

import numpy as np
import symengine
from benchmarks.straightforward import Solution, StartJoints
from jitcdde import jitcdde, t, y
from surfaces import Border

from teleop_drake.scenario import LoadScenario, Scenario

# (relative, absolute in units of the commanded speed), by the number of axes.
TOLERANCES = {1: (3e-7, 3e-7), 2: (3e-6, 3e-6)}
_LONGEST_DELAY = 1.0

_modules: dict[tuple[str, str], tuple[Path, object]] = {}


class _Model:
    """The equations in symbols; the state is [q, q', x1, x2, F_c, W1, Psi, W3].

    G. Ansmann, Chaos 28 (2018). Right-hand sides have to be smooth: what is frozen
    between two events is a control parameter, and so are the delays.
    """

    def __init__(self, scenario: Scenario):
        self.scenario = scenario
        self.n = n = scenario.num_axes
        names = ["k_e", "d_e", "x_e", "sent", "received", "T_f", "T_r"]
        self.parameters = symengine.symbols(names)
        axes = [
            np.linspace(*axis)
            for axis in zip(
                scenario.controller.network.lower,
                scenario.controller.network.upper,
                scenario.controller.network.count,
                strict=True,
            )
        ]
        self.means = np.array(np.meshgrid(*axes, indexing="ij")).reshape(n, -1).T
        spacing = np.array([axis[1] - axis[0] for axis in axes])
        self.widths = scenario.controller.network.width * spacing
        self.N = len(self.means)
        weights, psi = np.zeros(n * self.N), scenario.initial_psi.ravel()
        start = [StartJoints(scenario), np.zeros(4 * n), weights, psi, weights]
        self.start = np.concatenate(start)
        self.helpers: list = []

    def Named(self, name: str, expressions) -> np.ndarray:
        """Returns symbols for expressions which are evaluated once (`helpers`)."""
        values = np.asarray(expressions, dtype=object)
        symbols = np.empty(values.shape, dtype=object)
        for i, value in np.ndenumerate(values):
            symbols[i] = symengine.Symbol("_".join([name, *map(str, i)]))
            self.helpers.append((symbols[i], value))
        return symbols

    def Tool(self, q, qdot):
        """Tool position and velocity, of symbols or of numbers."""
        if self.n == 1:
            return np.array([q[0]]), np.array([qdot[0]])
        J = self.Jacobian(q)
        return np.array([J[1, 0], -J[0, 0]]), J @ qdot

    def Jacobian(self, q):
        sin, cos = _Functions(q[0])
        s1, c1 = 0.75 * sin(q[0]), 0.75 * cos(q[0])
        s12, c12 = 0.75 * sin(q[0] + q[1]), 0.75 * cos(q[0] + q[1])
        return np.array([[-s1 - s12, -s12], [c1 + c12, c12]])

    def Acceleration(self, q, qdot, force):
        if self.n == 1:
            robot = self.scenario.robot
            return (force - robot.damping * qdot) / robot.mass
        sin, cos = _Functions(q[0])
        m, L, c, inertia = 0.5, 0.75, 0.375, 0.0234
        outer = m * c * c + inertia
        off = m * L * c * cos(q[1]) + outer
        inner = m * c * c + m * L * L + inertia + 2 * off - outer
        h = m * L * c * sin(q[1])
        coriolis = np.array([-h * qdot[1] * (2 * qdot[0] + qdot[1]), h * qdot[0] ** 2])
        a, b = self.Jacobian(q).T @ force - coriolis
        determinant = inner * outer - off * off
        return np.array(
            [(outer * a - off * b) / determinant, (inner * b - off * a) / determinant]
        )

    def State(self, at=None):
        """q, q', x1, x2 at a time, in symbols."""
        n = self.n
        args = () if at is None else (at,)
        return (
            np.array([y(k * n + i, *args) for i in range(n)], dtype=object)
            for k in range(4)
        )

    def Equations(self) -> list:
        """The right-hand side in symbols."""
        s, n = self.scenario, self.n
        k_e, d_e, x_e, sent, received, T_f, T_r = self.parameters
        b1, b0 = s.haptic_device.numerator
        _, a1, a0 = s.haptic_device.denominator
        velocity = np.array(s.surgeon.velocity, dtype=object)
        zero = np.array([symengine.Integer(0)] * n, dtype=object)
        contact_force = (
            zero
            if s.surgeon.contact_force is None
            else np.array(s.surgeon.contact_force, dtype=object)
        )
        q, qdot, x1, x2 = self.State()
        p, v = self.Tool(q, qdot)
        p, v = self.Named("p", p), self.Named("v", v)
        F_e = np.array([k_e * (p[0] - x_e) + d_e * v[0], *zero[1:]], dtype=object)
        F_e = self.Named("F_e", F_e)
        _, _, x1_late, x2_late = self.State(t - T_f)
        q_late, qdot_late, _, _ = self.State(t - T_r)
        _, felt = self.Tool(q_late, qdot_late)
        # `received` is 0 before the first packet, 1 in velocity mode, 2 in force mode.
        haptic, force = received * (2 - received), received * (received - 1) / 2
        F_h = haptic * (b0 * x1_late + b1 * x2_late) + force * contact_force
        F_h = self.Named("F_h", F_h)
        v_dd = haptic * velocity
        F_c = np.array([y(4 * n + i) for i in range(n)], dtype=object)
        rates = [qdot, self.Acceleration(q, qdot, F_c - F_e), x2]
        rates.append(sent * velocity - felt - a1 * x2 - a0 * x1)
        rates.append(self._Law(p, v, F_e, F_h, v_dd))
        return list(np.concatenate(rates))

    def _Law(self, p, v, F_e, F_h, v_dd):
        """(4.2) to (4.53), (5.2) to (5.53), away from the projection's limit."""
        c, n, N = self.scenario.controller, self.n, self.N
        Lambda, G1, G2, P = (
            np.eye(n) * gain if np.ndim(gain) == 0 else np.array(gain)
            for gain in (c.Lambda, c.G1, c.G2, c.P)
        )
        parts = np.cumsum([4 * n, n, n * N, n * n, n * N])
        F_c, W1, Psi, W3 = (
            np.array([y(i) for i in range(a, b)], dtype=object)
            for a, b in itertools.pairwise(parts)
        )
        W1, Psi, W3 = W1.reshape(n, N), Psi.reshape(n, n), W3.reshape(n, N)
        d = self.Named("d", (p - self.means) / self.widths)
        Phi = self.Named("Phi", [symengine.exp(-(row @ row)) for row in d])
        Phi_dot = self.Named("Phi_dot", Phi * (-2 * (d @ (v / self.widths))))
        if n == 1:
            Psi_inv = np.array([[1 / Psi[0, 0]]], dtype=object)
        else:
            determinant = Psi[0, 0] * Psi[1, 1] - Psi[0, 1] * Psi[1, 0]
            Psi_inv = (
                np.array([[Psi[1, 1], -Psi[0, 1]], [-Psi[1, 0], Psi[0, 0]]])
                / determinant
            )
        Psi_inv = self.Named("Psi_inv", Psi_inv)
        s = self.Named("s", v - v_dd + Lambda @ (F_e - F_h))
        y1 = self.Named("y1", W1 @ Phi)
        offset = self.Named("offset", Psi_inv @ (y1 + G1 @ s))
        u = self.Named("u", F_c - F_e)
        z = self.Named("z", u + offset)
        g = self.Named("g", P @ s + G1.T @ Psi_inv.T @ z)
        beta, nu = c.adaptation_rate, c.leakage
        W1_dot = beta * (np.outer(g, Phi) - nu * W1)
        W3_dot = beta * (-np.outer(z, Phi) - nu * W3)
        Psi0 = self.scenario.initial_psi
        Psi_dot = beta * (np.outer(g, u) + c.supervision * (Psi0 - Psi))
        W1_dot, Psi_dot = self.Named("W1_dot", W1_dot), self.Named("Psi_dot", Psi_dot)
        s_dot = Psi @ u + y1
        lead_dot = W1_dot @ Phi + W1 @ Phi_dot + G1 @ s_dot
        alpha_dot = W3 @ Phi + Psi_inv @ (Psi_dot @ offset - lead_dot)
        F_c_dot = alpha_dot - Psi.T @ (P.T @ s) - G2 @ z
        return np.concatenate(
            [F_c_dot, W1_dot.ravel(), Psi_dot.ravel(), W3_dot.ravel()]
        )


def _Functions(x):
    numeric = isinstance(x, (float, np.floating))
    return (np.sin, np.cos) if numeric else (symengine.sin, symengine.cos)


def Prepare(task: str, controller: str, *_) -> float:
    """Compiles the equations of a task; returns the time that took in s."""
    key = (task, controller)
    start = time.perf_counter()
    if key not in _modules:
        model = _Model(LoadScenario(task, {"controller.kind": controller}))
        *_, T_f, T_r = model.parameters
        equations = model.Equations()
        dde = jitcdde(
            equations,
            helpers=model.helpers,
            n=len(model.start),
            delays=[T_f, T_r],
            max_delay=_LONGEST_DELAY,
            control_pars=model.parameters,
            verbose=False,
        )
        folder = tempfile.TemporaryDirectory()
        # Away from any pyproject.toml, which its build would read.
        with contextlib.chdir(folder.name):
            dde.compile_C(simplify=False)
            path = dde.save_compiled(f"{task}.so", overwrite=True)
            _modules[key] = Path(path).resolve(), folder
    return time.perf_counter() - start


def Compiled(task: str, controller: str) -> str:
    """Returns the file with the compiled equations of a task, for Adopt()."""
    Prepare(task, controller)
    return str(_modules[task, controller][0])


def Adopt(task: str, controller: str, file: str) -> None:
    """Takes what another process, which has to live on, has compiled."""
    _modules[task, controller] = Path(file), None


def Simulate(task: str, controller: str, delay: float, duration: float) -> Solution:
    """Simulates a task; the first time in a process it is compiled."""
    Prepare(task, controller)
    scenario = LoadScenario(task, {"controller.kind": controller})
    return _Run(scenario, str(_modules[task, controller][0]), delay, duration)


def _Run(scenario: Scenario, module: str, delay: float, duration: float) -> Solution:
    model = _Model(scenario)
    n = model.n
    layers, surface = scenario.environment.layers, Border(scenario, "contact")
    if scenario.surgeon.contact_force is None:
        surface = None
    dde = jitcdde(
        n=len(model.start),
        delays=[delay, delay],
        max_delay=delay,
        control_pars=model.parameters,
        module_location=module,
        verbose=False,
    )
    dde.constant_past(model.start, time=0.0)
    rtol, relative = TOLERANCES[n]
    dde.set_integration_parameters(
        rtol=rtol,
        atol=relative * float(np.linalg.norm(scenario.surgeon.velocity)),
        first_step=1e-4,
        max_step=delay,
        min_step=1e-14,
    )
    borders = [layer.start for layer in layers] + [math.inf]
    layer = 0
    mode = {"sent": 1.0, "received": 0.0}
    changes = [(delay, "received", 1.0)]
    times, rows = [], []

    def Sample(state):
        q, qdot = state[:n], state[n : 2 * n]
        p, v = model.Tool(q, qdot)
        law = layers[layer]
        F_e = np.zeros(n)
        F_e[0] = law.stiffness * (p[0] - law.reference) + law.damping * v[0]
        return [p, v, F_e, state[4 * n : 5 * n]]

    def Restart():
        law = layers[layer]
        dde.set_parameters(
            law.stiffness,
            law.damping,
            law.reference,
            mode["sent"],
            mode["received"],
            delay,
            delay,
        )
        dde.adjust_diff()
        dde.dt = min(dde.dt, 1e-4)

    def Gap(state):
        """Positive past one of the layer's borders; the border's index change too."""
        x = model.Tool(state[:n], state[n : 2 * n])[0][0]
        up, down = x - borders[layer + 1], borders[layer] - x
        return (up, 1) if up > down else (down, -1)

    Restart()
    steps = 0
    while dde.t < duration:
        begin = dde.t
        bound = min([duration, *(change[0] for change in changes)])
        length = min(dde.dt, bound - begin)
        if length <= 1e-12:
            pass
        elif not dde.try_single_step(length):
            continue
        else:
            before = Gap(dde.DDE.get_recent_state(begin))[0]
            gap, direction = Gap(dde.DDE.get_recent_state(begin + length))
            crosses = gap > 1e-15
            if crosses:
                # Shorten the step until it ends on the border: false position.
                low, high = (0.0, before), (length, gap)
                for _ in range(60):
                    a, b = low[1], high[1]
                    share = -a / (b - a) if a < 0 else 0.5
                    share = min(max(share, 0.01), 0.99)
                    length = low[0] + share * (high[0] - low[0])
                    dde.DDE.get_next_step(length)
                    gap, _ = Gap(dde.DDE.get_recent_state(begin + length))
                    if gap > 0:
                        high = (length, gap)
                    else:
                        low = (length, gap)
                    if 0 <= gap < 1e-14 or high[0] - low[0] < 1e-13:
                        break
                length = high[0]
                dde.DDE.get_next_step(length)
            dde.DDE.accept_step()
            steps += 1
            state = np.array(dde.DDE.get_current_state())
            times.append(dde.t)
            rows.append(Sample(state))
            dde.DDE.forget(dde.max_delay)
            if crosses:
                layer += direction
                arrived = borders[layer] if direction > 0 else None
                if surface is not None and arrived == surface:
                    surface = None
                    changes += [
                        (dde.t + delay, "sent", 0.0),
                        (dde.t + 2 * delay, "received", 2.0),
                    ]
                Restart()
                continue
        due = [change for change in changes if change[0] <= dde.t + 1e-12]
        if due:
            changes = [change for change in changes if change not in due]
            mode |= {name: value for _, name, value in due}
            Restart()
    return Solution(
        time=np.array(times),
        signals={
            name: np.array([row[i] for row in rows])
            for i, name in enumerate(
                ("tool_position", "tool_velocity", "environment_force", "control_force")
            )
        },
        steps=steps,
        derivative_evaluations=None,
    )
