"""Margins of any loop, against closed forms, python-control, SciPy and runs."""

import math
import sys

import numpy as np
import pytest
import scipy.signal
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.examples import PendulumPlant
from pydrake.symbolic import Variable
from pydrake.systems.primitives import (
    Adder,
    AffineSystem,
    Integrator,
    Linearize,
    LinearSystem,
    SymbolicVectorSystem,
)
from wired import InSeries, Wired

from teleop_drake import AnalyzeStability, LoadScenario, MakeTeleoperator, simulate
from teleop_drake.loops import DelayMargin, LinearizePorts, TransportDelay
from teleop_drake.loops.engine.parameters import SetNumbers
from teleop_drake.loops.linear.delay_map import DelayMargins


def MakeLoop(A, B, C, K, *, inner=0.0, side=None):
    """Returns the loop dx/dt = A x + B u, y = C x, u = -K y(t - inner).

    Args:
        side: Gain and delay of a second feedback of y.
    """
    n = len(C)
    gain, time = side or (np.zeros((1, n)), 0.0)
    diagram = Wired(
        {
            "plant": LinearSystem(A, B, C),
            "total": Adder(2, 1),
            "delay": TransportDelay(inner, n),
            "law": LinearSystem(D=-np.atleast_2d(K)),
            "side_delay": TransportDelay(time, n),
            "side_law": LinearSystem(D=-np.atleast_2d(gain)),
        },
        InSeries("total", "plant", "delay", "law", "total.u0")
        | InSeries("plant", "side_delay", "side_law", "total.u1"),
        {"y": "plant"},
    )
    diagram.set_name("loop")
    return diagram


INTEGRATOR = ([[0.0]], [[1.0]], [[1.0]])
DOUBLE = (np.array([[0.0, 1.0], [0.0, 0.0]]), [[0.0], [1.0]], np.eye(2))
THREE_LAGS = (-np.eye(3) + np.eye(3, k=1), [[0.0], [0.0], [1.0]], [[1.0, 0.0, 0.0]])


def ModelAt(diagram, port):
    context = diagram.CreateDefaultContext()
    return LinearizePorts(diagram, context, port, is_opened=True)


def test_an_integrator_tolerates_a_quarter_turn():
    """dx/dt = -k x(t - T) is stable for k T < pi/2."""
    for inner in (0.0, 0.3):
        diagram = MakeLoop(*INTEGRATOR, [[2.0]], inner=inner)
        law = diagram.GetSubsystemByName("law")
        margins = ModelAt(diagram, law.get_input_port()).margins()
        assert margins.is_stable
        assert margins.delay == pytest.approx(math.pi / 4 - inner, rel=1e-9)
        assert margins.frequency == pytest.approx(2.0, rel=1e-9)
        assert margins.phase == pytest.approx(math.pi / 2 - 2 * inner, rel=1e-9)
        highest = math.pi / 4 / inner if inner else math.inf
        assert margins.gain == pytest.approx((0.0, highest), rel=1e-9)
        assert margins.phase_frequency == pytest.approx(2.0, rel=1e-9)
        # k T = pi/2 has the root j pi/(2 T).
        turning = math.pi / 2 / inner if inner else 0.0
        assert margins.gain_frequencies == pytest.approx((0.0, turning), rel=1e-9)


@pytest.mark.slow
def test_state_feedback_of_a_double_integrator():
    """|k1 + j w k2| = w^2 at the crossover, where the phase is atan(k2 w/k1)."""
    k1 = 4.0
    k2 = 2.0
    w = math.sqrt((k2**2 + math.sqrt(k2**4 + 4 * k1**2)) / 2)
    diagram = MakeLoop(*DOUBLE, [[k1, k2]], inner=0.1)
    expected = math.atan(k2 * w / k1) / w - 0.1
    context = diagram.CreateDefaultContext()
    plant, delay, law = map(diagram.GetSubsystemByName, ("plant", "delay", "law"))
    # The margin is the same at ports of outputs and inputs, of vectors and scalars.
    for port in (
        plant.get_input_port(),
        delay.get_input_port(),
        delay.get_output_port(),
        law.get_output_port(),
    ):
        assert DelayMargin(diagram, context, port) == pytest.approx(expected, rel=1e-7)


