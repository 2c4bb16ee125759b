"""The oracle itself, held against closed forms and the thesis's numbers."""

from dataclasses import replace
from math import factorial, inf, pi

import numpy as np
import pytest
from independent_solver import (
    AdaptiveLaw,
    Layer,
    Slider,
    Task,
    solve,
    thesis_task,
)
from scipy.linalg import expm

FREE = Layer(start=-inf, stiffness=0.0, damping=0.0, reference=0.0)
ARM = thesis_task("two_dof_combined", False).robot


def linear_task(**changes):
    """A frictionless slider under H(s) = 3 / s, without any environment."""
    task = Task(
        robot=Slider(start=0.0, mass=0.5, damping=0.0),
        layers=(FREE,),
        velocity=(0.2,),
        contact_force=None,
        stop_time=inf,
        forward_delay=0.0,
        return_delay=0.0,
        numerator=(3.0, 12.0),
        denominator=(1.0, 4.0, 0.0),
        controller=None,
    )
    return replace(task, **changes)


@pytest.mark.parametrize(
    "delays", [(0.0, 0.0), (0.13, 0.0), (0.0, 0.217), (0.13, 0.217), (0.3, 0.0317)]
)
def test_method_of_steps_reproduces_the_delayed_cosine(delays):
    """v'' = w^2 (v_d - v(t - T)) has a piecewise polynomial as its solution."""
    T_f, T = delays[0], sum(delays)
    result = solve(linear_task(forward_delay=T_f, return_delay=delays[1]), 2.0)
    for t in np.linspace(0.0, 2.0, 41):
        terms = [
            (-1) ** (j - 1)
            * np.sqrt(6.0) ** (2 * j)
            * max(t - T_f - (j - 1) * T, 0.0) ** (2 * j)
            / factorial(2 * j)
            for j in range(1, 20)
        ]
        assert result.at(t)["v_WT"][0] == pytest.approx(0.2 * sum(terms), abs=1e-10)


def test_the_operators_stop_superposes_a_shifted_response():
    task = linear_task(forward_delay=0.13, return_delay=0.217)
    steps, stopped = solve(task, 2.0), solve(replace(task, stop_time=0.7341), 2.0)
    for t in (0.7341, 0.8, 0.9, 1.3, 2.0):
        late = steps.at(t - 0.7341)["v_WT"]
        expected = steps.at(t)["v_WT"] - late
        assert stopped.at(t)["v_WT"] == pytest.approx(expected, abs=1e-10)
    assert stopped.at(0.7341, "left")["v_d"] == 0.2
    assert stopped.at(0.7341, "right")["v_d"] == 0.0
    assert stopped.at(0.8641, "left")["v_d_received"] == 0.2
    assert stopped.at(0.8642)["v_d_received"] == 0.0


def test_without_delay_the_loop_is_a_matrix_exponential():
    task = thesis_task("one_dof", False, delays=(0.0, 0.0))
    result = solve(task, 5.0, until="puncture")
    # d/dt [x, v, x1, x2, 1] with F_h = 50 x1 + 25 x2 and the tissue's force.
    A = np.zeros((5, 5))
    A[0, 1] = 1
    A[1, :4] = np.array([-0.01, -0.1 - 0.5, 50, 25]) / 0.5
    A[2, 3] = 1
    A[3, 1], A[3, 3], A[3, 4] = -1, -25, 0.001
    for t in (0.01, 0.3, 2.0, 5.0):
        state = expm(A * t) @ [0, 0, 0, 0, 1]
        now = result.at(t)
        assert now["p_WT"][0] == pytest.approx(state[0], rel=1e-9)
        assert now["v_WT"][0] == pytest.approx(state[1], rel=1e-9)
        assert now["F_c"][0] == pytest.approx(50 * state[2] + 25 * state[3], rel=1e-9)


