"""Measured delays, read from a file."""

import pytest

from teleop_drake.channels import VariableChannelConfig
from teleop_drake.channels.trace import ReadTrace
from teleop_drake.scenario import LoadScenario, ScenarioError


def test_it_is_read_as_it_stands(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("time,delay\n# measured at night\n\n7, 0.1\n7.5,0.3\n")
    assert ReadTrace("trace", str(path)) == ([7.0, 7.5], [0.1, 0.3])


@pytest.mark.parametrize("header", ["", "time,delay\n", '"t [s]", "d, x", é\n'])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_no_row_is_lost(header, mark, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(f"{mark}{header}0,0.1\n0.5,0.3\n1,0.3\n", encoding="utf-8")
    channel = VariableChannelConfig(delay=0.0, trace=str(path))
    assert channel.Profile(0.5).minimum == 0.1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must have at least two lines of time,delay, not 0"),
        ("time,delay\n", "must have at least two lines of time,delay, not 0"),
        ("0,0.1\n", "must have at least two lines of time,delay, not 1"),
        ("0,0.1\n1,-0.1\n", "line 2, '1,-0.1': must be a delay >= 0 (s)"),
        ("0,0.1\n1,nan\n", "line 2, '1,nan': must be finite numbers"),
        ("0,0.1\n0,0.1\n", "line 2, '0,0.1': must be later than the line before, 0 s"),
        ("0,0.1\n1\n", "line 2, '1': must be time,delay in s"),
        ("0,0.1,3\n1,0.1\n", "line 1, '0,0.1,3': must be time,delay in s"),
        ("time,delay\nx,y\n0,1\n", "line 2, 'x,y': must be time,delay in s"),
        # No header, but a typing error.
        ("O.0,0.1\n1,0.1\n30,0.1\n", "line 1, 'O.0,0.1': must be time,delay in s"),
        ("x0,0.1\n1,0.1\n30,0.1\n", "line 1, 'x0,0.1': must be time,delay in s"),
        (".0;0.1\n1,0.1\n30,0.1\n", "line 1, '.0;0.1': must be time,delay in s"),
        ("nan,inf\n1,0.1\n30,0.1\n", "line 1, 'nan,inf': must be finite numbers"),
        ("0,0.1\n5,0.1\n", "must be at least as long as the duration, 25 s, not 5 s"),
        (b"\xff\xfe", "must be readable (not UTF-8 text)"),
        (None, "must be readable (No such file or directory)"),
    ],
)
def test_bad_traces(text, message, tmp_path):
    path = tmp_path / "t.csv"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    override = f"forward_channel={{kind: variable, trace: {path}}}"
    with pytest.raises(ScenarioError) as e:
        LoadScenario("one_dof", [override])
    assert str(e.value).startswith("forward_channel.trace = ")
    assert message in str(e.value)
    assert "\n" not in str(e.value)
