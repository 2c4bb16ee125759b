"""Six axes: the loop against one by hand, the kinematics, and what is refused.

The loop by hand shares no code with the package: the arm is the model file in a
MultibodyPlant, which tests/robots checks against textbook recursions, the rest numpy
and scipy. The operator commands a constant twist, and delays go by the method of steps.
The rate of the basis functions and the slopes of the tissue's energy are differences.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from grids import Slow
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import teleop_drake
from teleop_drake.environments.base import ForceAt
from teleop_drake.environments.needle_path import NeedleInTissue
from teleop_drake.laws.task_space import position_rate, rotated, rotation_vector
from teleop_drake.linear_model.loop import Linearizer
from teleop_drake.linear_model.operating_point import OperatingPoint
from teleop_drake.scenario import LoadScenario
from teleop_drake.signals import UnitOf
from teleop_drake.simulation import simulate
from teleop_drake.teleoperator import MakeTeleoperator
from teleop_drake.validation import ScenarioError

MODEL = Path(teleop_drake.__file__).parent / "models" / "puma560.sdf"
START, DELAY = [0.6, -0.15, 0.4, 0.3, -0.2, 0.25], 0.05
TWIST = [0.08, 0.01, -0.02, 0.1, 0.25, -0.15]


def turn_by(vector):
    return Rotation.from_rotvec(vector)


class Arm:
    def __init__(self, posture):
        plant = self.plant = MultibodyPlant(0.0)
        Parser(plant).AddModels(str(MODEL))
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        self.tool = plant.GetBodyByName("tool")
        self.R_PW = self.motion(np.append(posture, np.zeros(6)))[1].inv()

    def motion(self, x):
        plant, context = self.plant, self.context
        plant.SetPositionsAndVelocities(context, x)
        pose, world = plant.EvalBodyPoseInWorld(context, self.tool), plant.world_frame()
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, self.tool.body_frame(), np.zeros(3), world,
            world,
        )  # fmt: skip
        R = Rotation.from_matrix(pose.rotation().matrix())
        return pose.translation(), R, np.vstack([J[3:], J[:3]])

    def accelerations(self, wrench, J):
        forces = MultibodyForces(self.plant)  # Neither weight nor damping.
        forces.mutable_generalized_forces()[:] += J.T @ wrench
        rest = self.plant.CalcInverseDynamics(self.context, np.zeros(6), forces)
        return np.linalg.solve(self.plant.CalcMassMatrix(self.context), -rest)


class Tissue:
    """A potential of the pose of a needle along x, and a drag, by quadrature."""

    def __init__(self, c):
        self.entry, self.c = np.array([c.start, *START[1:3]]), c
        self.nodes, self.weights = np.polynomial.legendre.leggauss(6)

    def needle(self, p, turn):
        """Depths along the needle, their weights, and its points from the tip."""
        depth, u = p[0] - self.entry[0], turn.apply([1.0, 0, 0])
        xi = depth * (1 + self.nodes) / 2
        return xi, depth / 2 * self.weights, np.outer((xi - depth) / u[0], u)

    def energy(self, p, turn):
        xi, weights, arms = self.needle(p, turn)
        path = self.entry + np.outer(xi, [1, 0, 0]) + np.outer(xi**2 / 2, self.c.bend)
        return self.c.stiffness / 2 * weights @ ((p + arms - path) ** 2).sum(axis=1)

    def wrench(self, p, turn, v, h=1e-5):
        if p[0] <= self.entry[0]:
            return np.zeros(6)
        ends = [
            [self.energy(p + s * e[:3], turn_by(s * e[3:]) * turn) for s in (h, -h)]
            for e in np.eye(6)
        ]
        _, weights, arms = self.needle(p, turn)
        F = self.c.drag * weights[:, None] * (v[:3] + np.cross(v[3:], arms))
        drag = np.append(F.sum(axis=0), np.cross(arms, F).sum(axis=0))
        return -np.diff(ends)[:, 0] / (2 * h) + drag


class Adaptive:
    """(5.2) to (5.51), the projection left out: Psi stays away from its limit."""

    def __init__(self, c, psi):
        x, y = (z.ravel() for z in np.meshgrid([0, 1], [0, 1], indexing="ij"))
        share = np.full((4, 6), 0.5)
        share[:, 0], share[:, 4] = x, y
        self.widths = c.network.upper - c.network.lower
        self.centres, self.c, self.psi_0 = c.network.lower + share * self.widths, c, psi
        self.start = np.concatenate([np.zeros(30), psi.ravel(), np.zeros(24)])

    def basis(self, p, turn):
        r = np.append(p, turn.as_rotvec())
        return np.exp(-(((r - self.centres) / self.widths) ** 2).sum(axis=1))

    def rate(self, x, p, turn, v, F_e, F_hd, v_dd, h=1e-6):
        c, (F_c, W1, psi, W3) = self.c, np.split(x, [6, 30, 66])
        W1, psi, W3 = W1.reshape(6, 4), psi.reshape(6, 6), W3.reshape(6, 4)
        Phi, G1, nu = self.basis(p, turn), c.G1, c.leakage
        ends = [self.basis(p + s * v[:3], turn_by(s * v[3:]) * turn) for s in (h, -h)]
        Phi_dot = (ends[0] - ends[1]) / (2 * h)
        s, inverse = v - v_dd + c.Lambda @ (F_e - F_hd), np.linalg.inv(psi)
        y1 = W1 @ Phi
        z = F_c - F_e + inverse @ (y1 + G1 * s)
        g = c.P @ s + G1 * inverse.T @ z
        W1_dot = c.beta1 * (np.outer(g, Phi) - nu * W1)
        psi_dot = c.beta2 * (np.outer(g, F_c - F_e) + self.psi_0 - psi)
        W3_dot = c.beta3 * (-np.outer(z, Phi) - nu * W3)
        alpha_dot = W3 @ Phi + inverse @ psi_dot @ inverse @ (y1 + G1 * s)
        s_dot = psi @ (F_c - F_e) + y1
        alpha_dot -= inverse @ (W1_dot @ Phi + W1 @ Phi_dot + G1 * s_dot)
        F_dot = alpha_dot - psi.T @ c.P.T @ s - c.G2 * z
        return np.concatenate([F_dot, W1_dot.ravel(), psi_dot.ravel(), W3_dot.ravel()])


def solve_by_hand(scenario, law):
    """Returns the tool's [p; theta; v; F_e] as a function of time."""
    arm, tissue = Arm(scenario.robot.posture), Tissue(scenario.environment)
    scale, pieces = 10 * np.repeat([1, 0.2**2], 3), []

    def tool(x):
        p, R, J = arm.motion(x[:12])
        v, turn = J @ x[6:12], R * arm.R_PW
        return p, turn, v, tissue.wrench(p, turn, v), J

    def rate(t, x):
        F_hd, v_dd, felt = np.zeros((3, 6))
        if pieces:  # The last one is that of a delay ago.
            before = pieces[-1](t - DELAY)
            F_hd, v_dd = scale * (50 * before[12:18] + 25 * before[18:24]), TWIST
            felt = tool(before)[2]
        p, turn, v, F_e, J = tool(x)
        a = arm.accelerations((x[24:30] if law else F_hd) - F_e, J)
        hand = np.append(x[18:24], TWIST - felt - 25 * x[18:24])
        own = law.rate(x[24:], p, turn, v, F_e, F_hd, v_dd) if law else []
        return np.concatenate([x[6:12], a, hand, own])

    x = np.append(scenario.robot.JointPositions(START), np.zeros(18))
    x = np.append(x, law.start if law else [])
    for k in range(round(scenario.duration / DELAY)):
        span = k * DELAY, (k + 1) * DELAY
        options = {"rtol": 1e-7, "atol": 1e-9, "dense_output": True}
        part = solve_ivp(rate, span, x, "DOP853", **options)
        pieces.append(part.sol)
        x = part.y[:, -1]

    def seen(t):
        p, turn, v, F_e, _ = tool(pieces[min(int(t / DELAY), len(pieces) - 1)](t))
        return np.concatenate([p, turn.as_rotvec(), v, F_e])

    return seen


