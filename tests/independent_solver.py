"""A second solver of the whole loop, which shares no code with the package."""

import bisect
import functools
from dataclasses import dataclass, fields, replace
from math import inf, isinf

import appendix_a as arm
import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq, minimize_scalar

_NODES = -np.cos(np.pi * np.arange(8) / 7)  # DOP853's dense output has degree 7.
_POWERS = np.arange(8)
_TO_COEFFICIENTS = np.linalg.inv(np.vander(_NODES, increasing=True))


@dataclass(frozen=True, kw_only=True)
class Layer:
    """Force stiffness (x - reference) + damping v_x from `start` to the next layer.

    x is along the task's direction, and a lateral spring pulls the tool to its line
    through the start.
    """

    start: float
    stiffness: float
    damping: float
    reference: float
    lateral_stiffness: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Slider:
    """The 1-DOF robot: mass a + damping v = F_c - F_e (2.6)."""

    start: float
    mass: float
    damping: float
    n = 1

    def start_joints(self):
        return np.array([self.start])

    def tool(self, q, qdot):
        return q, qdot

    def acceleration(self, q, qdot, force):
        return (force - self.damping * qdot) / self.mass

    def mobility(self, q):
        return np.array([[1 / self.mass]])


@dataclass(frozen=True, kw_only=True)
class TwoLinkArm:
    """The planar arm of Appendix A, no gravity. `elbow` down: q2 > 0, up: q2 < 0."""

    start: tuple[float, float]
    elbow: str
    n = 2

    def start_joints(self):
        return arm.joints(self.start, {"down": 1, "up": -1}[self.elbow])

    def tool(self, q, qdot):
        J = arm.J(q)
        # The Jacobian's first column is the tool position turned by a right angle.
        return np.array([J[1, 0], -J[0, 0]]), J @ qdot

    def acceleration(self, q, qdot, force):
        return np.linalg.solve(arm.M(q), arm.J(q).T @ force - arm.C(q, qdot) @ qdot)

    def mobility(self, q):
        J = arm.J(q)
        return J @ np.linalg.inv(arm.M(q)) @ J.T


@dataclass(frozen=True, kw_only=True)
class SpatialArm:
    """The arm of models/spatial_arm.sdf, no gravity, elbow up.

    A column turns by a about z; in its plane, whose axes are the radius r and z, the
    upper arm is lowered by b and the forearm by b + c. Of the inertia about z each link
    has m r^2 of its centre and a part of its own. Lagrange's equations give the rest.
    """

    start: tuple[float, float, float]
    n = 3
    height = 0.2
    damping = 0.2
    I_column = 0.001
    # By link: length, centre, mass, moment of inertia about its own axis and across it.
    lengths = (0.4, 0.3)
    centres = (0.2, 0.15)
    masses = (0.4, 0.3)
    I_along = (0.0001, 0.0001)
    I_across = (0.0054, 0.0023)

    def start_joints(self):
        x, y, z = self.start
        r = np.hypot(x, y)
        h = z - self.height
        (l1, l2) = self.lengths
        c = np.arccos((r * r + h * h - l1 * l1 - l2 * l2) / (2 * l1 * l2))
        b = -np.arctan2(h, r) - np.arctan2(l2 * np.sin(c), l1 + l2 * np.cos(c))
        return np.array([np.arctan2(y, x), b, c])

    def jacobian(self, q):
        """Returns p_WT and its derivatives with respect to q."""
        angles = np.array([q[1], q[1] + q[2]])
        lengths = np.array(self.lengths)
        across = lengths * np.cos(angles)
        down = lengths * np.sin(angles)
        r = across.sum()
        turn = np.array([np.cos(q[0]), np.sin(q[0])])
        p = np.array([*(r * turn), self.height - down.sum()])
        J = np.zeros((3, 3))
        J[:2, 0] = r * np.array([-turn[1], turn[0]])
        J[:2, 1] = -down.sum() * turn
        J[:2, 2] = -down[1] * turn
        J[2, 1:] = -across.sum(), -across[1]
        return p, J

    def tool(self, q, qdot):
        p, J = self.jacobian(q)
        return p, J @ qdot

    def inertia(self, q):
        """Returns M, and how its first entry depends on b and c."""
        (l1, _) = self.lengths
        (c1, c2) = self.centres
        (m1, m2) = self.masses
        b = q[1]
        both = q[1] + q[2]
        r = c1 * np.cos(b), l1 * np.cos(b) + c2 * np.cos(both)
        # The radii's derivatives with respect to b and c.
        r_b = -c1 * np.sin(b), -l1 * np.sin(b) - c2 * np.sin(both)
        r_c = 0.0, -c2 * np.sin(both)
        M = np.zeros((3, 3))
        slope = np.zeros(2)
        M[0, 0] = self.I_column
        links = zip(self.masses, (b, both), self.I_along, self.I_across, strict=True)
        for i, (m, angle, along, across) in enumerate(links):
            M[0, 0] += m * r[i] ** 2
            M[0, 0] += along * np.sin(angle) ** 2 + across * np.cos(angle) ** 2
            own = (along - across) * np.sin(2 * angle)
            slope += 2 * m * r[i] * np.array([r_b[i], r_c[i]]) + own * np.array([1, i])
        outer = m2 * c2 * c2 + self.I_across[1]
        off = m2 * l1 * c2 * np.cos(q[2]) + outer
        inner = m1 * c1 * c1 + m2 * l1 * l1 + self.I_across[0] + 2 * off - outer
        M[1:, 1:] = [[inner, off], [off, outer]]
        return M, slope

    def acceleration(self, q, qdot, force):
        M, slope = self.inertia(q)
        turn, b, c = qdot
        h = self.masses[1] * self.lengths[0] * self.centres[1] * np.sin(q[2])
        quadratic = np.array([0.0, -h * c * (2 * b + c), h * b * b])
        quadratic[0] = slope @ qdot[1:] * turn
        quadratic[1:] -= slope * turn**2 / 2
        torque = self.jacobian(q)[1].T @ force - self.damping * qdot
        return np.linalg.solve(M, torque - quadratic)

    def mobility(self, q):
        J = self.jacobian(q)[1]
        return J @ np.linalg.inv(self.inertia(q)[0]) @ J.T


