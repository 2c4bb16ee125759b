"""Recorded motions: columns, units, stamps, uneven rows, and positions."""

import math

import numpy as np
import pytest

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.tables.motion import ReadMotion


def read(tmp_path, text, num_axes=1, **given):
    path = tmp_path / "hand.csv"
    path.write_text(text, encoding="utf-8")
    whole = {"file": str(path), **given} if given else str(path)
    return ReadMotion("surgeon.file", whole, num_axes)


def rows(times, *columns, head="t,v", form="{:.9f}"):
    lines = [head]
    for row in zip(times, *columns, strict=True):
        lines.append(",".join([form.format(row[0]), *(f"{x:.9f}" for x in row[1:])]))
    return "\n".join(lines)


TWIST = ",".join(f"field.{kind}.{x}" for kind in ("linear", "angular") for x in "xyz")
NS = 1_700_000_000_000_000_000
VELOCITIES = {
    "no header": "0,0.001\n0.5,0.002\n",
    "without units": "t,v\n0,0.001\n0.5,0.002\n",
    "a header that is quoted": '"time","v"\n0,0.001\n0.5,0.002\n',
    "ms and mm/s": "Time [ms],v [mm/s]\n0,1\n500,2\n",
    "units in words": "t (s),velocity (mm/sec)\n0,1\n0.5,2\n",
    "units with powers": "t [s],v [mm·s⁻¹]\n0,1\n0.5,2\n",
    "units behind _": "t_ms,v_mm_s\n0,1\n500,2\n",
    "blanks and decimal commas": "time_s vel_mm_s\n0,0 1\n0,5 2\n",
    "UNIX stamps": "stamp,speed_m_s\n1700000000.0,0.001\n1700000000.5,0.002\n",
    "a time of day": "time,v_m_s\n23:59:59.8,0.001\n00:00:00.3,0.002\n",
    "rostopic echo -p": f"%time,field.linear.x\n{NS},0.001\n{NS + 500_000_000},0.002\n",
    "a bag of ROS 2": "header.stamp.sec,header.stamp.nanosec,twist.linear.x\n"
    "8,900000000,0.001\n9,400000000,0.002\n".replace("8,", "1700000008,").replace(
        "9,4", "1700000009,4"
    ),
    "of a run of the package": "time_s,tool_velocity[0]\n0,0.001\n0.5,0.002\n",
    "rows that are there twice": "t,v\n0,0.001\n0,0.001\n0.5,0.002\n",
}


@pytest.mark.parametrize("form", VELOCITIES)
def test_a_form_of_velocities(form, tmp_path):
    motion = read(tmp_path, VELOCITIES[form])
    assert motion.times.tolist() == pytest.approx([0, 0.5], abs=1e-9)
    assert motion.velocities.ravel().tolist() == pytest.approx([0.001, 0.002])
    assert motion.period == pytest.approx(0.5)


def test_a_column_an_axis(tmp_path):
    text = f"%time,{TWIST}\n{NS},1,2,3,4,5,6\n{NS + 10**8},1,2,3,4,5,6\n"
    assert read(tmp_path, text, 6).velocities[0].tolist() == [1, 2, 3, 4, 5, 6]
    linear = read(tmp_path, text, 3)
    assert linear.velocities[0].tolist() == [1, 2, 3]
    assert "angular columns left out" in linear.summary
    columns = {"velocity": ["field.linear.y", "field.linear.x"]}
    assert read(tmp_path, text, 2, columns=columns).velocities[0].tolist() == [2, 1]
    columns = {"time": 1, "velocity": "field.linear.z"}
    assert read(tmp_path, text, 1, columns=columns).velocities[0].tolist() == [3]


def test_orientations_are_left_out(tmp_path):
    names = [f"pose.position.{x}" for x in "xyz"]
    names += [f"pose.orientation.{x}" for x in "xyzw"]
    text = f"t,{','.join(names)}\n0,0,0,0,0,0,0,1\n0.5,1,2,3,0,0,0,1\n"
    motion = read(tmp_path, text, 3)
    assert motion.velocities[0].tolist() == pytest.approx([2, 4, 6])
    assert "angular columns left out" in motion.summary


