"""The chapter on future work: its verdicts, and what the documentation says of it."""

import itertools
import re

import numpy as np
import pytest
from documentation import ROOT

from teleop_drake.laws.backstepping import (
    BacksteppingGains,
    BacksteppingState,
    backstepping_rate,
)
from teleop_drake.scenario import ARCHITECTURES, LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.tasks.metrics import RunMetrics
from teleop_drake.thesis.claims.evidence import Evidence
from teleop_drake.thesis.claims.future_work import (
    EXTENSION_REQUESTS,
    LEARNING,
    Extensions,
)
from teleop_drake.thesis.claims.learning import (
    PathDistance,
    ReplayedShare,
    WeightDrift,
)
from teleop_drake.thesis.claims.measures import BasisFunctions, Rms, UnlearnedShare
from teleop_drake.thesis.runs import ThesisRuns

pytestmark = pytest.mark.xdist_group("thesis")

# What the page of the thesis quotes of each row.
EXTENSIONS = {
    "F-puma-settles": "1.23 0.594 0.659",
    "F-puma-first-impact": "4.44 4.56",
    "F-puma-varying-delays": "3.8 0.4 20.7 15.1",
    "F-drive-of-100": "",
    "F-drive-of-20": "",
    "F-robust-on-bone": "1.97 1.83 1.31 2.46",
    "F-robust-weight": "42.2 46.5 23.7",
}
PAGE = (ROOT / "teleop_drake/docs/learning.md").read_text("utf-8")


@pytest.fixture(scope="module")
def learning(on_learning):
    return {row.key: row for row in on_learning}


def Cells(first):
    """The cells behind the first of a row of the page, as text."""
    (cells,) = re.findall(rf"^\| `?{first}`? \|(.*)\|$", PAGE, re.MULTILINE)
    return [cell.strip() for cell in cells.split("|")]


def Numbers(text):
    return [float(x) for x in re.findall(r"\d+(?:\.\d+)?(?= ?(?:%|mm))", text)]


def test_verdicts(learning):
    refuted = {key for key, row in learning.items() if row.verdict == "refuted"}
    assert refuted == {
        "F-representation",
        "F-velocity-inputs",
        "F-faster-adaptation",
        "F-network-over-integrator",
    }
    assert {row.verdict for row in learning.values()} == {"refuted", "reproduced"}


def test_the_page_says_what_the_ledger_says(learning):
    row = learning["F-representation"]
    tasks = ("one_dof", "two_dof_puncture", "two_dof_collision", "two_dof_combined")
    said = [[float(x.rstrip("%")) for x in Cells(task)] for task in tasks]
    by_place, by_speed = zip(*said, strict=True)
    assert Numbers(row.ours) == list(by_place)
    assert Numbers(row.reason) == list(by_speed)

    names = ("these settings", "as in the thesis", "no adaptation", "direct force")
    said = [Cells(name) for name in (*names, "integrator")]
    beside = [float(distance) for distance, _ in said]
    ours = Numbers(learning["F-learning-matters"].ours)
    assert ours == pytest.approx(beside, rel=0.01)
    these, thesis, none, _, integrator = (share.rstrip("%") for _, share in said)
    assert none == "100"
    for key, *shares in (
        ("F-learns", these, thesis),
        ("F-network-over-integrator", integrator, these),
    ):
        shown = re.findall(r"[\d.]+(?=%)", learning[key].ours)
        np.testing.assert_allclose(
            *(np.array(x, float) for x in (shown, shares)), rtol=0.01
        )
    faster = learning["F-faster-adaptation"].reason
    _, impact, settling = re.findall(r"[+-]([\d.]+)%", faster)
    said = " ".join(PAGE.split())
    assert (
        f"case III grows by {settling} %, and the first impact falls by {impact} %"
        in said
    )
    assert Numbers(learning["F-velocity-inputs"].ours)[0] > 99