@dataclass(frozen=True, kw_only=True)
class Adaptive:
    """Parameters of the adaptive controller; gains are scalars (times I) or matrices.

    The basis functions sit on a lattice from `lower` to `upper` (n numbers each) with
    `count` points an axis; `width` is in units of the lattice spacing.
    `initial_psi`: "auto" = (I + Lambda D_e) M_r^-1 at the start.
    """

    Lambda: float | np.ndarray
    G1: float | np.ndarray
    G2: float | np.ndarray
    P: float | np.ndarray
    adaptation_rate: float
    leakage: float
    supervision: float
    initial_psi: float | np.ndarray | str
    minimum_psi: float
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    count: tuple[int, ...]
    width: float
    # The rate of the third network's law; None: that of the others.
    third_rate: float | None = None


@dataclass(frozen=True, kw_only=True)
class Task:
    """Everything that defines a run.

    `controller` None is direct force application and a damper `local_damping` at the
    tool: against the ground, or with `follows_command` against v_d as it arrives.
    `contact_force` None: the operator keeps to velocity mode; `stop_time` inf: always.
    `numerator` (b1, b0) and `denominator` (1, a1, a0) are the haptic device's.
    The layers follow each other along `direction`, None: along x.
    """

    robot: Slider | TwoLinkArm | SpatialArm
    layers: tuple[Layer, ...]
    velocity: tuple[float, ...]
    contact_force: tuple[float, ...] | None
    stop_time: float
    forward_delay: float
    return_delay: float
    numerator: tuple[float, float]
    denominator: tuple[float, float, float]
    controller: Adaptive | None
    local_damping: float = 0.0
    follows_command: bool = False
    direction: tuple[float, ...] | None = None

    @functools.cached_property
    def axis(self):
        return np.array(self.direction or np.eye(self.robot.n)[0])

    def layer_at(self, p):
        starts = [layer.start for layer in self.layers]
        return bisect.bisect_right(starts, self.axis @ p) - 1

    def damped(self, F_h, v, v_dd):
        """F_c of direct force with the damper."""
        braked = v - v_dd if self.follows_command else v
        return F_h - self.local_damping * braked

    def puncture_index(self):
        """Index of the layer behind the first boundary to a softer one, or None."""
        k = [layer.stiffness for layer in self.layers]
        return next((i for i in range(1, len(k)) if k[i] < k[i - 1]), None)

    def contact_index(self):
        """Index of the stiffest layer if it is entered from a softer one, or None."""
        k = [layer.stiffness for layer in self.layers]
        i = int(np.argmax(k))
        return i if i > 0 and k[i - 1] < k[i] else None