def test_a_file_with_positions_and_velocities_has_velocities(tmp_path):
    text = "t,x,v\n0,5,0.001\n0.5,6,0.002\n"
    assert read(tmp_path, text).velocities.ravel().tolist() == [0.001, 0.002]
    positions = read(tmp_path, text, quantity="position")
    assert positions.velocities.ravel().tolist() == pytest.approx([2, 2])


def test_what_was_read_is_told(tmp_path):
    times = np.arange(150) / 30
    text = rows(times, 1e-3 * np.cos(times), form="{:.6f}")
    assert read(tmp_path, text).summary == (
        "150 rows in 4.967 s, every 0.03333 s, velocity in 'v', taken in s and m/s "
        "(no unit named), up to 0.001 m/s, clock: seconds"
    )


@pytest.mark.parametrize("digits", [6, 3])
def test_rounded_stamps_are_moved_to_even_ones(digits, tmp_path):
    """30 frames a second: 33.333 ms with stamps in us or in ms."""
    times = np.arange(300) / 30
    motion = read(tmp_path, rows(times, np.sin(times), form=f"{{:.{digits}f}}"))
    assert motion.times == pytest.approx(times, abs=10.0**-digits)
    assert motion.period == pytest.approx(1 / 30, rel=10.0 ** -(digits - 1))
    moved = "(stamps moved by up to 0.00033"
    assert (moved in motion.summary) == (digits == 3)


def test_the_last_row_may_be_nearer(tmp_path):
    times = [0.125 * i for i in range(200)]
    motion = read(tmp_path, rows([*times, times[-1] + 0.1], np.ones(201)))
    assert motion.period == 0.125 and motion.times[-1] == times[-1] + 0.1


def test_uneven_rows_are_resampled_within_the_error_that_is_told(tmp_path):
    times = np.sort(np.random.default_rng(1).uniform(0, 10, 400))
    values = np.sin(times)
    motion = read(tmp_path, rows(times, values))
    assert motion.period is not None
    assert np.diff(motion.times) == pytest.approx(motion.period)
    told = float(motion.summary.split(" within ")[1].split(" %")[0]) / 100
    found = np.interp(times, motion.times, motion.velocities[:, 0])
    error = np.abs(found - np.round(values, 9)).max() / np.ptp(values)
    assert error == pytest.approx(told, rel=0.05) and told <= 1e-3
    gap = float(np.diff(np.round(times, 9)).max())
    assert f"longest gap {gap:.4g} s" in motion.summary


def test_a_few_uneven_rows_stay_as_they_are(tmp_path):
    motion = read(tmp_path, rows([0, 1, 1.5, 3], [0, 1, 0, 2]))
    assert motion.times.tolist() == [0, 1, 1.5, 3] and motion.period is None
    assert "at uneven times" in motion.summary


def test_rows_without_values_are_left_out(tmp_path):
    motion = read(tmp_path, "t,v\n0,1\n0.5,\n1,NaN\n1.5,2\n")
    assert motion.times.tolist() == [0, 1.5]
    assert "2 rows without values left out" in motion.summary


def test_positions_are_differentiated_with_a_stated_bandwidth(tmp_path):
    """The derivative of a sine is a cosine, times the gain of the Gaussian."""
    times = np.arange(2000) * 1e-3
    w = 2 * math.pi * 2.0
    text = rows(times, 5.0 * np.sin(w * times), head="time_s,x_mm")
    for bandwidth, told in ((None, 10), (4.0, 4)):
        given = {} if bandwidth is None else {"bandwidth": bandwidth}
        motion = read(tmp_path, text, **given)
        gain = math.exp(-math.log(2) / 2 * (2.0 / told) ** 2)
        expected = 0.005 * w * gain * np.cos(w * times)
        middle = slice(400, 1600)
        assert motion.velocities[middle, 0] == pytest.approx(expected[middle], abs=1e-6)
        assert f"with a bandwidth of {told} Hz" in motion.summary
        way = np.cumsum(motion.velocities[:-1, 0] + motion.velocities[1:, 0]) * 5e-4
        error = np.abs(way - 0.005 * np.sin(w * times[1:])).max()
        within = float(motion.summary.split("integral within ")[1].split(" m")[0])
        assert error == pytest.approx(within, rel=0.05)