def short(kind, **overrides):
    """A task without weight and Coulomb friction, oblique to everything."""
    overrides = {
        "controller.kind": kind,
        "surgeon": {"kind": "constant_velocity", "velocity": TWIST},
        "robot.start": START,
        "robot.gravity": [0, 0, 0],
        "robot.friction": 0.0,
        "environment.start": 0.6005,
        "controller.network.count": [2, 1, 1, 1, 2, 1],
        "delay": DELAY,
        **overrides,
    }
    return LoadScenario("puma560_six_axes", overrides)


LOOPS = [
    ("adaptive_backstepping", 0.15, "drake"),
    ("direct_force", 0.6, "compiled"),
    ("adaptive_backstepping", 0.8, "compiled"),
]


@pytest.mark.parametrize(("kind", "duration", "engine"), Slow(LOOPS, but=(0, 1)))
def test_the_loop_by_hand(kind, duration, engine):
    scenario = short(kind, duration=duration)
    is_adaptive = kind == "adaptive_backstepping"
    law = Adaptive(scenario.controller, scenario.initial_psi) if is_adaptive else None
    seen, recording = solve_by_hand(scenario, law), simulate(scenario, engine=engine)
    times = np.linspace(0.0, 0.99 * duration, 21)
    expected = np.array([seen(t) for t in times])
    names = ("tool_position", "tool_velocity", "environment_force")
    found = np.hstack([recording.Interpolate(name, times) for name in names])
    for part in np.split(np.arange(18), 6):  # Of one unit.
        scale = np.abs(expected[:, part] - expected[0, part]).max()
        assert np.abs(found - expected)[:, part].max() <= 1e-4 * scale
    if duration > 0.5:  # It has turned, and tissue turns it.
        assert np.linalg.norm(expected[-1, 3:6] - START[3:]) > 0.03
        assert np.abs(expected[-1, 15:]).max() > 1e-4
    assert UnitOf("tool_position", 6) == "m, rad"