def MakePendulum():
    """Returns a pendulum with the law u = -(k1 (x1 - pi) + k2 x2), 0.05 s late."""
    parts = {
        "plant": PendulumPlant(),
        "delay": TransportDelay(0.05, 2),
        "law": AffineSystem(D=[[-25.0, -5.0]], y0=[25.0 * math.pi]),
    }
    return Wired(parts, InSeries("plant", "delay", "law", "plant"))


def PendulumAt(diagram, angle):
    context = diagram.CreateDefaultContext()
    plant = diagram.GetSubsystemByName("plant")
    plant.GetMyMutableContextFromRoot(context).SetContinuousState([angle, 0.0])
    return context


def test_a_point_that_is_no_equilibrium_is_refused_as_drake_refuses_it():
    """The angular acceleration of the pendulum with m = 1, l = 0.5, g = 9.81."""
    diagram = MakePendulum()
    plant = diagram.GetSubsystemByName("plant")
    port = plant.get_input_port()
    upright = DelayMargin(diagram, PendulumAt(diagram, math.pi), port)
    assert 0 < upright < 0.3
    leaning = PendulumAt(diagram, math.pi - 0.5)
    rate = (25.0 * 0.5 - 9.81 * 0.5 * math.sin(0.5)) / 0.25
    refused = (
        rf"'plant' with a derivative of {rate:.4g} \(element 1\): must be an equil"
    )
    with pytest.raises(ValueError, match=refused):
        DelayMargin(diagram, leaning, port)
    own = plant.GetMyContextFromRoot(leaning)
    alone = plant.CreateDefaultContext()
    alone.SetContinuousState(own.get_continuous_state_vector().CopyToVector())
    alone_port = plant.get_input_port()
    alone_port.FixValue(alone, [12.5])
    with pytest.raises(RuntimeError, match="not an equilibrium"):
        Linearize(plant, alone)
    moving = DelayMargin(diagram, leaning, port, is_moving=True)
    assert 0 < moving < 0.3 and moving != upright


def test_a_delay_that_is_not_settled_is_no_equilibrium():
    diagram = MakePendulum()
    context = PendulumAt(diagram, math.pi)
    port = diagram.GetSubsystemByName("law").get_output_port()
    # The law receives 0, so that its torque is 25 pi N m.
    refused = r"'plant' with a derivative of 314\.2 .*is_settled=True"
    with pytest.raises(ValueError, match=refused):
        LinearizePorts(diagram, context, port, is_opened=True)
    model = LinearizePorts(diagram, context, port, is_opened=True, is_settled=True)
    assert model.margins().is_stable


def test_two_delays_of_which_one_is_left_as_it_is():
    """dx/dt = -a x(t - T1) - b x(t - T): j w + a e^(-j w T1) + b e^(-j w T) = 0."""
    a = 1.0
    b = 3.0
    T1 = 0.4
    diagram = MakeLoop(*INTEGRATOR, [[b]], side=(a, T1))
    margins = ModelAt(
        diagram, diagram.GetSubsystemByName("law").get_output_port()
    ).margins()
    w = margins.frequency
    T = margins.delay
    terms = np.array([1j * w, a * np.exp(-1j * w * T1), b * np.exp(-1j * w * T)])
    assert abs(terms.sum()) < 1e-9
    # No smaller T has a root on the axis: |j w + a e^(-j w T1)| = b has one solution.
    frequencies = np.linspace(1e-3, a + b, 20001)
    rest = np.abs(1j * frequencies + a * np.exp(-1j * frequencies * T1)) - b
    (crossing,) = frequencies[:-1][np.diff(np.signbit(rest))]
    assert w == pytest.approx(crossing, abs=1e-3)


