"""The built-in studies: what they vary, and what that does."""

import pytest

from teleop_drake.sweep.study import LoadStudy
from teleop_drake.thesis.runs import ADAPTIVE, DIRECT

pytestmark = pytest.mark.xdist_group("thesis")


def Axes(name):
    return LoadStudy(name).plans["one_dof"].axes


def test_located_boundaries_converge(thesis_runs):
    accuracies = Axes("tolerance")["simulator.accuracy"]
    change = {"duration": 18.0, "simulator.max_step_size": 0.1}
    for accuracy, allowed in ((accuracies[0], 0.06), (1e-7, 2e-3), (1e-9, 5e-4)):
        assert accuracy in accuracies
        run = thesis_runs("one_dof", DIRECT, change, {"simulator.accuracy": accuracy})
        force = run.Number("collision.peak_force")
        assert force == pytest.approx(15.74e-3, rel=allowed)


def test_only_psi0_moves_the_numbers_of_the_collision(thesis_runs):
    spread = {}
    for key, values in Axes("sensitivity").items():
        if key != "controller":
            runs = [thesis_runs.Short("one_dof", ADAPTIVE, {key: x}) for x in values]
            forces = [run.Number("collision.initial_impact_force") for run in runs]
            spread[key] = max(forces) / min(forces) - 1
    assert spread.pop("controller.initial_psi") > 0.05
    assert max(spread.values()) < 0.02
