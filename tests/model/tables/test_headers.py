"""Names of columns: words and units."""

import pytest

from teleop_drake.model.tables.headers import UNITS, IsTime, ParseHeader

HEADERS = [
    ("time_s", ("time",), "s"),
    ("Time [ms]", ("time",), "ms"),
    ("RTT(us)", ("rtt",), "us"),
    ("RTT [µs]", ("rtt",), "us"),
    ("latency/ms", ("latency",), "ms"),
    ("sendTimeMs", ("send", "time"), "ms"),
    ("v_m_s", ("v",), "m_s"),
    ("v_mm_per_s", ("v",), "mm_per_s"),
    ("tool velocity [mm/s]", ("tool", "velocity"), "mm/s"),
    ("x_mm", ("x",), "mm"),
    ("force_N", ("force",), "N"),
    ("seq_n", ("seq", "n"), ""),
    ("linear.x", ("linear", "x"), ""),
    ("/cmd_vel/linear/x", ("cmd", "vel", "linear", "x"), ""),
    ("header.stamp.nanosec", ("header", "stamp"), "nanosec"),
    ("seconds", ("time",), "seconds"),
    ("s", ("s",), ""),
    ("tool_velocity[0]", ("tool", "velocity", "0"), ""),
    ("RTT (client)", ("rtt", "client"), ""),
    ("RTT [furlong]", ("rtt",), "furlong"),
    ("rtt_min", ("rtt", "min"), ""),
    ("", (), ""),
]


@pytest.mark.parametrize(("name", "words", "unit"), HEADERS)
def test_the_words_and_the_unit_of_a_name(name, words, unit):
    assert ParseHeader(name) == (words, unit)


def test_units_are_those_of_si():
    assert UNITS["us"] == ("time", 1e-6) and UNITS["mm/s"] == ("speed", 1e-3)
    assert UNITS["deg"].factor * 180 == pytest.approx(3.141592653589793)
    assert UNITS["cm_s"] == ("speed", 1e-2) and UNITS["mN"] == ("force", 1e-3)


@pytest.mark.parametrize("key", ["t", "stamp", "header_stamp", "date", "time_of_day"])
def test_names_of_times(key):
    assert IsTime(key) and not IsTime(f"{key}_delay")
