"""Scenarios and recordings can be pickled, and configs refuse misspelt fields."""

import copy
import dataclasses
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import pytest
from numpy.testing import assert_array_equal

from teleop_drake import LoadScenario, simulate
from teleop_drake.loops.framework.validation import FixedFields
from teleop_drake.model.kinds import KindConfig


@pytest.mark.parametrize("name", ["two_dof_learning", "network_tracking_linear"])
def test_scenarios_are_pickled_and_copied(name):
    scenario = LoadScenario(name, ["simulator.accuracy=1e-5"])
    for twin in (pickle.loads(pickle.dumps(scenario)), copy.deepcopy(scenario)):
        assert twin == scenario
        twin.simulator.accuracy = 1e-4
        assert scenario.simulator.accuracy == 1e-5


@pytest.mark.slow
def test_runs_of_other_processes_are_the_same():
    scenario = LoadScenario("one_dof", {"duration": 0.05})
    here = simulate(scenario)
    # As with joblib, the new process inherits nothing from this one.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as executor:
        there = executor.submit(simulate, scenario).result()
    assert there.scenario == scenario
    assert there.signals.keys() == here.signals.keys()
    for name, samples in here.signals.items():
        assert_array_equal(there[name], samples)


def Configs(value):
    """Yields a config and the configs inside it."""
    if dataclasses.is_dataclass(value):
        yield value
        for item in dataclasses.fields(value):
            yield from Configs(getattr(value, item.name))
    elif isinstance(value, list):
        for element in value:
            yield from Configs(element)


@pytest.mark.parametrize("name", ["one_dof", "network_tracking_coupled"])
def test_every_config_refuses_a_misspelt_field(name):
    configs = list(Configs(LoadScenario(name)))
    if name == "one_dof":
        assert len(configs) > 15
    for config in configs:
        assert isinstance(config, FixedFields)
        with pytest.raises(AttributeError, match=r"^dely = 0\.3: .*has no such field"):
            config.dely = 0.3


def test_the_refusal_says_what_was_meant():
    channel = LoadScenario("one_dof").forward_channel
    with pytest.raises(AttributeError, match=r"did you mean 'delay'\?"):
        channel.dely = 0.3
    channel.delay = 0.3
    assert channel.delay == 0.3


def test_a_kind_of_ones_own_has_its_own_fields():
    @dataclasses.dataclass(kw_only=True)
    class Mine(KindConfig):
        gain: float = 1.0
        points: list[float] = dataclasses.field(default_factory=list)

    mine = Mine(gain=2.0)
    mine.points = [1.0]
    mine._seen = True
    with pytest.raises(AttributeError, match="Mine has no such field"):
        mine.gian = 3.0
