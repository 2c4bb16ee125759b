"""The delay map: margins of all connections, against runs beside them."""

import math

import numpy as np
import pytest
from grids import Slow
from late_wires import Case, Late, PortOf
from pydrake.examples import PendulumPlant
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.symbolic import Variable
from pydrake.systems.framework import BasicVector, LeafSystem
from pydrake.systems.primitives import (
    Adder,
    AffineSystem,
    Gain,
    Integrator,
    LinearSystem,
    MatrixGain,
    Saturation,
    SymbolicVectorSystem,
    ZeroOrderHold,
)
from wired import Wired

from teleop_drake import LoadScenario, MakeTeleoperator
from teleop_drake.loops import DelayMargin, TransportDelay
from teleop_drake.loops.kernel import Kernel
from teleop_drake.loops.linear.cut_diagram import CutDiagram
from teleop_drake.loops.linear.delay_map import DelayMap, DelayMargins


def MakePd(late):
    """A mass with a spring and a damper, whose velocity has two branches."""
    return Late(
        late,
        {
            "total": Adder(2, 1),
            "v": Integrator(1),
            "x": Integrator(1),
            "kp": Gain(-4.0, 1),
            "kd": Gain(-2.0, 1),
        },
        {
            "v": "total",
            "x": "v",
            "kd": "v",
            "kp": "x",
            "total.u0": "kp",
            "total.u1": "kd",
        },
        {"y": "x"},
    )


def MakeTwoDelays(late):
    """dx/dt = -x(t - 0.4) - 3 x(t - 0.1), and a lag outside of the loops."""
    return Late(
        late,
        {
            "plant": Integrator(1),
            "total": Adder(2, 1),
            "channel0": TransportDelay(0.4, 1),
            "law0": Gain(-1.0, 1),
            "channel1": TransportDelay(0.1, 1),
            "law1": Gain(-3.0, 1),
            "lag": LinearSystem([[-1.0]], [[1.0]], [[1.0]]),
        },
        {
            "channel0": "plant",
            "law0": "channel0",
            "total.u0": "law0",
            "channel1": "plant",
            "law1": "channel1",
            "total.u1": "law1",
            "plant": "total",
            "lag": "plant",
        },
        {"y": "plant"},
    )


def MakeStateFeedback(late):
    """A double integrator whose state comes back on one wire, 0.1 s late."""
    A = [[0.0, 1.0], [0.0, 0.0]]
    return Late(
        late,
        {
            "plant": LinearSystem(A, [[0.0], [1.0]], np.eye(2)),
            "sensor": TransportDelay(0.1, 2),
            "law": MatrixGain([[-4.0, -2.0]]),
        },
        {"sensor": "plant", "law": "sensor", "plant": "law"},
        {"y": "plant"},
    )


def MakeNested(late):
    """A controller in a Diagram of its own, whose input has two branches."""
    actuator = Late(
        late,
        {"total": Adder(2, 1), "motor": LinearSystem([[-5.0]], [[5.0]], [[1.0]])},
        {"motor": "total"},
        {"force": "motor"},
        inputs={"u0": "total.u0", "u1": "total.u1"},
        path="controller/actuator/",
    )
    controller = Late(
        late,
        {
            "gain": Gain(-0.5, 1),
            "lag": LinearSystem([[-3.0]], [[6.0]], [[-1.0]]),
            "actuator": actuator,
        },
        {"actuator.u0": "gain", "actuator.u1": "lag"},
        {"force": "actuator"},
        inputs={"y": "gain lag"},
        path="controller/",
    )
    return Late(
        late,
        {
            "plant": LinearSystem([[-1.0]], [[2.0]], [[1.0]]),
            "controller": controller,
        },
        {"controller": "plant", "plant": "controller"},
        {"y": "plant"},
    )


