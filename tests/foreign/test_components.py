"""The names of components: of Drake's plants, behind delays, and in recordings."""

import itertools

from foreign.manipulation import ArmOfAModelInstance
from numpy.testing import assert_array_equal
from pydrake.examples import AcrobotPlant
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    Demultiplexer,
    Gain,
    PassThrough,
    ZeroOrderHold,
)

from teleop_drake.loops import TransportDelay, simulate
from teleop_drake.loops.engine.components import ComponentsIn
from teleop_drake.loops.framework.signals import SelectSignals
from teleop_drake.loops.run.recording import ReadRecording, Recording

STATE = ["theta1", "theta2", "theta1dot", "theta2dot"]


def LateAcrobot():
    """An acrobot whose state is delayed, held, split and multiplied."""
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", AcrobotPlant())
    chain = [
        plant.get_output_port(),
        *(
            builder.AddNamedSystem(name, block)
            for name, block in [
                ("late", TransportDelay(0.1, 4)),
                ("hold", ZeroOrderHold(0.01, 4)),
                ("parts", Demultiplexer([3, 1])),
            ]
        ),
        builder.AddNamedSystem("twice", Gain(2.0, 3)),
    ]
    for source, target in itertools.pairwise(chain):
        port = source if source is chain[0] else source.get_output_port(0)
        builder.Connect(port, target.get_input_port())
    builder.ExportInput(plant.get_input_port(), "torque")
    builder.ExportOutput(chain[1].get_output_port(), "seen")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, [0.0])
    return diagram, context


def test_names_pass_through_what_does_not_mix_them():
    diagram, _ = LateAcrobot()
    names = ["hold.y", "parts.y0", "parts.y1", "twice.y0", "seen"]
    found = ComponentsIn(diagram, SelectSignals(diagram, names))
    assert found == {"hold.y": STATE, "parts.y0": STATE[:3], "seen": STATE}


def test_names_in_a_ring_of_blocks_that_pass_on_are_none():
    builder = DiagramBuilder()
    late = builder.AddNamedSystem("late", TransportDelay(0.1, 2))
    same = builder.AddNamedSystem("same", PassThrough(2))
    builder.Connect(late.get_output_port(), same.get_input_port())
    builder.Connect(same.get_output_port(), late.get_input_port())
    diagram = builder.Build()
    assert ComponentsIn(diagram, SelectSignals(diagram, None)) == {}


def test_a_plant_names_states_motors_and_what_leads_to_them():
    builder = DiagramBuilder()
    ArmOfAModelInstance(builder)
    diagram = builder.Build()
    plant = diagram.GetSubsystemByName("plant")
    names = ["plant.state", "plant.arm_state", "plant.net_actuation", "law.control"]
    found = ComponentsIn(diagram, SelectSignals(diagram, names))
    state = plant.GetStateNames(add_model_instance_prefix=False)
    assert found["plant.state"] == found["plant.arm_state"] == state
    motors = plant.GetActuatorNames(add_model_instance_prefix=False)
    assert found["plant.net_actuation"] == found["law.control"] == motors
    assert isinstance(diagram.GetSubsystemByName("law"), PidController)


def test_recordings_have_the_names_in_tables_and_files(tmp_path):
    diagram, context = LateAcrobot()
    recording = simulate(diagram, context=context, duration=0.2)
    assert recording.components == {"seen": STATE}
    table = recording.to_dataframe()
    assert_array_equal(table["seen", "theta2"], recording["seen"][:, 1])
    recording.WriteCsv(tmp_path / "run.csv")
    head = (tmp_path / "run.csv").read_text("utf-8").partition("\n")[0]
    assert head == ",".join(["time_s", *(f"seen[{name}]" for name in STATE)])
    recording.Save(tmp_path / "run.npz")
    again = ReadRecording(tmp_path / "run.npz", lambda _: Recording)
    assert again.components == recording.components
