"""The command `teleop-drake check`, and the package's runs against the references."""

import re

import numpy as np
import pytest
from grids import Slow
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

NAME, NEEDLE = "two_dof_puncture_direct_force", "needle_insertion_adaptive_backstepping"
CASES = [(name, "auto") for name in REFERENCES]
# In Drake's Simulator, which is slow, not each task with both controllers.
CASES += [(name, "drake") for i, name in enumerate(REFERENCES) if i in (0, 3, 4, 6, 7)]


def Reference(name):
    lines = (FOLDER / f"{name}.csv").read_text("utf-8").splitlines()
    table = np.array([line.split(",") for line in lines[3:]], float)
    return dict(zip(lines[2].split(","), table.T, strict=True))


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
        ("tool_velocity_1", "v", "column 'tool_velocity_1': must be there: time, "),
        ("time,", "t,", "must be names, `time` among them"),
        ("\n0.0", "\nnan,0.0", "'nan,0.0"),
        (",-", ",x", "finite numbers"),
        ("\n0.0", "\n0.3", "must ascend and cover"),
    ],
)
def test_bad_input(old, new, message, tmp_path, capsys):
    text = (FOLDER / f"{NAME}.csv").read_text("utf-8")
    (tmp_path / "own.csv").write_text(text.replace(old, new, 1))
    code, (printed, error) = Check(tmp_path / "own.csv", capsys)
    assert code == 2 and printed == ""
    assert message in error and error.count("\n") == 1


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
        np.testing.assert_allclose(columns[column], values, rtol=0, atol=1e-6 * scale)
