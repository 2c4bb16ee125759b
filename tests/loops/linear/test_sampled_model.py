"""Margins of diagrams with holds and samplers: python-control, and growth of runs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.primitives import (
    DiscreteTimeDelay,
    Gain,
    Integrator,
    LinearSystem,
    PassThrough,
    ZeroOrderHold,
)
from scipy import signal
from scipy.optimize import brentq
from wired import InSeries, Wired

from teleop_drake.loops import simulate
from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.loops.linear.ports import DelayMargin, LinearizePorts

H = 0.05


def chain(**systems):
    """Returns a loop of systems, each fed by the one before it."""
    first = next(iter(systems))
    return Wired(systems, InSeries(*systems, first))


ABCD = signal.tf2ss([2.0], [1.0, 3.0, 2.0, 0.0])


def plant(start=None):
    """Returns 2/(s (s + 1)(s + 2))."""
    A, B, C, D = ABCD
    system = LinearSystem(A=A, B=B, C=C, D=D)
    if start is not None:
        system.configure_default_state(np.full(3, start))
    return system


def margins_at(diagram, name, **options):
    port = diagram.GetSubsystemByName(name).get_input_port()
    context = diagram.CreateDefaultContext()
    return LinearizePorts(diagram, context, port, is_opened=True, **options).margins()


# The plant's input is held; the hold's input is continuous.
@pytest.mark.parametrize("name", ["plant", "hold"])
def test_margins_of_a_loop_with_a_hold(name):
    diagram = chain(plant=plant(), minus=Gain(-1.0, 1), hold=ZeroOrderHold(H, 1))
    margins = margins_at(diagram, name)
    assert margins.gain[1] == pytest.approx(2.792786, abs=1e-6)
    assert np.degrees(margins.phase) == pytest.approx(31.5416, abs=1e-4)
    assert margins.delay == pytest.approx(14.69307 * H, abs=1e-6)


# python-control hides a warning of NumPy's, and then returns another kind of system.
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_loop_is_that_of_python_control():
    control = pytest.importorskip("control")
    diagram = chain(plant=plant(), minus=Gain(-1.0, 1), hold=ZeroOrderHold(H, 1))
    port = diagram.GetSubsystemByName("hold").get_input_port()
    model = LinearizePorts(
        diagram, diagram.CreateDefaultContext(), port, is_opened=True
    )
    expected = control.c2d(control.ss(*ABCD), H)

    def Response(w):
        return expected(np.exp(1j * w * H))

    margins = model.margins()
    turned_back = brentq(lambda w: Response(w).imag, 1.0, 2.0, xtol=1e-13)
    assert margins.gain[1] == pytest.approx(-1 / Response(turned_back).real, rel=1e-8)
    at_one = brentq(lambda w: abs(Response(w)) - 1, 0.1, 2.0, xtol=1e-13)
    phase = np.pi + np.angle(Response(at_one))
    assert margins.phase == pytest.approx(phase, rel=1e-8)
    w = np.array([0.1, 1.0, 10.0, 60.0])
    bode = model.bode(w)
    response = Response(w)
    assert_allclose(10 ** (bode.magnitude / 20), np.abs(response), rtol=1e-9)
    turned = np.exp(1j * np.radians(bode.phase)) - np.exp(1j * np.angle(response))
    assert_allclose(np.abs(turned), 0.0, atol=1e-9)
    converted = model.to_control()(np.exp(1j * w * H))
    assert_allclose(converted, response, rtol=1e-9)
    closed = control.feedback(expected, 1)
    found = sorted(np.abs(model.Roots()))[-3:]
    assert found == pytest.approx(sorted(np.abs(closed.poles())), rel=1e-8)


# Loops that are cut at `minus`, with a delay there of 0.97 and 1.03 of the margin.
LOOPS = {
    "hold": {"hold": ZeroOrderHold, "late": None},
    "delay that is no multiple": {"hold": ZeroOrderHold, "late": 0.37 * H},
    "delay by samples": {"hold": lambda h, n: DiscreteTimeDelay(h, 3, n), "late": None},
    "sampled channel": {
        "hold": lambda h, n: SampledDelay(size=n, delay=2.6 * h, sample_period=h),
        "late": None,
    },
}


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kinds", LOOPS.values(), ids=LOOPS.keys())
def test_runs_decay_below_the_delay_margin_and_grow_above_it(kinds):
    def Loop(extra, start=None):
        late = kinds["late"]
        return chain(
            plant=plant(start),
            late=PassThrough(1) if late is None else TransportDelay(late, 1),
            minus=PassThrough(1) if extra is None else TransportDelay(extra, 1),
            sign=Gain(-1.0, 1),
            hold=kinds["hold"](H, 1),
        )

    diagram = Loop(None)
    port = diagram.GetSubsystemByName("minus").get_input_port()
    margin = DelayMargin(diagram, diagram.CreateDefaultContext(), port)
    assert 0.2 < margin < 1.0
    for share, grows in ((0.97, False), (1.03, True)):
        recording = simulate(Loop(share * margin, start=1.0), duration=120.0)
        assert recording.solver.engine == "compiled"
        y = np.abs(recording["plant.y0"][:, 0])
        early = y[(recording.time > 20) & (recording.time < 40)].max()
        late = y[recording.time > 100].max()
        assert (late > 1.05 * early) == grows
        assert (late < early / 1.05) != grows


def test_two_rates_with_a_common_period():
    """x' = q1, q1 reads -3 q2 every 0.1 s, q2 reads x every 0.2 s."""
    diagram = chain(
        x=Integrator(1),
        slow=ZeroOrderHold(0.2, 1),
        gain=Gain(-3.0, 1),
        fast=ZeroOrderHold(0.1, 1),
    )
    port = diagram.GetSubsystemByName("gain").get_input_port()
    context = diagram.CreateDefaultContext()
    model = LinearizePorts(diagram, context, port, is_opened=True)
    expected = np.abs(np.linalg.eigvals([[0.7, -0.3], [1.0, 0.0]]))
    found = np.sort(np.abs(model.Roots()))[-2:]
    assert_allclose(found, np.sort(expected), atol=1e-12)
    assert model.period == pytest.approx(0.2)


