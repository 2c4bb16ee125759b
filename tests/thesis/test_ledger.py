"""The ledger: its verdicts follow from the runs."""

import dataclasses
from importlib import resources

import numpy as np
import pytest

from teleop_drake.laws.backstepping import BacksteppingGains, unpack_state
from teleop_drake.laws.gaussian_network import GaussianNetwork, gaussian_functions
from teleop_drake.tasks.metrics import RunMetrics
from teleop_drake.thesis.claims.chapter4 import Chapter4
from teleop_drake.thesis.claims.chapter5 import CaseI, CaseII
from teleop_drake.thesis.claims.claim import VERDICTS, PrintedNumber, Row, Statement
from teleop_drake.thesis.claims.evidence import Evidence
from teleop_drake.thesis.claims.requests import SHORT
from teleop_drake.thesis.claims.separate_updates import SeparateRate
from teleop_drake.thesis.ledger import ShortLedger

pytestmark = pytest.mark.xdist_group("thesis")

REFUTED = {
    "3-slightly-more",
    "3-effects-of-delay",
    "4-delay-of-channels",
    "4-no-start-overshoot",
    "4-adapts-quickly",
    "5-I-no-overshoot",
    "5-I-less-force",
    "5-I-networks",
    "5-II-direct-position",
    "5-II-direct-unstable-x",
    "5-II-direct-unstable-y",
    "5-II-larger-gains",
    "5-II-sluggish",
    "5-II-less-force",
    "5-II-less-variation",
    "5-III-lower-first-impact",
    "5-III-direct-unstable-x",
    "5-III-sluggish",
    "5-III-less-force",
    "5-III-less-variation",
    "6-rest-without-delay",
    "6-delay-causes-overshoot",
    "6-outperforms",
    "6-slows-down",
    "6-guarantees-stability",
    "6-adds-robustness",
    "6-tuning-functions-learn",
    "6-tuning-functions-filter",
    "A-adaptation-matters",
    "A-I-retuned",
    "A-II-retuned",
    "A-III-retuned",
    "A-rest-on-bone",
}
IN_KIND = {
    *(f"3-I-{name}" for name in ("max-x", "max-z", "rms-x", "rms-z")),
    *(f"3-II-{name}" for name in ("max-x", "max-z", "rms-x", "rms-z")),
    "4-adaptive-overshoot",
    "4-overshoot-reduction",
    "4-direct-rebound",
    "4-rebound-reduction",
    "4-direct-first-impact",
    "4-direct-largest-force",
    "4-force-reduction",
}


@pytest.fixture(scope="module")
def rows(ledger):
    return {row.key: row for row in ledger}


class Changed:
    """Runs of which some recordings are tampered with."""

    def __init__(self, runs, name, kind, change):
        self._runs = runs
        self._which = (name, kind)
        self._change = change

    def __call__(self, name, /, **overrides):
        recording = self._runs(name, **overrides)
        if (name, overrides.get("controller.kind")) != self._which:
            return recording
        signals = {key: x.copy() for key, x in recording.signals.items()}
        changed = dataclasses.replace(recording, signals=signals)
        self._change(changed)
        return changed


def Verdicts(section, runs):
    return {row.key: row.verdict for row in section(Evidence(runs))}


def test_every_row_is_complete(rows, ledger):
    assert len(rows) == len(ledger), "keys are unique"
    for row in rows.values():
        fields = dataclasses.asdict(row)
        assert all(isinstance(value, str) for value in fields.values())
        assert all(value for name, value in fields.items() if name != "reason")
        assert row.verdict in VERDICTS
        assert "nan" not in row.ours.split()


def test_what_is_refuted(rows):
    by_verdict = {verdict: set() for verdict in VERDICTS}
    for row in rows.values():
        by_verdict[row.verdict].add(row.key)
    assert by_verdict["refuted"] == REFUTED
    assert by_verdict["reproduced in kind"] == IN_KIND
    assert not by_verdict["not determinable"]


@pytest.mark.parametrize(
    ("key", "ours"),
    [
        ("4-direct-overshoot", 0.4693),
        ("4-adaptive-overshoot", 0.2524),
        ("4-direct-puncture-force", 0.5725),
        ("4-adaptive-puncture-force", 0.5720),
        ("4-direct-first-impact", 8.657),
        ("4-adaptive-first-impact", 9.506),
        ("4-direct-largest-force", 15.74),
        ("4-adaptive-largest-force", 9.506),
        ("4-direct-rebound", -1.229),
        ("4-adaptive-rebound", -0.6693),
        ("4-overshoot-reduction", 46.2),
        ("4-rebound-reduction", 45.5),
        ("4-force-reduction", 39.6),
    ],
)
def test_numbers_of_chapter_4(rows, key, ours):
    assert float(rows[key].ours.split()[0]) == pytest.approx(ours, rel=2e-3)


def test_short_runs_have_the_metrics_of_the_full_ones(thesis_runs):
    for name, short in SHORT.items():
        if name == "two_dof_puncture":
            continue
        kind = {"controller.kind": "adaptive_backstepping"}
        full = RunMetrics(thesis_runs(name, **kind))
        metrics = RunMetrics(thesis_runs(name, **kind, **short))
        for part in ("puncture", "collision"):
            if full[part] is not None:
                assert metrics[part] == pytest.approx(full[part], rel=1e-3)


def test_a_quicker_tool_changes_the_verdicts_of_chapter_4(thesis_runs):
    def Hurry(recording):
        # In free space only, so that the puncture stays what it is.
        free = recording["environment_layer"][:, 0] == 1
        recording["tool_velocity"][free] += 0.5e-3

    runs = Changed(thesis_runs, "one_dof", "adaptive_backstepping", Hurry)
    verdicts = Verdicts(Chapter4, runs)
    assert verdicts["4-adaptive-overshoot"] == "refuted"
    assert verdicts["4-overshoot-reduction"] == "refuted"
    assert verdicts["4-direct-overshoot"] == "reproduced"


