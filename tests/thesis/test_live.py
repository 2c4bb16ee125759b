"""The executable thesis: its figures simulate, and its claims are judged as here."""

import re

import pytest
from grids import Slow

from teleop_drake.cli import main
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunSentence
from teleop_drake.thesis.figures import FIGURES
from teleop_drake.thesis.live import SLIDERS, FigureOf
from teleop_drake.thesis.report import CLAIMS
from teleop_drake.thesis.runs import Delay, Run, ThesisRuns

pytestmark = pytest.mark.xdist_group("thesis")

PHONE = 390, 844

# Of each task sliders that are moved, far enough to turn verdicts.
MOVED = {
    "one_dof": {"delay": 0.2, "controller.initial_psi": 2.0, "robot.damping": 0.7},
    "two_dof_puncture": {"delay": 0.04, "controller.G1": 8.0},
    "two_dof_collision": {
        "delay": 0.05,
        "controller.G2": 60.0,
        "environment.layers.bone.damping": 3.0,
    },
    "two_dof_combined": {"delay": 0.02, "environment.layers.bone.damping": 5.0},
}


class MovedRuns(ThesisRuns):
    """Runs of a task at the numbers of sliders."""

    def __init__(self, task, values):
        super().__init__()
        self._task = task
        self._change = {key: x for key, x in values.items() if key != "delay"}
        self._change |= Delay(values["delay"])

    def __call__(self, name, *changes) -> Run:
        own = [self._change] if name == self._task else []
        return super().__call__(name, *changes, *own)


def Measured(keys, runs):
    """What some claims are found to be, by the claims' keys."""
    return {claim.key: claim.Measure(runs) for claim in CLAIMS if claim.key in keys}


def Claims(keys):
    return {claim.key: claim for claim in CLAIMS if claim.key in keys}


@pytest.fixture(scope="module")
def seen(look, reproduced):
    return look(reproduced.folder / "report.html", "thesis.js")


def test_claims_stand_beside_their_figures():
    figures = {claim.key: FigureOf(claim) for claim in CLAIMS}
    assert figures["4-adaptive-overshoot"] == "4.1"
    assert figures["5-III-lower-first-impact"] == "5.15"
    assert figures["5-II-larger-gains"] == "5.7"
    assert figures["6-outperforms"] == ""
    beside = {FIGURES[number].task for number in figures.values() if number}
    assert beside >= set(SLIDERS)


@pytest.mark.parametrize("task", SLIDERS)
def test_sliders_are_numbers_of_the_scenario(task):
    scenario = LoadScenario(task)
    for key, (low, high) in SLIDERS[task].items():
        assert low <= scenario.Value(key) < high


@pytest.mark.slow
def test_a_figure_of_a_run_is_live(seen):
    assert seen["inputs"] == ["delay", *SLIDERS["one_dof"]]
    assert seen["scopes"] == ["tool_velocity", "psi", "change of psi"]
    assert min(seen["curves"]) > 10


@pytest.mark.slow
def test_a_damper_runs_beside_the_controllers_of_the_thesis(seen, thesis_runs):
    """What each of the three did is said in the words of the package."""
    kinds = ["direct_force", "adaptive_backstepping", "damped_force"]
    assert seen["kinds"] == kinds
    change = {"controller.damped_force.against": "command"}
    runs = [thesis_runs("one_dof", {"controller.kind": x}, change) for x in kinds]
    said = " ".join(RunSentence(run.recording) for run in runs)
    assert seen["said"] == said.replace("Damped force", "Damper")


def test_the_printed_numbers_are_marked_in_the_figure(seen, thesis_runs):
    """0.472 and 0.26 mm/s above 1 mm/s after the puncture; the rebounds on the bone."""
    both = thesis_runs.OfBoth("one_dof")
    puncture = both.Numbers("puncture.time")
    contact = both.Numbers("collision.time")
    levels = (1.472e-3, 1.26e-3, -0.72e-3, -0.658e-3)
    expected = zip((*puncture, *contact), levels, strict=True)
    assert seen["drawn"] == len(seen["marks"]) == 4
    for mark, place in zip(seen["marks"], expected, strict=True):
        assert mark == pytest.approx(place, rel=1e-6)


def test_a_slider_changes_curves_and_returns(seen):
    assert seen["isMoved"] and seen["isBack"]


def test_the_filter_shows_refuted_claims(seen):
    assert seen["refuted"] == seen["shown"] > 0
    assert seen["all"] > seen["shown"]


