"""The pictures of rendering.py: reproducible, complete, and of the right format."""

import base64
import os
import re
import shlex
import struct
import subprocess
import sys
import zlib
from importlib import metadata
from xml.etree import ElementTree

import numpy as np
import pytest
from drake import lcmt_scope
from pydrake.geometry import (
    DrakeVisualizer,
    Meshcat,
    MeshcatVisualizer,
)
from pydrake.lcm import DrakeLcm
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.lcm import LcmInterfaceSystem, LcmSubscriberSystem
from pydrake.systems.primitives import Adder, Gain, Integrator, MatrixGain, PassThrough
from wired import Wired

from teleop_drake.loops.draw import block_diagram as rendering
from teleop_drake.loops.draw.block_diagram import DiagramDot, RenderSvg, WriteDiagram
from teleop_drake.model.run.simulate import MakeDiagram
from teleop_drake.model.scenario import LoadScenario

# What every picture of MakeLoop() must show, opened or not.
PORTS = {"reference", "response", "position"}
PARTS = {"command", "actuator", "mass", "sensor"}
INSIDE_MASS = {"velocity", "damping"}


class Actuator(LeafSystem):
    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("demand", 1)
        self.DeclareVectorOutputPort(
            "push",
            1,
            lambda context, output: None,
            prerequisites_of_calc={self.nothing_ticket()},
        )


def _MakeMass() -> Diagram:
    return Wired(
        {"balance": Adder(2, 1), "velocity": Integrator(1), "damping": Gain(-0.5, 1)},
        {"velocity": "balance", "damping": "velocity", "balance.u1": "damping"},
        {"response": "velocity"},
        inputs={"force": "balance.u0"},
    )


def MakeLoop() -> Diagram:
    """A loop of four parts, one of them a diagram and one written in Python."""
    loop = Wired(
        {
            "command": Adder(2, 1),
            "actuator": Actuator(),
            "mass": _MakeMass(),
            "sensor": PassThrough(1),
        },
        {
            "actuator.demand": "command",
            "mass.force": "actuator.push",
            "sensor": "mass.response",
            "command.u1": "sensor",
        },
        {"response": "mass.response", "position": "sensor"},
        inputs={"reference": "command.u0"},
    )
    loop.set_name("loop")
    return loop


@pytest.fixture(params=["system dot", "embedded dot"])
def dot_on_path(request, monkeypatch, tmp_path):
    """Runs a test with a `dot` on the PATH and without one."""
    directory = tmp_path / "bin"
    directory.mkdir()
    monkeypatch.setenv("PATH", str(directory))
    if request.param == "embedded dot":
        return None
    # Stands for Graphviz's own program, and logs how it was called.
    embedded = shlex.quote(rendering._EmbeddedDot())
    dot = directory / "dot"
    dot.write_text(
        f"""#!/bin/sh
echo "$@" >> {shlex.quote(str(directory))}/calls
exec {embedded} "$@"
"""
    )
    dot.chmod(0o755)
    return directory / "calls"


def _Labels(svg: str) -> set[str]:
    """The pieces of text that a reader of the picture sees."""
    root = ElementTree.fromstring(svg.encode())
    return {
        (element.text or "").removeprefix("name=")
        for element in root.iter("{http://www.w3.org/2000/svg}text")
    }


def test_dot_text_has_a_style_and_leads_feedback_around_the_boxes():
    diagram = Wired(
        {"first": Actuator(), "second": PassThrough(1)},
        {"second": "first.push", "first.demand": "second"},
        {"result": "second"},
    )
    lines = DiagramDot(diagram).splitlines()
    assert lines[:6] == [
        "digraph _0 {",
        "rankdir=LR",
        'graph [fontname="Helvetica", nodesep=0.3, ranksep=0.45]',
        'node [fontname="Helvetica"]',
        'edge [arrowsize=0.8, fontname="Helvetica"]',
        "subgraph cluster0diagram {",
    ]
    assert "<B>Actuator</B><BR/>" in lines  # Without its module.
    assert lines[-15:] == [
        "s1:y0:e -> s2:u0:w [weight=10]",
        f"s2_y0_turn [{rendering._FILLED}]",
        "{rank=same; s2; s2_y0_turn}",
        "s2:y0:e -> s2_y0_turn:e [dir=none, arrowsize=0]",
        f"s1_u0_turn [{rendering._FILLED}]",
        "{rank=same; s1; s1_u0_turn}",
        "s1_u0_turn:e -> s2_y0_turn:w [dir=none, arrowsize=0]",
        "s1_u0_turn:w -> s1:u0:w",
        "s2:y0:e -> s0out:0:w [color=palegreen3, penwidth=0.7]",
        'before_s1 [style=invis, label="", fixedsize=true, width=0, height=0]',
        "before_s1 -> s1 [style=invis]",
        "}",
        "margin=40",
        "}",
        "}",
    ]