def test_a_low_rate_limits_the_bandwidth(tmp_path):
    text = rows(np.arange(90) / 30, np.zeros(90), head="time_s,x_m")
    assert "with a bandwidth of 3.98 Hz" in read(tmp_path, text).summary
    with pytest.raises(ScenarioError, match=r"^surgeon.file.bandwidth = 5: must be a "):
        read(tmp_path, text, bandwidth=5)


BAD = [
    ("0,1\n", {}, "must have at least two rows, not 1"),
    (
        "0,1\n0,2\n",
        {},
        "line 2: must be later than the line before, 0 s, and is at 0 s",
    ),
    ("0,1\n1,2\n0.5,2\n", {}, "line 3: must be later than the line before, 1 s, and"),
    ("0,1\n0,1\n", {}, "must have rows at different times"),
    ("0,1\n1,2,3\n", {}, "line 2, '1,2,3': must have 2 cells, and has 3"),
    ("0,1\n1,x\n", {}, "column '2': line 2, 'x': must be a finite number"),
    ("-1,1\n1,1\n", {}, "must begin at a time >= 0 (s)"),
    ("t,v [kn]\n0,1\n1,1\n", {}, "column 'v [kn]': unit 'kn': must be one of m/s, cm"),
    (
        "t,v (km/h)\n0,1\n1,1\n",
        {},
        "unit 'km/h': must be one of m/s, cm/s, mm/s, um/s,",
    ),
    (
        "t,v\n2e12,1\n2.1e12,1\n",
        {},
        "column 't': times up to 2.1e+12: must have a unit",
    ),
    ("t,x [deg]\n0,1\n1,1\n", {}, "unit 'deg': must be one of m, cm, mm, um"),
    ("t,v_mm\n0,1\n1,1\n", {"quantity": "velocity"}, "unit 'mm': must be one of m/s"),
    (
        "t,a,b\n0,1,2\n1,1,2\n",
        {},
        "columns 't', 'a', 'b': must have a velocity or a position; write {file: ..., "
        "columns: {time: 't', velocity: ['a']}}",
    ),
    (
        "t,vx,vy\n0,1,2\n1,1,2\n",
        {},
        "must have 1 columns of velocity, one an axis, not 2; write {file: ..., "
        "columns: {time: 't', velocity: ['vx']}}",
    ),
    (
        "a,v\n0,1\n1,1\n",
        {},
        "columns 'a', 'v': must have a time; write {file: ..., col",
    ),
    (
        "t,time,v\n0,0,1\n1,1,1\n",
        {},
        "must have one of these as its time; write {file:",
    ),
    ("t,v\n0,1\n1,1\n", {"quantity": "force"}, "surgeon.file.quantity = 'force': must"),
    (
        "t,v\n0,1\n1,1\n",
        {"bandwidth": 5},
        "bandwidth = 5: must be left out where vel",
    ),
    ("t,v\n0,1\n1,1\n", {"bandwidth": 0}, "surgeon.file.bandwidth = 0: must be a fini"),
    (
        "t,v\n0,1\n1,1\n",
        {"columns": {"speed": "v"}},
        "surgeon.file.columns.speed = 'v'",
    ),
]


@pytest.mark.parametrize(("text", "given", "message"), BAD)
def test_refused(text, given, message, tmp_path):
    with pytest.raises(ScenarioError) as error:
        read(tmp_path, text, **given)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_positions_of_rotations_are_refused(tmp_path):
    text = rows([0, 1], *np.zeros((6, 2)), head="t,x,y,z,p1,p2,p3")
    with pytest.raises(ScenarioError, match="must have velocities for 6 axes: the"):
        read(tmp_path, text, 6)
