"""What settings make of a scenario."""

import pytest

from teleop_drake.driving.settings import LoadDriven, Settings
from teleop_drake.scenario import LoadScenario, ScenarioError


def test_each_setting_arrives_where_it_belongs():
    base = LoadScenario("one_dof", {"return_channel.delay": 0.3})
    plain = Settings(controller="direct_force").Overrides(base)
    # The delays of the scenario stay as long as nobody changes them.
    assert plain == ["controller.kind='direct_force'"]
    settings = Settings(controller="direct_force", delay=0.2, loss=0.1, stiffness=2.0)
    scenario = LoadDriven("one_dof", settings.Overrides(base))
    for channel in (scenario.forward_channel, scenario.return_channel):
        assert (channel.kind, channel.delay) == ("network", 0.2)
        assert (channel.loss.kind, channel.loss.probability) == ("independent", 0.1)
    for layer, driven in zip(
        base.environment.layers, scenario.environment.layers, strict=True
    ):
        assert driven.stiffness == 2 * layer.stiffness
    assert str(settings) == (
        "direct_force, 0.2 s each way, 10 % lost, 2 times as stiff"
    )


def test_a_tracking_has_no_operator():
    with pytest.raises(ScenarioError, match="there is no operator"):
        LoadDriven("network_tracking_linear", [])