def test_what_the_weight_adds_is_what_the_arm_does():
    """At rest and without any force the tool falls as the closed form says."""
    scenario = LoadScenario(LEARNING)
    change = {
        "controller.kind": "direct_force",
        "duration": 1e-3,
        "surgeon.velocity": [1e-9, 0.0],
        "environment.layers.tissue.stiffness": 0.0,
    }
    recording = simulate(LoadScenario(LEARNING, change))
    # D_e of the tissue acts along x alone.
    factor = np.array([1.5, 1.0])
    np.testing.assert_allclose(
        WeightDrift(scenario, [scenario.robot.start])[0],
        factor * recording["tool_acceleration"][0],
        rtol=1e-6,
    )


def test_distance_from_the_path_is_how_far_the_start_is_missed(thesis_runs):
    """At the end the hand is where it began."""
    recording = thesis_runs(LEARNING)
    beside = PathDistance(recording)
    missed = recording["tool_position"][-1] - recording.scenario.robot.start
    assert beside[0] == pytest.approx(0.0, abs=1e-12)
    assert beside[-1] == pytest.approx(np.linalg.norm(missed), abs=1e-5)


def test_replaying_the_update_law_learns_what_the_run_has_learned(thesis_runs):
    kind = {"controller.kind": "adaptive_backstepping"}
    recording = thesis_runs("two_dof_puncture", **kind)
    share = ReplayedShare(recording, BasisFunctions(recording))
    assert share == pytest.approx(UnlearnedShare(recording), abs=1e-5)
    assert share < 0.998


@pytest.mark.parametrize("which", ["W1", "W3"])
def test_what_leakage_leaves_and_how_long_it_takes(which):
    """The formulas of the page, from the law with a constant unknown."""
    G1, G2, nu, beta, active = 4.0, 30.0, 0.1, 0.1, 1.6
    # Each network for itself, and so that s and z hardly move one another: an unknown
    # of ds/dt moves z unless Psi = G1.
    is_first = which == "W1"
    gain, psi = (G1, G1) if is_first else (G2, 1e-3)
    one = np.eye(1)
    gains = BacksteppingGains(
        Lambda=one, G1=G1 * one, G2=G2 * one, P=one,
        beta1=beta * is_first, beta2=0.0, beta3=beta * (not is_first),
        nu1=nu, nu3=nu, Upsilon=0.0, Psi0=psi * one, Psi_min=1e-4,
    )  # fmt: skip
    Phi, zero = np.array([np.sqrt(active)]), np.zeros(1)

    def Rate(y, unknown=1.0):
        """The rate of [s, F_c - F_e, w], which is affine in them."""
        s, dF, w = y
        W1, W3 = (w, 0.0) if is_first else (0.0, w)
        state = BacksteppingState(
            np.array([dF]), np.array([[W1]]), gains.Psi0, np.array([[W3]])
        )
        rate = backstepping_rate(
            gains, state, Phi, zero, np.array([s]), zero, zero, zero
        )
        s_dot = psi * dF + unknown * is_first
        F_e_dot = unknown * (not is_first)
        w_dot = rate.W1 if is_first else rate.W3
        return np.array([s_dot, rate.F_c[0] - F_e_dot, w_dot[0, 0]])

    offset = Rate(np.zeros(3))
    A = np.column_stack([Rate(e, 0.0) for e in np.eye(3)])
    learned = np.sqrt(active) * np.linalg.solve(A, -offset)[2]
    assert 1 - learned == pytest.approx(nu * gain / (nu * gain + active), rel=1e-3)
    slowest = -np.linalg.eigvals(A).real.max()
    assert slowest == pytest.approx(beta * (active / gain + nu), rel=0.02)


@pytest.mark.slow
def test_the_extensions():
    """The verdicts, and each number that the page of the thesis has of them."""
    with ThesisRuns(1) as runs:
        runs.Prefetch(EXTENSION_REQUESTS)
        rows = {row.key: row for row in Extensions(Evidence(runs))}
    assert {key for key, row in rows.items() if row.verdict == "refuted"} == {
        "F-puma-first-impact",
        "F-drive-of-20",
        "F-robust-on-bone",
    }
    assert list(rows) == list(EXTENSIONS)
    page = (ROOT / "teleop_drake/docs/thesis.md").read_text("utf-8")
    said = page[page.index("## Section 6.3") : page.index("## Where this model")]
    for key, numbers in EXTENSIONS.items():
        for number in numbers.split():
            assert number in re.findall(r"[\d.]*\d", rows[key].ours), (key, number)
            assert number in re.findall(r"[\d.]*\d", said), number


