"""Six axes: the loop against one by hand, the kinematics, and what is refused.

The loop by hand shares no code with the package: the arm is the model file in a
MultibodyPlant, which tests/model/blocks/robots checks against textbook recursions, the
rest numpy and scipy. The operator commands a constant twist, and delays go by the
method of steps. The rate of the basis functions and the slopes of the tissue's energy
are differences.
"""

import functools
import re
from pathlib import Path

import numpy as np
import pytest
from documentation import ROOT
from energies import ChannelEnergy
from grids import Slow
from needle_error import path_error
from numpy.testing import assert_allclose
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import teleop_drake
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.environments.base import ForceAt
from teleop_drake.model.blocks.environments.needle_path import NeedleInTissue
from teleop_drake.model.laws.task_space import (
    displacement,
    position_rate,
    rotated,
    rotation_vector,
)
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.signals import UnitOf
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.operating_point import OperatingPoint
from teleop_drake.study.analysis.stability import AnalyzeStability

MODEL = Path(teleop_drake.__file__).parent / "model/models" / "puma560.sdf"
START = [0.6, -0.15, 0.4, 0.3, -0.2, 0.25]
DELAY = 0.05
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
        plant = self.plant
        context = self.context
        plant.SetPositionsAndVelocities(context, x)
        pose = plant.EvalBodyPoseInWorld(context, self.tool)
        world = plant.world_frame()
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, self.tool.body_frame(), np.zeros(3), world,
            world,
        )  # fmt: skip
        R = Rotation.from_matrix(pose.rotation().matrix())
        return pose.translation(), R, np.vstack([J[3:], J[:3]])

    def mobility(self, scenario):
        q = scenario.robot.JointPositions(START)
        J = self.motion(np.append(q, np.zeros(6)))[2]
        return J @ np.linalg.solve(self.plant.CalcMassMatrix(self.context), J.T)

    def accelerations(self, wrench, J):
        forces = MultibodyForces(self.plant)  # Neither weight nor damping.
        forces.mutable_generalized_forces()[:] += J.T @ wrench
        rest = self.plant.CalcInverseDynamics(self.context, np.zeros(6), forces)
        return np.linalg.solve(self.plant.CalcMassMatrix(self.context), -rest)


class Tissue:
    """A potential of the pose of a needle along x, and a drag, by quadrature."""

    def __init__(self, c):
        self.entry = np.array([c.start, *START[1:3]])
        self.c = c
        self.nodes, self.weights = np.polynomial.legendre.leggauss(6)

    def needle(self, p, turn):
        """Depths along the needle, their weights, and its points from the tip."""
        depth = p[0] - self.entry[0]
        u = turn.apply([1.0, 0, 0])
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
    """(5.2) to (5.51), the projection left out: Psi stays away from its limit.

    And the robust term against the error in dF_e/dt, (rho3, eps3).
    """

    def __init__(self, c, psi, robust=(0.0, 1.0)):
        self.robust = robust
        x, y = (z.ravel() for z in np.meshgrid([0, 1], [0, 1], indexing="ij"))
        share = np.full((4, 6), 0.5)
        share[:, 0] = x
        share[:, 4] = y
        self.widths = c.network.upper - c.network.lower
        self.centres = c.network.lower + share * self.widths
        self.c = c
        self.psi_0 = psi
        self.start = np.concatenate([np.zeros(30), psi.ravel(), np.zeros(24)])

    def basis(self, p, turn):
        r = np.append(p, turn.as_rotvec())
        return np.exp(-(((r - self.centres) / self.widths) ** 2).sum(axis=1))

    def rate(self, x, p, turn, v, F_e, F_hd, v_dd, h=1e-6):
        c = self.c
        (F_c, W1, psi, W3) = np.split(x, [6, 30, 66])
        W1 = W1.reshape(6, 4)
        psi = psi.reshape(6, 6)
        W3 = W3.reshape(6, 4)
        Phi = self.basis(p, turn)
        G1 = c.G1
        nu = c.leakage
        ends = [self.basis(p + s * v[:3], turn_by(s * v[3:]) * turn) for s in (h, -h)]
        Phi_dot = (ends[0] - ends[1]) / (2 * h)
        s = v - v_dd + c.Lambda @ (F_e - F_hd)
        inverse = np.linalg.inv(psi)
        y1 = W1 @ Phi
        z = F_c - F_e + inverse @ (y1 + G1 * s)
        g = c.P @ s + G1 * inverse.T @ z
        W1_dot = c.beta1 * (np.outer(g, Phi) - nu * W1)
        psi_dot = c.beta2 * (np.outer(g, F_c - F_e) + self.psi_0 - psi)
        W3_dot = c.beta3 * (-np.outer(z, Phi) - nu * W3)
        alpha_dot = W3 @ Phi + inverse @ psi_dot @ inverse @ (y1 + G1 * s)
        s_dot = psi @ (F_c - F_e) + y1
        alpha_dot -= inverse @ (W1_dot @ Phi + W1 @ Phi_dot + G1 * s_dot)
        rho3, eps3 = self.robust
        F_dot = alpha_dot - psi.T @ c.P.T @ s - c.G2 * z
        F_dot -= rho3 * z / np.hypot(np.linalg.norm(z), eps3)
        return np.concatenate([F_dot, W1_dot.ravel(), psi_dot.ravel(), W3_dot.ravel()])