def _matrix(gain, n):
    """A matrix as it is, a scalar times I."""
    return gain * np.eye(n) if np.ndim(gain) == 0 else np.asarray(gain)


class AdaptiveLaw:
    """Adaptive backstepping (4.2 to 4.53, 5.2 to 5.53) for n axes, N functions."""

    def __init__(self, c: Adaptive, psi0):
        n = len(c.lower)
        self.c = c
        self.n = n
        self.psi0 = psi0
        self.Lambda, self.G1, self.G2, self.P = (
            _matrix(g, n) for g in (c.Lambda, c.G1, c.G2, c.P)
        )
        axes = [
            np.linspace(*abc) for abc in zip(c.lower, c.upper, c.count, strict=True)
        ]
        grid = np.meshgrid(*axes, indexing="ij")
        self.means = np.stack([g.ravel() for g in grid], axis=1)
        spacing = (np.array(c.upper) - c.lower) / (np.array(c.count) - 1)
        self.inverse_width = 1 / (c.width * spacing)
        self.N = len(self.means)
        self.cuts = np.cumsum([n, n * self.N, n * n])

    def unpack(self, a):
        """Splits the state into F_c, W1, Psi, W3."""
        i, j, k = self.cuts
        n = self.n
        N = self.N
        W1 = a[i:j].reshape(n, N)
        W3 = a[k:].reshape(n, N)
        return a[:i], W1, a[j:k].reshape(n, n), W3

    def start(self):
        zero = np.zeros(self.n * self.N)
        return np.concatenate([np.zeros(self.n), zero, self.psi0.ravel(), zero])

    def errors(self, a, p, v, F_e, F_h, v_d):
        """The auxiliary error s (5.2) and z = F_c - alpha (5.22), with Phi, Psi^-1."""
        F_c, W1, Psi, _ = self.unpack(a)
        d = (p - self.means) * self.inverse_width
        Phi = np.exp(-(d * d).sum(axis=1))
        inverse = np.linalg.inv(Psi)
        s = v - v_d + self.Lambda @ (F_e - F_h)
        lead = W1 @ Phi + self.G1 @ s
        return s, F_c - F_e + inverse @ lead, Phi, d, inverse, lead

    def rates(self, a, p, v, F_e, F_h, v_d):
        c = self.c
        F_c, W1, Psi, W3 = self.unpack(a)
        s, z, Phi, d, inverse, lead = self.errors(a, p, v, F_e, F_h, v_d)
        Phi_dot = Phi * (-2 * d @ (self.inverse_width * v))
        u = F_c - F_e
        g = self.P @ s + self.G1.T @ inverse.T @ z
        W1_dot = c.adaptation_rate * (np.outer(g, Phi) - c.leakage * W1)
        third_rate = c.adaptation_rate if c.third_rate is None else c.third_rate
        W3_dot = third_rate * (-np.outer(z, Phi) - c.leakage * W3)
        Psi_dot = c.adaptation_rate * (
            np.outer(g, u) + c.supervision * (self.psi0 - Psi)
        )
        if self.n == 1 and Psi[0, 0] < c.minimum_psi:
            Psi_dot = np.maximum(Psi_dot, 0)  # projection (4.53)
        s_dot = Psi @ u + W1 @ Phi
        lead_dot = W1_dot @ Phi + W1 @ Phi_dot + self.G1 @ s_dot
        alpha_dot = W3 @ Phi + inverse @ (Psi_dot @ (inverse @ lead) - lead_dot)
        F_c_dot = alpha_dot - Psi.T @ (self.P.T @ s) - self.G2 @ z
        return np.concatenate(
            [F_c_dot, W1_dot.ravel(), Psi_dot.ravel(), W3_dot.ravel()]
        )


@dataclass(frozen=True)
class Piece:
    """One step: a polynomial in theta = (t - middle) / half, and what was frozen."""

    start: float
    end: float
    middle: float
    half: float
    coefficients: np.ndarray
    layer: int

    def state(self, t):
        theta = (t - self.middle) / self.half
        return theta**_POWERS @ self.coefficients


