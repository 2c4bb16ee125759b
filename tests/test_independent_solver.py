"""The oracle itself, held against closed forms and the thesis's numbers."""

from dataclasses import replace
from math import factorial, inf, pi

import numpy as np
import pytest
from independent_solver import (
    Layer,
    Slider,
    Task,
    solve,
    thesis_task,
)
from scipy.linalg import expm

FREE = Layer(start=-inf, stiffness=0.0, damping=0.0, reference=0.0)


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
    T_f = delays[0]
    T = sum(delays)
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


def test_the_operators_stop_superposes_a_shifted_response(subtests):
    task = linear_task(forward_delay=0.13, return_delay=0.217)
    steps = solve(task, 2.0)
    stopped = solve(replace(task, stop_time=0.7341), 2.0)
    for t in (0.7341, 0.8, 0.9, 1.3, 2.0):
        with subtests.test(t=t):
            late = steps.at(t - 0.7341)["v_WT"]
            expected = steps.at(t)["v_WT"] - late
            assert stopped.at(t)["v_WT"] == pytest.approx(expected, abs=1e-10)
    assert stopped.at(0.7341, "left")["v_d"] == 0.2
    assert stopped.at(0.7341, "right")["v_d"] == 0.0
    assert stopped.at(0.8641, "left")["v_d_received"] == 0.2
    assert stopped.at(0.8642)["v_d_received"] == 0.0


def test_without_delay_the_loop_is_a_matrix_exponential(subtests):
    task = thesis_task("one_dof", False, delays=(0.0, 0.0))
    result = solve(task, 5.0, until="puncture")
    # d/dt [x, v, x1, x2, 1] with F_h = 50 x1 + 25 x2 and the tissue's force.
    A = np.zeros((5, 5))
    A[0, 1] = 1
    A[1, :4] = np.array([-0.01, -0.1 - 0.5, 50, 25]) / 0.5
    A[2, 3] = 1
    A[3, 1] = -1
    A[3, 3] = -25
    A[3, 4] = 0.001
    for t in (0.01, 0.3, 2.0, 5.0):
        with subtests.test(t=t):
            state = expm(A * t) @ [0, 0, 0, 0, 1]
            now = result.at(t)
            assert now["p_WT"][0] == pytest.approx(state[0], rel=1e-9)
            assert now["v_WT"][0] == pytest.approx(state[1], rel=1e-9)
            assert now["F_c"][0] == pytest.approx(
                50 * state[2] + 25 * state[3], rel=1e-9
            )


def test_undamped_spring_hit_and_every_event_on_the_way():
    """A spring throws the slider through free space against another spring."""
    k0 = 0.3
    r0 = 0.02
    b = 0.015
    k = 150.0
    bone = 0.05
    m = 0.5
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


@pytest.mark.mostly_slow
@pytest.mark.parametrize("delays", [(0.0, 0.0), (0.07, 0.0), (0.0, 0.113), (0.1, 0.09)])
def test_the_operator_switches_when_the_contact_has_come_back(delays):
    task = thesis_task("one_dof", False, delays=delays)
    layers = tuple(replace(a, start=a.start / 10) for a in task.layers)
    result = solve(replace(task, layers=layers), 4.0)
    contact = result.event("contact")
    switch = result.event("switch")
    assert switch.time == pytest.approx(contact.time + delays[1], abs=1e-12)
    assert result.at(switch.time)["p_felt"][0] == pytest.approx(0.0015, abs=1e-12)
    assert result.at(switch.time, "left")["v_d"] == 0.001
    after = result.at(switch.time + 0.5 * delays[0] + 1e-6)
    assert after["v_d"] == 0.0
    assert after["F_h"] == 0.005
    arrival = switch.time + delays[0]
    assert result.at(arrival - 1e-6)["F_c"] != 0.005
    assert result.at(arrival + 1e-6)["F_c"] == 0.005


def test_an_operator_who_starts_in_contact_presses_at_once(subtests):
    """x = F / k (1 - cos w t) once the force has arrived."""
    k = 150.0
    F = 0.005
    m = 0.5
    wall = Layer(start=0.0, stiffness=k, damping=0.0, reference=0.0)
    task = linear_task(layers=(FREE, wall), contact_force=(F,), forward_delay=0.1)
    result = solve(replace(task, stop_time=0.4), 0.8)
    for t in (0.2, 0.31, 0.5):
        with subtests.test(t=t):
            x = F / k * (1 - np.cos(np.sqrt(k / m) * (t - 0.1)))
            assert result.at(t)["p_WT"][0] == pytest.approx(x, rel=1e-8)
    assert result.at(0.45)["F_h"] == 0.0
