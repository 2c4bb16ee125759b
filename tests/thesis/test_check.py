"""Tests of the comparison with the published ledger."""

import pytest

from teleop_drake.cli import main
from teleop_drake.thesis import check
from teleop_drake.thesis.check import Agree, CheckClaims, Outcome, Published

pytestmark = pytest.mark.xdist_group("thesis")


@pytest.mark.slow
def test_the_published_ledger_is_that_of_the_runs(ledger):
    """Where a claim or the model has changed, its row has to change, too."""
    published = Published()
    assert [row.key for row in ledger] == list(published)
    for row in ledger:
        assert Agree(published[row.key], Outcome(row)), row.key


@pytest.mark.parametrize(
    ("expected", "found", "agrees"),
    [
        ("reproduced: 1.000 N", "reproduced: 1.009 N", True),
        ("reproduced: 1.000 N", "reproduced: 1.012 N", False),
        ("reproduced: 1.000 N", "refuted: 1.000 N", False),
        ("reproduced: 22 contacts", "reproduced: 23 contacts", False),
        ("reproduced: x 0.7%", "reproduced: x 0.65%", True),
        ("reproduced: never", "reproduced: 3 s", False),
        ("reproduced: 1.0e-05 m", "reproduced: 1.2e-05 m", False),
        ("reproduced: 0 mN", "reproduced: 2.9e-14 mN", True),
        ("reproduced: 0 mN", "reproduced: 1e-6 mN", False),
        ("reproduced: 1e-10 m", "reproduced: 2e-10 m", False),
        ("reproduced: -0.5", "reproduced: 0.5", False),
    ],
)
def test_outcomes_agree(expected, found, agrees):
    assert Agree(expected, found) is agrees


def test_only_some_claims(thesis_runs):
    (claim,) = CheckClaims(["4-settling"], thesis_runs)
    assert claim.passes and claim.key == "4-settling"
    assert claim.seconds >= 0


def test_a_claim_that_differs_ends_with_exit_code_1(monkeypatch, capsys):
    published = Published()
    key = "3-effects-of-delay"
    arguments = ["reproduce", "--check", "--only", key, "--quiet"]
    assert main(arguments) == 0
    head, row, last = capsys.readouterr().out.splitlines()
    names = ["claim", "expected", "tolerance", "found", "command", "seconds"]
    assert head.split() == names
    assert row.startswith(key) and row.endswith("ok")
    assert last == "1 claims, of which 0 differ"
    changed = published | {key: "reproduced: 2 channels"}
    monkeypatch.setattr(check, "Published", lambda: changed)
    assert main(arguments) == 1
    assert "DIFFERS" in capsys.readouterr().out


def test_an_unknown_claim_is_refused(capsys):
    assert main(["reproduce", "--check", "--only", "4-setling"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "claim = '4-setling': must be one of" in line
    assert "did you mean '4-settling'?" in line
