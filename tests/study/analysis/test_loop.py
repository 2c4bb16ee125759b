"""Tests of analysis.loop against models in closed form."""

import math
from dataclasses import replace
from pathlib import Path

import appendix_a
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.framework import BasicVector, LeafSystem
from wired import Wired

from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.kernel import Kernel, KernelBlock
from teleop_drake.model.blocks.architectures.direct_force import DirectForce
from teleop_drake.model.blocks.robots import TwoLinkArmConfig
from teleop_drake.model.blocks.robots.inverse_kinematics import ToolJacobian
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.analysis.loop import (
    Linearizer,
)
from teleop_drake.study.analysis.operating_point import (
    OperatingPoint,
    OperatingPointAt,
    OperatingPoints,
)
from teleop_drake.study.analysis.stability import AnalyzeStability

OWN_ARM = Path(__file__).parents[3] / "diagrams" / "own_arm.yaml"
# Two task axes for three joints.
OWN_ARM_IN_A_PLANE = {
    "robot.start": [0.45, 0.0],
    "surgeon.velocity": [0.1, 0.02],
    "surgeon.contact_force": [1.0, 0.0],
    "controller.network": {"lower": [0.4, -0.1], "upper": [0.6, 0.1], "count": [3, 2]},
}

W = np.geomspace(0.01, 300, 50)
S = 1j * W


def LinearizeLoop(scenario, point, teleoperator=None):
    return Linearizer(scenario, teleoperator).Loop(point)


def Model(name, kind="direct_force", point=0, **overrides):
    scenario = LoadScenario(name, {"controller.kind": kind} | overrides)
    return LinearizeLoop(scenario, OperatingPoints(scenario)[point])


def test_operating_points_of_the_tasks():
    scenario = LoadScenario("one_dof")
    tissue, free, bone = OperatingPoints(scenario)
    assert [p.name for p in (tissue, free, bone)] == ["tissue", "free", "bone"]
    assert_allclose(tissue.position, [0.00375])
    assert_allclose(free.position, [0.01125])
    # The first impact of 0.5 kg at 1 mm/s on 150 N/m.
    assert_allclose(bone.position, 0.015 + 0.001 * math.sqrt(0.5 / 150))
    assert_allclose(tissue.velocity, [0.001])
    assert_allclose(bone.velocity, [0.0])
    names = {
        name: [p.name for p in OperatingPoints(LoadScenario(name))]
        for name in ("two_dof_puncture", "two_dof_collision", "two_dof_combined")
    }
    assert names == {
        "two_dof_puncture": ["tissue", "free"],
        "two_dof_collision": ["free", "bone"],
        "two_dof_combined": ["tissue", "free", "bone"],
    }


def test_empty_space_and_the_robots_reach():
    scenario = LoadScenario(
        "two_dof_puncture", {"environment.layers": [], "duration": 100.0}
    )
    (point,) = OperatingPoints(scenario)
    assert point.name == "empty"
    # The path is from 0.85 m to |sin q2| = 0.05; both links are 0.75 m long.
    reach = math.sqrt(2 * 0.75**2 * (1 + math.sqrt(1 - 0.05**2)))
    assert_allclose(point.position, [(0.85 + reach) / 2, 0.0])


def test_adaptive_law_without_adaptation_is_its_textbook_form(subtests):
    """With W1 = W3 = 0 and constant Psi, (4.23), (4.31), (4.32) are F_c = A F_e - K s.

    A = (G1 + G2)/(p + G1 + G2), K = (Psi + G1 G2/Psi)/(p + G1 + G2), p = d/dt. dF_e/dt
    does not appear.
    """
    scenario = LoadScenario("one_dof", {"controller.adaptation_rate": 0.0})
    m = 0.5
    c = 0.1
    Psi = 4.3
    G1 = 2.0
    G2 = 20.0
    Lambda = 1.0
    for point, Z in (
        (0, 0.5 + 0.01 / S),
        (1, 0 * S),
        (2, 150 / S),
    ):
        with subtests.test(point=point):
            model = LinearizeLoop(scenario, OperatingPoints(scenario)[point])
            assert model.frozen_weights
            A = (G1 + G2) / (S + G1 + G2)
            K = (Psi + G1 * G2 / Psi) / (S + G1 + G2)
            # F_c = A F_e - K [(v - v_dd) + Lambda (F_e - F_hd)], m v' + c v = F_c - F_e
            v = (
                K
                * np.array([Lambda + 0 * S, 1 + 0 * S])
                / (m * S + c + (1 - A) * Z + K * (1 + Lambda * Z))
            )
            G = model.slave.frequency_response(W)
            assert_allclose(G[:, 1, :], v.T, rtol=1e-8)
            assert_allclose(G[:, 0, :], (v / S).T, rtol=1e-8)


