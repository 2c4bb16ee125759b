"""A guess in a page, and the strip that shows at which delays the runs come to rest."""

import math

import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Gain, Integrator

from teleop_drake import TransportDelay, WritePage
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario

pytestmark = pytest.mark.xdist_group("browser")


def LateLoop():
    """A position x' = -2 x(t - T), which starts at 1."""
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", Integrator(1))
    gain = builder.AddNamedSystem("gain", Gain(-2.0, 1))
    late = builder.AddNamedSystem("late", TransportDelay(delay=0.1, size=1))
    builder.Connect(plant.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), late.get_input_port())
    builder.Connect(late.get_output_port(), plant.get_input_port())
    builder.ExportOutput(plant.get_output_port(), "position")
    return builder.Build()


@pytest.fixture(scope="module")
def seen(look, tmp_path_factory):
    page = tmp_path_factory.mktemp("page") / "late.html"
    loop = LateLoop()
    loop.set_name("loop")
    context = loop.CreateDefaultContext()
    context.SetContinuousState([1.0])
    vary = {"late.delay": (0.0, 1.5), "gain.k": (-4.0, -1.0)}
    WritePage(loop, page, vary=vary, context=context, duration=20.0)
    return look(page, "guess.js", link="#guess=")


def test_the_page_asks_first_and_hides_what_tells_it(seen):
    question = "From which delay on does loop no longer come to rest?"
    assert seen["asked"] == {"question": question, "hidden": [], "strip": 0}
    assert seen["isShown"]


def test_the_strip_ends_at_the_exact_margin(seen):
    """The loop is stable up to T = pi/4, where it swings with 2 rad/s."""
    verdicts = seen["rows"]["loop"]
    assert verdicts == sorted(verdicts)
    grows = min(delay for delay, verdict in verdicts if verdict == 2)
    decays = max(delay for delay, verdict in verdicts if verdict < 2)
    assert decays < grows < decays + 1.5 / 12 / 16 * 1.01
    # In 20 s it grows by less than a tenth within 1 % of the margin.
    assert math.pi / 4 <= grows < 1.02 * math.pi / 4
    assert seen["first"].startswith("Loop comes to rest at delays up to 0.6")
    assert seen["first"].endswith("The guess is 0.3 s.")


def test_answers_of_a_class_make_a_histogram(seen):
    """Bins of 0.075 s: 0.3 and 0.31 are in the fifth, 0.9 in the thirteenth."""
    counts = dict(enumerate(seen["counts"]))
    assert {i: n for i, n in counts.items() if n} == {4: 2, 12: 1}
    assert seen["said"] == "3 drawn, 1 not understood, 1 on another controller"


def test_a_guess_is_in_the_link_and_within_the_slider(seen):
    assert seen["link"].endswith("&guess=0.3")
    allowed = "must be a late.delay from 0 to 1.5"
    assert seen["wrong"] == [f"guess = {x}: {allowed}" for x in ("9", "NaN")]


@pytest.mark.slow
def test_the_strip_agrees_with_runs_of_the_package(look, tmp_path):
    """Direct force runs away on one side of the limit in the strip, and not before."""
    page = tmp_path / "one.html"
    WritePage("one_dof", page)
    seen = look(page, "guess.js", link="#guess=")
    assert (
        seen["asked"]["question"] == "From which delay on does direct force run away?"
    )
    assert "Adaptive backstepping comes to rest at each delay" in seen["first"]
    verdicts = dict(seen["rows"]["direct_force"])
    first = min(delay for delay, verdict in verdicts.items() if verdict == 2)
    before = max(delay for delay in verdicts if delay < first)
    for delay, has_diverged in ((before, False), (first, True)):
        changes = {"controller.kind": "direct_force", "delay": delay}
        recording = simulate(LoadScenario("one_dof", changes))
        assert (recording.termination != "completed") == has_diverged, delay