class Springs:
    """P+d: the handle is a ball with a quaternion, its state [p; q; v; w]."""

    def __init__(self, c):
        zeros = np.zeros(6)
        self.start = np.concatenate([START[:3], turn_by(START[3:]).as_quat(), zeros])
        self.M = c.master_mass
        self.B = c.master_damping
        self.K = c.stiffness

    def pull(self, handle, p, turn):
        turned = Rotation.from_quat(handle[3:7]) * turn.inv()
        return self.K @ np.append(handle[:3] - p, turned.as_rotvec())

    def rate(self, handle, F_h, p, turn):
        q = handle[3:7]
        v = handle[7:]
        w = handle[10:]
        q_dot = np.append(q[3] * w + np.cross(w, q[:3]), -w @ q[:3]) / 2
        F = F_h - self.pull(handle, p, turn) - self.B @ v
        return np.concatenate([v[:3], q_dot, np.linalg.solve(self.M, F)])


def solve_by_hand(scenario, law):
    """Returns the tool's [p; theta; v; F_e] as a function of time."""
    arm = Arm(scenario.robot.posture)
    tissue = Tissue(scenario.environment)
    scale = 10 * np.repeat([1, 0.2**2], 3)
    pieces = []

    def tool(x):
        p, R, J = arm.motion(x[:12])
        v = J @ x[6:12]
        turn = R * arm.R_PW
        return p, turn, v, tissue.wrench(p, turn, v), J

    def rate(t, x):
        # The last piece is that of a delay ago.
        late, v_dd = (pieces[-1](t - DELAY), TWIST) if pieces else (x_0, np.zeros(6))
        F_h, F_hd = (scale * (50 * z[12:18] + 25 * z[18:24]) for z in (x, late))
        p_late, turn_late, felt, *_ = tool(late)
        p, turn, v, F_e, J = tool(x)
        F_c = F_hd
        own = []
        if isinstance(law, Springs):
            F_c = law.pull(late[24:], p, turn) - law.B @ v
            felt = x[31:]
            own = law.rate(x[24:], F_h, p_late, turn_late)
        elif law:
            F_c = x[24:30]
            own = law.rate(x[24:], p, turn, v, F_e, F_hd, v_dd)
        a = arm.accelerations(F_c - F_e, J)
        hand = np.append(x[18:24], TWIST - felt - 25 * x[18:24])
        return np.concatenate([x[6:12], a, hand, own])

    x = np.append(scenario.robot.JointPositions(START), np.zeros(18))
    x = x_0 = np.append(x, law.start if law else [])
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
        "environment.bend": [0, 0, -2],
        "controller.network.count": [2, 1, 1, 1, 2, 1],
        "delay": DELAY,
        **overrides,
    }
    return LoadScenario("puma560_six_axes", overrides)