@pytest.mark.slow
@pytest.mark.parametrize("is_dark", Slow([False, True]), ids=["light", "dark"])
def test_it_fits_a_phone(look, reproduced, is_dark):
    path = reproduced.folder / "report.html"
    seen = look(path, "thesis.js", size=PHONE, is_dark=is_dark)
    assert seen["width"] <= PHONE[0]
    assert min(seen["targets"]) >= 44


@pytest.fixture(scope="module")
def whole(tmp_path_factory, thesis_runs):
    """The report with all figures, by the command; its runs are those of the ledger."""
    folder = tmp_path_factory.mktemp("thesis")
    assert main(["reproduce", "--format", "svg", "--out", str(folder)]) == 0
    return folder / "report.html"


def Link(task, values):
    """What tells judge.js a task and the values of its sliders."""
    return f"#{task}&" + "&".join(f"{key}={x}" for key, x in values.items())


def AssertSame(found, measured):
    """Compares what the page finds with what the ledger does, where runs can decide."""
    judged = [key for key, x in found.items() if x["holds"] is not None]
    assert len(judged) > 3
    for key in judged:
        assert found[key]["holds"] == measured[key].holds, key
        if isinstance(measured[key].ours, float):
            assert found[key]["ours"] == pytest.approx(measured[key].ours, rel=1e-4)
    return judged


@pytest.mark.slow
@pytest.mark.parametrize("task", MOVED)
def test_a_page_measures_as_the_ledger(look, whole, thesis_runs, task):
    """At the thesis's numbers and where sliders have moved."""
    assert whole.stat().st_size < 4e6
    seen = look(whole, "judge.js", link=Link(task, MOVED[task]))
    measured = Measured(seen["published"], thesis_runs)
    judged = AssertSame(seen["published"], measured)
    moved = Measured(seen["moved"], MovedRuns(task, MOVED[task]))
    AssertSame(seen["moved"], moved)
    # Only where sliders have moved there is something to say about them.
    assert seen["hidden"] == [len(measured), 0]
    claims = Claims(judged)
    words = {True: ("holds here", "still holds"),
             False: ("does not hold here either", "no longer holds")}  # fmt: skip
    turned = set()
    for key in judged:
        text = seen["texts"][key]
        if seen["moved"][key]["holds"] is None:
            assert text.startswith("cannot be judged: ")
            continue
        word = words[bool(moved[key].holds)][bool(measured[key].holds)]
        turned.add(word)
        # A number of the thesis is shown, and never judged elsewhere.
        assert not re.search("reproduced|refuted", text)
        if claims[key].printed is None:
            assert text.startswith(word)
            continue
        numbers = re.match(r"(\S+) \S+ here, (\S+) \S+ at the thesis's settings", text)
        here, there = map(float, numbers.groups())
        scale = {"mm/s": 1e3, "mN": 1e3, "%": 1e2}[claims[key].unit]
        assert here == pytest.approx(scale * moved[key].ours, rel=1e-3)
        assert there == pytest.approx(scale * measured[key].ours, rel=1e-3)
        assert text.endswith(f"; {claims[key].in_kind}: {word}")
    assert turned & {"no longer holds", "holds here"}


@pytest.mark.slow
def test_a_number_of_the_thesis_is_no_claim_about_another_delay(look, reproduced):
    seen = look(
        reproduced.folder / "report.html",
        "judge.js",
        link=Link("one_dof", {"delay": 0.05}),
    )
    runs = MovedRuns("one_dof", {"delay": 0.05})
    here = 1e3 * Measured(["4-direct-rebound"], runs)["4-direct-rebound"].ours
    text = seen["texts"]["4-direct-rebound"]
    assert text.startswith(f"{here:.4g} mm/s here, -1.229 mm/s at 0.1 s; more negative")
    pale = "pale: our run at the thesis's numbers"
    assert pale in seen["heads"][0]


@pytest.mark.slow
def test_runs_that_ended_are_not_judged(look, whole):
    """At 0.2 s direct force diverges before it reaches the bone."""
    link = Link("two_dof_combined", {"delay": 0.2})
    texts = look(whole, "judge.js", link=link)["texts"]
    ended = "cannot be judged: direct force ran away after 2.2 s"
    for key in ("5-III-lower-first-impact", "5-III-less-force", "5-III-tracking"):
        assert texts[key] == ended
    # A claim with a measure of its own.
    assert texts["5-III-stable-on-bone"] == "judged in Python, at 0.1 s only"


@pytest.mark.slow
def test_only_some_figures_make_no_report(tmp_path):
    assert main(["reproduce", "--only", "2.4", "--quiet", "--out", str(tmp_path)]) == 0
    assert not (tmp_path / "report.html").exists()