def test_gain_margin_of_three_lags():
    """k/(s + 1)^3 is stable for k < 8, at w = sqrt(3)."""
    diagram = MakeLoop(*THREE_LAGS, [[2.0]])
    port = diagram.GetSubsystemByName("plant").get_input_port()
    assert ModelAt(diagram, port).margins().gain == pytest.approx((0.0, 4.0))


def test_gain_margins_of_an_unstable_plant():
    """k/(s - 1) after the actuator 1/(0.1 s + 1): roots of 0.1 s^2 + 0.9 s + k - 1."""
    A = [[1.0, 1.0], [0.0, -10.0]]
    diagram = MakeLoop(A, [[0.0], [10.0]], [[1.0, 0.0]], [[3.0]])
    port = diagram.GetSubsystemByName("plant").get_input_port()
    gain = ModelAt(diagram, port).margins().gain
    assert gain == pytest.approx((1 / 3, math.inf), rel=1e-6)


def test_an_unstable_loop_has_no_margin_and_a_small_gain_any():
    for K, expected in ((9.0, 0.0), (0.5, math.inf)):
        diagram = MakeLoop(*THREE_LAGS, [[K]])
        output = diagram.GetSubsystemByName("plant").get_output_port()
        context = diagram.CreateDefaultContext()
        assert DelayMargin(diagram, context, output) == expected


def test_the_delay_is_that_of_the_context():
    diagram = MakeLoop(*INTEGRATOR, [[2.0]], inner=0.3)
    context = diagram.CreateDefaultContext()
    SetNumbers(diagram, context, {"delay.delay": 0.1})
    port = diagram.GetSubsystemByName("law").get_output_port()
    margin = DelayMargin(diagram, context, port)
    assert margin == pytest.approx(math.pi / 4 - 0.1, rel=1e-9)


def test_a_delay_of_0_in_the_context_is_none():
    diagram = MakeLoop(*INTEGRATOR, [[2.0]], inner=0.3, side=(0.5, 0.2))
    context = diagram.CreateDefaultContext()
    SetNumbers(diagram, context, {"delay.delay": 0.0})
    port = diagram.GetSubsystemByName("law").get_output_port()
    margin = DelayMargin(diagram, context, port)
    without = MakeLoop(*INTEGRATOR, [[2.0]], side=(0.5, 0.2))
    port = without.GetSubsystemByName("law").get_output_port()
    expected = DelayMargin(without, without.CreateDefaultContext(), port)
    assert margin == pytest.approx(expected, rel=1e-12)
    assert DelayMargins(diagram, context)["law.u0"] == pytest.approx(expected)


@pytest.mark.parametrize(("share", "is_stable"), [(0.98, True), (1.02, False)])
def test_runs_on_both_sides_of_the_margin(share, is_stable):
    """Of two delays, the first one is increased up to and beyond its margin."""
    diagram = MakeLoop(*INTEGRATOR, [[3.0]], inner=0.1, side=(1.0, 0.4))
    port = diagram.GetSubsystemByName("delay").get_output_port()
    margin = DelayMargin(diagram, diagram.CreateDefaultContext(), port)
    delay = 0.1 + share * margin
    late = MakeLoop(*INTEGRATOR, [[3.0]], inner=delay, side=(1.0, 0.4))
    context = late.CreateDefaultContext()
    plant = late.GetSubsystemByName("plant")
    plant.GetMyMutableContextFromRoot(context).SetContinuousState([1.0])
    recording = simulate(late, context=context, duration=100.0)
    size = np.abs(recording["y"])
    early = size[(recording.time > 20) & (recording.time < 40)].max()
    end = size[recording.time > 80].max()
    assert (end < 0.5 * early) == is_stable
    assert (end > 2 * early) == (not is_stable)