LOOPS = [
    ("adaptive_backstepping", 0.1, "drake"),
    ("direct_force", 0.6, "compiled"),
    ("proportional_damping", 0.8, "compiled"),
    ("adaptive_backstepping", 0.8, "compiled"),
    ("robust_backstepping", 0.8, "compiled"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "duration", "engine"), Slow(LOOPS, but=(2,)))
def test_the_loop_by_hand(kind, duration, engine):
    bounds = {"force_rate_bound": 5.0, "force_width": 0.1}
    scenario = short(kind, duration=duration, **{"controller.robust": bounds})
    c = scenario.controller
    law = None
    if kind == "proportional_damping":
        law = Springs(c.proportional_damping)
    elif kind != "direct_force":
        robust = (5.0, 0.1) if kind == "robust_backstepping" else (0.0, 1.0)
        law = Adaptive(c, scenario.initial_psi, robust)
    seen = solve_by_hand(scenario, law)
    recording = simulate(scenario, engine=engine)
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


def run(kind, duration=0.3, delay=DELAY, **own):
    own = {f"controller.{kind}.{name}": x for name, x in own.items()}
    return simulate(
        short(kind, duration=duration, delay=delay, **own), engine="compiled"
    )


LINE, SPRING = (np.diag(np.repeat(x, 3)).tolist() for x in ([9.2, 0.368], [65, 2.6]))
LOCAL = {f"C_{end}": {"damping": 0.0, "stiffness": SPRING} for end in "ms"}
IDLE = {
    "kind": "time_domain_passivity",
    "initial_energy": 1e6,
    "maximum_mobility": 1e-9,
}
SAME = {
    "without delay a matched line is its damper": (
        {"kind": "wave_variables", "delay": 0.0},
        {"kind": "damped_force", "delay": 0.0, "damping": LINE},
    ),
    "two springs without dampers": (
        {"kind": "four_channel", "variant": "position_position", "master_damping": 0.0}
        | LOCAL,
        {"kind": "proportional_damping", "master_damping": 0.0},
    ),
    "energy that is never spent": (IDLE, {"kind": "direct_force"}),
}


@pytest.mark.mostly_slow
@pytest.mark.parametrize("why", SAME)
def test_architectures_that_are_the_same_here(why):
    runs = [run(**own) for own in SAME[why]]
    times = np.linspace(0, 0.3, 31)
    for name in ("tool_position", "tool_velocity"):
        found, expected = (x.Interpolate(name, times) for x in runs)
        moved = np.abs(expected - expected[0]).max(axis=0)
        assert np.all(np.abs(found - expected) <= 1e-4 * moved)


@pytest.mark.slow
def test_passivity_control_bounds_the_energy_of_each_axis():
    """Moments have budgets of their own; idle, the channels make more."""
    runs = run(IDLE["kind"], 3.0, 0.1), run(**IDLE, duration=3.0, delay=0.1)
    E_0 = ResolveController(runs[0].scenario).initial_energy
    acts, idles = (ChannelEnergy(x).min(axis=0) for x in runs)
    assert (acts >= -1.1 * E_0).all()
    assert (idles < -1.5 * E_0).sum() > 2


def test_the_model_of_a_predictor_has_the_momentum_of_its_forces():
    """And is felt at once, and taken back a round trip later."""
    smith = run("smith_predictor", 0.4)
    t = np.linspace(0, 0.4, 4001)
    names = "forward_packet_sent", "model_velocity", "felt_velocity"
    F_h, v, felt = (smith.Interpolate(name, t) for name in names)
    momentum = np.trapezoid(F_h[:, :6], t, axis=0)
    mobility = Arm(smith.scenario.robot.posture).mobility(smith.scenario)
    assert_allclose(v[-1], mobility @ momentum, rtol=1e-4)
    back = smith.Interpolate("return_packet_received", t)[:, 6:]
    assert_allclose(felt[2000], (back + v)[2000] - v[1000], rtol=1e-4)