def test_a_tool_without_overshoot_turns_a_refuted_claim(thesis_runs):
    def Limit(recording):
        v = np.minimum(recording["tool_velocity"], 0.1)
        steps = np.diff(recording.time)[:, np.newaxis] * (v[1:] + v[:-1]) / 2
        p = recording["tool_position"]
        p[1:] = p[0] + np.cumsum(steps, axis=0)
        recording["tool_velocity"][:] = v
        recording["tool_acceleration"][:] = 0.0

    runs = Changed(thesis_runs, "two_dof_puncture", "adaptive_backstepping", Limit)
    verdicts = Verdicts(CaseI, runs)
    assert verdicts["5-I-no-overshoot"] == "reproduced"


def test_a_jump_of_the_control_force_is_seen(thesis_runs):
    def Jump(recording):
        i = int(np.flatnonzero(np.diff(recording.time) == 0)[-1])
        recording["control_force"][i + 1 :] += 1.0

    name = "two_dof_collision"
    runs = Changed(thesis_runs, name, "adaptive_backstepping", Jump)
    assert Verdicts(CaseII, runs)["5-II-no-jumps"] == "refuted"
    verdicts = Verdicts(CaseII, thesis_runs)
    assert verdicts["5-II-no-jumps"] == "reproduced"


def test_tolerances():
    place = {"key": "key", "place": "", "claim": ""}

    def Verdict(ours, holds, is_fitted=False):
        return PrintedNumber(
            **place,
            printed=2.0,
            ours=ours,
            unit=(1.0, "m"),
            tolerance=0.1,
            in_kind="",
            is_in_kind=holds,
            is_fitted=is_fitted,
        ).verdict

    assert Verdict(2.199, False) == "reproduced"
    assert Verdict(2.201, True) == "reproduced in kind"
    assert Verdict(2.201, False) == "refuted"
    assert Verdict(2.0, True, is_fitted=True) == "reproduced in kind"
    assert Verdict(float("nan"), False) == "refuted"
    undecided = Statement(**place, criterion="", holds=None, ours="")
    assert undecided.verdict == "not determinable"


def test_as_many_fields_are_fitted_as_the_rows_say(rows):
    file = (
        resources.files("teleop_drake") / "scenarios" / "network_tracking_linear.yaml"
    )
    assert file.read_text("utf-8").count(" fitted") == 8
    assert "Eight fields" in rows["3-I-max-x"].reason


def test_separate_updates_follow_the_errors_of_their_stages():
    """W1 and Psi by P s, W3 by z; dF_c/dt by (5.30), (5.31) with these rates."""
    rng = np.random.default_rng(1)
    n = 2
    A, B = rng.normal(size=(2, n, n))
    gains = BacksteppingGains(
        Lambda=np.eye(n), P=np.eye(n) + A @ A.T / 9,
        G1=4 * np.eye(n), G2=30 * np.eye(n),
        beta1=0.3, beta2=0.2, beta3=0.1, nu1=0.4, nu3=0.5, Upsilon=0.6,
        Psi0=np.eye(n) + B / 9, Psi_min=1e-3,
    )  # fmt: skip
    network = GaussianNetwork(lower=[0, 0], upper=[1, 1], count=[2, 3], width=1.0)
    N = network.num_functions
    x = rng.normal(size=n + 2 * n * N + n * n)
    x[n + n * N : n + n * N + n * n] = (3 * np.eye(n) + A / 9).ravel()
    F_c, W1, Psi, W3 = unpack_state(x, n)
    r, v, v_dd, F_e, F_hd = rng.uniform(size=(5, n))
    taken = gains, network, x, r, v, v_dd, F_e, F_hd
    rate = unpack_state(SeparateRate(*taken), n)

    Phi, Phi_dot = gaussian_functions(r, v, network.centres, network.widths)
    s = v - v_dd + F_e - F_hd
    inverse = np.linalg.inv(Psi)
    offset = inverse @ (W1 @ Phi + 4 * s)
    z, g = F_c - F_e + offset, gains.P @ s
    W1_dot = 0.3 * (np.outer(g, Phi) - 0.4 * W1)
    Psi_dot = 0.2 * (np.outer(g, F_c - F_e) + 0.6 * (gains.Psi0 - Psi))
    s_dot = Psi @ (F_c - F_e) + W1 @ Phi
    alpha_dot = W3 @ Phi + inverse @ (
        Psi_dot @ offset - W1_dot @ Phi - W1 @ Phi_dot - 4 * s_dot
    )
    np.testing.assert_allclose(rate.W1, W1_dot)
    np.testing.assert_allclose(rate.Psi, Psi_dot)
    np.testing.assert_allclose(rate.W3, 0.1 * (-np.outer(z, Phi) - 0.5 * W3))
    np.testing.assert_allclose(rate.F_c, alpha_dot - Psi.T @ g - 30 * z)


def test_short_ledger(rows):
    lines = ShortLedger(list(rows.values())).splitlines()
    assert len(lines) == 12
    assert all(line.count("|") == 6 for line in lines)
    assert "refuted" in lines[5]
    with pytest.raises(KeyError):
        ShortLedger([])


def test_row_fields():
    names = [field.name for field in dataclasses.fields(Row)]
    assert names[0] == "key"
    assert {"place", "thesis", "ours", "tolerance", "verdict", "reason"} <= set(names)
