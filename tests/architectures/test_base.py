"""What an architecture of one's own gets from the bases."""

from dataclasses import dataclass

import pytest
from blocks import Feedthrough

from teleop_drake.architectures.adaptive_backstepping import AdaptiveBackstepping
from teleop_drake.architectures.base import (
    ArchitectureConfig,
    ControlLawConfig,
    MakeLawArchitecture,
    MakeSlaveStation,
)
from teleop_drake.architectures.direct_force import DirectForce
from teleop_drake.architectures.facts import Facts
from teleop_drake.scenario import LoadScenario
from teleop_drake.systems.haptic_device import HapticDevice


@dataclass(kw_only=True, eq=False)
class Own(ControlLawConfig):
    kind = "own"
    gain: float = 2.0

    def MakeControlLaw(self, facts: Facts, path: str) -> DirectForce:
        law = DirectForce(num_axes=facts.num_axes)
        law.set_name(f"gain_{self.gain:g}")
        return law


def test_nothing_derives_unless_a_config_says_so():
    config = Own()
    assert not config.has_gains_of_delay
    config.Check("controller", 2)
    facts = LoadScenario("two_dof_combined").Facts()
    assert config.Resolve(facts, "controller") is config


def test_a_law_becomes_the_slave_side():
    facts = LoadScenario("two_dof_combined").Facts()
    sides = Own().MakeArchitecture(facts, "controller")
    assert sides.slave_side.get_name() == "controller"
    assert sides.slave_side.HasSubsystemNamed("gain_2")
    assert sides.initial_return_packet == [*facts.start, 0.0, 0.0]
    assert sides.initial_forward_packet == [0.0] * 4


def test_the_bases_are_abstract():
    for base in (ArchitectureConfig, ControlLawConfig):
        with pytest.raises(TypeError, match="abstract"):
            base()


def test_telemetry_leaves_the_station_by_its_name():
    scenario = LoadScenario("one_dof")
    controller = scenario.controller.Chosen()
    law = controller.MakeControlLaw(scenario.Facts(), "controller")
    assert isinstance(law, AdaptiveBackstepping)
    names = {law.get_output_port(i).get_name() for i in range(law.num_output_ports())}
    station = MakeSlaveStation(law)
    outputs = {
        station.get_output_port(i).get_name() for i in range(station.num_output_ports())
    }
    assert outputs == names | {"return_packet"}
    assert Feedthrough(station)["return_packet"] == {"tool_position", "tool_velocity"}


def test_what_is_no_law_is_refused():
    device = HapticDevice(numerator=[50.0], denominator=[1.0, 1.0], num_axes=1)
    with pytest.raises(RuntimeError, match="control_force"):
        MakeLawArchitecture(device, [0.0])
