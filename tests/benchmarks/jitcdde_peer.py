"""JiTCDDE: the same delay differential equation, compiled from its symbols."""

import contextlib
import itertools
import tempfile
import time
from math import inf, isinf
from pathlib import Path

import appendix_a as arm
import numpy as np
from benchmarks.accuracy import SIGNALS
from benchmarks.straightforward import Solution
from independent_solver import Result, _kind, thesis_task
from jitcdde import jitcdde, t, y
from scipy.optimize import brentq
from symengine import Integer, Symbol, cos, exp, sin, symbols

# Relative, and absolute in units of the commanded speed, by the number of axes.
TOLERANCES = {1: 3e-7, 2: 3e-6}
# How far past a border a step ends, m; in s, such steps are none.
_TINY = 1e-14

_modules: dict[tuple[str, str], tuple[Path, object]] = {}


def _Start(task: str, controller: str, delay: float) -> Result:
    """Returns a task's equations at its start, in numbers."""
    adaptive = controller == "adaptive_backstepping"
    return Result(thesis_task(task, adaptive, delays=(delay, delay)))


class _Model:
    """The equations in symbols; the state is [q, q', x1, x2, F_c, W1, Psi, W3].

    G. Ansmann, Chaos 28 (2018). Right-hand sides have to be smooth: what is frozen
    between two events is a control parameter, and so are the delays.
    """

    def __init__(self, result: Result):
        self.result = result
        self.n = result.n
        names = ["k_e", "d_e", "x_e", "sent", "received", "T_f", "T_r"]
        self.parameters = symbols(names)
        self.helpers: list = []

    def Named(self, name: str, expressions) -> np.ndarray:
        """Returns symbols for expressions which are evaluated once (`helpers`)."""
        values = np.asarray(expressions, dtype=object)
        named = np.empty(values.shape, dtype=object)
        for i, value in np.ndenumerate(values):
            named[i] = Symbol("_".join([name, *map(str, i)]))
            self.helpers.append((named[i], value))
        return named

    def Tool(self, q, qdot):
        if self.n == 1:
            return q, qdot
        J = self.Jacobian(q)
        return np.array([J[1, 0], -J[0, 0]]), J @ qdot

    def Jacobian(self, q):
        s1 = arm.L1 * sin(q[0])
        c1 = arm.L1 * cos(q[0])
        s12 = arm.L3 * sin(q[0] + q[1])
        c12 = arm.L3 * cos(q[0] + q[1])
        return np.array([[-s1 - s12, -s12], [c1 + c12, c12]])

    def Acceleration(self, q, qdot, force):
        if self.n == 1:
            return self.result.task.robot.acceleration(q, qdot, force)
        m = arm.m1
        L = arm.L1
        c = arm.L2
        inertia = arm.I1
        outer = m * c * c + inertia
        off = m * L * c * cos(q[1]) + outer
        inner = m * c * c + m * L * L + inertia + 2 * off - outer
        h = m * L * c * sin(q[1])
        coriolis = np.array([-h * qdot[1] * (2 * qdot[0] + qdot[1]), h * qdot[0] ** 2])
        a, b = self.Jacobian(q).T @ force - coriolis
        determinant = inner * outer - off * off
        return np.array([outer * a - off * b, inner * b - off * a]) / determinant

    def State(self, *at):
        """q, q', x1, x2 at a time, in symbols."""
        n = self.n
        rows = [[y(k * n + i, *at) for i in range(n)] for k in range(4)]
        return np.array(rows, dtype=object)

    def Equations(self) -> list:
        """The right-hand side in symbols."""
        task = self.result.task
        n = self.n
        k_e, d_e, x_e, sent, received, T_f, T_r = self.parameters
        (b1, b0) = task.numerator
        (_, a1, a0) = task.denominator
        velocity = np.array(task.velocity, dtype=object)
        zero = [Integer(0)] * n
        contact_force = np.array(task.contact_force or zero, dtype=object)
        q, qdot, x1, x2 = self.State()
        p, v = self.Tool(q, qdot)
        p = self.Named("p", p)
        v = self.Named("v", v)
        F_e = self.Named("F_e", [k_e * (p[0] - x_e) + d_e * v[0], *zero[1:]])
        _, _, x1_late, x2_late = self.State(t - T_f)
        _, felt = self.Tool(*self.State(t - T_r)[:2])
        # `received` is 0 before the first packet, 1 in velocity mode, 2 in force mode.
        haptic = received * (2 - received)
        force = received * (received - 1) / 2
        F_h = haptic * (b0 * x1_late + b1 * x2_late) + force * contact_force
        F_h = self.Named("F_h", F_h)
        F_c = np.array([y(4 * n + i) for i in range(n)], dtype=object)
        rates = [qdot, self.Acceleration(q, qdot, F_c - F_e), x2]
        rates.append(sent * velocity - felt - a1 * x2 - a0 * x1)
        rates.append(self._Law(p, v, F_e, F_h, haptic * velocity))
        return list(np.concatenate(rates))

    def _Law(self, p, v, F_e, F_h, v_dd):
        """(4.2) to (4.53), (5.2) to (5.53), away from the projection's limit."""
        n = self.n
        law = self.result.law
        c = law.c
        N = law.N
        parts = np.cumsum([4 * n, n, n * N, n * n, n * N])
        F_c, W1, Psi, W3 = (
            np.array([y(i) for i in range(a, b)], dtype=object)
            for a, b in itertools.pairwise(parts)
        )
        W1 = W1.reshape(n, N)
        Psi = Psi.reshape(n, n)
        W3 = W3.reshape(n, N)
        d = self.Named("d", (p - law.means) * law.inverse_width)
        Phi = self.Named("Phi", [exp(-(row @ row)) for row in d])
        Phi_dot = self.Named("Phi_dot", Phi * (-2 * (d @ (v * law.inverse_width))))
        if n == 1:
            Psi_inv = np.array([[1 / Psi[0, 0]]], dtype=object)
        else:
            determinant = Psi[0, 0] * Psi[1, 1] - Psi[0, 1] * Psi[1, 0]
            Psi_inv = (
                np.array([[Psi[1, 1], -Psi[0, 1]], [-Psi[1, 0], Psi[0, 0]]])
                / determinant
            )
        Psi_inv = self.Named("Psi_inv", Psi_inv)
        s = self.Named("s", v - v_dd + law.Lambda @ (F_e - F_h))
        y1 = self.Named("y1", W1 @ Phi)
        offset = self.Named("offset", Psi_inv @ (y1 + law.G1 @ s))
        u = self.Named("u", F_c - F_e)
        z = self.Named("z", u + offset)
        g = self.Named("g", law.P @ s + law.G1.T @ Psi_inv.T @ z)
        beta = c.adaptation_rate
        nu = c.leakage
        W1_dot = beta * (np.outer(g, Phi) - nu * W1)
        W3_dot = beta * (-np.outer(z, Phi) - nu * W3)
        Psi_dot = beta * (np.outer(g, u) + c.supervision * (law.psi0 - Psi))
        W1_dot = self.Named("W1_dot", W1_dot)
        Psi_dot = self.Named("Psi_dot", Psi_dot)
        s_dot = Psi @ u + y1
        lead_dot = W1_dot @ Phi + W1 @ Phi_dot + law.G1 @ s_dot
        alpha_dot = W3 @ Phi + Psi_inv @ (Psi_dot @ offset - lead_dot)
        F_c_dot = alpha_dot - Psi.T @ (law.P.T @ s) - law.G2 @ z
        return np.concatenate(
            [F_c_dot, W1_dot.ravel(), Psi_dot.ravel(), W3_dot.ravel()]
        )


