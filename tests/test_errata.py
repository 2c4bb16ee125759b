"""The evidence behind the package's list of errata."""

import math
import re
from pathlib import Path

import appendix_a
import numpy as np
import pytest
from grids import Slow
from runs import TASKS, Run
from scipy.optimize import brentq

import teleop_drake
from teleop_drake.model.blocks.environments.layered_force_field import LayerColumns
from teleop_drake.model.laws.layered_force import layer_table, layered_force
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.thesis.claims.measures import BasisFunctions
from teleop_drake.thesis.report import CLAIMS

ERRATA = Path(teleop_drake.__file__).parent / "thesis" / "errata.md"
TESTS = Path(__file__).parent
START = np.array([0.85, 0.0])


def Mobility(q):
    J = appendix_a.J(q)
    return J @ np.linalg.solve(appendix_a.M(q), J.T)


def Derivative(f, q, direction, h=1e-6):
    return (f(q + h * direction) - f(q - h * direction)) / (2 * h)


def test_every_test_that_the_errata_name_exists():
    named = set(re.findall(r"`(test_\w+)`", ERRATA.read_text(encoding="utf-8")))
    source = "".join(
        path.read_text(encoding="utf-8") for path in TESTS.rglob("test_*.py")
    )
    assert len(named) > 10
    assert {name for name in named if f"def {name}(" not in source} == set()


def test_every_row_that_the_errata_name_exists():
    rows = re.findall(r"row `([^`]+)`", ERRATA.read_text(encoding="utf-8"))
    assert rows
    assert set(rows) <= {claim.key for claim in CLAIMS}


def test_printed_sign_of_the_haptic_device_runs_away():
    backwards = {"haptic_device.numerator": [-25.0, -50.0], "duration": 10.0}
    recording = simulate(
        LoadScenario("one_dof", {"controller.kind": "direct_force", **backwards})
    )
    assert recording.termination == "diverged"
    assert recording["tool_velocity"][-1, 0] < 0


def test_absolute_x_is_right_in_tissue_and_wrong_on_bone():
    scenario = LoadScenario("one_dof")
    tissue, _, bone = scenario.environment.layers
    assert bone.stiffness * bone.start == pytest.approx(2.25)
    _, tissue, bone = layer_table(*LayerColumns([tissue, bone]).values())
    along = np.array([[1.0], [0.0]])
    touched = layered_force(bone, along, bone[:1], np.zeros(1))
    assert touched.item() == 0.0
    punctured = layered_force(tissue, along, np.array([0.0075]), np.array([0.001]))
    assert punctured.item() == pytest.approx(5.72e-4, rel=0.01)


@pytest.mark.parametrize("task", ["one_dof", "two_dof_combined"])
def test_stiffness_and_damping_change_with_the_material(task):
    """k_e and d_e of (2.14), (2.15) are the layers'; the sensor is ideal."""
    scenario = LoadScenario(task)
    tissue, free, bone = scenario.environment.layers
    assert (tissue.stiffness, tissue.damping) == (0.01, 0.5)
    assert (free.stiffness, free.damping) == (0.0, 0.0)
    assert (bone.stiffness, bone.damping) == (150.0, 0.0)
    recording = simulate(scenario, duration=0.5)
    x, v = (recording[f"tool_{name}"][:, 0] for name in ("position", "velocity"))
    assert recording["environment_force"][:, 0] == pytest.approx(
        tissue.stiffness * x + tissue.damping * v, rel=1e-9, abs=1e-15
    )


def test_task_space_coriolis_matrix():
    rng = np.random.default_rng(1)
    q = np.array([-0.9, 1.9])
    qdot = rng.normal(size=2)
    qddot = rng.normal(size=2)
    M = appendix_a.M(q)
    C = appendix_a.C(q, qdot)
    J = appendix_a.J(q)
    J_dot = Derivative(appendix_a.J, q, qdot)
    J_inv = np.linalg.inv(J)
    C_r = J_inv.T @ (C - M @ J_inv @ J_dot) @ J_inv
    a = J @ qddot + J_dot @ qdot
    force = J_inv.T @ (M @ qddot + C @ qdot)
    assert J_inv.T @ M @ J_inv @ a + C_r @ (J @ qdot) == pytest.approx(force)
    # As printed, with the vector J' q' spread over the columns of the bracket.
    printed = J_inv.T @ (C - (M @ J_inv @ J_dot @ qdot)[:, np.newaxis])
    assert J_inv.T @ M @ J_inv @ a + printed @ (J @ qdot) != pytest.approx(
        force, rel=0.1
    )


def test_c21_as_printed_creates_energy():
    q = np.array([-0.9, 1.9])
    qdot = np.array([0.7, -1.3])
    M_dot = Derivative(appendix_a.M, q, qdot)
    right = M_dot - 2 * appendix_a.C(q, qdot)
    printed = M_dot - 2 * appendix_a.C_as_printed(q, qdot)
    assert qdot @ right @ qdot == pytest.approx(0.0, abs=1e-8)
    assert abs(qdot @ printed @ qdot) > 0.1


def test_direct_force_cannot_carry_the_arm():
    q = appendix_a.joints(START)
    needed = np.linalg.solve(appendix_a.J(q).T, appendix_a.G(q))
    assert np.linalg.norm(needed) > 3.4