def MakeNeutral(late):
    """u = -0.5 u(t - 0.4) - 2 x, dx/dt = -x + u: part of the signal passes at once."""
    return Late(
        late,
        {
            "plant": LinearSystem([[-1.0]], [[1.0]], [[1.0]]),
            "total": Adder(2, 1),
            "echo": TransportDelay(0.4, 1),
            "half": Gain(-0.5, 1),
            "law": Gain(-2.0, 1),
        },
        {
            "plant": "total",
            "echo": "total",
            "half": "echo",
            "total.u0": "half",
            "law": "plant",
            "total.u1": "law",
        },
        {"y": "plant"},
    )


def MakeTurning(late):
    """Two axes that are coupled by a rotation, on one wire."""
    return Late(
        late,
        {"plant": Integrator(2), "turn": MatrixGain([[-1.0, 0.5], [-0.5, -1.0]])},
        {"turn": "plant", "plant": "turn"},
        {"y": "plant"},
    )


def MakeOscillator(late):
    """x'' + x = 0.3 x(t - 2), which the delay stabilises."""
    A = [[0.0, 1.0], [-1.0, 0.0]]
    return Late(
        late,
        {
            "plant": LinearSystem(A, [[0.0], [1.0]], [[1.0, 0.0]]),
            "gain": Gain(0.3, 1),
            "delay": TransportDelay(2.0, 1),
        },
        {"gain": "plant", "delay": "gain", "plant": "delay"},
        {"y": "plant"},
    )


def MakePendulum(late):
    """Drake's pendulum, held upright by a law that receives its state."""
    return Late(
        late,
        {
            "plant": PendulumPlant(),
            "law": AffineSystem(D=[[-25.0, -5.0]], y0=[25.0 * math.pi]),
        },
        {"law": "plant", "plant": "law"},
        {"y": "plant"},
    )


class Cubic(LeafSystem):
    """dx/dt = -x^3 - u, y = x: it does not convert to AutoDiffXd."""

    def __init__(self):
        LeafSystem.__init__(self)
        self._u = self.DeclareVectorInputPort("u", 1)
        state = self.DeclareContinuousState(BasicVector([0.0]))
        self.DeclareStateOutputPort("y", state)

    def DoCalcTimeDerivatives(self, context, derivatives):
        x = context.get_continuous_state_vector().CopyToVector()
        derivatives.SetFromVector(CubicRate(x, self._u.Eval(context)))

    def Kernel(self):
        return Kernel(outputs={"y": "state"}, rate=(CubicRate, "state", "u"))


def CubicRate(x, u):
    return -(x**3) - u


def MakePython(late):
    """A user's LeafSystem with a gain and a constant, at rest at x = 0.5."""
    # u = 3 x - 1.625, so that u = -x^3 at x = 0.5.
    return Late(
        late,
        {"plant": Cubic(), "law": AffineSystem(D=[[3.0]], y0=[-1.625])},
        {"law": "plant", "plant": "law"},
        {"y": "plant"},
    )


def MakeCartPole(late):
    """Drake's cart-pole, upright, with a linear law behind a motor."""
    plant = MultibodyPlant(time_step=0.0)
    url = "package://drake/examples/multibody/cart_pole/cart_pole.sdf"
    Parser(plant).AddModelsFromUrl(url)
    plant.Finalize()
    K = np.array([[-3.2, 264.0, -9.3, 84.0]])
    return Late(
        late,
        {
            "plant": plant,
            "law": AffineSystem(D=-K, y0=K @ [0.0, math.pi, 0.0, 0.0]),
            "motor": LinearSystem([[-200.0]], [[200.0]], [[1.0]]),
        },
        {"law": "plant.state", "motor": "law", "plant.actuation": "motor"},
        {"y": "plant.state"},
    )


