"""What a run did, in words. The page's own words are compared in tests/study/page."""

import dataclasses

import pytest

from teleop_drake.cli import main
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import MissingInWords, RunMetrics, RunSentence
from teleop_drake.model.tasks.sentences import EndInWords, Quantity


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0086568, "N", "8.7 mN"),
        (2.0, "s", "2.0 s"),
        (0.583, "s", "0.58 s"),
        (12.34, "s", "12 s"),
        (9.96, "s", "10 s"),
        (-0.06, "m", "-60 mm"),
        (0.0, "N", "0.0 N"),
        (1234.0, "N", "1.2 kN"),
        (5e-8, "m", "50 nm"),
        (0.4, "rad", "0.40 rad"),
    ],
)
def test_a_quantity_has_two_digits(value, unit, text):
    assert Quantity(value, unit) == text


@pytest.fixture(scope="module")
def adaptive():
    return simulate(LoadScenario("two_dof_collision", {"delay": 0.1}))


def test_a_contact_and_its_rest(adaptive):
    collision = RunMetrics(adaptive)["collision"]
    assert RunSentence(adaptive) == (
        f"Adaptive backstepping hit the bone with "
        f"{Quantity(collision['initial_impact_force'], 'N')} and came to rest after "
        f"{Quantity(collision['rest_time'], 's')}."
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"duration": 0.5}, "did not reach the bone."),
        ({"controller": "direct_force"}, "hit the bone with "),
        ({"controller": "direct_force"}, ", later with up to "),
        ({"controller": "direct_force"}, ", and did not come to rest."),
        (
            {"environment.layers": [], "duration": 3.0},
            "commanded velocity to within x ",
        ),
        (
            {"controller": "direct_force", "delay": 0.4},
            "Direct force ran away after 1.1 s.",
        ),
    ],
)
def test_other_runs(changes, words):
    assert words in RunSentence(simulate(LoadScenario("two_dof_collision", changes)))


@pytest.mark.parametrize(
    ("termination", "reason", "words"),
    [
        ("completed", "", ""),
        ("interrupted", "by the user", "was interrupted after 8.0 s"),
        ("diverged", "the tool's speed, 1 m/s, exceeds ...", "ran away after 8.0 s"),
        (
            "diverged",
            "joint elbow leaves its range, -1 to 2",
            "ended after 8.0 s, where joint elbow leaves its range",
        ),
        ("diverged", "numbers become infinite", "cannot be simulated beyond 8.0 s"),
    ],
)
def test_how_a_run_ends(adaptive, termination, reason, words):
    run = dataclasses.replace(adaptive, termination=termination, reason=reason)
    assert run.time[-1] == 8.0
    assert EndInWords(run) == words


@pytest.mark.slow
def test_commands_and_notebooks_have_the_sentence(adaptive, capsys, tmp_path):
    sentence = RunSentence(adaptive)
    options = ["--controllers", "adaptive_backstepping", "--quiet"]
    assert main(["compare", "two_dof_collision", *options, "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.splitlines()[1] == sentence
    assert adaptive._repr_html_().startswith(f"<p>{sentence}</p>")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("collision.rest_time", "never"),
        ("puncture.time", "never"),
        ("diverged_at", "never"),
        ("collision.peak_force", "-"),
    ],
)
def test_a_time_that_does_not_come(name, text):
    assert MissingInWords(name) == text
