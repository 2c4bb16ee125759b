"""What an architecture of one's own gets from the bases."""

from block_checks import Feedthrough

from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    AdaptiveBackstepping,
)
from teleop_drake.model.blocks.architectures.base import (
    MakeSlaveStation,
)
from teleop_drake.model.scenario import LoadScenario


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