@dataclass(frozen=True)
class Event:
    """`kind`: puncture, reentry, contact, release, crossing, switch, stop, diverged.

    Forces are F_e just before and just after.
    """

    kind: str
    time: float
    position: np.ndarray
    velocity: np.ndarray
    force_before: np.ndarray
    force_after: np.ndarray


class Result:
    """The solution; also the loop's equations, read by the solver while it grows.

    Channel 0 goes forward, 1 returns. No step is longer than `longest_step`, s.
    """

    def __init__(self, task: Task):
        self.task = task
        self.n = n = task.robot.n
        self.delays = task.forward_delay, task.return_delay
        self.longest_step = min((T for T in self.delays if T > 0), default=inf)
        self.breakpoints: list[float] = []
        self.pieces: list[Piece] = []
        self.events: list[Event] = []
        self._ends: list[float] = []
        q = task.robot.start_joints()
        self.p_start, _ = task.robot.tool(q, np.zeros(n))
        # The operator perceives contact at this time. One who starts there knows.
        self.perceived = inf
        surface = task.contact_index()
        self.perceives = surface is not None and task.contact_force is not None
        if self.perceives and task.axis @ self.p_start >= task.layers[surface].start:
            self.perceived = 0.0
        self.law = None
        start = np.concatenate([q, np.zeros(3 * n)])
        if task.controller is not None:
            self.law = AdaptiveLaw(task.controller, self._initial_psi(q))
            start = np.concatenate([start, self.law.start()])
        self.start_state = start

    def _initial_psi(self, q):
        psi0 = self.task.controller.initial_psi
        n = self.n
        if not isinstance(psi0, str):
            return _matrix(psi0, n)
        assert psi0 == "auto"
        layer = self.task.layer_at(self.p_start)
        axis = self.task.axis
        d_e = self.task.layers[layer].damping if layer >= 0 else 0.0
        D_e = d_e * np.outer(axis, axis)
        Lambda = _matrix(self.task.controller.Lambda, n)
        return (np.eye(n) + Lambda @ D_e) @ self.task.robot.mobility(q)

    def environment_force(self, layer, p, v):
        if layer < 0:
            return np.zeros(self.n)
        law = self.task.layers[layer]
        axis = self.task.axis
        along = law.stiffness * (axis @ p - law.reference) + law.damping * (axis @ v)
        if not law.lateral_stiffness:
            return along * axis
        offset = p - self.p_start
        return along * axis + law.lateral_stiffness * (offset - axis @ offset * axis)

    def command(self, t):
        """The operator's v_d and force at t; force None means the haptic device's."""
        task = self.task
        still = np.zeros(self.n)
        if t < 0:
            return still, still
        v_d = np.array(task.velocity)
        if t >= min(self.perceived, task.stop_time):
            v_d = still
        if t < self.perceived:
            return v_d, None
        return v_d, (np.array(task.contact_force) if t < task.stop_time else still)

    def device_force(self, y):
        n = self.n
        (b1, b0) = self.task.numerator
        return b0 * y[2 * n : 3 * n] + b1 * y[3 * n : 4 * n]

    def piece_at(self, t, side):
        """The step that holds t; where two of them meet, the one on the given side."""
        find = bisect.bisect_right if side == "right" else bisect.bisect_left
        return self.pieces[min(find(self._ends, t), len(self.pieces) - 1)]

    def motion(self, layer, y):
        """Tool position, tool velocity and F_e in a state."""
        p, v = self.task.robot.tool(y[: self.n], y[self.n : 2 * self.n])
        return p, v, self.environment_force(layer, p, v)

    def sent(self, t, channel):
        """When what a channel delivers at t was sent."""
        return t - self.delays[channel]

    def arrival(self, t, channel):
        """When a channel delivers what is sent at t."""
        return t + self.delays[channel]

    def add_breakpoints(self, t, channel):
        """Ends steps at t, and where its echoes arrive, through this channel first."""
        for way in (channel, 1 - channel, channel, 1 - channel, channel):
            bisect.insort(self.breakpoints, t)
            t = self.arrival(t, way)

    def arrive(self, t, y, layer):
        """Called at the start of each segment."""

    def received_command(self, t):
        """command() as the slave has it at t."""
        return self.command(self.sent(t, 0))

    def received_force(self, t, y, command_force):
        """F_h as the slave has it; `command_force` is that of received_command()."""
        if command_force is not None:
            return command_force
        sent = self.sent(t, 0)
        return self.device_force(y if sent == t else self._past(sent))

    def felt(self, t, p, v):
        """Tool position and velocity as the operator has them."""
        sent = self.sent(t, 1)
        n = self.n
        if sent == t:
            return p, v
        if sent < 0:
            return self.p_start, np.zeros(n)
        return self.task.robot.tool(*self._past(sent)[: 2 * n].reshape(2, n))

    def _past(self, t):
        return self.piece_at(t, "left").state(t)

    def derivative(self, layer, v_d, v_d_received, force_received):
        """The right-hand side of one segment, in which these are constant."""
        task = self.task
        n = self.n
        law = self.law
        _, a1, a0 = task.denominator

        def f(t, y):
            q, qdot, x1, x2 = y[: 4 * n].reshape(4, n)
            p, v, F_e = self.motion(layer, y)
            F_h = self.received_force(t, y, force_received)
            _, felt_v = self.felt(t, p, v)
            plain = task.damped(F_h, v, v_d_received)
            F_c = plain if law is None else y[4 * n : 5 * n]
            qddot = task.robot.acceleration(q, qdot, F_c - F_e)
            rates = [qdot, qddot, x2, v_d - felt_v - a1 * x2 - a0 * x1]
            if law is not None:
                rates.append(law.rates(y[4 * n :], p, v, F_e, F_h, v_d_received))
            return np.concatenate(rates)

        return f

    @property
    def end(self):
        return self._ends[-1]

    @property
    def jumps(self):
        """Where F_e or F_c may jump: at events, and where they arrive."""
        times = [0.0, *(event.time for event in self.events)]
        return [*times, *(self.arrival(time, 0) for time in times)]

    def event(self, kind) -> Event | None:
        """The first event of this kind."""
        return next((e for e in self.events if e.kind == kind), None)

    def append(self, piece):
        self.pieces.append(piece)
        self._ends.append(piece.end)

    def at(self, t, side="right"):
        """All signals at time t; at a jump the limit from the given side."""
        piece = self.piece_at(t, side)
        n = self.n
        y = piece.state(t)
        # The modes are constant on a piece, so its middle tells them on both sides.
        inside = (piece.start + piece.end) / 2
        p, v, F_e = self.motion(piece.layer, y)
        v_d, force = self.command(inside)
        v_dd, force_d = self.received_command(inside)
        F_hd = self.received_force(t, y, force_d)
        felt_p, felt_v = self.felt(t, p, v)
        out = {"q": y[:n], "qdot": y[n : 2 * n], "p_WT": p, "v_WT": v, "F_e": F_e}
        out |= {"F_h": self.device_force(y) if force is None else force, "v_d": v_d}
        out |= {"F_h_received": F_hd, "v_d_received": v_dd}
        out["F_c"] = self.task.damped(F_hd, v, v_dd)
        out |= {"p_felt": felt_p, "v_felt": felt_v}
        if self.law is not None:
            a = y[4 * n :]
            out["F_c"], out["W1"], out["Psi"], out["W3"] = self.law.unpack(a)
            out["s"], out["z"] = self.law.errors(a, p, v, F_e, F_hd, v_dd)[:2]
        return out

    def sample(self, times, side="right"):
        """`at` for many times: name -> array with time as the first axis."""
        rows = [self.at(t, side) for t in times]
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    def maximum(self, name, t0, t1, sign=1.0, axis=0):
        """(time, value) of the largest sign * signal between t0 and t1, located."""
        assert t0 < t1
        signal = ("p_WT", "v_WT", "F_e").index(name)
        best = -inf
        best_time = t0
        for piece in self.pieces:
            a = max(piece.start, t0)
            b = min(piece.end, t1)
            if a >= b:
                continue

            def value(t, piece=piece):
                return sign * self.motion(piece.layer, piece.state(t))[signal][axis]

            times = np.linspace(a, b, 6)
            values = [value(t) for t in times]
            i = int(np.argmax(values))
            # Six samples miss the peak by less than what they differ by.
            if 2 * values[i] - min(values) > best:
                peak = minimize_scalar(
                    lambda t, value=value: -value(t),
                    bounds=(times[max(i - 1, 0)], times[min(i + 1, 5)]),
                    method="bounded",
                    options={"xatol": 1e-9},
                )
                ranked = [(values[i], times[i]), (-peak.fun, peak.x)]
                best, best_time = max((best, best_time), *ranked)
        return best_time, sign * best

    def rest_time(self, step=2e-4):
        """From contact until v and F_e stay in bands of 5 % of v_d and the last F_e."""
        contact = self.event("contact").time
        times = np.arange(contact, self.end, step)
        signals = self.sample(times)
        v = np.linalg.norm(signals["v_WT"], axis=1)
        F_e = signals["F_e"]
        off = np.linalg.norm(F_e - F_e[-1], axis=1)
        moves = v >= 0.05 * np.linalg.norm(self.task.velocity)
        is_at_rest = ~moves & (off < 0.05 * np.linalg.norm(F_e[-1]))
        return times[~is_at_rest][-1] - contact

    def metrics(self):
        """The thesis's numbers along x; those of events that never came are absent."""
        v_d = self.task.velocity[0]
        out = {}
        puncture = self.event("puncture")
        contact = self.event("contact")
        first = min([e.time for e in (puncture, contact) if e] + [self.end])
        over = self.maximum("v_WT", 0.0, first)[1] - v_d
        out["start_velocity_overshoot"] = max(over, 0.0)
        if puncture:
            out["puncture_time"] = t = puncture.time
            out["puncture_velocity"] = puncture.velocity[0]
            out["puncture_force"] = puncture.force_before[0]
            last = contact.time if contact else self.end
            out["velocity_overshoot"] = self.maximum("v_WT", t, last)[1] - v_d
        if contact:
            out["contact_time"] = t = contact.time
            out["contact_velocity"] = contact.velocity[0]
            release = self.event("release")
            last = release.time if release else self.end
            out["initial_impact_force"] = self.maximum("F_e", t, last)[1]
            out["peak_force"] = self.maximum("F_e", t, self.end)[1]
            out["rebound_velocity"] = self.maximum("v_WT", t, self.end, sign=-1)[1]
        return out


