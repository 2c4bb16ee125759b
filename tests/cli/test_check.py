"""The command `teleop-drake check`, and the package's runs against the references."""

import re

import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_allclose
from references import (
    FOLDER,
    NETWORK,
    PACKETS,
    REFERENCES,
    SIGNALS,
    overrides,
    solve,
    split,
    write,
)
from runs import Run

from teleop_drake.cli.main import main

NAME = "two_dof_puncture_direct_force"
NEEDLE = "needle_insertion_adaptive_backstepping"
DELAYS = FOLDER / "delays"
CASES = [(name, "auto") for name in REFERENCES]
# In Drake's Simulator, which is slow, not each task with both controllers.
CASES += [(name, "drake") for i, name in enumerate(REFERENCES) if i in (0, 3, 4, 6, 7)]


def Reference(name, folder=FOLDER):
    lines = (folder / f"{name}.csv").read_text("utf-8").splitlines()
    header, *rows = [line.split(",") for line in lines if not line.startswith("#")]
    return dict(zip(header, np.array(rows, float).T, strict=True))


def Check(path, capsys):
    code = main(["check", str(path)])
    return code, capsys.readouterr()


def CheckOwn(name, engine, tmp_path, capsys, *changes):
    """Checks a run of the package with changes, PATH=VALUE."""
    changes = [*overrides(name), *changes]
    if engine == "auto":  # Its steps are longer than one can interpolate between.
        changes.append("simulator.max_step_size=0.002")
    run = Run(*REFERENCES[name], *changes, engine=engine)
    times = Reference(name)["time"]
    signals = {signal: run.Interpolate(signal, times) for signal in SIGNALS}
    write(tmp_path / "own.csv", name, split(times, signals))
    code, (printed, _) = Check(tmp_path / "own.csv", capsys)
    return code, printed


@pytest.mark.parametrize(
    ("name", "engine"),
    Slow(CASES, but=[CASES.index((name, "auto")) for name in (NAME, NETWORK)]),
)
def test_a_run_of_the_package_is_inside(name, engine, tmp_path, capsys):
    code, printed = CheckOwn(name, engine, tmp_path, capsys)
    assert code == 0, printed
    shares = [float(line.split()[3]) for line in printed.splitlines()[2:-1]]
    assert len(shares) == len(Reference(name)) - 1 and max(shares) <= 1


# Little is changed: the packets of the way back, which are those of the way out, a
# hundredth of the delay, a lateral spring by a fifth, the forearm's mass by 0.7 %.
@pytest.mark.parametrize(
    ("name", "change"),
    Slow(
        [
            (NETWORK, f"return_channel.trace={PACKETS['forward']}"),
            (NETWORK, "forward_channel.delay=0.001"),
            (NEEDLE, "environment.layers.bone.lateral_stiffness=4"),
            (NEEDLE, "robot.payload=0.002"),
        ],
        but=[0],
    ),
)
def test_a_wrong_run_is_outside(name, change, tmp_path, capsys):
    code, printed = CheckOwn(name, "auto", tmp_path, capsys, change)
    assert code == 1, printed


def test_a_difference_is_found_where_it_is(tmp_path, capsys):
    columns = Reference(NAME)
    columns["tool_velocity_0"][100] += 0.01
    write(tmp_path / "own.csv", NAME, columns)
    code, (printed, _) = Check(tmp_path / "own.csv", capsys)
    assert code == 1 and printed.endswith("outside of the tubes\n")
    shares = {x.split()[0]: float(x.split()[3]) for x in printed.splitlines()[2:-1]}
    assert [name for name, share in shares.items() if share > 0] == ["tool_velocity_0"]
    (line,) = re.findall(r"tool_velocity_0 .*", printed)
    assert line.endswith(f"{columns['time'][100]:.4g} s")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (f"reference: {NAME}", "reference: mine", "reference = 'mine': must be one of"),
        ("tool_velocity_1", "v", "'v', 'environment_force_0'"),
        ("tool_velocity_1", "v", "must have 'tool_velocity_1'; the header that --te"),
        ("time,", "u,", "columns 'u', 'tool_position_0',"),
        ("time,", "u,", "must have one named 'time' and one for each signal, in the "),
        ("\n0.0", "\nnan,0.0", "'nan,0.0"),
        (",-", ",x", "must be a finite number, or a word for a missing one"),
        ("0.849988864126", "NA", "line 4, 'NA': must be a finite number"),
        ("\n0.0", "\n0.3", "must ascend and cover"),
    ],
)
def test_bad_input(old, new, message, tmp_path, capsys):
    text = (FOLDER / f"{NAME}.csv").read_text("utf-8")
    (tmp_path / "own.csv").write_text(text.replace(old, new, 1))
    code, (printed, error) = Check(tmp_path / "own.csv", capsys)
    assert code == 2 and printed == ""
    assert message in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("header", "first", "scale", "clock"),
    [
        ("header.stamp [ns]", 1_700_000_000_000_000_000, 1e9, "ns since 1970"),
        ("stamp", 1_700_000_000_000, 1e3, "ms since 1970"),
        ("time", 0, 1, ""),
        ("Time [ms]", 0, 1e3, ""),
    ],
)
def test_stamps_of_a_clock_count_from_the_first_row(
    header, first, scale, clock, tmp_path, capsys
):
    """As ROS and others write them: the run begins at its first row."""
    columns = Reference("delay_echo", DELAYS)
    lines = [f"# reference: delay_echo\n{header},ramp_echo,step_echo"]
    rows = zip(columns["time"], columns["ramp_echo"], columns["step_echo"], strict=True)
    lines += [f"{first},0,0"]
    lines += [f"{first + round(t * scale, 6):.15g},{a},{b}" for t, a, b in rows]
    (tmp_path / "own.csv").write_text("\n".join(lines))
    code, (printed, told) = Check(tmp_path / "own.csv", capsys)
    assert code == 0 and printed.endswith("inside of the tubes\n")
    shift = f"teleop-drake: time: {clock}, counted from the first row\n"
    assert told == (shift if clock else "")


def test_units_in_brackets_are_converted(tmp_path, capsys):
    columns = Reference(NAME)
    columns["tool_velocity_0 [mm/s]"] = columns.pop("tool_velocity_0") * 1e3
    write(tmp_path / "own.csv", NAME, columns)
    assert Check(tmp_path / "own.csv", capsys)[0] == 0


def test_a_file_that_is_not_there(tmp_path, capsys):
    code, (_, error) = Check(tmp_path / "none.csv", capsys)
    assert code == 2 and "must be readable (No such file" in error


@pytest.mark.parametrize(
    "name", Slow(list(REFERENCES), but=[list(REFERENCES).index(NAME)])
)
def test_a_reference_is_what_the_solver_makes(name, tmp_path):
    columns, _ = solve(name)
    for column, values in Reference(name).items():
        scale = np.ptp(values) or 1.0
        assert_allclose(columns[column], values, rtol=0, atol=1e-6 * scale)
