"""What inputs change in a run: the numbers of a run at any of their values."""

import numpy as np
import pytest

from teleop_drake import MakePage
from teleop_drake.loops.page.inputs import CheckSums, FindChange, Input, NotSums
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.study.page.scenario_model import ModelOf

STIFFNESS = "environment.layers.bone.stiffness"


def Make(values, name="one_dof", more=()):
    return ModelOf(LoadScenario(name, {**dict(more), **values}))


def Change(key, low, high, at, **more):
    one = Input(key=key, low=low, high=high, value=at, label=key, owners=[])
    return FindChange(one, lambda values: Make(values, **more))


@pytest.mark.slow
def test_another_one_has_stops():
    """The first estimate is the inverse of the mass."""
    law = {"controller.kind": "adaptive_backstepping", "controller.initial_psi": "auto"}
    change = Change("robot.mass", 0.5, 3.0, 2.0, more=law)
    assert change.stops and not change.slopes
    base = Make({"robot.mass": 2.0}, more=law).numbers
    mass = change.values[7]
    for name, expected in Make({"robot.mass": mass}, more=law).numbers.items():
        z = change.Added(name, base[name], base[name], mass)
        np.testing.assert_allclose(z, expected, rtol=1e-9, atol=1e-15)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(("own", "other"), [(0.1, 0.0), (0.0, 0.1)])
def test_a_delay_reaches_zero(own, other):
    change = Change("forward_channel.delay", 0.0, 0.2, own)
    base = Make({"forward_channel.delay": own}).numbers
    for name, expected in Make({"forward_channel.delay": other}).numbers.items():
        z = change.Added(name, base[name], base[name], other)
        np.testing.assert_allclose(z, expected, rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_what_changes_nothing_or_the_program_is_refused():
    with pytest.raises(ScenarioError, match="another one"):
        Change("actuator.coulomb_friction", 0.0, 0.2, 0.1)
    vary = {"controller.initial_psi": (1.0, 8.0)}
    with pytest.raises(ScenarioError, match="changes something"):
        MakePage("one_dof", controllers=["direct_force"], vary=vary)


@pytest.mark.slow
def test_an_input_may_change_one_controller_of_two():
    page = MakePage("one_dof", vary={"controller.initial_psi": (1.0, 8.0)})
    direct, adaptive = (x["changes"] for x in page.data["controllers"])
    assert not direct["controller.initial_psi"]["slopes"]
    assert adaptive["controller.initial_psi"]["slopes"]


def Product(a, b):
    return a * b


def AtMixedCorners(a, b):
    """It is 0 where one input has its own value, and where both are low, or high."""
    return (a - 0.5) * (b - 0.5) * (a - b) ** 2


@pytest.mark.parametrize("function", [Product, AtMixedCorners])
def test_two_inputs_that_change_a_number_together_are_refused(function):
    class Run:
        structure = ()

        def __init__(self, values):
            x = function(values.get("a", 0.5), values.get("b", 0.5))
            sums = values.get("a", 0.5) + values.get("b", 0.5)
            self.numbers = {"x": np.array([x + sums])}

    changes = {}
    for key in "ab":
        one = Input(key=key, low=0.0, high=1.0, value=0.5, label=key, owners=[])
        changes[key] = FindChange(one, Run)
    with pytest.raises(NotSums, match=r"^a, b: .*change x together"):
        CheckSums(Run({}).numbers, changes, Run)
