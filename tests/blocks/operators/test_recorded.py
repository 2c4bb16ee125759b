"""The recorded operator: its file, and what of it is refused."""

import pytest

from teleop_drake.blocks.operators.recorded import ReadCommand
from teleop_drake.scenario import LoadScenario, ScenarioError


def test_a_file_beside_the_scenario(tmp_path):
    (tmp_path / "hand.csv").write_text("# by hand\nt,v\n0.0,0.0\n1.0,0.002\n1.5,0.0\n")
    built_in = LoadScenario("one_dof").robot.start.tolist()
    (tmp_path / "mine.yaml").write_text(
        "duration: 1.0\n"
        f"robot: {{model: slider, start: {built_in}, mass: 0.5, damping: 0.1}}\n"
        "surgeon: {kind: recorded, velocity: [0.002], file: hand.csv}\n"
        "controller: {kind: direct_force}\n"
    )
    scenario = LoadScenario(tmp_path / "mine.yaml")
    assert scenario.surgeon.LongestStep() == 0.5
    dut = scenario.surgeon.MakeOperator(start=built_in)
    context = dut.CreateDefaultContext()
    values = []
    for time in (0.5, 1.0, 1.25, 1.5, 9.0):
        context.SetTime(time)
        values.append(dut.GetOutputPort("velocity_command").Eval(context).item())
    assert values == pytest.approx([0.001, 0.002, 0.001, 0.0, 0.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "must be readable (No such file or directory)"),
        ("0,1\n", "must have at least two rows, not 1"),
        ("0,1\n0,2\n", "line 2, '0,2': must be later than the line before, 0"),
        ("0,1\n1,2,3\n", "line 2, '1,2,3': must be time,v1, finite numbers"),
        ("0,1\n1,x\n", "line 2, '1,x': must be time,v1, finite"),
        ("0,1\n1,nan\n", "line 2, '1,nan': must be time,v1, finite numbers"),
        ("-1,1\n1,1\n", "must begin at a time >= 0 (s)"),
    ],
)
def test_refused(text, message, tmp_path):
    file = tmp_path / "hand.csv"
    if text is not None:
        file.write_text(text)
    with pytest.raises(ScenarioError) as error:
        ReadCommand("surgeon.file", str(file), 1)
    assert f"surgeon.file = {str(file)!r}"[:40] in str(error.value)
    assert message in str(error.value)


def test_many_rows_are_at_equal_distances(tmp_path):
    file = tmp_path / "hand.csv"
    even = [0.125 * i for i in range(200)]
    # The last one may be nearer, as where a drive ended.
    file.write_text("".join(f"{t},0.1\n" for t in [*even, even[-1] + 0.1]))
    times, _ = ReadCommand("surgeon.file", str(file), 1)
    assert len(times) == 201
    file.write_text("".join(f"{t},0.1\n" for t in [*even[:7], *even[8:]]))
    with pytest.raises(ScenarioError, match="rows at equal distances in time"):
        ReadCommand("surgeon.file", str(file), 1)
