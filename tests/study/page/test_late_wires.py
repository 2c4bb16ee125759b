"""A page with a delay on each connection: margins, and runs with late wires."""

import cmath
import math

import numpy as np
import pytest
from servo import Servo

from teleop_drake import WritePage
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.run.simulate import simulate

pytestmark = pytest.mark.xdist_group("browser")


@pytest.fixture(scope="module")
def seen(look, tmp_path_factory):
    page = tmp_path_factory.mktemp("page") / "servo.html"
    assert WritePage(Servo, page, delays="all") == []
    return look(page, "wires.js")


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_a_late_wire_is_a_transport_delay(seen, late):
    """The page's run equals that of a Diagram with the delay as a block."""
    recording = simulate(Servo(late), duration=10.0)
    expected = recording.Interpolate("state", np.array([0.1, 0.3, 0.9, 3.0]))
    found = seen["runs"][0 if late == 0 else 1]
    np.testing.assert_allclose(np.transpose(found), expected, atol=1e-7)


def test_margins_are_exact(seen):
    """L = (15 s + 49)/(s^2 + s + 1) is 1 at one frequency; the goal is in no loop."""
    # |15 i w + 49|^2 = |1 - w^2 + i w|^2 is quadratic in w^2.
    square = max(np.roots([1, -1 - 15**2, 1 - 49**2]).real)
    w = math.sqrt(square)
    s = 1j * w
    margin = (math.pi + cmath.phase((15 * s + 49) / (s * s + s + 1))) / w
    assert seen["margins"] == {
        "body:u0": pytest.approx(margin, rel=1e-6),
        "pid:estimated_state": pytest.approx(margin, rel=1e-6),
        "pid:desired_state": None,
    }


def test_a_click_shows_the_margin_and_the_delay(seen):
    assert "wire to pid · estimated_state" in seen["words"]
    assert "up to 0.0928 s later" in seen["words"]
    assert seen["isShown"] and "pid:estimated_state" in seen["scopes"]


def test_python_names_a_delay_that_the_diagram_does_not_have(seen):
    python = seen["python"]
    words = "has no block for it: pid.estimated_state.delay = 0.05 s\n"
    assert words in python
    assert python.index(words) < python.index("diagram = Servo()")
    assert '"pid.estimated_state.delay"' not in python


def test_other_words_than_all_are_refused(tmp_path):
    with pytest.raises(ScenarioError, match="delays = 'some': must be 'all' or None"):
        WritePage(Servo, tmp_path / "page.html", delays="some")