def test_undamped_spring_hit_and_every_event_on_the_way():
    """A spring throws the slider through free space against another spring."""
    k0, r0, b, k, bone, m = 0.3, 0.02, 0.015, 150.0, 0.05, 0.5
    layers = (
        Layer(start=-inf, stiffness=k0, damping=0.0, reference=r0),
        Layer(start=b, stiffness=0.0, damping=0.0, reference=0.0),
        Layer(start=bone, stiffness=k, damping=0.0, reference=bone),
    )
    task = linear_task(layers=layers, velocity=(0.0,), numerator=(0.0, 0.0))
    result = solve(task, 12.0)
    v = np.sqrt(k0 / m * (r0**2 - (r0 - b) ** 2))
    leaves = np.arccos(1 - b / r0) / np.sqrt(k0 / m)
    arrives = leaves + (bone - b) / v
    rests = pi * np.sqrt(m / k)
    returns = arrives + rests + (bone - b) / v
    expected = [
        ("puncture", leaves, v),
        ("contact", arrives, v),
        ("release", arrives + rests, -v),
        ("reentry", returns, -v),
        ("puncture", returns + 2 * leaves, v),
    ]
    assert len(result.events) >= len(expected)
    for event, (kind, time, velocity) in zip(result.events, expected, strict=False):
        assert event.kind == kind
        assert event.time == pytest.approx(time, rel=1e-9)
        assert event.velocity[0] == pytest.approx(velocity, rel=1e-8)
    metrics = result.metrics()
    assert metrics["initial_impact_force"] == pytest.approx(v * np.sqrt(k * m), 1e-8)
    assert metrics["rebound_velocity"] == pytest.approx(-v, rel=1e-8)
    assert metrics["puncture_force"] == pytest.approx(k0 * (b - r0), rel=1e-8)
    assert result.events[0].force_after[0] == 0.0


@pytest.mark.parametrize("delays", [(0.0, 0.0), (0.07, 0.0), (0.0, 0.113), (0.1, 0.09)])
def test_the_operator_switches_when_the_contact_has_come_back(delays):
    task = thesis_task("one_dof", False, delays=delays)
    layers = tuple(replace(a, start=a.start / 10) for a in task.layers)
    result = solve(replace(task, layers=layers), 4.0)
    contact, switch = result.event("contact"), result.event("switch")
    assert switch.time == pytest.approx(contact.time + delays[1], abs=1e-12)
    assert result.at(switch.time)["p_felt"][0] == pytest.approx(0.0015, abs=1e-12)
    assert result.at(switch.time, "left")["v_d"] == 0.001
    after = result.at(switch.time + 0.5 * delays[0] + 1e-6)
    assert after["v_d"] == 0.0
    assert after["F_h"] == 0.005
    arrival = switch.time + delays[0]
    assert result.at(arrival - 1e-6)["F_c"] != 0.005
    assert result.at(arrival + 1e-6)["F_c"] == 0.005


def test_an_operator_who_starts_in_contact_presses_at_once():
    """x = F / k (1 - cos w t) once the force has arrived."""
    k, F, m = 150.0, 0.005, 0.5
    wall = Layer(start=0.0, stiffness=k, damping=0.0, reference=0.0)
    task = linear_task(layers=(FREE, wall), contact_force=(F,), forward_delay=0.1)
    result = solve(replace(task, stop_time=0.4), 0.8)
    for t in (0.2, 0.31, 0.5):
        x = F / k * (1 - np.cos(np.sqrt(k / m) * (t - 0.1)))
        assert result.at(t)["p_WT"][0] == pytest.approx(x, rel=1e-8)
    assert result.at(0.45)["F_h"] == 0.0


@pytest.mark.parametrize("elbow", ["up", "down"])
def test_the_arm_conserves_energy_and_starts_with_its_mobility(elbow):
    """A stray term in c21 of (A.4) would show here."""
    robot = replace(ARM, elbow=elbow)
    spring = Layer(start=-inf, stiffness=8.0, damping=0.0, reference=1.0)
    task = linear_task(
        robot=robot, layers=(spring,), velocity=(0.0, 0.0), numerator=(0.0, 0.0)
    )
    result = solve(task, 2.0)
    assert result.at(0.0)["p_WT"] == pytest.approx([0.85, 0.0], abs=1e-13)
    assert np.sign(result.at(0.0)["q"][1]) == {"down": 1, "up": -1}[elbow]
    for t in np.linspace(0.1, 2.0, 20):
        now = result.at(t)
        energy = now["qdot"] @ robot.inertia(now["q"]) @ now["qdot"] / 2
        energy += 8.0 * (now["p_WT"][0] - 1.0) ** 2 / 2
        assert energy == pytest.approx(8.0 * 0.15**2 / 2, rel=1e-8)
    assert np.ptp(result.sample(np.linspace(0, 2, 50))["qdot"][:, 0]) > 0.5
    start = robot.mobility(robot.start_joints()) @ [8.0 * 0.15, 0.0]
    assert result.at(1e-4)["v_WT"] / 1e-4 == pytest.approx(start, rel=1e-4)