def test_the_delay_margin_of_a_loop_whose_inertia_has_axes():
    """M dv/dt = F_h(t - T): each eigenvalue of M^-1 and the device is a loop."""
    scenario = short("direct_force")
    scale = np.repeat([1, 0.2**2], 3)
    mobility = Arm(scenario.robot.posture).mobility(scenario)
    margins = []
    for x in np.linalg.eigvals(mobility * scale):
        # |x (250 j w + 500)| = w^2 |j w + 25|
        squares = np.roots([1, 625, -((250 * x) ** 2), -((500 * x) ** 2)])
        w = np.sqrt(squares.real.max())  # The one that is > 0.
        margins.append((np.arctan(w / 2) - np.arctan(w / 25)) / w)
    point = OperatingPoint(name="x", position=np.array(START), velocity=np.zeros(6))
    (found,) = AnalyzeStability(scenario, points=[point]).points
    assert found.margin.delay == pytest.approx(min(margins), rel=1e-4)


def test_rotation_vectors():
    """Against scipy's, at no rotation, near it and far from it."""
    rng = np.random.default_rng(0)
    u = np.array([0.3, -0.5, 0.8])
    h = 1e-6
    for angle in (0.0, 1e-9, 1e-4, 0.5, 3.0):
        theta = angle * (axis := rng.normal(size=3)) / np.linalg.norm(axis)
        turn = turn_by(theta)
        v = rng.normal(size=6)
        found = rotation_vector(turn.as_matrix())
        assert_allclose(found, theta, rtol=1e-12, atol=1e-15)
        assert_allclose(rotated(theta, u), turn.apply(u), atol=1e-14)
        ends = [(turn_by(s * v[3:]) * turn).as_rotvec() for s in (h, -h)]
        expected = np.append(v[:3], (ends[0] - ends[1]) / (2 * h))
        rate = position_rate(r := np.append(np.zeros(3), theta), v)
        assert_allclose(rate, expected, atol=3e-9)
        if angle == 0.0:  # Its slope is known there, too.
            slope = ExtractGradient(position_rate(InitializeAutoDiff(r).ravel(), v))
            assert_allclose(slope[3:, 3:], -np.cross(np.eye(3), v[3:]).T / 2)
        relative = (turn * turn_by(u).inv()).as_rotvec()
        found = displacement(r, np.append(v[:3], u))
        assert_allclose(found, [*-v[:3], *relative], atol=1e-12)


def test_the_tissue_has_an_energy():
    """The wrench is the slope of an energy, and a drag, wherever the needle is."""
    scenario = short("direct_force")
    rng = np.random.default_rng(1)
    tissue = Tissue(scenario.environment)
    dut = NeedleInTissue(scenario.environment, START)
    for depth in (-0.01, 0.02, 0.1):
        r = np.append(tissue.entry, 0.2 * rng.normal(size=3))
        v = rng.normal(size=6)
        r[:3] += [depth, *rng.normal(scale=0.01, size=2)]
        expected = tissue.wrench(r[:3], turn_by(r[3:]), v, h=1e-4)
        assert_allclose(ForceAt(dut, r, v), expected, rtol=1e-5, atol=1e-6)


@pytest.fixture(scope="module")
def needle_task(tmp_path_factory):
    """Makes the task, by a hand that turns the needle or by one that never does.

    The tip is commanded alike by both: the second is the first, recorded, with the
    angular velocity left out.
    """
    name = "puma560_six_axes"
    file = tmp_path_factory.mktemp("hand") / "hand.csv"
    turning = simulate(LoadScenario(name, {"controller.kind": "direct_force"}))
    times = np.linspace(0, turning.time[-1], 321)
    twists = turning.Interpolate("forward_packet_sent", times)[:, 6:]
    twists[:, 3:] = 0
    np.savetxt(file, np.column_stack([times, twists]), delimiter=",")

    def Make(kind, turns):
        overrides = {"controller.kind": kind}
        if not turns:
            hand = {"kind": "recorded", "file": str(file), "waypoints": []}
            overrides |= {f"surgeon.{key}": value for key, value in hand.items()}
        return LoadScenario(name, overrides)

    return Make


def needle_error(scenario, r):
    """The rms distance of the needle from the path, by quadrature, m."""
    entry = np.array([scenario.environment.start, *scenario.robot.start[1:3]])
    depth = r[0] - entry[0]
    u = turn_by(r[3:]).apply([1.0, 0, 0])
    if depth <= 0:
        return 0.0
    xi = np.linspace(0, depth, 201)
    needle = r[:3] + np.outer((xi - depth) / u[0], u)
    path = entry + np.outer(xi, [1, 0, 0])
    path += np.outer(xi**2 / 2, scenario.environment.bend)
    squares = ((needle - path) ** 2).sum(axis=1)
    return np.sqrt(np.trapezoid(squares, xi) / depth)