def test_bode_is_scipys_and_follows_the_phase_of_a_delay():
    lags = [1.0], [1.0, 3.0, 3.0, 1.0]
    w, magnitude, phase = scipy.signal.bode(lags, np.geomspace(0.01, 100, 50))
    diagram = MakeLoop(*THREE_LAGS, [[1.0]], inner=0.7)
    plant = diagram.GetSubsystemByName("plant")
    model = ModelAt(diagram, plant.get_input_port())
    bode = model.bode(w)
    assert_allclose(bode.magnitude, magnitude, rtol=1e-9, atol=1e-9)
    expected = phase - np.degrees(0.7 * w)
    assert_allclose(bode.phase, expected, rtol=1e-9, atol=1e-6)
    own = model.bode()
    assert own.frequencies[0] < 0.11 and own.frequencies[-1] > 9
    assert model.A.shape == (3, 3) and model.D.shape == (2, 2)


@pytest.mark.parametrize(
    ("stiffness", "gain", "inner"),
    [(1.0, 0.3, 2.0), (4.0, 0.5, 1.0), (2.25, 1.0, 0.5), (1.0, 0.3, 0.0)],
)
def test_an_undamped_oscillator_that_a_delay_damps(stiffness, gain, inner):
    """x'' + k x = g x(t - T) is stable for 0 < T < pi/sqrt(k + g), neutral at T = 0."""
    plant = ([[0.0, 1.0], [-stiffness, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    diagram = MakeLoop(*plant, [[-gain]], inner=inner)
    port = diagram.GetSubsystemByName("law").get_input_port()
    margin = DelayMargin(diagram, diagram.CreateDefaultContext(), port)
    expected = math.pi / math.sqrt(stiffness + gain) - inner
    assert margin == pytest.approx(expected, rel=1e-8)


def test_bode_at_the_frequency_of_an_undamped_mode():
    """1/(s^2 + 1): the magnitude is infinite, the phase that just above."""
    plant = ([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    diagram = MakeLoop(*plant, [[1.0]])
    model = ModelAt(diagram, diagram.GetSubsystemByName("plant").get_input_port())
    bode = model.bode([0.5, 1.0, 2.0])
    assert bode.magnitude[1] == math.inf
    sizes = 20 * np.log10([1 / 0.75, 1 / 3])
    assert_allclose(bode.magnitude[[0, 2]], sizes)
    assert_allclose(np.abs(bode.phase), [0.0, 180.0, 180.0], atol=1e-6)


def test_python_control_finds_the_margins_of_the_same_loop():
    control = pytest.importorskip("control")
    diagram = MakeLoop(*DOUBLE, [[4.0, 2.0]], inner=0.1)
    port = diagram.GetSubsystemByName("plant").get_input_port()
    model = ModelAt(diagram, port)
    converted = model.to_control(order=6)
    w = np.array([0.1, 1.0, 5.0])
    response = converted(1j * w)
    assert_allclose(response, model.Response(w)[:, 0, 0], rtol=1e-9)
    gain, phase, _, _ = control.margin(converted)
    assert math.radians(phase) == pytest.approx(model.margins().phase, rel=1e-6)
    assert gain == pytest.approx(model.margins().gain[1], rel=1e-6)
    undelayed = MakeLoop(*DOUBLE, [[4.0, 2.0]])
    port = undelayed.GetSubsystemByName("plant").get_input_port()
    model = ModelAt(undelayed, port)
    assert_array_equal(model.to_control().A, model.A)


# python-control hides a warning of NumPy's, and then returns another kind of system.
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_loop_has_the_sign_of_negative_feedback():
    """L = 3/(s + 1)^3 e^(-0.1 s), and python-control closes the loop with L/(1 + L)."""
    control = pytest.importorskip("control")
    diagram = MakeLoop(*THREE_LAGS, [[3.0]], inner=0.1)
    port = diagram.GetSubsystemByName("plant").get_input_port()
    model = ModelAt(diagram, port)
    w = np.array([0.2, 1.0, 2.0])
    L = 3 / (1 + 1j * w) ** 3 * np.exp(-0.1j * w)
    converted = model.to_control(order=6)
    assert_allclose(model.Response(w)[:, 0, 0], L, rtol=1e-9)
    assert_allclose(converted(1j * w), L, rtol=1e-9)
    bode = model.bode(w)
    degrees = np.degrees(np.unwrap(np.angle(L)))
    assert_allclose(bode.magnitude, 20 * np.log10(np.abs(L)), rtol=1e-9)
    assert_allclose(bode.phase, degrees, rtol=1e-9)
    # A deviation that is added to the signal at the port comes back as -L/(1 + L).
    closed = LinearizePorts(diagram, diagram.CreateDefaultContext(), port)
    around = control.feedback(converted)(1j * w)
    assert_allclose(around, L / (1 + L), rtol=1e-9)
    assert_allclose(closed.Response(w)[:, 0, 0], -around, rtol=1e-9)


def test_without_python_control_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    diagram = MakeLoop(*INTEGRATOR, [[2.0]])
    model = ModelAt(diagram, diagram.GetSubsystemByName("law").get_input_port())
    with pytest.raises(ModuleNotFoundError, match=r"teleop-drake\[control\]"):
        model.to_control()


def test_what_is_no_loop_has_no_margins():
    diagram = MakeLoop(*INTEGRATOR, [[2.0]])
    context = diagram.CreateDefaultContext()
    plant = diagram.GetSubsystemByName("plant")
    closed = LinearizePorts(diagram, context, plant.get_input_port())
    with pytest.raises(ValueError, match=r"must be a loop, .*is_opened=True"):
        closed.margins()
    through = LinearizePorts(
        diagram,
        context,
        plant.get_input_port(),
        plant.get_output_port(),
        is_opened=True,
    )
    with pytest.raises(ValueError, match=r"must be a loop"):
        through.margins()
    alone = Integrator(1)
    diagram = Wired({"alone": alone}, {}, inputs={"u": "alone"})
    context = diagram.CreateDefaultContext()
    with pytest.raises(ValueError, match="input is not connected"):
        DelayMargin(diagram, context, alone.get_input_port())
    with pytest.raises(ValueError, match="must be connected to another system"):
        DelayMargin(diagram, context, alone.get_output_port())


def test_delays_in_series_are_settled():
    """dx/dt = c - x^2(t - T1 - T2) has the equilibrium x = sqrt(c), with slope -2 x."""
    x = Variable("x")
    u = Variable("u")
    plant = SymbolicVectorSystem(
        state=[x], input=[u], dynamics=[4.0 - u**2], output=[x]
    )
    second = TransportDelay(0.05, 1)
    diagram = Wired(
        {"plant": plant, "first": TransportDelay(0.1, 1), "second": second},
        {"first": "plant", "second": "first", "plant": "second"},
    )
    context = diagram.CreateDefaultContext()
    plant.GetMyMutableContextFromRoot(context).SetContinuousState([2.0])
    for port in (plant.get_output_port(), second.get_output_port()):
        margin = DelayMargin(diagram, context, port)
        assert margin == pytest.approx(math.pi / 2 / 4 - 0.15, rel=1e-7)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "kind", ["direct_force", "wave_variables", "proportional_damping"]
)
def test_a_teleoperator_has_the_margin_of_the_loop_analysis(kind):
    """The loop analysis uses the stations, and cuts the loop at both channels."""
    scenario = LoadScenario("one_dof", {"controller.kind": kind, "delay": 0.02})
    tissue = AnalyzeStability(scenario)["tissue"]
    diagram = MakeTeleoperator(scenario)
    context = diagram.CreateDefaultContext()
    point = tissue.model.point
    robot = diagram.GetSubsystemByName("robot").GetMyMutableContextFromRoot(context)
    robot.SetContinuousState([*point.position, *point.velocity])
    channel = diagram.GetSubsystemByName("forward_channel")
    port = channel.get_output_port()
    margin = DelayMargin(diagram, context, port, is_moving=True)
    expected = tissue.margin.delay - 0.04 if tissue.margin else math.inf
    assert margin == pytest.approx(expected, rel=1e-9)