@pytest.mark.parametrize("name", ["one_dof", "two_dof_combined"])
def test_the_adaptive_law_satisfies_its_lyapunov_identity(name):
    """dV2/dt = -s^T P G1 s - z^T G2 z where the networks are exact."""
    random = np.random.default_rng(3)
    robot = thesis_task(name, False).robot
    n = robot.n
    matrices = random.normal(size=(5, n, n))
    P = matrices[0] @ matrices[0].T + np.eye(n)
    beta = 0.37
    controller = thesis_task(
        name,
        True,
        Lambda=matrices[1],
        G1=matrices[2],
        G2=matrices[3],
        P=P,
        adaptation_rate=beta,
        leakage=0.0,
        supervision=0.0,
    ).controller
    law = AdaptiveLaw(controller, np.eye(n))
    a = law.start() + random.normal(size=len(law.start()))
    F_c, W1, Psi, W3 = law.unpack(a)
    Psi += 5 * np.eye(n)
    p = np.full(n, 0.01) if n == 1 else np.array([1.0, 0.02])
    v, F_e, F_h, v_d = random.normal(size=(4, n))
    s, z, Phi, *_ = law.errors(a, p, v, F_e, F_h, v_d)
    true_W1, true_W3 = random.normal(size=(2, *W1.shape))
    true_Psi = Psi + matrices[4]
    s_dot, F_e_dot = true_Psi @ (F_c - F_e) + true_W1 @ Phi, true_W3 @ Phi
    a_dot = law.rates(a, p, v, F_e, F_h, v_d)

    def z_after(h):
        # F_h only shifts s, so it carries the true ds/dt = s_dot of the plant.
        moved = F_e + h * F_e_dot
        shift = np.linalg.solve(law.Lambda, s + h * s_dot - (v - v_d))
        return law.errors(a + h * a_dot, p + h * v, v, moved, moved - shift, v_d)[1]

    h = 1e-6
    z_dot = (z_after(h) - z_after(-h)) / (2 * h)
    _, W1_dot, Psi_dot, W3_dot = law.unpack(a_dot)
    V_dot = s @ P @ s_dot + z @ z_dot
    pairs = [(true_W1 - W1, W1_dot), (true_Psi - Psi, Psi_dot), (true_W3 - W3, W3_dot)]
    V_dot -= sum(np.sum(error * rate) for error, rate in pairs) / beta
    expected = -s @ P @ matrices[2] @ s - z @ matrices[3] @ z
    assert V_dot == pytest.approx(expected, rel=1e-6)


def test_leakage_supervision_and_projection():
    controller = thesis_task("one_dof", True).controller
    law = AdaptiveLaw(controller, np.array([[4.0]]))
    a = law.start()
    _, W1, Psi, W3 = law.unpack(a)
    W1 += 2.0
    W3 += 3.0
    Psi += 1.0
    far, zero = np.array([1e3]), np.zeros(1)
    _, W1_dot, Psi_dot, W3_dot = law.unpack(law.rates(a, far, zero, zero, zero, zero))
    assert W1_dot == pytest.approx(-0.1 * 0.1 * W1)
    assert W3_dot == pytest.approx(-0.1 * 0.1 * W3)
    assert Psi_dot == pytest.approx(0.1 * 1.0 * (4.0 - 5.0))
    # A falling Psi is held below its minimum, a rising one is not.
    law = AdaptiveLaw(controller, np.array([[-1.0]]))
    for value, rate in ((0.2, -0.12), (0.05, 0.0), (-2.0, 0.1)):
        Psi[:] = value
        found = law.unpack(law.rates(a, far, zero, zero, zero, zero))[2]
        assert found[0, 0] == pytest.approx(rate)