def ArmMotion(x, F):
    """Returns [p, v, dv/dt] of the tool by Appendix A; x = [q, qdot] may be complex.

    F is the total force F_c - F_e on the tool.
    """
    q = x[:2]
    qdot = x[2:]
    J, M, C = (
        f(*args)
        for f, *args in ((appendix_a.J, q), (appendix_a.M, q), (appendix_a.C, q, qdot))
    )
    qddot = np.linalg.solve(M, J.T @ F - C @ qdot)
    L1 = appendix_a.L1
    L3 = appendix_a.L3
    w = qdot[0] + qdot[1]
    c1 = np.cos(q[0]) * qdot[0]
    s1 = np.sin(q[0]) * qdot[0]
    c12 = np.cos(q[0] + q[1]) * w
    s12 = np.sin(q[0] + q[1]) * w
    Jdot = -np.array([[L1 * c1 + L3 * c12, L3 * c12], [L1 * s1 + L3 * s12, L3 * s12]])
    return np.concatenate([appendix_a.p_WT(q), J @ qdot, J @ qddot + Jdot @ qdot])


@pytest.mark.parametrize("velocity", [[0.0, 0.0], [0.1, -0.05]])
def test_arm_is_appendix_a(velocity):
    """The arm is in tissue and moves; complex steps give exact derivatives."""
    scenario = LoadScenario("two_dof_combined", {"controller.kind": "direct_force"})
    p0 = np.array([0.93, 0.05])
    v0 = np.array(velocity)
    point = OperatingPoint(name="here", position=p0, velocity=v0)
    model = LinearizeLoop(scenario, point)

    q0 = TwoLinkArmConfig(elbow="down").JointPositions(p0)
    x0 = np.concatenate([q0, np.linalg.solve(appendix_a.J(q0), v0)])
    assert_allclose(ArmMotion(x0, np.zeros(2))[:4], [*p0, *v0], atol=1e-12)
    # F0 is the force at a constant velocity. dv/dt is affine in the force.
    a0 = ArmMotion(x0, np.zeros(2))[4:]
    slope = np.array([ArmMotion(x0, F)[4:] - a0 for F in np.eye(2)]).T
    F0 = np.linalg.solve(slope, -a0)

    def Motion(x):
        p, v = ArmMotion(x, F0)[:4].reshape(2, 2)
        # The change of F_e.
        change = 0.01 * (p[0] - p0[0]) + 0.5 * (v[0] - v0[0])
        return ArmMotion(x, F0 - np.array([change, 0 * change]))

    h = 1e-30
    by_x = np.array([Motion(x0 + 1j * h * e).imag / h for e in np.eye(4)]).T
    A = by_x[2:] @ np.linalg.inv(by_x[:4])
    assert_allclose(model.slave.A, A, atol=1e-12)
    assert_allclose(model.slave.B[2:, :2], slope, rtol=1e-12)
    assert np.all(model.slave.B[:, 2:] == 0) and np.all(model.slave.B[:2] == 0)
    assert_allclose(model.slave.C, np.eye(4), atol=1e-12)
    assert model.trim_residual < 1e-12


def test_free_joints_are_states_like_others():
    """At rest v/F_h = J (s M + D)^-1 J^T, with M, D and J of all three joints."""
    scenario = LoadScenario(OWN_ARM, OWN_ARM_IN_A_PLANE)
    r = np.array([0.46, 0.0])
    model = LinearizeLoop(
        scenario,
        OperatingPoint(name="free", position=r, velocity=0 * r),
    )
    plant = scenario.robot.LoadPlant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, scenario.robot.JointPositions(r))
    M = plant.CalcMassMatrix(context)
    J = ToolJacobian(plant, context, 2)
    exact = J @ np.linalg.solve(S[:, None, None] * M + 0.02 * np.eye(3), J.T)
    assert model.slave.num_states == 6
    response = model.slave.frequency_response(W)[:, 2:, :2]
    assert_allclose(response, exact, rtol=1e-6, atol=1e-9)


def test_estimates_are_those_of_the_point():
    """The model uses Psi of the point, not of the scenario, and its weights W1."""
    scenario = LoadScenario("one_dof", {"controller.adaptation_rate": 0.0})
    point = OperatingPoints(scenario)[1]
    count = scenario.controller.network.count[0]
    weights = np.zeros(count)
    other = LinearizeLoop(
        scenario,
        replace(point, estimates=np.concatenate([[0.0], weights, [6.0], weights])),
    )
    same = LoadScenario(
        "one_dof", {"controller.adaptation_rate": 0.0, "controller.initial_psi": 6.0}
    )
    expected = LinearizeLoop(same, point)
    assert_allclose(
        other.slave.frequency_response(W),
        expected.slave.frequency_response(W),
        rtol=1e-9,
    )
    # With weights, F_c contains -Psi^-1 W1 Phi(r), which acts as a spring.
    weights = np.linspace(-1, 1, count)
    curved = LinearizeLoop(
        scenario,
        replace(point, estimates=np.concatenate([[0.0], weights, [6.0], 0 * weights])),
    )
    assert abs(curved.slave.A[2, 0]) > 100 * abs(expected.slave.A[2, 0])


