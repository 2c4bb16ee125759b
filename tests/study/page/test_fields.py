"""The numbers in the boxes of a page as fields, and its state as Python."""

import json

import numpy as np
import pytest
from browsers import SCRIPTS
from servo import Servo

from teleop_drake import WritePage
from teleop_drake.loops.engine.parameters import Scalar
from teleop_drake.loops.page.fields import FindFields
from teleop_drake.loops.page.inputs import Change
from teleop_drake.loops.page.sliders import Runs

pytestmark = pytest.mark.xdist_group("browser")

TIMES = [0.2, 0.7, 1.9, 4.0]


@pytest.fixture
def numbers_of(look, tmp_path, monkeypatch):
    """Returns what fields.js finds in a page, called with some arguments."""

    script = SCRIPTS.joinpath("fields.js").read_text("utf-8")

    def Look(page, *arguments):
        call = tmp_path / "call.js"
        function = script[script.index("async") :].rstrip().removesuffix(";")
        call.write_text(f"({function})(...{json.dumps(arguments)})")
        return look(page, call)

    return Look


def RunLines(text):
    """Runs Python lines; returns the recording."""
    found = {}
    exec(text, found)
    return found["recording"]


def test_numbers_of_drakes_blocks_are_fields(numbers_of, tmp_path):
    """Matrices and gains, which no Context has; D would close an algebraic loop."""
    page = tmp_path / "servo.html"
    WritePage(Servo, page)
    changes = {"body.A(1,1)": -2.0, "pid.ki": 0.5, "pid.kp": 60.0}
    seen = numbers_of(page, "body", changes, "state", TIMES)
    assert seen["labels"][:4] == ["A(0,0)", "A(0,1)", "A(1,0)", "A(1,1)"]
    assert seen["made"] == {"before": False, "after": True, "label": "body.A(0,0)"}
    reason = "it needs another program: make the page again with it"
    assert seen["fixed"] == [f"D(0,0) = 0, D(1,0) = 0: fixed here, as {reason}"]
    # Only numbers that differ are in the link.
    assert "body" not in seen["link"] and "body.A%281%2C1%29=-2&" in seen["moved"]
    recording = RunLines(seen["python"])
    expected = recording.Interpolate("state", np.array(TIMES))
    np.testing.assert_allclose(np.transpose(seen["samples"]), expected, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "changes", "label"),
    [
        (
            "controller/adaptive_backstepping",
            {"controller/adaptive_backstepping.G1": 5.0},
            "Lambda",
        ),
        ("robot/plant", {"robot/plant.carriage.mass": 0.7}, "carriage.mass"),
        ("environment", {"environment.stiffness(bone)": 120.0}, "stiffness(empty)"),
        ("environment", {"delay": 0.0}, "stiffness(empty)"),
    ],
)
def test_numbers_of_a_scenario_are_fields(numbers_of, tmp_path, path, changes, label):
    page = tmp_path / "loop.html"
    WritePage("one_dof", page, controllers=["adaptive_backstepping"])
    seen = numbers_of(page, path, changes, "tool_position", [5.0, 14.0, 15.5, 24.0])
    assert seen["labels"][0].startswith(f"{label} [")
    recording = RunLines(seen["python"])
    # In a run of the Diagram, the name has the block, too.
    (name,) = (x for x in recording if x.endswith("tool_position"))
    expected = recording.Interpolate(name, np.array([5.0, 14.0, 15.5, 24.0]))
    np.testing.assert_allclose(np.transpose(seen["samples"]), expected, atol=1e-9)


class Made:
    """A run with some numbers, as the maker of a page's runs returns it."""

    structure = ()
    has_zero_delays = True

    def __init__(self, **z):
        self.numbers = {name: np.array(x, float) for name, x in z.items()}


def MakeRun(values):
    """A slider s and the fields a to f."""
    x = {"s": 1.0, **dict.fromkeys("abcdef", 0.5), **values}
    return Made(
        own=[x["a"], 3 * x["b"] + 2, 7],
        two=[x["c"] + 2 * x["d"]],
        curved=[x["e"] ** 2],
        meets=[x["s"] * x["f"], x["s"]],
    )


def ListsOf(slopes):
    return {array: [x.tolist() for x in part] for array, part in slopes.items()}


def test_fields_are_affine_and_add_up():
    runs = Runs({("run",): MakeRun}, [])
    change = Change(
        value=1.0,
        values=(0.5, 2.0),
        slopes={"meets": (np.array([0, 1]), np.array([0.5, 1.0]))},
        stops={},
    )

    class Slider:
        key = "s"
        changes = (change,)

    numbers = {name: Scalar(0.5, "", ["block"]) for name in "abcdefg"}
    found, why = FindFields([numbers], [Slider()], runs)
    slopes = {one.key: one.changes[0].slopes for one in found}
    assert {key: ListsOf(x) for key, x in slopes.items()} == {
        "a": {"own": [[0], [1.0]]},
        "b": {"own": [[1], [3.0]]},
        "c": {"two": [[0], [1.0]]},
        "d": {"two": [[0], [2.0]]},
    }
    assert {name: text.split()[0] for name, text in why.items()} == {
        "e": "its",
        "f": "a",
        "g": "it",
    }