def test_estimate_at_zero_joint_angles_is_singular():
    expected = np.diag([0.0, 6.86])
    assert Mobility(np.zeros(2)) == pytest.approx(expected, abs=0.005)


def test_elementwise_projection_does_not_keep_psi_invertible():
    limit = 0.1
    rate = np.array([[0.0, 1.0], [1.0, 0.0]])
    Psi = np.array([[1.0, 0.2], [0.2, 1.0]])
    target = np.ones((2, 2))
    for _ in range(80):
        # (5.53): an element below the limit may not fall. None is, none falls.
        update = np.where((limit > Psi) & (rate < 0), 0.0, rate)
        Psi = Psi + 0.01 * update
    assert Psi == pytest.approx(target)
    assert np.linalg.svd(Psi, compute_uv=False)[-1] == pytest.approx(0.0, abs=1e-12)


def test_mobility_that_the_delayed_loop_tolerates():
    """H(s) mobility e^(-0.2 s)/s has its phase margin where both phases cancel."""

    def Phase(w):
        return math.atan(w / 2) - math.atan(w / 25) - 0.2 * w

    w = brentq(Phase, 2.0, 10.0)
    gain = math.hypot(25 * w, 50) / (w * math.hypot(w, 25) * w)
    assert 1 / gain == pytest.approx(4.69, abs=0.005)
    for x in np.linspace(0.85, 1.49, 30):
        largest = np.linalg.eigvalsh(Mobility(appendix_a.joints(np.array([x, 0.0]))))[
            -1
        ]
        assert 6.0 < largest < 6.8


@pytest.mark.parametrize("task", Slow(TASKS))
def test_runs_stay_inside_the_residual_set(task):
    """The radius delta/lambda_min(G) of (4.50), (5.49), with delta estimated.

    The ideal weights are those constant ones that fit the rates of s and F_e best over
    the run: delta_1 and d_3 are what they leave, delta_2 = d_3 + Psi^-1 G1 delta_1
    (4.40). Steps with a jump of s or F_e in them, and very short ones, are left out.
    """
    recording = Run(task, "adaptive_backstepping")
    n = recording.scenario.num_axes
    controller = recording.scenario.controller
    h = np.diff(recording.time)
    layer = recording["environment_layer"][:, 0]
    kept = (h > 1e-4) & (np.diff(layer) == 0)
    weight = np.sqrt(h[kept])[:, np.newaxis]

    def Middle(samples):
        return ((samples[1:] + samples[:-1]) / 2)[kept]

    def Rest(known, samples):
        rate = np.diff(samples, axis=0)[kept] / h[kept, np.newaxis]
        weights = np.linalg.lstsq(weight * known, weight * rate, rcond=None)[0]
        return rate - known @ weights

    F_e = recording["environment_force"]
    s = recording["auxiliary_error"]
    Phi = Middle(BasisFunctions(recording))
    dF = Middle(recording["control_force"] - F_e)
    delta_1 = Rest(np.hstack([dF, Phi]), s)
    d_3 = Rest(Phi, F_e)
    Psi = Middle(recording["psi"]).reshape(-1, n, n)
    # P is the identity, G1 and G2 are multiples of it.
    share = np.linalg.solve(Psi, controller.G1 * delta_1[:, :, np.newaxis])[:, :, 0]
    delta = np.linalg.norm(np.hstack([delta_1, d_3 + share]), axis=1).max()
    mu = np.linalg.norm(np.hstack([s, recording["control_force_error"]]), axis=1)
    assert delta / min(controller.G1, controller.G2) > mu.max()


def test_case_I_reaches_the_edge_of_the_workspace():
    scenario = LoadScenario("two_dof_puncture")
    way = appendix_a.L1 + appendix_a.L3 - scenario.robot.start[0]
    assert way / scenario.surgeon.velocity[0] == pytest.approx(6.5)
    assert scenario.duration > 6.5


def test_bound_as_printed_leaves_no_residual_set():
    lam = 2.0
    delta = 0.7
    mu = np.linspace(1e-3, 3.0, 301)
    right = -lam * (mu**2 - mu * delta / lam)
    printed = -lam * mu**2 - mu * delta / lam
    assert right == pytest.approx(-lam * mu**2 + mu * delta)
    assert ((right < 0) == (mu > delta / lam)).all()
    assert (printed < 0).all()


def test_appendix_a_is_consistent():
    q = np.array([-0.7, 1.6])
    J = np.column_stack([Derivative(appendix_a.p_WT, q, e) for e in np.eye(2)])
    assert appendix_a.J(q) == pytest.approx(J, abs=1e-8)

    def Potential(q):
        first = appendix_a.L2 * math.sin(q[0])
        second = appendix_a.L1 * math.sin(q[0]) + appendix_a.L4 * math.sin(q.sum())
        return appendix_a.g * (appendix_a.m1 * first + appendix_a.m2 * second)

    G = [Derivative(Potential, q, e) for e in np.eye(2)]
    assert appendix_a.G(q) == pytest.approx(G)
    for sign in (1.0, -1.0):
        p = np.array([0.9, -0.3])
        assert appendix_a.p_WT(appendix_a.joints(p, sign)) == pytest.approx(p)
    rod = appendix_a.m1 * appendix_a.L1**2 / 12
    assert math.isclose(appendix_a.I1, rod, rel_tol=2e-3)
