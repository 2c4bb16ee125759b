"""The lattice of the Gaussian networks as plain data."""

import numpy as np
import pytest

from teleop_drake.architectures.lattice import MAX_BASIS_FUNCTIONS, NetworkConfig
from teleop_drake.validation import ScenarioError

GIVEN = {"lower": np.array([0.0, 1.0]), "upper": np.array([1.0, 3.0]), "count": [3, 5]}


def Network(**changes):
    return NetworkConfig(**(GIVEN | changes))


def test_it_makes_the_network():
    config = Network(width=2.0)
    config.Check("network", 2)
    centres = config.MakeNetwork().centres
    assert centres.shape == (15, 2)
    assert sorted(set(centres[:, 0])) == [0.0, 0.5, 1.0]
    assert sorted(set(centres[:, 1])) == [1.0, 1.5, 2.0, 2.5, 3.0]


def test_whether_anything_is_given():
    nothing = NetworkConfig(lower=None, upper=None, count=None)
    assert not nothing.is_given
    assert NetworkConfig(lower=None, upper=None, count=[3]).is_given


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lower": np.array([0.0])}, "network.lower = "),
        ({"upper": np.array([1.0, np.nan])}, "network.upper = "),
        ({"upper": np.array([1.0, 1.0])}, r"network.upper = .*> network.lower = "),
        ({"count": [3]}, r"network.count = \[3\]: must be a list of 2 whole numbers"),
        ({"count": [3, 0]}, r"network.count = \[3, 0\]: must be a list of 2 whole"),
        ({"count": [MAX_BASIS_FUNCTIONS, 2]}, "network.count = .* at most 10000 in"),
        ({"width": 0.0}, "network.width = 0.0: must be"),
    ],
)
def test_what_is_refused(changes, message):
    with pytest.raises(ScenarioError, match=message):
        Network(**changes).Check("network", 2)