def slider():
    plant = MultibodyPlant(0.01)
    inertia = SpatialInertia(1.0, np.zeros(3), UnitInertia(1.0, 1.0, 1.0))
    body = plant.AddRigidBody("cart", inertia)
    rail = PrismaticJoint(
        "rail", plant.world_frame(), body.body_frame(), np.array([1.0, 0, 0])
    )
    joint = plant.AddJoint(rail)
    plant.AddJointActuator("motor", joint)
    plant.Finalize()
    return plant


def test_what_has_no_exact_sampled_model_is_refused_by_name():
    network = PacketNetwork(profile=DelayProfile(delay=0.1), sample_period=0.01)
    packets = NetworkDelay(network=network, size=1)
    diagram = chain(x=Integrator(1), minus=Gain(-1.0, 1), packets=packets)
    with pytest.raises(ScenarioError, match=r"diagram = 'packets': must be without"):
        margins_at(diagram, "minus")
    diagram = Wired(
        {"robot": slider(), "minus": LinearSystem(D=[[-1.0, -1.0]])},
        {"minus": "robot.state", "robot.actuation": "minus"},
    )
    with pytest.raises(ScenarioError, match=r"diagram = 'robot': must be without"):
        margins_at(diagram, "minus")
    delayed = chain(
        x=Integrator(1),
        late=TransportDelay(0.1, 1),
        minus=Gain(-1.0, 1),
        hold=ZeroOrderHold(H, 1),
    )
    port = delayed.GetSubsystemByName("late").get_input_port()
    model = LinearizePorts(
        delayed, delayed.CreateDefaultContext(), port, is_opened=True
    )
    with pytest.raises(ScenarioError, match="the input of a hold or a sampler"):
        model.bode()
    with pytest.raises(ScenarioError, match=r"is_opened = false: must be True"):
        LinearizePorts(delayed, delayed.CreateDefaultContext(), port)
