"""What inputs change in a run: the numbers of a run at any of their values."""

import numpy as np
import pytest

from teleop_drake.page import MakePage
from teleop_drake.page.inputs import Added, CheckSums, FindChange, NotSums, Stops
from teleop_drake.page.model import ModelOf
from teleop_drake.scenario import LoadScenario, ScenarioError

STIFFNESS = "environment.layers.bone.stiffness"


def Make(values, name="one_dof", more=()):
    return ModelOf(LoadScenario(name, {**dict(more), **values}))


def Change(key, low, high, at, **more):
    are_whole = key.endswith("seed")
    stops = Stops(low, high, at, are_whole=are_whole)
    change = FindChange(
        key, low, high, at, lambda v: Make({key: v}, **more), stops, are_whole=are_whole
    )
    return stops, change


def test_another_one_has_stops():
    """The first estimate is the inverse of the mass."""
    law = {"controller.kind": "adaptive_backstepping", "controller.initial_psi": "auto"}
    stops, change = Change("robot.mass", 0.5, 3.0, 2.0, more=law)
    assert change.stops and not change.slopes
    base = Make({"robot.mass": 2.0}, more=law).numbers
    for name, expected in Make({"robot.mass": stops[7]}, more=law).numbers.items():
        z = Added(base[name], base[name], name, stops[7], 2.0, stops, change)
        np.testing.assert_allclose(z, expected, rtol=1e-9, atol=1e-15)


def test_what_changes_nothing_or_the_program_is_refused():
    with pytest.raises(ScenarioError, match="another one"):
        Change("forward_channel.delay", 0.0, 0.2, 0.1)
    vary = {"controller.initial_psi": (1.0, 8.0)}
    with pytest.raises(ScenarioError, match="changes something"):
        MakePage("one_dof", controllers=["direct_force"], vary=vary)


def test_an_input_may_change_one_controller_of_two():
    page = MakePage("one_dof", vary={"controller.initial_psi": (1.0, 8.0)})
    direct, adaptive = (x["changes"] for x in page.data["controllers"])
    assert not direct["controller.initial_psi"]["slopes"]
    assert adaptive["controller.initial_psi"]["slopes"]


def test_two_inputs_whose_product_enters_are_refused():
    line = {"x": np.array([2.0])}

    class Product:
        def __init__(self, values):
            a, b = values.get("a", 1.0), values.get("b", 2.0)
            self.numbers = {"x": np.array([a * b])}
            self.structure = ()

    inputs = {}
    for key, at in (("a", 1.0), ("b", 2.0)):
        change = FindChange(
            key, 0.5, 3.0, at, lambda v, k=key: Product({k: v}), [], are_whole=False
        )
        inputs[key] = at, (0.5, 3.0), change
    with pytest.raises(NotSums, match=r"^a, b: .*change x together"):
        CheckSums(line, inputs, Product)