def Prepare(task: str, controller: str, *_) -> float:
    """Compiles the equations of a task; returns the time that took in s."""
    key = (task, controller)
    start = time.perf_counter()
    if key not in _modules:
        model = _Model(_Start(task, controller, 0.1))
        *_, T_f, T_r = model.parameters
        equations = model.Equations()
        dde = jitcdde(
            equations,
            helpers=model.helpers,
            n=len(model.result.start_state),
            delays=[T_f, T_r],
            max_delay=1.0,
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
    result = _Start(task, controller, delay)
    file = str(_modules[task, controller][0])
    return _Run(_Model(result), file, delay, duration)


def _MakeSolver(model: _Model, module: str, delay: float) -> jitcdde:
    """Returns JiTCDDE's solver of a model at its start."""
    result = model.result
    dde = jitcdde(
        n=len(result.start_state),
        delays=[delay, delay],
        max_delay=delay,
        control_pars=model.parameters,
        module_location=module,
        verbose=False,
    )
    dde.constant_past(result.start_state, time=0.0)
    tolerance = TOLERANCES[model.n]
    dde.set_integration_parameters(
        rtol=tolerance,
        atol=tolerance * float(np.linalg.norm(result.task.velocity)),
        first_step=1e-4,
        max_step=delay,
        min_step=1e-14,
    )
    return dde


def _Run(model: _Model, module: str, delay: float, duration: float) -> Solution:
    result = model.result
    n = model.n
    task = result.task
    dde = _MakeSolver(model, module, delay)
    ends = [layer.start for layer in task.layers] + [inf]
    layer = task.layer_at(result.p_start)
    times = []
    rows = []

    def Gaps(length):
        """How far the tool is past its layer after a step, upwards and downwards."""
        x = result.motion(layer, dde.DDE.get_recent_state(dde.t + length))[0][0]
        return x - ends[layer + 1], ends[layer] - x

    def Past(length):
        dde.DDE.get_next_step(length)
        return max(Gaps(length)) - _TINY

    while dde.t < duration - _TINY:
        # The operator feels the contact, and the slave hears of it.
        changes = [delay, result.perceived, result.perceived + delay, duration]
        bound = min(time for time in changes if time > dde.t + _TINY)
        inside = (dde.t + bound) / 2
        law = task.layers[layer]
        received = (inside > delay) + (inside > result.perceived + delay)
        sent = float(inside < result.perceived)
        frozen = law.stiffness, law.damping, law.reference, sent, float(received)
        dde.set_parameters(*frozen, delay, delay)
        dde.adjust_diff()
        dde.dt = min(dde.dt, 1e-4)
        before = layer
        while layer == before and dde.t < bound - _TINY:
            length = min(dde.dt, bound - dde.t)
            if not dde.try_single_step(length):
                continue
            gaps = Gaps(length)
            if max(gaps) > _TINY:  # A shorter step ends on the border.
                dde.DDE.get_next_step(brentq(Past, 1e-6 * length, length, xtol=1e-15))
            dde.DDE.accept_step()
            state = np.array(dde.DDE.get_current_state())
            times.append(dde.t)
            rows.append([*result.motion(layer, state), state[4 * n : 5 * n]])
            dde.DDE.forget(dde.max_delay)
            if max(gaps) > _TINY:
                layer += 1 if gaps[0] > gaps[1] else -1
                is_felt = result.perceives and isinf(result.perceived)
                if _kind(task, before, layer) == "contact" and is_felt:
                    result.perceived = dde.t + delay
    return Solution(
        time=np.array(times),
        signals=dict(zip(SIGNALS, map(np.array, zip(*rows, strict=True)), strict=True)),
        steps=len(times),
        derivative_evaluations=None,
    )