def test_no_wire_leaves_its_frame():
    """The first box and the last one have wires that turn beside them."""
    diagram = Wired(
        {"first": Adder(2, 1), "middle": Integrator(1), "last": Gain(-1.0, 1)},
        {"middle": "first", "last": "middle", "first.u0": "last", "first.u1": "middle"},
    )
    svg = RenderSvg(diagram, max_depth=1)
    frame = re.search(r'0diagram</title>\s*<polygon [^>]*points="([^"]*)"', svg)[1]
    left, *_, right = sorted(float(x.split(",")[0]) for x in frame.split())
    wires = re.findall(r'<path [^>]*d="([^"]*)"', svg)
    x = [float(x) for wire in wires for x in re.findall(r"(-?[\d.]+),", wire)]
    assert len(wires) == 8
    assert left < min(x) and max(x) < right


def test_wires_of_vectors_have_their_widths():
    builder = DiagramBuilder()
    diagram = Wired({"pair": PassThrough(2)}, {}, {"y": "pair"}, inputs={"u": "pair"})
    part = builder.AddNamedSystem("part", diagram)
    sum_of_both = builder.AddNamedSystem("sum", MatrixGain(np.ones((1, 2))))
    last = builder.AddNamedSystem("last", PassThrough(1))
    builder.Connect(part.get_output_port(), sum_of_both.get_input_port())
    builder.Connect(sum_of_both.get_output_port(), last.get_input_port())
    builder.ExportInput(part.get_input_port(), "both")
    wires = [
        line
        for line in DiagramDot(builder.Build(), max_depth=1).splitlines()
        if "->" in line
    ]
    widths = [re.findall(r'taillabel="(\d+)"', wire) for wire in wires]
    assert [wire.split(" -> ")[0] for wire in wires] == [
        *("s1:y0:e", "s2:y0:e", "s0in:0:e")
    ]
    assert widths == [["2"], [], ["2"]]


def test_visualizers_lead_to_nodes_that_there_are():
    """Drake's own text has edges from a box to Meshcat and to LCM, by its numbers."""
    builder = DiagramBuilder()
    _, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    scene_graph.set_name("scene_graph")
    builder.GetSubsystemByName("plant").Finalize()
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, Meshcat())
    lcm = DrakeLcm("memq://")
    builder.AddNamedSystem("lcm", LcmInterfaceSystem(lcm=lcm))
    DrakeVisualizer.AddToBuilder(builder, scene_graph, lcm)
    dot = DiagramDot(builder.Build(), max_depth=1)
    declared = set(re.findall(r"(?:^|;)(\w+) \[", dot, re.MULTILINE))
    ends = re.findall(r"^(\w+)\S* -> (\w+)", dot, re.MULTILINE)
    assert ("s3", "meshcat_in") in ends
    assert {end for edge in ends for end in edge} <= declared
    assert not re.search(r"drakelcminterface\d{3}", dot)  # An address.


