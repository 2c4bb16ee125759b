"""Linear models with a delay that is a signal, against closed forms and runs."""

import math

import numpy as np
import pytest
from signal_delays import Conveyor, Loop, Source

from teleop_drake import DelayMargin, LinearizePorts, simulate
from teleop_drake.loops.linear.delay_map import DelayMargins
from teleop_drake.model.scenario import ScenarioError


def StateDependent(least, start=1.0):
    """Returns x' = 1 - x(t - T), T = least + 0.1 x^2, which rests at x = 1."""
    return Loop(
        lambda t, late: 1.0 - late,
        lambda t, x: least + 0.1 * x * x,
        (0.0, start),
        maximum_delay=5.0,
    )


@pytest.mark.parametrize("least", [0.2, -0.1])
def test_the_delay_of_the_model_is_that_at_rest(least):
    """x' = -x(t - T) is stable for T < pi/2; at rest T is least + 0.1, here also 0."""
    diagram, context = StateDependent(least)
    late = diagram.GetSubsystemByName("plant").GetInputPort("late")
    expected = math.pi / 2 - (least + 0.1)
    assert DelayMargin(diagram, context, late) == pytest.approx(expected, rel=1e-9)
    model = LinearizePorts(diagram, context, late, is_opened=True, is_settled=True)
    assert sum(model.delays) == pytest.approx(least + 0.1, abs=1e-15)
    # The delay has no slope in the model, so that its connection is in no loop.
    assert DelayMargins(diagram, context) == {
        "plant.late": pytest.approx(expected, rel=1e-6),
        "line.signal": pytest.approx(expected, rel=1e-6),
        "line.delay": math.inf,
    }


@pytest.mark.parametrize(("share", "grows"), [(0.97, False), (1.03, True)])
def test_runs_on_both_sides_of_the_margin(share, grows):
    diagram, context = StateDependent(share * math.pi / 2 - 0.1, start=1.0001)
    run = simulate(diagram, context=context, duration=60.0)
    away = np.abs(run.Interpolate("x", np.linspace(30.0, 60.0, 400))[:, 0] - 1)
    assert (away[200:].max() > away[:200].max()) == grows


def test_what_has_no_linear_model_is_refused():
    diagram, context = StateDependent(-0.2)
    late = diagram.GetSubsystemByName("plant").GetInputPort("late")
    with pytest.raises(ScenarioError, match=r"delay of line = -0.1: must be 0 to 5"):
        DelayMargin(diagram, context, late)
    conveyor = Conveyor(Source(lambda t: [1.0]), Source(lambda t: [1.0]), 0.3)
    port = conveyor.GetSubsystemByName("out").GetInputPort("signal")
    with pytest.raises(ScenarioError, match="without packets, delays by a profile"):
        LinearizePorts(conveyor, conveyor.CreateDefaultContext(), port, is_opened=True)
