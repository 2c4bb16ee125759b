"""Tests of the fields of configs that are checked."""

import math
from dataclasses import dataclass

import pytest

from teleop_drake.loops.framework.validation import (
    REQUIRED,
    FixedFields,
    Number,
    ScenarioError,
)


@dataclass(kw_only=True)
class Spring(FixedFields):
    stiffness: float = Number(REQUIRED, "N/m", above=0)
    share: float | None = Number(None, minimum=0, maximum=1)
    free: float = 0.0


@dataclass(kw_only=True)
class StiffSpring(Spring):
    stiffness: float = 1e3


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (Spring(), r"a.stiffness = null: must be a finite number > 0 \(N/m\)"),
        (StiffSpring(stiffness=0.0), "stiffness = 0.0: .* > 0"),
        (StiffSpring(share=1.5), "share = 1.5: .* >= 0 and <= 1"),
        (StiffSpring(share=math.nan), "share = nan"),
    ],
)
def test_a_number_has_its_limits(config, message):
    with pytest.raises(ScenarioError, match=message):
        config.CheckNumbers("a")


def test_other_fields_and_null_are_free():
    StiffSpring(free=-1.0, share=None).CheckNumbers()
    with pytest.raises(ScenarioError, match=r"^share"):
        StiffSpring(share=-1.0).CheckNumbers()
