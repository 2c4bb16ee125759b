"""Which cases of a grid belong to the short run of the tests."""

from collections.abc import Sequence

import pytest


def Slow(cases: Sequence, *, but: Sequence[int] = (0,)) -> list:
    """Returns the cases for pytest.mark.parametrize, marked slow.

    `but` are the indices of those that the short run needs.
    """
    return [
        case
        if i in but
        else pytest.param(
            *(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow
        )
        for i, case in enumerate(cases)
    ]