@pytest.fixture(scope="module")
def needle_scores(needle_task):
    """Returns the rms of needle_error over the time in tissue, mm, and max |F_z|, N."""

    @functools.cache
    def Score(kind, turns):
        scenario = needle_task(kind, turns)
        recording = simulate(scenario, engine="compiled")
        assert recording.termination == "completed"
        times = np.linspace(0, recording.time[-1], 401)
        positions = recording.Interpolate("tool_position", times)
        inside = positions[positions[:, 0] > scenario.environment.start]
        errors = np.array([needle_error(scenario, r) for r in inside])
        force = np.abs(recording["environment_force"][:, 2]).max()
        return 1e3 * np.sqrt(np.mean(errors**2)), force

    return Score


def test_the_run_ends_after_the_path():
    scenario = LoadScenario("puma560_six_axes")
    end = scenario.surgeon.Path()[0][-1]
    assert end + 2 < scenario.duration


def test_path_error_is_the_quadrature(subtests):
    scenario = LoadScenario("puma560_six_axes")
    rng = np.random.default_rng(2)
    path = scenario.environment.Path(scenario.robot.start)
    for depth in (-0.01, 0.02, 0.1):
        with subtests.test(depth=depth):
            r = np.append(path.entry, 0.2 * rng.normal(size=3))
            r[:3] += [depth, *rng.normal(scale=0.01, size=2)]
            expected = needle_error(scenario, r)
            assert path_error(path, r) == pytest.approx(expected, rel=1e-4)


KINDS = Slow(
    ["damped_force", "direct_force", "wave_variables", "adaptive_backstepping"], but=[0]
)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_turning_the_needle_takes_it_nearer_to_its_path(kind, needle_scores):
    (error, _), (straight, _) = (needle_scores(kind, x) for x in (True, False))
    assert error < 0.75 * straight


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_says_how_far_the_needle_is_from_its_path(kind, needle_scores):
    page = (ROOT / "teleop_drake/docs/robots.md").read_text(encoding="utf-8")
    row = rf"^\| `{kind}` \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$"
    (found,) = re.findall(row, page, re.MULTILINE)
    (error, force), (straight, force_straight) = (
        needle_scores(kind, x) for x in (True, False)
    )
    expected = [error, straight, force, force_straight]
    assert [float(x) for x in found] == pytest.approx(expected, rel=0.01)


def test_the_linear_model_knows_that_a_rotation_vector_is_no_integral():
    """dtheta/dt of small deviations from a turn, with an angular velocity."""
    point = OperatingPoint(name="x", position=np.array(START), velocity=np.array(TWIST))
    A = Linearizer(short("direct_force")).Loop(point).system.A
    x = np.append(START, TWIST)
    h = 1e-6
    steps = [(h * e, -h * e) for e in np.eye(12)]
    ends = [[position_rate(*np.split(x + dx, 2)) for dx in pair] for pair in steps]
    expected = -np.diff(ends, axis=1)[:, 0].T / (2 * h)
    assert_allclose(A[:6, :12], expected, atol=1e-8)
    assert np.abs(A[3:6, 3:6]).max() > 0.05


def test_a_run_ends_before_the_rotation_vector_jumps():
    overrides = {"surgeon.velocity": [0.01, 0, 0, 9.0, 0, 0], "duration": 2.0}
    overrides["robot.start"] = [*START[:3], 0, 0, 0]
    recording = simulate(short("damped_force", **overrides))
    assert recording.reason == "the tool is turned by 3 rad from the posture"
    last = np.linalg.norm(recording["tool_position"][-1, 3:])
    assert last == pytest.approx(3.0, abs=1e-6)


SMITH = {"controller.kind": "smith_predictor"}
BAD = [
    (SMITH | {"controller.smith_predictor.stiffness": 1.0}, "must be 0 about axes"),
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