class Packets(Result):
    """Both directions hold the newest packet that has arrived.

    A step ends at each sending and each arrival. When packets of a network arrive is
    drawn from a seed: those times are the package's, as data.
    """

    def __init__(self, task, period, arrivals):
        super().__init__(task)
        self.longest_step = inf
        self._period = period
        self._arrivals = arrivals
        times = {time for way in arrivals for time in way if time < inf}
        self.breakpoints = sorted(times | {k * period for k in range(len(arrivals[0]))})
        self._sent: tuple[list, list] = ([], [])
        zero = np.zeros(self.n)
        # (when it arrived, its number, what it says) of the packets shown, by channel.
        self._shown = (
            [(-inf, -1, np.concatenate([zero, zero]))],
            [(-inf, -1, np.concatenate([self.p_start, zero]))],
        )

    def arrival(self, t, channel):
        return inf  # The breakpoints are known before.

    def arrive(self, t, y, layer):
        if t >= len(self._sent[0]) * self._period - 1e-12:
            v_d, force = self.command(t)
            if force is None:
                force = self.device_force(y)
            p, v, _ = self.motion(layer, y)
            self._sent[0].append(np.concatenate([v_d, force]))
            self._sent[1].append(np.concatenate([p, v]))
        for sent, times, shown in zip(
            self._sent, self._arrivals, self._shown, strict=True
        ):
            for k in range(shown[-1][1] + 1, len(sent)):
                if times[k] <= t + 1e-12:
                    shown.append((t, k, sent[k]))
        if self.perceives and isinf(self.perceived):
            surface = self.task.layers[self.task.contact_index()].start
            if self.task.axis @ self._newest(t, 1)[0] >= surface:
                self.perceived = t

    def _newest(self, t, channel):
        """Returns the two halves of the packet that is shown at t."""
        shown = self._shown[channel]
        i = bisect.bisect_right(shown, t, key=lambda packet: packet[0])
        return np.split(shown[i - 1][2], 2)

    def received_command(self, t):
        return self._newest(t, 0)

    def felt(self, t, p, v):
        return self._newest(t, 1)


