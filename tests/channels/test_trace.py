"""Measured delays, read from a file."""

import dataclasses
import math
import re

import numpy as np
import pytest

from teleop_drake.channels import NetworkChannelConfig, VariableChannelConfig
from teleop_drake.channels.trace import ReadTrace
from teleop_drake.scenario import LoadScenario, ScenarioError


def test_it_is_read_as_it_stands(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("time,delay\n# measured at night\n\n7, 0.1\n7.5,0.3\n")
    trace = ReadTrace("trace", str(path))
    assert trace.times.tolist() == [7.0, 7.5]
    assert trace.delays.tolist() == [0.1, 0.3]
    assert not trace.is_lost.any()


@pytest.mark.parametrize("header", ["", "time,delay\n", '"t [s]", "d, x", é\n'])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_no_row_is_lost(header, mark, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(f"{mark}{header}0,0.1\n0.5,0.3\n1,0.3\n", encoding="utf-8")
    channel = VariableChannelConfig(delay=0.0, trace=str(path))
    assert channel.Profile(0.5).minimum == 0.1


def test_bad_traces(tmp_path):
    for text, message in [
        (None, "must be readable (No such file or directory)"),
        ("time,delay\n", "must have at least two lines of time,delay, not 0"),
        ("0,0.1\n1,-0.1\n", "line 2, '1,-0.1': must be a delay >= 0 (s)"),
        ("0,0.1\n1,nan\n30,1\n", "without losses, and has 1; where packets are lost, "),
        ("0,nan\n30,\n", "must have a delay that is a number"),
        ("0,0.1\n0,0.1\n", "line 2, '0,0.1': must be later than the line before, 0 s"),
        ("0,0.1\n1\n", "line 2, '1': must be time,delay in s"),
        ("time,delay\nx,y\n0,1\n", "line 2, 'x,y': must be time,delay in s"),
        (
            "time,rtt_ms\nx,y\n0,1\n",
            "line 2, 'x,y': must be time in s, delay in ms",
        ),
        # No header, but a typing error.
        ("O.0,0.1\n1,0.1\n30,0.1\n", "line 1, 'O.0,0.1': must be time,delay in s"),
        ("nan,inf\n1,0.1\n30,0.1\n", "line 1, 'nan,inf': must be finite numbers"),
        ("0,0.1\n5,0.1\n", "must be at least as long as the duration, 25 s, not 5 s"),
        (b"\xff\xfe", "must be readable (not UTF-8 text)"),
    ]:
        path = tmp_path / "t.csv"
        if text is not None:
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
        override = f"forward_channel={{kind: variable, trace: {path}}}"
        with pytest.raises(ScenarioError) as e:
            LoadScenario("one_dof", [override])
        assert str(e.value).startswith("forward_channel.trace = ")
        assert message in str(e.value)
        assert "\n" not in str(e.value)


def Read(tmp_path, text, **options):
    path = tmp_path / "trace.txt"
    path.write_text(text, encoding="utf-8")
    return ReadTrace("trace", str(path), **options)


def test_units_are_those_of_the_header_or_given(tmp_path):
    for header, options, delay in [
        ("time,delay", {}, 20.0),
        ("time,delay_ms", {}, 0.02),
        ('"time [s]","rtt [ms]"', {}, 0.02),
        ("t,latency (us)", {}, 2e-5),
        ("time,delay", {"unit": "ms"}, 0.02),
        ("time,delay_us", {"unit": "ms"}, 0.02),
    ]:
        trace = Read(tmp_path, f"{header}\n0,10\n1,20\n", **options)
        assert trace.delays.tolist() == pytest.approx([delay / 2, delay])


def test_columns_are_found_by_their_names(tmp_path):
    rows = "n,sent_ms,ttl,rtt_ms\n1,1000,64,10\n2,3000,64,20\n"
    trace = Read(tmp_path, rows)
    assert trace.times.tolist() == [1.0, 3.0]
    assert trace.delays.tolist() == [0.01, 0.02]
    trace = Read(tmp_path, rows, columns=["n", "sent_ms"])
    assert trace.times.tolist() == [1.0, 2.0]
    assert trace.delays.tolist() == [1.0, 3.0]
    with pytest.raises(ScenarioError, match=r"^trace_columns .*mean 'rtt_ms'"):
        Read(tmp_path, rows, columns=["n", "rtt_m"])


def test_what_is_lost_has_the_fate_of_the_packet(tmp_path):
    trace = Read(tmp_path, "0,0.1\n1,lost\n2,0.3\n3,\n4,nan\n")
    assert trace.is_lost.tolist() == [False, True, False, True, True]
    assert trace.delays.tolist() == pytest.approx([0.1, 0.2, 0.3, 0.3, 0.3])
    assert [trace.IsLost(t) for t in (0, 0.99, 1, 1.99, 2)] == [0, 0, 1, 1, 0]


def test_entries_may_be_the_packets_themselves(tmp_path):
    for text in ("delay_ms\n10\nlost\n30\n", "10\nlost\n30\n"):
        trace = Read(tmp_path, text, unit="ms", sample_period=0.5)
        assert trace.times.tolist() == [0.0, 0.5, 1.0]
        assert trace.delays.tolist() == pytest.approx([0.01, 0.02, 0.03])
        assert trace.is_lost.tolist() == [False, True, False]


PING = """\
PING a.example (192.0.2.1) 56(84) bytes of data.
64 bytes from 192.0.2.1: icmp_seq=1 ttl=56 time=10.0 ms
64 bytes from 192.0.2.1: icmp_seq=2 ttl=56 time=12.5 ms
64 bytes from 192.0.2.1: icmp_seq=4 ttl=56 time=9.5 ms
64 bytes from 192.0.2.1: icmp_seq=4 ttl=56 time=11.5 ms (DUP!)

--- a.example ping statistics ---
4 packets transmitted, 3 received, 25% packet loss, time 3004ms
"""


def test_what_ping_prints_is_read(tmp_path):
    trace = Read(tmp_path, PING)
    assert trace.times.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert trace.delays.tolist() == pytest.approx([0.01, 0.0125, 0.011, 0.0095])
    assert trace.is_lost.tolist() == [False, False, True, False]
    # With `ping -D` the answers have time stamps: they were sent by the delay earlier.
    stamps = iter((0.51, 1.5125, 3.5095, 3.5095))
    stamped = re.sub("^64", lambda m: f"[{next(stamps)}] 64", PING, flags=re.M)
    times = Read(tmp_path, stamped).times.tolist()
    assert times == pytest.approx([0.5, 1.5, 2.5, 3.5])


@pytest.mark.parametrize(
    ("end", "late"), [("hold", [0.3, 0.3, 0.3]), ("repeat", [0.1, 0.2, 0.3])]
)
def test_past_its_end_it_holds_or_repeats(end, late, tmp_path):
    trace = Read(tmp_path, "5,0.1\n6,0.2\n7,0.3\n").Until(20.0, end)
    assert trace.times[0] == 0 and trace.times[-1] >= 20
    shown = np.interp([0, 1, 2, 12, 13, 14], trace.times, trace.delays)
    assert shown.tolist() == pytest.approx([0.1, 0.2, 0.3, *late])


def test_a_run_has_the_losses_and_the_delays_of_its_trace(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("time,rtt_ms\n0,40\n0.1,60\n0.2,timeout\n0.3,80\n")
    channel = NetworkChannelConfig(
        delay=0.0,
        sample_period=0.1,
        trace=str(path),
        trace_end="repeat",
    )
    channel.Check("forward_channel", 1.0)
    network = channel.Network(1.0)
    expected = [0.02, 0.13, math.inf, 0.34, 0.42, 0.53, math.inf, 0.74]
    assert network.Arrivals(8).tolist() == pytest.approx(expected)
    whole = dataclasses.replace(channel, trace_factor=1.0).Network(1.0)
    assert whole.Arrival(0) == pytest.approx(0.04)
    # As the packets' own fates, whenever they were taken.
    numbered = dataclasses.replace(channel, trace_is_numbered=True, sample_period=0.2)
    arrivals = numbered.Network(1.0).Arrivals(4).tolist()
    assert arrivals == pytest.approx([0.02, 0.23, math.inf, 0.64])


def test_bad_rules_for_a_trace(tmp_path):
    for fields, message in [
        ({"trace_unit": "min"}, "c.trace_unit = 'min': must be one of s, ms, us"),
        ({"trace_end": "stop"}, "c.trace_end = 'stop': must be one of refuse, hold"),
        ({"trace_factor": 0.0}, "c.trace_factor = 0.0: must be a finite number > 0"),
        ({}, "at least as long as the duration, 9 s, not 1 s; trace_end says what"),
    ]:
        path = tmp_path / "t.csv"
        path.write_text("0,0.1\n1,0.2\n")
        channel = NetworkChannelConfig(sample_period=0.1, trace=str(path), **fields)
        with pytest.raises(ScenarioError, match=re.escape(message)):
            channel.Check("c", 9.0)


def test_a_trace_that_overtakes_itself_is_for_a_network(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("0,0.3\n0.1,0.05\n0.2,0.4\n1,0.1\n")
    fields = {"delay": 0.1, "trace": str(path)}
    with pytest.raises(ScenarioError, match=r"overtake each other, kind must be netw"):
        VariableChannelConfig(**fields).Check("c", 1.0)
    NetworkChannelConfig(sample_period=0.1, **fields).Check("c", 1.0)
