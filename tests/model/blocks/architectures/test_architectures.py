"""The seam: an architecture is a master side and a slave side, and nothing else."""

import dataclasses
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Demultiplexer, Multiplexer
from runs import Run
from wired import Wired

from teleop_drake.model.blocks.architectures import Architecture
from teleop_drake.model.blocks.architectures.direct_force import DirectForce
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import ARCHITECTURES, LoadScenario, ScenarioError
from teleop_drake.model.stations import (
    MakeArchitecture,
    MakeMasterStation,
    MakeSlaveStation,
    ResolveController,
)
from teleop_drake.model.task_recording import LoadRecording
from teleop_drake.model.tasks.metrics import RunMetrics, RunSummary
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.figures.runs import PlotRun


def PlainMasterSide(n):
    """Sends [v_d; F_h; v_d], unlike the thesis, and feels what returns."""
    builder = DiagramBuilder()
    unpack = builder.AddNamedSystem("unpack", Demultiplexer([n, n]))
    pack = builder.AddNamedSystem("pack", Multiplexer([n, n, n]))
    builder.ExportInput(unpack.get_input_port(), "return_packet")
    builder.ExportInput(pack.get_input_port(1), "haptic_force")
    command = builder.ExportInput(pack.get_input_port(0), "velocity_command")
    builder.ConnectInput(command, pack.get_input_port(2))
    builder.ExportOutput(unpack.get_output_port(0), "felt_velocity")
    builder.ExportOutput(unpack.get_output_port(1), "felt_position")
    builder.ExportOutput(pack.get_output_port(), "forward_packet")
    return builder.Build()


def PlainSlaveSide(n):
    """Applies the force that comes second, and returns [v; p]."""
    return Wired(
        {
            "unpack": Demultiplexer([n, n, n]),
            "law": DirectForce(num_axes=n),
            "pack": Multiplexer([n, n]),
        },
        {"law.haptic_force": "unpack.y1"},
        {"control_force": "law.control_force", "return_packet": "pack"},
        inputs={
            "forward_packet": "unpack",
            "tool_velocity": "pack.u0",
            "tool_position": "pack.u1",
            "environment_force": "law.environment_force",
        },
    )


def PlainArchitecture(scenario):
    n = scenario.num_axes
    return Architecture(
        master_side=PlainMasterSide(n),
        slave_side=PlainSlaveSide(n),
        initial_forward_packet=[0.0] * (3 * n),
        initial_return_packet=[*[0.0] * n, *scenario.robot.start],
    )


@pytest.fixture(scope="module")
def plain():
    """Direct force application through the general seam."""
    scenario = LoadScenario("two_dof_combined", {"controller.kind": "direct_force"})
    scenario.duration = 4.0
    teleoperator = MakeTeleoperator(scenario, architecture=PlainArchitecture(scenario))
    return simulate(scenario, teleoperator=teleoperator)


def test_direct_force_in_other_packets_is_direct_force(plain):
    theirs = Run("two_dof_combined", "direct_force", "duration=4.0")
    assert plain["forward_packet_sent"].shape[1] == 6
    for signal in ("tool_position", "tool_velocity", "control_force"):
        times = np.linspace(0, 4, 1001)
        expected = theirs.Interpolate(signal, times)
        assert_allclose(
            plain.Interpolate(signal, times), expected, atol=1e-4 * np.ptp(expected)
        )
    for event in ("puncture", "contact", "release", "surgeon_force"):
        assert theirs.EventTimes(event)
        assert plain.EventTimes(event) == pytest.approx(
            theirs.EventTimes(event), abs=1e-6
        )


def test_metrics_do_not_depend_on_the_packets(plain):
    """The commands' errors too, although the slave receives something else."""
    theirs = RunMetrics(Run("two_dof_combined", "direct_force", "duration=4.0"))
    ours = RunMetrics(plain)
    for group in ("puncture", "collision"):
        for name, value in theirs[group].items():
            expected = value and pytest.approx(value, rel=1e-3, abs=1e-7)
            assert ours[group][name] == expected, name
    for name in ("velocity_rms_error", "force_rms_error", "control_force_peak"):
        assert ours[name] == pytest.approx(theirs[name], rel=1e-3, abs=1e-6), name


def test_recording_and_figures_take_any_packet(plain, tmp_path):
    theirs = Run("two_dof_combined", "direct_force", "duration=4.0")
    assert_allclose(plain.commands[-1], theirs.commands[-1], atol=1e-6)
    assert theirs.commands is theirs["forward_packet_sent"]
    assert PlotRun(plain).axes
    plain.Save(tmp_path / "run.npz")
    again = LoadRecording(tmp_path / "run.npz")
    assert RunSummary(again) == RunSummary(plain)


def test_stations_take_their_widths_from_the_ports():
    scenario = LoadScenario("two_dof_combined")
    master = MakeMasterStation(scenario, PlainMasterSide(2))
    assert master.GetOutputPort("forward_packet").size() == 6
    for name in ("felt_position", "felt_velocity", "velocity_command", "force_command"):
        assert master.GetOutputPort(name).size() == 2
    thesis = MakeMasterStation(scenario)
    names = [
        thesis.get_output_port(i).get_name() for i in range(thesis.num_output_ports())
    ]
    assert names == ["forward_packet", "surgeon_mode"]