def _tolerances(result, rtol):
    """Absolute tolerances in units of the commanded speed; Psi is of order one."""
    task = result.task
    n = task.robot.n
    speed = np.linalg.norm(task.velocity) or 1.0
    atol = np.full(len(result.start_state), 0.1 * rtol * speed)
    atol[2 * n : 4 * n] /= max(task.denominator[1], 1.0)
    if result.law is not None:
        _, j, k = 4 * n + result.law.cuts
        atol[j:k] = rtol
    return atol


def solve(
    task: Task, duration, *, rtol=1e-10, speed_limit=inf, until="", make=Result
) -> Result:
    """Solves the loop from rest until `duration`, by the method of steps.

    No step is longer than the shortest delay, and none straddles a jump, known before
    or located, or one of its echoes through two round trips, each of which smooths it
    by several orders; in between, layer and modes are frozen.

    Ends early at the first event of the kind `until`, and as "diverged" where |v_WT|
    exceeds `speed_limit`.
    """
    result = make(task)
    n = task.robot.n
    atol = _tolerances(result, rtol)
    result.add_breakpoints(0.0, 0)
    result.add_breakpoints(0.0, 1)
    result.add_breakpoints(task.stop_time, 0)

    def record(kind, t, y, before, after):
        p, v, F_e = result.motion(before, y)
        result.events.append(Event(kind, t, p, v, F_e, result.motion(after, y)[2]))

    t = 0.0
    y = result.start_state
    layer = task.layer_at(result.p_start)
    tiny = 1e-12  # Breakpoints closer than this are one.
    while t < duration - tiny:
        result.arrive(t, y, layer)
        for kind, time in (("switch", result.perceived), ("stop", task.stop_time)):
            if time <= t + tiny and not result.event(kind):
                record(kind, t, y, layer, layer)
        if result.event(until):
            break
        later = [time for time in result.breakpoints if time > t + tiny]
        bound = min([*later[:1], duration])
        inside = (t + bound) / 2
        v_d, _ = result.command(inside)
        f = result.derivative(layer, v_d, *result.received_command(inside))
        solver = DOP853(
            f, t, y, bound, rtol=rtol, atol=atol, max_step=result.longest_step
        )
        monitors = _monitors(task, layer, speed_limit)
        while solver.status == "running":
            message = solver.step()
            assert solver.status != "failed", message
            piece, hit = _accept(solver, layer, monitors, task.robot)
            result.append(piece)
            t = piece.end
            y = piece.state(piece.end) if hit else solver.y
            if result.law is not None:
                Psi = result.law.unpack(y[4 * n :])[2]
                smallest = np.linalg.svd(Psi, compute_uv=False)[-1]
                assert n == 1 or smallest > result.law.c.minimum_psi
            if hit == "diverged":
                record(hit, t, y, layer, layer)
                return result
            if hit:
                result.add_breakpoints(t, 1)
                before = layer
                layer = layer + (1 if hit == "up" else -1)
                record(kind := _kind(task, before, layer), t, y, before, layer)
                if kind == "contact" and result.perceives and isinf(result.perceived):
                    result.perceived = result.arrival(t, 1)
                    result.add_breakpoints(result.perceived, 0)
                break
    return result


