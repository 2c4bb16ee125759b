"""The ten rows in the documentation are those of the ledger."""

import re
from pathlib import Path

import pytest

from teleop_drake.thesis.ledger import ShortLedger

pytestmark = pytest.mark.xdist_group("thesis")

PAGE = Path(__file__).parents[2] / "teleop_drake" / "docs" / "thesis.md"
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def test_short_ledger_stands_in_the_documentation(ledger):
    """Word for word, and each number within one per cent."""
    now = ShortLedger(ledger).strip()
    header = now.splitlines()[0]
    text = PAGE.read_text("utf-8")
    committed = text[text.index(header) :][: len(now) + 200].split("\n\n")[0]
    assert NUMBER.sub("#", committed) == NUMBER.sub("#", now)
    for old, new in zip(NUMBER.findall(committed), NUMBER.findall(now), strict=True):
        assert float(old) == pytest.approx(float(new), rel=0.01)