@pytest.mark.slow  # It starts processes.
def test_dot_text_is_the_same_in_every_build_and_process():
    expected = DiagramDot(MakeLoop())
    # Drake's own text differs here: it sorts connections by memory address and numbers
    # systems through the life of the process.
    keep = [MakeLoop() for _ in range(5)]
    assert MakeLoop().GetGraphvizString() != keep[0].GetGraphvizString()
    assert {DiagramDot(loop) for loop in keep} == {expected}
    # In a process whose sets have another order than those of this one.
    seed = str(1 + (os.environ.get("PYTHONHASHSEED") == "1"))
    output = subprocess.run(
        [
            sys.executable,
            "-c",
            "from test_block_diagram import *; print(end=DiagramDot(MakeLoop()))",
        ],
        env=os.environ
        | {"PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(sys.path)},
        cwd=os.path.dirname(__file__),
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert output == expected


def test_max_depth_opens_that_many_levels():
    loop = MakeLoop()
    named = [
        set(re.findall(r"name=(\w+)", DiagramDot(loop, max_depth=depth)))
        for depth in (0, 1, 2, None)
    ]
    assert named[0] == {"loop"}
    assert named[1] == {"loop"} | PARTS
    assert named[2] == {"loop", "balance"} | PARTS | INSIDE_MASS
    assert named[3] == named[2]
    with pytest.raises(ValueError, match="max_depth = -1: must be"):
        DiagramDot(loop, max_depth=-1)


def test_labels_that_look_like_markup_stay_labels():
    names = ["s3 -> s4", "<B>a.b</B>", 'a "b" & c', "Größe ψ", "$x_1$"]
    builder = DiagramBuilder()
    for name in names:
        system = builder.AddNamedSystem(name, Gain(1.0, 1))
        builder.ExportInput(system.get_input_port(), f"in {name}")
    labels = _Labels(RenderSvg(builder.Build()))
    assert labels >= set(names) | {f"in {name}" for name in names}


@pytest.mark.parametrize(
    ("control", "shown"),
    [
        ("\x00", "␀"),
        ("\x01", "␁"),
        ("\n", "␊"),
        ("\t", "␉"),
        ("\x1b", "␛"),
        ("\x7f", "␡"),
        ("\x85", "\ufffd"),
        ("\uffff", "\ufffd"),
    ],
)
def test_a_control_character_in_a_name_is_drawn(control, shown):
    builder = DiagramBuilder()
    # More ports than a box shows, so that their labels are read from Drake's text.
    system = builder.AddNamedSystem(f"a<{control}s3 [b", Adder(12, 1))
    builder.ExportInput(system.get_input_port(0), f"in{control}put")
    svg = RenderSvg(builder.Build())
    assert {f"a<{shown}s3 [b", f"in{shown}put", "11 more"} <= _Labels(svg)


class Undrawn(LeafSystem):
    """A system whose text for Graphviz lacks a box."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("a<b", 1)
        self.DeclareVectorOutputPort("y", 1, lambda context, output: None)

    def DoGetGraphvizFragment(self, params):
        fragment = LeafSystem.DoGetGraphvizFragment(self, params)
        fragment.fragments = []
        return fragment


def test_a_system_without_a_box_of_its_own_has_one():
    builder = DiagramBuilder()
    first, second = (builder.AddNamedSystem(name, Undrawn()) for name in ("p", "q"))
    builder.Connect(first.get_output_port(), second.get_input_port())
    diagram = builder.Build()
    assert first.GetGraphvizFragment().fragments == []
    dot = DiagramDot(diagram)
    assert "s1:y0:e -> s2:u0:w [weight=10]" in dot
    assert {"p", "q", "Undrawn", "a<b", "y"} <= _Labels(RenderSvg(diagram))


def test_a_system_after_an_interface_of_lcm_keeps_its_number():
    """A level of a page finds the k-th system of a diagram by the number k."""
    builder = DiagramBuilder()
    interface = builder.AddNamedSystem("lcm", LcmInterfaceSystem(DrakeLcm("memq://")))
    other = DrakeLcm("memq://")
    for lcm in (interface, other):
        subscriber = LcmSubscriberSystem.Make("CHANNEL", lcmt_scope, lcm)
        builder.AddNamedSystem("own" if lcm is other else "shared", subscriber)
    builder.AddNamedSystem("last", Gain(1.0, 1))
    dot = DiagramDot(builder.Build())
    assert re.findall(r"^(\w+) \[shape=none", dot, re.M) == [
        *("drakelcminterface1in", "drakelcminterface1out", "s2", "s3", "s4")
    ]
    assert re.findall(r"^(\w+) -> (\w+):w", dot, re.M) == [
        ("drakelcminterface1out", "s2"),
        ("drakelcminterface5out", "s3"),
    ]
    assert "\ndrakelcminterface5out [label=LCM]" in dot


def test_svg_shows_every_name(dot_on_path):
    labels = _Labels(RenderSvg(MakeLoop()))
    expected = {"loop", "Actuator", "demand", "push", "force"} | PORTS | PARTS
    assert expected | INSIDE_MASS <= labels
    assert (dot_on_path is not None) == bool(
        dot_on_path and dot_on_path.read_text().startswith("-Tsvg")
    )


def test_every_suffix_gives_a_file_of_its_kind(tmp_path):
    loop = MakeLoop()
    names = {f"loop.{suffix}" for suffix in ("svg", "png", "pdf", "dot", "SVG")}
    for name in names:
        WriteDiagram(loop, tmp_path / name)
    assert (tmp_path / "loop.dot").read_text() == DiagramDot(loop)
    svg = (tmp_path / "loop.svg").read_text()
    assert svg == RenderSvg(loop) == (tmp_path / "loop.SVG").read_text()
    png = (tmp_path / "loop.png").read_bytes()
    assert png.startswith(b"\x89PNG\r\n")
    # An SVG point is 1/72 inch.
    points = float(re.search(r'width="([\d.]+)pt"', svg)[1])
    assert struct.unpack(">I", png[16:20])[0] / (points / 72) >= 150
    pdf = (tmp_path / "loop.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert _PdfText(pdf) == _Labels(svg) - {""}
    assert {path.name for path in tmp_path.iterdir()} == names


def test_levels_stand_below_each_other_on_a_page():
    """Each opened box by itself, in its order; A4 holds them all."""
    svg = RenderSvg(MakeDiagram(LoadScenario("two_dof_combined")), max_depth=2)
    root = ElementTree.fromstring(svg.encode())
    width, height = (float(root.attrib[x][:-2]) for x in ("width", "height"))
    # In points: text of 14 has 5.5 or more on the page.
    assert 14 * min(595 / width, 842 / height) > 5.5
    names = re.findall(r">name=(\w+)<", svg)
    assert {names.count(x) for x in ("master", "controller", "robot")} == {2}
    assert names.count("plant") == 1
    # What is not connected is counted, and what is connected is there.
    assert re.search(r">\d+ more<", svg)
    assert "geometry_query" not in svg and "applied_generalized_force" in svg
    # The frames: one below the other, even on the left, and the whole is the first.
    frames = sorted(
        [tuple(map(float, point.split(","))) for point in points.split()]
        for points in re.findall(r"cluster\d+diagram.*?points=\"(.*?)\"", svg, re.S)
    )
    tops, bottoms = (sorted(f(y for _, y in x) for x in frames) for f in (min, max))
    assert len(tops) == 4 and all(map(float.__lt__, bottoms, tops[1:]))
    assert frames[-1][0][0] - frames[0][0][0] < 40
    y = re.search(r' y="([-.\d]+)"[^>]*>name=teleoperator<', svg)[1]
    assert tops[0] < float(y) < bottoms[0]
    identifiers = re.findall(r'\bid="(.*?)"', svg)
    assert len(identifiers) == len(set(identifiers)) > 50


def _PdfText(pdf: bytes) -> set[str]:
    (page,) = re.findall(rb"stream\r?\n(.*?)endstream", pdf, re.S)
    text = zlib.decompress(base64.a85decode(b"<~" + page.strip(), adobe=True))
    return {
        found.decode().removeprefix("name=")
        for found in re.findall(rb"\((.+?)\) Tj", text)
    }


def test_pdf_is_reproducible_and_has_letters_of_other_scripts(tmp_path):
    for name in ("a.pdf", "b.pdf"):
        WriteDiagram(MakeLoop(), tmp_path / name)
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()
    diagram = Wired({"ψ": Gain(1.0, 1)}, {})
    WriteDiagram(diagram, tmp_path / "psi.pdf")
    # The standard fonts have no such letter, so the file brings a font along.
    assert b"+DejaVuSans" in (tmp_path / "psi.pdf").read_bytes()


def test_without_svglib_a_pdf_is_refused(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "svglib", None)
    with pytest.raises(RuntimeError, match=r"pip install 'teleop-drake\[pdf\]'"):
        WriteDiagram(MakeLoop(), tmp_path / "loop.pdf")
    assert not list(tmp_path.iterdir())


def test_unknown_suffix_is_refused_before_anything_is_written(tmp_path, subtests):
    for name in ("loop.jpg", "loop", "loop.svg.gz"):
        with (
            subtests.test(name=name),
            pytest.raises(ValueError, match=r"ends in one of .svg, .png, .pdf"),
        ):
            WriteDiagram(MakeLoop(), tmp_path / name)
    assert not list(tmp_path.iterdir())
    missing = tmp_path / "missing" / "loop.dot"
    with pytest.raises(FileNotFoundError) as error:
        WriteDiagram(MakeLoop(), missing)
    assert error.value.filename == str(missing)


def test_without_any_renderer_the_error_names_the_remedies(monkeypatch, tmp_path):
    def no_files(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(metadata, "files", no_files)
    path = tmp_path / "loop.png"
    path.write_bytes(b"an older picture")
    with pytest.raises(RuntimeError) as error:
        WriteDiagram(MakeLoop(), path)
    message = str(error.value)
    assert "Graphviz" in message and "pip install graphviz-pure" in message
    assert ".dot" in message and "\n" not in message
    assert path.read_bytes() == b"an older picture"
    WriteDiagram(MakeLoop(), tmp_path / "loop.dot")
    assert (tmp_path / "loop.dot").read_text() == DiagramDot(MakeLoop())


def test_a_renderer_that_fails_is_quoted(monkeypatch, tmp_path):
    dot = tmp_path / "dot"
    dot.write_text("#!/bin/sh\necho 'Format: \"svg\" not recognized' >&2\nexit 1\n")
    dot.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match='Format: "svg" not recognized'):
        RenderSvg(MakeLoop())


def _Widths(svg: str, color: str) -> set[str]:
    """Returns the widths of the lines of a colour."""
    pattern = rf'<path fill="none" stroke="{color}"(?: stroke-width="([\d.]+)")?'
    return set(re.findall(pattern, svg))


def test_connections_show_their_delay_margins():
    """Four connections: the smallest margin, 3 and 20 times as much, and any delay."""
    diagram = MakeLoop()
    wires = ["command.u1", "actuator.demand", "mass.force", "sensor.u"]
    margins = dict(zip(wires, [0.0123, 0.0369, 0.246, np.inf], strict=True))
    svg = RenderSvg(diagram, max_depth=1, delay_margins=margins)
    assert _Widths(svg, "#d55e00") == {"3.6"}
    assert _Widths(svg, "#e69f00") == {"2.6"}
    assert _Widths(svg, "#0072b2") == {"1.7"}
    assert _Widths(svg, "#999999") == {"0.7"}
    texts = re.findall(r">([^<>]+)</text>", svg)
    assert {"12.3 ms", "36.9 ms", "246 ms", "up to 24.6 ms", "up to 123 ms"} <= {*texts}
    assert "shape=point" not in DiagramDot(diagram, max_depth=1, delay_margins=margins)


def test_several_levels_have_labels_of_margins():
    """Where dot packs graphs it leaves out the labels of connections."""
    margins = {"mass.force": 0.5, "mass/velocity.u0": 0.25}
    svg = RenderSvg(MakeLoop(), delay_margins=margins)
    texts = re.findall(r">([^<>]+)</text>", svg)
    assert "500 ms" in texts and "250 ms" in texts


def test_an_unstable_diagram_says_so_once():
    svg = RenderSvg(MakeLoop(), max_depth=1, delay_margins={"mass.force": 0.0})
    texts = re.findall(r">([^<>]+)</text>", svg)
    assert texts.count("unstable already: no signal may come later") == 1
    assert not any(text[0].isdigit() and text.endswith(" s") for text in texts)


def test_margins_are_computed_at_the_context(tmp_path):
    """dx/dt = -k x tolerates pi/(2 k)."""
    diagram = Wired(
        {"plant": Integrator(1), "gain": Gain(-5.0, 1)},
        {"gain": "plant", "plant": "gain"},
    )
    context = diagram.CreateDefaultContext()
    path = tmp_path / "map.svg"
    WriteDiagram(diagram, path, context=context, delay_margins=True)
    assert path.read_text().count(">314 ms<") == 2
    context.SetContinuousState([1.0])
    with pytest.raises(ValueError, match="'plant' with a derivative of -5"):
        WriteDiagram(diagram, path, context=context, delay_margins=True)
    with pytest.raises(ValueError, match="left out without delay_margins=True"):
        WriteDiagram(diagram, path, context=context)
    with pytest.raises(ValueError, match="left out of a page"):
        WriteDiagram(diagram, tmp_path / "map.html", delay_margins=True)
    with pytest.raises(ValueError, match="left out of a system without connections"):
        WriteDiagram(Gain(1.0, 1), path, delay_margins=True)