def test_what_was_learned_hardly_moves_the_margin():
    """The estimates are those of a run, and the point is the tool's position then."""
    scenario = LoadScenario("one_dof", {"duration": 12.0})
    recording = simulate(scenario)

    def At(name):
        return recording.Interpolate(name, [11.2])[0]

    point = OperatingPoint(
        name="free",
        position=At("tool_position"),
        velocity=At("tool_velocity"),
        estimates=np.concatenate(
            [At(name) for name in ("control_force", "weights_1", "psi", "weights_3")]
        ),
    )
    learned = AnalyzeStability(scenario, points=[point])["free"].margin.delay
    initial = AnalyzeStability(scenario)["free"].margin.delay
    assert learned != initial
    assert learned == pytest.approx(initial, rel=1e-2)


class ForcePlus(LeafSystem):
    """F_c = F_hd + extra(r, v), on one axis."""

    def __init__(self, extra):
        LeafSystem.__init__(self)
        force, _, r, v, _ = [
            self.DeclareVectorInputPort(name, 1)
            for name in (
                "haptic_force",
                "velocity_command",
                "tool_position",
                "tool_velocity",
                "environment_force",
            )
        ]

        def Calc(context, output: BasicVector):
            F_hd = force.Eval(context)
            output.SetFromVector(F_hd + extra(r.Eval(context), v.Eval(context)))

        self.DeclareVectorOutputPort("control_force", 1, Calc)


@pytest.mark.slow
def test_a_block_that_does_not_convert_is_differentiated_and_named():
    """The law is a plain LeafSystem, with a sine whose length is 2 mm per radian."""
    curved = ForcePlus(lambda r, v: np.sin(r / 0.002))
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    point = OperatingPoints(scenario)[0]
    diagram = MakeTeleoperator(scenario, control_law=curved)
    model = LinearizeLoop(scenario, point, teleoperator=diagram)
    exact = (math.cos(0.00375 / 0.002) / 0.002 - 0.01) / 0.5
    assert model.slave.A[1, 0] == pytest.approx(exact, rel=1e-9)
    (path,) = model.by_differences
    notes = AnalyzeStability(scenario, points=[point], teleoperator=diagram).notes
    assert (
        f"central differences, without conversion to AutoDiffXd: {path}." in notes[-1]
    )


def sine_in_free_space(F_hd, r):
    return F_hd if r[0] < 0.0075 else F_hd + np.array([math.sin(r[0])])


class HalfDual(KernelBlock):
    """F_c = F_hd, plus sin(r) in free space, computed by a function of `math`."""

    def __init__(self):
        super().__init__()
        names = ("haptic_force", "velocity_command", "tool_position", "tool_velocity")
        for name in (*names, "environment_force"):
            self.DeclareVectorInputPort(name, 1)
        self.DeclareOutputs(control_force=1)

    def Kernel(self):
        term = (sine_in_free_space, "haptic_force", "tool_position")
        return Kernel(
            outputs={"control_force": term},
            unused=("velocity_command", "tool_velocity", "environment_force"),
        )


def test_a_block_that_converts_at_one_point_only():
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    diagram = MakeTeleoperator(scenario, control_law=HalfDual())
    linearizer = Linearizer(scenario, diagram)
    tissue, free, _ = map(linearizer.Loop, OperatingPoints(scenario))
    assert tissue.by_differences == () and len(free.by_differences) == 1
    slope = math.cos(free.point.position[0]) / 0.5
    assert free.slave.A[1, 0] == pytest.approx(slope, rel=1e-9)


def LawWith(late):
    """Returns a law of direct force whose haptic force passes through a system."""
    others = ("velocity_command", "tool_position", "tool_velocity", "environment_force")
    return Wired(
        {"law": DirectForce(num_axes=1), "late": late},
        {"law.haptic_force": "late"},
        {"control_force": "law.control_force"},
        inputs={"haptic_force": "late"} | {name: f"law.{name}" for name in others},
    )