def _kind(task, before, after):
    boundary = max(before, after)
    up = after > before
    if boundary == task.contact_index():
        return "contact" if up else "release"
    if boundary == task.puncture_index():
        return "puncture" if up else "reentry"
    return "crossing"


def _monitors(task, layer, speed_limit):
    """Functions of p, v that turn positive where the segment has to end."""
    # Behind the last layer, and (index -1) before the first one, there is no boundary.
    ends = [layer.start for layer in task.layers] + [inf, -inf]
    return {
        "up": lambda p, v: task.axis @ p - ends[layer + 1],
        "down": lambda p, v: ends[layer] - task.axis @ p,
        "diverged": lambda p, v: np.sqrt(v @ v) - speed_limit,
    }


def _accept(solver, layer, monitors, robot):
    """The last step as a Piece, cut where the first monitor fires, and its name."""
    t0 = solver.t_old
    t1 = solver.t
    n = robot.n
    middle = (t0 + t1) / 2
    half = (t1 - t0) / 2
    values = solver.dense_output()(middle + half * _NODES)
    piece = Piece(t0, t1, middle, half, _TO_COEFFICIENTS @ values.T, layer)
    motions = [robot.tool(y[:n], y[n : 2 * n]) for y in values.T]
    hits = []
    for name, g in monitors.items():

        def signed(t, g=g):
            y = piece.state(t)
            return g(*robot.tool(y[:n], y[n : 2 * n]))

        # From the second node on: a segment may start on the boundary it crossed.
        i = next((i for i in range(1, 8) if g(*motions[i]) > 0), None)
        if i is not None:
            bracket = middle + half * _NODES[i - 1 : i + 1]
            hits.append((brentq(signed, *bracket, xtol=1e-15), name))
    if not hits:
        return piece, ""
    time, name = min(hits)
    return Piece(t0, time, middle, half, piece.coefficients, layer), name