def test_rotation_vectors():
    """Against scipy's, at no rotation, near it and far from it."""
    rng, u, h = np.random.default_rng(0), np.array([0.3, -0.5, 0.8]), 1e-6
    for angle in (0.0, 1e-9, 1e-4, 0.5, 3.0):
        theta = angle * (axis := rng.normal(size=3)) / np.linalg.norm(axis)
        turn, v = turn_by(theta), rng.normal(size=6)
        found = rotation_vector(turn.as_matrix())
        np.testing.assert_allclose(found, theta, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(rotated(theta, u), turn.apply(u), atol=1e-14)
        ends = [(turn_by(s * v[3:]) * turn).as_rotvec() for s in (h, -h)]
        expected = np.append(v[:3], (ends[0] - ends[1]) / (2 * h))
        rate = position_rate(np.append(np.zeros(3), theta), v)
        np.testing.assert_allclose(rate, expected, atol=3e-9)


def test_the_tissue_has_an_energy():
    """The wrench is the slope of an energy, and a drag, wherever the needle is."""
    scenario, rng = short("direct_force"), np.random.default_rng(1)
    tissue = Tissue(scenario.environment)
    dut = NeedleInTissue(scenario.environment, START)
    for depth in (-0.01, 0.02, 0.1):
        r, v = np.append(tissue.entry, 0.2 * rng.normal(size=3)), rng.normal(size=6)
        r[:3] += [depth, *rng.normal(scale=0.01, size=2)]
        expected = tissue.wrench(r[:3], turn_by(r[3:]), v, h=1e-4)
        np.testing.assert_allclose(ForceAt(dut, r, v), expected, rtol=1e-5, atol=1e-6)


def test_a_needle_that_is_not_turned_is_pushed_and_twisted_more():
    name, kind = "puma560_six_axes", {"controller.kind": "damped_force"}
    straight = [[0.04, 0, 0, 0, 0, 0], [0.14, 0, -0.01, 0, 0, 0]]
    runs = [
        simulate(LoadScenario(name, {**kind, **more}))
        for more in ({}, {"surgeon.waypoints": straight})
    ]
    peaks = [np.abs(run["environment_force"][:, [2, 4]]).max(axis=0) for run in runs]
    assert (peaks[1] > 1.5 * peaks[0]).all()


def test_the_linear_model_knows_that_a_rotation_vector_is_no_integral():
    """dtheta/dt of small deviations from a turn, with an angular velocity."""
    point = OperatingPoint(name="x", position=np.array(START), velocity=np.array(TWIST))
    A = Linearizer(short("direct_force")).Loop(point).system.A
    x, h = np.append(START, TWIST), 1e-6
    steps = [(h * e, -h * e) for e in np.eye(12)]
    ends = [[position_rate(*np.split(x + dx, 2)) for dx in pair] for pair in steps]
    expected = -np.diff(ends, axis=1)[:, 0].T / (2 * h)
    np.testing.assert_allclose(A[:6, :12], expected, atol=1e-8)
    assert np.abs(A[3:6, 3:6]).max() > 0.05


def test_a_run_ends_before_the_rotation_vector_jumps():
    overrides = {"surgeon.velocity": [0.01, 0, 0, 3.0, 0, 0], "duration": 5.0}
    overrides["robot.start"] = [*START[:3], 0, 0, 0]
    recording = simulate(short("damped_force", **overrides))
    assert recording.reason == "the tool is turned by 3 rad from the posture"
    last = np.linalg.norm(recording["tool_position"][-1, 3:])
    assert last == pytest.approx(3.0, abs=1e-6)


BAD = [
    ({"controller.kind": "four_channel"}, "controller.kind = 'four_channel': must be"),
    ({"controller.kind": "wave_variables"}, "with six axes"),
    ({"controller.damped_force.damping": None}, "damping = null: must be given"),
    ({"surgeon.kind": "human", "surgeon.waypoints": []}, "surgeon.kind = 'human'"),
    ({"robot.hold": "orientation"}, "robot.hold = 'orientation': must be none"),
    ({"robot.start.4": 3.1}, "must be turned by at most 3 rad"),
    ({"robot.start": [0.6, 0, 0.4, 0]}, "finite numbers (m), or of 6"),
    ({"surgeon.waypoints.1.3": 0.1}, "must be turned about one axis"),
    ({"environment.bend": [1, 0, 0]}, "environment.bend = [1.0, 0.0, 0.0]: must be"),
    ({"sensor.encoder.sample_period": 0.01}, "sample_period = 0.01: must be null"),
    ({"actuator.force_limit": 9.0}, "must be ideal with six axes"),
    ({"environment.needle": [-1, 0, 0]}, "must be less than a right angle from"),
]


@pytest.mark.parametrize(("overrides", "text"), BAD)
def test_bad_input(overrides, text):
    overrides = {"controller.kind": "damped_force", **overrides}
    with pytest.raises(ScenarioError, match=re.escape(text)):
        MakeTeleoperator(LoadScenario("puma560_six_axes", overrides))
