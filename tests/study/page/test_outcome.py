"""The sentences under the title of a page: what each run did."""

import math
from fractions import Fraction

import numpy as np
import pytest
from pydrake.symbolic import Variable
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Gain, Integrator, SymbolicVectorSystem
from scipy.special import lambertw
from servo import Servo

from teleop_drake import TransportDelay, WritePage
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunSentence

pytestmark = pytest.mark.xdist_group("browser")


@pytest.fixture(scope="module")
def seen(look, tmp_path_factory):
    page = tmp_path_factory.mktemp("page") / "arm.html"
    WritePage("two_dof_combined", page, overrides={"delay": 0.2})
    return look(page, "outcome.js")


def Sentences(delay):
    """The sentences of the package on the runs of the page."""
    kinds = ("direct_force", "adaptive_backstepping")
    changes = [{"controller.kind": kind, "delay": delay} for kind in kinds]
    scenarios = [LoadScenario("two_dof_combined", change) for change in changes]
    return " ".join(RunSentence(simulate(scenario)) for scenario in scenarios)


@pytest.mark.slow
def test_what_each_run_did_stands_under_the_title(seen):
    assert (
        "Direct force went through the tissue at 2.1 s and ran away after 2.2 s. "
        in (seen["first"])
    )
    assert seen["first"].endswith(
        "hit the bone with 0.94 N and came to rest after 2.0 s."
    )
    assert seen["first"] == Sentences(0.2)
    assert seen["live"] == "polite"


def test_it_follows_the_sliders(seen):
    assert seen["moved"] == Sentences(0.0) != seen["first"]


def test_on_paper_it_is_the_caption(seen):
    assert seen["isCaption"] and seen["isPrinted"] and seen["isBack"]


def test_a_run_that_ran_away_ends_with_a_cross(seen):
    """A cross for each of its two lines, and its words once."""
    assert seen["before"]["crosses"] == seen["after"]["crosses"] == 2
    assert seen["after"]["words"].count("ran away at 2.2 s") == 1


def test_after_its_end_a_run_has_no_values_and_no_arm(seen):
    before = seen["before"]
    after = seen["after"]
    assert "direct force x " in before["head"]
    assert "direct force has ended" in after["head"]
    assert (before["arms"], before["tools"], before["ends"]) == (2, 2, 0)
    assert (after["arms"], after["tools"], after["ends"]) == (1, 1, 1)


def test_a_time_that_does_not_come_is_never(seen):
    cells = {name: values for name, *values in seen["table"]}
    assert cells["collision: rest time [s]"][0] == "never"
    assert cells["collision: peak force [N]"][0] == "\N{EN DASH}"


@pytest.fixture(scope="module")
def own_page(tmp_path_factory):
    page = tmp_path_factory.mktemp("page") / "servo.html"
    WritePage(Servo, page)
    return page


@pytest.mark.slow
def test_a_controlled_position_is_compared_with_its_reference(look, own_page):
    """The spring of 1 and kp = 49 leave 49/50 of the reference."""
    said = look(own_page, "outcome.js")["first"]
    assert said == "state 1 reached 0.98 of 1. state 2 settles at 0."


@pytest.fixture(scope="module")
def motions(look, own_page):
    return look(own_page, "motion.js")


@pytest.mark.parametrize(
    ("curve", "words"),
    [
        ("still", "stays at 2 m"),
        ("zero", "stays at 0 m"),
        # e^(1.5 t) has a hundredth of its last value at 10 - ln(100)/1.5.
        ("unstable", f"grows without bound from {10 - math.log(100) / 1.5:.2g} s on"),
        ("falling", f"falls without bound from {10 - math.log(100) / 2:.2g} s on"),
        ("parabola", "is at 10 m in the end, and still rises"),
        ("decaying", "swings with 1.4 Hz, decaying"),
        ("growing", "swings with 0.5 Hz, growing"),
        ("flutter", "swings with 2 Hz, growing"),
        ("steady", "swings with 0.3 Hz"),
        ("settled", "settles at 0.98 m"),
        ("reached", "reached 0.98 of 1 m"),
        ("rings", "settles at 2 m"),
        ("nothing", "settles at 0 m"),
        ("slow", "is at 0.61 m in the end, and still falls"),
    ],
)
def test_a_curve_in_words(motions, curve, words):
    assert motions[curve] == words