def thesis_task(
    name, adaptive, *, delays=(0.1, 0.1), elbow="down", local_damping=0.0, **controller
):
    """One of the thesis's tasks: one_dof, or two_dof_ puncture, collision, combined.

    `delays` = (T_f, T_r); `controller` overrides fields of the adaptive controller.
    """
    shared = {"P": 1.0, "adaptation_rate": 0.1, "leakage": 0.1, "minimum_psi": 0.1}
    shared |= {"Lambda": 1.0, "supervision": 1.0, "width": 1.0}
    if name == "one_dof":
        robot = Slider(start=0.0, mass=0.5, damping=0.1)
        scale = (0.001,)
        force = (0.005,)
        tissue_end = 0.0075
        bone = 0.015
        gains = {"G1": 2.0, "G2": 20.0, "initial_psi": 4.3}
        gains |= {"lower": (0.0,), "upper": (0.015,), "count": (5,)}
    else:
        robot = TwoLinkArm(start=(0.85, 0.0), elbow=elbow)
        scale = (0.1, 0.0)
        force, tissue_end, bone = {
            "two_dof_puncture": (None, 1.1, None),
            "two_dof_collision": ((0.2, 0.0), None, 1.0),
            "two_dof_combined": ((0.2, 0.0), 1.0, 1.1),
        }[name]
        gains = {"G1": 4.0, "G2": 30.0, "initial_psi": "auto"}
        gains |= {"lower": (0.85, -0.15), "upper": (1.15, 0.15), "count": (5, 5)}
    free = -inf if tissue_end is None else tissue_end
    layers = [Layer(start=free, stiffness=0.0, damping=0.0, reference=0.0)]
    if tissue_end is not None:
        layers.insert(0, Layer(start=-inf, stiffness=0.01, damping=0.5, reference=0.0))
    if bone is not None:
        layers.append(Layer(start=bone, stiffness=150.0, damping=0.0, reference=bone))
    return Task(
        robot=robot,
        layers=tuple(layers),
        velocity=scale,
        contact_force=force,
        stop_time=inf,
        forward_delay=delays[0],
        return_delay=delays[1],
        numerator=(25.0, 50.0),
        denominator=(1.0, 25.0, 0.0),
        controller=Adaptive(**(shared | gains | controller)) if adaptive else None,
        local_damping=local_damping,
    )


def needle_task(delays=(0.1, 0.1)):
    """The scenario needle_insertion: a needle in space, obliquely through two tissues.

    With the adaptive controller.
    """
    like = thesis_task("two_dof_combined", True, delays=delays)
    network = {"lower": (0.4, -0.05, 0.0), "upper": (0.65, 0.2, 0.3), "count": (3,) * 3}
    # Start, stiffness, damping, reference, lateral stiffness.
    layers = (
        (-inf, 0.0, 0.0, 0.0, 0.0),
        (0.15, 2.0, 0.5, 0.15, 5.0),
        (0.2, 0.5, 0.8, 0.2, 5.0),
        (0.3, 150.0, 0.0, 0.3, 5.0),
    )
    names = [field.name for field in fields(Layer)]
    return replace(
        like,
        robot=SpatialArm(start=(0.45, 0.0, 0.25)),
        layers=tuple(Layer(**dict(zip(names, x, strict=True))) for x in layers),
        direction=(0.6, 0.48, -0.64),
        velocity=(0.064, 0.042, -0.060),
        contact_force=(0.12, 0.096, -0.128),
        controller=replace(like.controller, **network),
    )


@functools.cache
def solve_thesis_task(
    name, adaptive, delays, duration, local_damping=0.0, follows_command=False
):
    """Solves one of the thesis's tasks up to five times the commanded speed."""
    task = thesis_task(name, adaptive, delays=delays, local_damping=local_damping)
    task = replace(task, follows_command=follows_command)
    return solve(task, duration, speed_limit=5 * np.linalg.norm(task.velocity))
