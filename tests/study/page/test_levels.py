"""Pictures of any diagram's levels: names, ports, and systems by themselves."""

import pytest
from foreign.wiring import SerialArm
from pydrake.examples import PendulumPlant
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Gain, PassThrough

from teleop_drake import WriteDiagram


def MakeUnnamed():
    """Returns a diagram whose parts have no names, one of them a diagram."""
    builder = DiagramBuilder()
    inner = DiagramBuilder()
    gain = inner.AddSystem(Gain(1.0, 2))
    inner.ExportInput(gain.get_input_port())
    inner.ExportOutput(gain.get_output_port())
    part = builder.AddSystem(inner.Build())
    gains = [builder.AddSystem(Gain(2.0, 2)) for _ in range(2)]
    builder.Connect(part.get_output_port(), gains[0].get_input_port())
    builder.Connect(gains[0].get_output_port(), gains[1].get_input_port())
    builder.ExportInput(part.get_input_port())
    return builder.Build()


def MakeArm():
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", PassThrough(1))
    plant = builder.AddSystem(SerialArm([0.5]))
    builder.Connect(source.get_output_port(), plant.get_actuation_input_port())
    builder.ExportInput(source.get_input_port())
    diagram = builder.Build()
    diagram.set_name("arm")
    return diagram


def MakeOdd():
    """Returns a diagram with control characters in its names."""
    builder = DiagramBuilder()
    gain = builder.AddNamedSystem("one\x00two\n", PassThrough(1))
    builder.ExportInput(gain.get_input_port(), "in\rput")
    builder.ExportOutput(gain.get_output_port(), "out\x01put")
    diagram = builder.Build()
    diagram.set_name("odd\x0b")
    return diagram


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("make", "boxes", "port", "crumbs"),
    [
        (MakeUnnamed, {"Diagram", "Gain1", "Gain2"}, "u0", "Diagram"),
        (MakeArm, {"plant", "source"}, "generalized_acceleration", "arm"),
        (PendulumPlant, {""}, "tau", "PendulumPlant"),
        (MakeOdd, {"one␀two␊"}, "y", "odd␋"),
    ],
    ids=["unnamed", "many ports", "no diagram", "control characters"],
)
def test_boxes_have_names_and_tell_all_their_ports(
    look, tmp_path, make, boxes, port, crumbs
):
    page = tmp_path / "page.html"
    WriteDiagram(make(), page)
    found = look(page, "ports.js")
    assert {box for box in found["boxes"] if box or boxes == {""}} == boxes
    assert found["crumbs"] == crumbs
    assert port in found["ports"].partition("Other ports: ")[2]