def test_an_architecture_that_does_not_fit_is_refused():
    scenario = LoadScenario("one_dof")
    architecture = PlainArchitecture(scenario)
    with pytest.raises(ValueError, match="control_law"):
        MakeTeleoperator(
            scenario, control_law=DirectForce(num_axes=1), architecture=architecture
        )
    architecture.initial_return_packet = [0.0]
    with pytest.raises(ValueError, match=r"initial_value = .*: must be 2 numbers"):
        MakeTeleoperator(scenario, architecture=architecture)
    architecture = PlainArchitecture(scenario)
    architecture.master_side = LeafSystem()
    with pytest.raises(RuntimeError, match=r"master_side .*return_packet"):
        MakeTeleoperator(scenario, architecture=architecture)


def test_every_other_architecture_resolves_its_defaults():
    """Nothing that stands for a derived value is left, and the tree stays valid."""
    controller = LoadScenario("two_dof_combined").controller
    # The other three have their fields in the controller itself, or none.
    kinds = [kind for kind in ARCHITECTURES if hasattr(controller, kind)]
    assert len(kinds) == len(ARCHITECTURES) - 3
    for kind in kinds:
        scenario = LoadScenario("two_dof_combined", {"controller.kind": kind})
        config = ResolveController(scenario)
        given = getattr(scenario.controller, kind)
        for field in dataclasses.fields(config):
            setattr(given, field.name, getattr(config, field.name))
        scenario.Validate()
        again = ResolveController(scenario)
        for field in dataclasses.fields(config):
            is_gain = isinstance(getattr(config, field.name), np.ndarray)
            if is_gain:
                assert_array_equal(
                    getattr(config, field.name), getattr(again, field.name)
                )
    auto = LoadScenario("two_dof_combined", {"controller.initial_psi": "auto"})
    assert_array_equal(ResolveController(auto).Psi0, auto.initial_psi)


# Of each kind: fields of its own and others, and the beginning of what is said.
BAD = {
    "damped_force": {
        "damping=-1": "damping = -1.0: must be null, not",
        "against=wall": "against = 'wall': must be one of ground, command",
        "haptic_device.numerator=[25] haptic_device.denominator=[1,25]":
            "damping = null: must be a number, because none derives from haptic_device",
    },
    "four_channel": {
        "variant=three_channel": "variant = 'three_channel': ",
        "C1=.inf": "C1 = inf: must be a finite number",
        "C_m.stiffness=-1": "C_m.stiffness = -1.0: must be",
        "C_s.gain=1": "C_s.gain = 1: unknown key",
    },
    "proportional_damping": {
        "margin=1": "margin = 1.0: must be",
        "master_mass=0": "master_mass = 0.0: must be",
        "stiffness=-1": "stiffness = -1.0: must be",
        "master_damping=0": "stiffness = null",
        "haptic_device.numerator=[50]": "master_damping = null",
    },
    "smith_predictor": {
        "mass=0": "mass = 0.0: must be",
        "damping=-1": "damping = -1.0: must be null, not neg",
        "delay=-1": "delay = -1.0: must be a finite number >= 0",
    },
    "time_domain_passivity": {
        "horizon=0": "horizon = 0.0",
        "initial_energy=-1": "initial_energy = -1.0: must be",
        "maximum_damping=0": "maximum_damping = 0.0: must be",
        "haptic_device.numerator=[50]": "maximum_mobility = null",
    },
    "wave_variables": {
        "impedance=0": "impedance = 0.0",
        "forward_scaling=2": "forward_scaling = 2.0: ",
        "haptic_device.numerator=[0,50]": "impedance = null",
        "haptic_device.numerator=[1,9] haptic_device.denominator=[1,2]":
            "haptic_device.numerator",
        "master_damping=0 forward_channel.delay=0 return_channel.delay=0":
            "master_damping = ",
    },
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        (kind, changes, message)
        for kind, rows in BAD.items()
        for changes, message in rows.items()
    ],
)
def test_bad_input_is_named(kind, changes, message):
    own = f"controller.{kind}."
    overrides = [f"controller.kind={kind}"]
    for change in changes.split():
        is_other = re.match(r"\w+(_device|_channel)\.", change)
        overrides.append(change if is_other else own + change)
    message = rf"^({own})?{re.escape(message)}"
    with pytest.raises(ScenarioError, match=message):
        MakeTeleoperator(LoadScenario("one_dof", overrides))


def test_the_thesis_has_no_master_side():
    scenario = LoadScenario("two_dof_combined")
    architecture = MakeArchitecture(scenario)
    assert architecture.master_side is None
    config = scenario.controller.Chosen()
    expected = MakeSlaveStation(config.MakeControlLaw(scenario.Facts(), "controller"))
    assert architecture.slave_side.num_output_ports() == expected.num_output_ports()
