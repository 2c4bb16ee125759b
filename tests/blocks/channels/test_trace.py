"""Measured delays, read from a file."""

import math
import re

import numpy as np
import pytest

from teleop_drake.blocks.channels import NetworkChannelConfig, VariableChannelConfig
from teleop_drake.blocks.channels.trace import ReadTrace
from teleop_drake.scenario import LoadScenario, ScenarioError

HEADER = "time_s,delay_s\n"


def Read(tmp_path, text):
    path = tmp_path / "trace.txt"
    path.write_text(text, encoding="utf-8")
    return ReadTrace("trace", str(path))


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_it_is_read_as_it_stands(mark, tmp_path):
    text = f"{mark}# measured\n\n{HEADER}# at night\n\n7, 0.1\n7.5,0.3\n"
    trace = Read(tmp_path, text)
    assert trace.times.tolist() == [7.0, 7.5]
    assert trace.delays.tolist() == [0.1, 0.3]
    assert not trace.is_lost.any()


@pytest.mark.parametrize(
    ("header", "delay"),
    [
        ("time_s,delay_s", 20.0),
        ("time_s, delay_ms", 0.02),
        ("time_s,delay_us", 2e-5),
    ],
)
def test_the_header_has_the_unit(header, delay, tmp_path):
    trace = Read(tmp_path, f"{header}\n0,10\n1,20\n")
    assert trace.times.tolist() == [0.0, 1.0]
    assert trace.delays.tolist() == pytest.approx([delay / 2, delay])


BAD = [
    (None, "must be readable (No such file or directory)"),
    (b"\xff\xfe", "must be readable (not UTF-8 text)"),
    ("", "must begin with the header time_s,delay_s or time_s,delay_ms or"),
    ("0,0.1\n1,0.1\n30,0.1\n", "time_s,delay_us, not '0,0.1'"),
    ("time,delay\n0,0.1\n30,0.1\n", "time_s,delay_us, not 'time,delay'"),
    ("time_s,rtt_ms\n0,1\n30,1\n", "time_s,delay_us, not 'time_s,rtt_ms'"),
    (f"{HEADER}0,0.1\n", "must have two packets, and has 1"),
    (f"{HEADER}0,0.1\n1,-0.1\n", "line 3, '1,-0.1': must be a delay >= 0"),
    (f"{HEADER}0,0.1\n1,nan\n30,1\n", "has 1; where packets are lost, kind must be"),
    (f"{HEADER}0,nan\n30,\n", "must have a delay that is a number"),
    (f"{HEADER}0,0.1\n0,0.1\n", "line 3, '0,0.1': must be later than the line before"),
    (f"{HEADER}0,0.1\n1\n", "line 3, '1': must be time_s,delay_s"),
    (f"{HEADER}0,0.1\n1,2,3\n", "line 3, '1,2,3': must be time_s,delay_s"),
    ("time_s,delay_ms\nx,y\n0,1\n", "line 2, 'x,y': must be time_s,delay_ms"),
    (f"{HEADER}O.0,0.1\n1,0.1\n", "line 2, 'O.0,0.1': must be time_s,delay_s"),
    (f"{HEADER}nan,0.1\n1,0.1\n", "line 2, 'nan,0.1': must be time_s,delay_s"),
    (f"{HEADER}0,inf\n1,0.1\n", "line 2, '0,inf': must be time_s,delay_s"),
    (f"{HEADER}0,0.1\n5,0.1\n", "at least as long as the duration, 25 s, not 5 s"),
]


@pytest.mark.parametrize(("text", "message"), BAD)
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


def test_what_is_lost_has_the_fate_of_the_packet(tmp_path):
    trace = Read(tmp_path, f"{HEADER}0,0.1\n1,lost\n2,0.3\n3,\n4,nan\n")
    assert trace.is_lost.tolist() == [False, True, False, True, True]
    assert trace.delays.tolist() == pytest.approx([0.1, 0.2, 0.3, 0.3, 0.3])
    assert [trace.IsLost(t) for t in (0, 0.99, 1, 1.99, 2)] == [0, 0, 1, 1, 0]


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
    assert trace.delays.tolist() == pytest.approx([0.005, 0.00625, 0.0055, 0.00475])
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
    trace = Read(tmp_path, f"{HEADER}5,0.1\n6,0.2\n7,0.3\n").Until(20.0, end)
    assert trace.times[0] == 0 and (trace.times[-1] >= 20) == (end == "repeat")
    shown = np.interp([0, 1, 2, 12, 13, 14], trace.times, trace.delays)
    assert shown.tolist() == pytest.approx([0.1, 0.2, 0.3, *late])


def test_a_run_has_the_losses_and_the_delays_of_its_trace(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("time_s,delay_ms\n0,20\n0.1,30\n0.2,lost\n0.3,40\n")
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


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"trace_end": "stop"}, "c.trace_end = 'stop': must be one of refuse, hold"),
        ({}, "at least as long as the duration, 9 s, not 1 s, unless trace_end"),
    ],
)
def test_bad_rules_for_a_trace(fields, message, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(f"{HEADER}0,0.1\n1,0.2\n")
    channel = NetworkChannelConfig(sample_period=0.1, trace=str(path), **fields)
    with pytest.raises(ScenarioError, match=re.escape(message)):
        channel.Check("c", 9.0)


def test_a_trace_that_overtakes_itself_is_for_a_network(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(f"{HEADER}0,0.3\n0.1,0.05\n0.2,0.4\n1,0.1\n")
    fields = {"delay": 0.1, "trace": str(path)}
    with pytest.raises(ScenarioError, match=r"overtake each other, kind must be netw"):
        VariableChannelConfig(**fields).Check("c", 1.0)
    NetworkChannelConfig(sample_period=0.1, **fields).Check("c", 1.0)