CASES = {
    "pd": Case(MakePd, 6, (0.0, 0.0)),
    "two delays": Case(MakeTwoDelays, 4, (0.0, 0.0)),
    "state feedback": Case(MakeStateFeedback, 3, (0.0, 0.0)),
    "nested": Case(MakeNested, 6, (0.0, 0.0, 0.0)),
    "neutral": Case(MakeNeutral, 3, (0.0,)),
    "turning": Case(MakeTurning, 2, (0.0, 0.0)),
    "oscillator": Case(MakeOscillator, 3, (0.0, 0.0)),
    "pendulum": Case(MakePendulum, 2, (math.pi, 0.0)),
    "python": Case(MakePython, 2, (0.5,)),
    "cart-pole": Case(MakeCartPole, 3, (0.0, math.pi, 0.0, 0.0, 0.0)),
}

# Those of which the short run needs runs on both sides of every margin.
_SHORT = ("pd", "nested", "turning", "pendulum")
_SHORT_PLACES = [i for i, name in enumerate(CASES) if name in _SHORT]


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", Slow(list(CASES), but=_SHORT_PLACES))
def test_runs_on_both_sides_of_the_margin_of_every_connection(name):
    case = CASES[name]
    diagram = case.make({})
    margins = DelayMargins(diagram, case.At(diagram))
    finite = {wire: x for wire, x in margins.items() if x < math.inf}
    assert len(finite) == case.num_finite
    for wire, margin in finite.items():
        assert not case.Grows(wire, 0.97 * margin), wire
        assert case.Grows(wire, 1.03 * margin), wire


@pytest.mark.mostly_slow
@pytest.mark.parametrize("name", Slow(list(CASES), but=_SHORT_PLACES))
def test_each_margin_is_that_of_the_loop_opened_there(name):
    case = CASES[name]
    diagram = case.make({})
    context = case.At(diagram)
    for wire, margin in DelayMargins(diagram, context).items():
        single = DelayMargin(diagram, context, PortOf(diagram, wire))
        assert margin == pytest.approx(single, rel=1e-9), wire


def test_the_branches_of_an_output_and_the_output():
    """The closed forms are in tests/loops/numerics/test_delay_map.py."""
    diagram = MakePd({})
    context = diagram.CreateDefaultContext()
    margins = DelayMargins(diagram, context)
    w = math.sqrt((math.sqrt(2.0**4 + 4 * 4.0**2) - 2.0**2) / 2)
    assert margins["x.u0"] == pytest.approx(math.atan2(2.0, w) / w, rel=1e-9)
    w = (2.0 + math.sqrt(2.0**2 + 4 * 4.0)) / 2
    assert margins["kd.u0"] == pytest.approx(math.pi / 2 / w, rel=1e-9)
    port = diagram.GetSubsystemByName("v").get_output_port()
    w = math.sqrt((2.0**2 + math.sqrt(2.0**4 + 4 * 4.0**2)) / 2)
    both = DelayMargin(diagram, context, port)
    assert both == pytest.approx(math.atan2(2.0 * w, 4.0) / w, rel=1e-9)


def test_the_diagram_is_linearised_once(monkeypatch):
    calls = []
    evaluate = CutDiagram.Evaluate

    def Count(self, step):
        calls.append(step)
        return evaluate(self, step)

    monkeypatch.setattr(CutDiagram, "Evaluate", Count)
    diagram = MakeNested({})
    assert len(DelayMargins(diagram, diagram.CreateDefaultContext())) == 9
    assert len(calls) == 1


def MakeWithLaw(law, target):
    """Returns dx/dt = -2 x, with a law of x behind it that acts on x or on nothing."""
    systems = {
        "plant": Integrator(1),
        "total": Adder(2, 1),
        "gain": Gain(-2.0, 1),
        "law": law,
    }
    connections = {
        "gain": "plant",
        "total.u0": "gain",
        "plant": "total",
        "law": "plant",
    }
    if target == "plant":
        return Wired(systems, connections | {"total.u1": "law"})
    systems |= {"still": Gain(0.0, 1), "sink": Gain(1.0, 1)}
    connections |= {"sink": "law", "still": "gain", "total.u1": "still"}
    return Wired(systems, connections)