@pytest.mark.slow
def test_the_price_of_learning():
    """What the page says of faster rates and longer delays."""

    def Run(**change):
        overrides = {path.replace("__", "."): x for path, x in change.items()}
        return simulate(LoadScenario(LEARNING, overrides), engine="compiled")

    slow = {"forward_channel__delay": 0.3, "return_channel__delay": 0.3}
    assert Run(**slow).termination == "diverged"
    assert Run(**slow, controller__adaptation_rate=0.0).termination == "completed"
    faster = Run(controller__adaptation_rate=2.0)
    distance = 1e3 * Rms(faster, PathDistance(faster))
    assert f"at 0.1 s, {distance:.1f} mm" in " ".join(PAGE.split())
    slow = {"forward_channel__delay": 0.2, "return_channel__delay": 0.2}
    assert Run(**slow).termination == "completed"
    twice = Run(**slow, controller__adaptation_rate=2.0)
    assert twice.termination == "diverged"
    for rate, time in ((0.1, 1.3), (10.0, 2.9)):
        change = {"controller.adaptation_rate": rate}
        run = simulate(LoadScenario("two_dof_combined", change), engine="compiled")
        settling = RunMetrics(run)["collision"]["settling_time"]
        assert f"{settling:.1f}" == str(time) and f"{time} s" in PAGE


def test_both_engines_run_it():
    overrides = {"duration": 0.5}
    drake, compiled = (
        simulate(LoadScenario(LEARNING, overrides), engine=engine)
        for engine in ("drake", "compiled")
    )
    assert np.abs(compiled["weights_1"][-1]).max() > 0.01
    for name in ("tool_position", "weights_1"):
        np.testing.assert_allclose(drake[name][-1], compiled[name][-1], atol=1e-6)


@pytest.mark.slow
def test_it_takes_a_network_where_the_unknown_changes_on_the_way():
    square = [[0.5, 0.0], [0.5, 0.5], [0.0, 0.5], [0.0, 0.0]]
    task = {
        "robot.start": [0.55, -0.25],
        "robot.posture": [-1.5, 2.2],
        "surgeon.waypoints": square * 4,
        "surgeon.velocity": [0.2, 0.0],
        "duration": 64.0,
        "controller.network.lower": [0.4, -0.4],
        "controller.network.upper": [1.2, 0.4],
    }
    said = " ".join(PAGE.split())
    for rate, count, width, ending in (
        (2.0, 5, 1.5, "mm beside its path"),
        (4.0, 1, 20.0, "mm. "),
    ):
        law = {"adaptation_rate": rate, "network.count": [count] * 2}
        law["network.width"] = width
        law = {f"controller.{name}": value for name, value in law.items()}
        scenario = LoadScenario(LEARNING, task | law)
        recording = simulate(scenario, engine="compiled")
        distance, time = PathDistance(recording), recording.time
        ends = np.linspace(0.0, scenario.surgeon.Path()[0][-1], 5)
        rounds = []
        for begin, end in itertools.pairwise(ends):
            kept = (time >= begin) & (time <= end)
            square_mean = np.trapezoid(distance[kept] ** 2, time[kept]) / (end - begin)
            rounds.append(f"{1e3 * np.sqrt(square_mean):.0f}")
        assert f"{', '.join(rounds[:3])} and {rounds[3]} {ending}" in said + " "


@pytest.mark.slow
def test_where_the_architectures_end():
    ends = {}
    for kind in ARCHITECTURES:
        scenario = LoadScenario(LEARNING, {"controller.kind": kind})
        recording = simulate(scenario, engine="auto")
        missed = recording["tool_position"][-1] - scenario.robot.start
        if recording.termination == "completed":
            ends[kind] = 1e3 * np.linalg.norm(missed)
    assert set(ARCHITECTURES) - set(ends) == {"time_domain_passivity"}
    ours, robust = ends.pop("adaptive_backstepping"), ends.pop("robust_backstepping")
    others = f"{min(ends.values()):.0f} mm or more"
    for text in (f"is {ours:.1f} mm off", f"robust law {robust:.1f} mm", others):
        assert text in " ".join(PAGE.split())