GAIN = 5  # 1/s: with a delay from pi/10 s on, x' = -5 x(t - T) is unstable.


def LateIntegral():
    """x' = -5 x(t - T) with x(0) = 1, and with 0 before."""
    builder = DiagramBuilder()
    x = builder.AddNamedSystem("integral", Integrator([1.0]))
    line = builder.AddNamedSystem("line", TransportDelay(0.1, 1))
    gain = builder.AddNamedSystem("gain", Gain(-float(GAIN), 1))
    builder.Connect(x.get_output_port(), line.get_input_port())
    builder.Connect(line.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), x.get_input_port())
    builder.ExportOutput(x.get_output_port(), "x")
    diagram = builder.Build()
    diagram.set_name("late_integral")
    return diagram


def ExactIntegral(time, delay):
    """The solution from step to step of the delay, in exact numbers."""
    late = [Fraction(time) - k * Fraction(delay) for k in range(100)]
    parts = [
        Fraction(-GAIN * t) ** k / math.factorial(k)
        for k, t in enumerate(late)
        if t >= 0
    ]
    return float(sum(parts))


def test_beyond_its_margin_a_page_draws_the_growth(look, tmp_path):
    """Up to 10 000 times the first run's range, which is the start of 1."""
    page = tmp_path / "integral.html"
    WritePage(LateIntegral, page, duration=60.0, vary={"line.delay": (0.01, 1.0)})
    seen = look(page, "runaway.js")
    assert seen["status"] == ""
    assert seen["last"] == pytest.approx(ExactIntegral(seen["end"], 0.5), rel=1e-5)
    assert abs(seen["last"]) == pytest.approx(1e4, rel=1e-9)
    # Where the fastest root alone is seen, three values at equal distances have the
    # recurrence of its polynomial, a quotient of which is its growth.
    x = np.array(seen["values"])
    shifted = np.stack([x[1:-1], -x[:-2]], axis=1)
    (_, growth), *_ = np.linalg.lstsq(shifted, x[2:], rcond=None)
    root = lambertw(-GAIN * 0.5) / 0.5
    assert math.log(growth) / (2 * 0.25) == pytest.approx(root.real, rel=1e-5)
    when = f"{seen['end']:.0f} s"
    assert seen["said"] == (
        f"Late integral ran away after {when}: x exceeds 10000. "
        "x swings with 0.56 Hz, growing."
    )
    assert (seen["crosses"], seen["words"]) == (1, [f"ran away at {when}"])
    assert seen["drawn"] > 100


def Winding():
    """A point that turns at w rad/s, with w' = 2 w and w(0) = 1."""
    x, y, w = (Variable(name) for name in "xyw")
    system = SymbolicVectorSystem(
        state=[x, y, w], dynamics=[-w * y, w * x, 2 * w], output=[x, y, w]
    )
    builder = DiagramBuilder()
    builder.AddNamedSystem("winding", system)
    builder.ExportOutput(system.get_output_port(), "state")
    diagram = builder.Build()
    diagram.set_name("winding")
    return diagram


def test_a_first_run_that_cannot_be_solved_ends_where_it_has_run_away(look, tmp_path):
    """Where the state is 10 000 times its start, w = sqrt(2) 1e4.

    The turns take too many steps long before w is 1e9.
    """
    diagram = Winding()
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([1.0, 0.0, 1.0])
    page = tmp_path / "winding.html"
    WritePage(diagram, page, context=context, duration=20.0)
    seen = look(page, "ended.js")
    assert seen["end"] == pytest.approx(math.log(math.sqrt(2) * 1e4) / 2, abs=1e-6)
    assert "ran away after 4.8 s" in seen["said"]