def test_delay_of_its_own_is_one_more_cut():
    """A delay in the slave is a further cut of its model.

    The delay's output acts on the slave as the haptic force did without it, and its
    input is the received haptic force.
    """
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    point = OperatingPoints(scenario)[0]
    late = LawWith(TransportDelay(delay=0.1, size=1))
    model = LinearizeLoop(
        scenario, point, teleoperator=MakeTeleoperator(scenario, control_law=late)
    )
    plain = LinearizeLoop(scenario, point)
    assert model.inner_delays == (0.1,) and plain.inner_delays == ()
    assert len(model.signals.forward) == len(model.signals.back) == 2
    assert_allclose(model.slave.A, plain.slave.A, atol=1e-12)
    assert_allclose(model.slave.B[:, [2, 1]], plain.slave.B, atol=1e-12)
    assert np.all(model.slave.B[:, 0] == 0)
    assert_allclose(model.slave.D[2], [1, 0, 0], atol=1e-12)
    assert model.trim_residual < 1e-12


def test_samples_have_no_linear_model():
    """Sampled states of a system are refused: they would count as constant."""
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    late = LawWith(SampledDelay(delay=0.1, sample_period=0.01, size=1))
    diagram = MakeTeleoperator(scenario, control_law=late)
    with pytest.raises(ValueError, match=r"controller\.late = a state that is not"):
        LinearizeLoop(scenario, OperatingPoints(scenario)[0], teleoperator=diagram)


def test_predictor_is_its_equation():
    """v_felt = v_ret + v_model - d, M dv_model/dt = F_h - B v_model - K y."""
    scenario = LoadScenario("one_dof", {"controller.kind": "smith_predictor"})
    model = Linearizer(scenario, at_ports=True).TwoPort(OperatingPoints(scenario)[0])
    m = 0.5
    c = 0.6
    k = 0.01
    rows = [0, 2, 3, 6]
    columns = [0, 4, 5, 6]
    G = model.system.frequency_response(W)[:, rows][:, :, columns]
    v_model = 1 / (m * S + c + k / S)
    one = np.ones_like(S)
    zero = np.zeros_like(S)
    # From [F_h, p, v_ret, d] to [v_felt, F_h, v_d, v_model].
    expected = np.array(
        [
            [v_model, zero, one, -one],
            [one, zero, zero, zero],
            [zero, zero, zero, zero],
            [v_model, zero, zero, zero],
        ]
    )
    assert_allclose(G, np.moveaxis(expected, -1, 0), atol=1e-9)


def Bent(v_bend, share=0.1):
    """F = F_hd + share |v - v_bend|."""
    return ForcePlus(lambda r, v: share * np.abs(v - v_bend))


@pytest.mark.slow
def test_law_that_bends_at_the_point_has_no_linear_model():
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    point = OperatingPoints(scenario)[0]
    diagram = MakeTeleoperator(scenario, control_law=Bent(0.001))
    with pytest.raises(
        ValueError, match="a law that bends at the operating point 'tis"
    ):
        LinearizeLoop(scenario, point, teleoperator=diagram)
    # On either side of the bend there is a linear model.
    for v_bend, sign in ((-0.1, 1), (0.1, -1)):
        model = LinearizeLoop(
            scenario,
            point,
            teleoperator=MakeTeleoperator(scenario, control_law=Bent(v_bend)),
        )
        assert model.slave.A[1, 1] == pytest.approx((-0.6 + sign * 0.1) / 0.5)


def test_no_difference_crosses_a_border():
    """At 1 um in front of the bone the slopes are those of free space."""
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    model = LinearizeLoop(scenario, OperatingPointAt(scenario, 0.015 - 1e-6))
    assert_allclose(model.slave.A, [[0, 1], [0, -0.2]], atol=1e-7)
    with pytest.raises(
        ValueError, match=r"position = \[0.015\]: must be off every surface"
    ):
        LinearizeLoop(scenario, replace(model.point, position=np.array([0.015])))


def test_no_point_is_invented_where_surfaces_are_not_told():
    with pytest.raises(ScenarioError, match=r"^environment = 'LeafSystem': must "):
        OperatingPoints(LoadScenario("two_dof_collision"), environment=LeafSystem())


def test_path_to_an_oblique_bone():
    """Positions on the path are measured along the normal of the contact surface."""
    scenario = LoadScenario("needle_insertion")
    normal = np.array([0.6, 0.48, -0.64])
    start = normal @ np.array(scenario.robot.start)
    before, on, inside = (OperatingPointAt(scenario, x) for x in (0.29, 0.3, 0.31))
    assert start < 0.29 and normal @ before.position == pytest.approx(0.29)
    assert_array_equal(before.velocity, scenario.surgeon.velocity)
    # On the surface there is no model; the point is just behind it.
    assert 0 < normal @ on.position - 0.3 < 2e-6
    assert on.name == inside.name == "contact" and not np.any(inside.velocity)
    with pytest.raises(ScenarioError, match=r"position = 0\.1: must be on the tool's"):
        OperatingPointAt(scenario, 0.1)