@pytest.mark.slow
def test_a_hold_in_the_loop():
    """2/(s (s + 1)(s + 2)) behind a hold of 0.05 s; a sink is in no loop."""
    A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -2.0, -3.0]]
    plant = LinearSystem(A, [[0.0], [0.0], [2.0]], [[1.0, 0.0, 0.0]])
    diagram = Wired(
        {
            "plant": plant,
            "hold": ZeroOrderHold(0.05, 1),
            "gain": Gain(-1.0, 1),
            "sink": Gain(1.0, 1),
        },
        {"hold": "plant", "gain": "hold", "plant": "gain", "sink": "plant"},
    )
    margins = DelayMargins(diagram, diagram.CreateDefaultContext())
    assert margins.pop("sink.u0") == math.inf
    assert list(margins.values()) == pytest.approx(3 * [14.69307 * 0.05], rel=1e-6)


def test_an_unstable_diagram_has_no_margin_at_all():
    diagram = MakeWithLaw(Gain(2.5, 1), "plant")
    unstable = DelayMap(diagram, diagram.CreateDefaultContext())
    assert not unstable.is_stable
    assert set(unstable.margins.values()) == {0.0}


def test_a_signal_in_no_loop_may_be_late_for_ever():
    diagram = MakeWithLaw(Gain(2.5, 1), "sink")
    margins = DelayMargins(diagram, diagram.CreateDefaultContext())
    assert margins.pop("plant.u0") == pytest.approx(math.pi / 4, rel=1e-9)
    assert margins.pop("total.u0") == pytest.approx(math.pi / 4, rel=1e-9)
    assert margins.pop("gain.u0") == pytest.approx(math.pi / 4, rel=1e-9)
    assert set(margins) == {"total.u1", "law.u0", "still.u0", "sink.u0"}
    assert set(margins.values()) == {math.inf}


def test_a_law_that_bends_is_refused_in_a_loop_only():
    diagram = MakeWithLaw(Saturation([0.0], [1.0]), "plant")
    with pytest.raises(ValueError, match="that of 'law' bends"):
        DelayMargins(diagram, diagram.CreateDefaultContext())
    diagram = MakeWithLaw(Saturation([0.0], [1.0]), "sink")
    margins = DelayMargins(diagram, diagram.CreateDefaultContext())
    assert margins["plant.u0"] == pytest.approx(math.pi / 4, rel=1e-9)


def test_a_law_with_the_slope_0_does_not_bend():
    u = Variable("u")
    diagram = MakeWithLaw(SymbolicVectorSystem(input=[u], output=[u**2]), "plant")
    margins = DelayMargins(diagram, diagram.CreateDefaultContext())
    assert margins["plant.u0"] == pytest.approx(math.pi / 4, rel=1e-9)
    assert margins["law.u0"] == math.inf


def test_a_motion_is_refused_unless_it_is_named():
    case = CASES["pendulum"]
    diagram = case.make({})
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([math.pi - 0.5, 0.0])
    with pytest.raises(ValueError, match=r"'plant' with a derivative .*is_moving"):
        DelayMargins(diagram, context)
    moving = DelayMargins(diagram, context, is_moving=True)
    assert moving["law.u0"] != DelayMargins(diagram, case.At(diagram))["law.u0"]


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", ["direct_force", "adaptive_backstepping"])
def test_a_teleoperator_with_all_of_its_states(kind):
    """The estimates of an adaptive law are states."""
    scenario = LoadScenario("one_dof", {"controller.kind": kind, "delay": 0.02})
    diagram = MakeTeleoperator(scenario)
    context = diagram.CreateDefaultContext()
    robot = diagram.GetSubsystemByName("robot").GetMyMutableContextFromRoot(context)
    robot.SetContinuousState([0.004, 0.0])
    margins = DelayMargins(diagram, context, is_moving=True)
    assert margins["environment.tool_velocity"] > 0
    for wire in (
        "forward_channel.signal",
        "master.return_packet",
        "robot.control_force",
    ):
        port = PortOf(diagram, wire)
        single = DelayMargin(diagram, context, port, is_moving=True)
        assert margins[wire] == pytest.approx(single, rel=1e-7), wire
