"""Measured delays, read from a file."""

import math
import re

import numpy as np
import pytest

from teleop_drake import simulate
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.channels.trace import ReadTrace
from teleop_drake.model.channels.variable import VariableChannelConfig
from teleop_drake.model.scenario import LoadScenario, ScenarioError

HEADER = "time_s,delay_s\n"


def Read(tmp_path, text):
    path = tmp_path / "trace.txt"
    path.write_text(text, encoding="utf-8")
    return ReadTrace("trace", str(path))


def test_a_trace_that_cannot_be_read_names_its_channel(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("time,delay\n0,0.1\n30,0.1\n")
    override = f"forward_channel={{kind: network, sample_period: 0.01, trace: {path}}}"
    with pytest.raises(ScenarioError) as e:
        LoadScenario("one_dof", [override])
    assert str(e.value).startswith("forward_channel.trace = ")
    assert "'time' must have a unit" in str(e.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            f"{HEADER}0,0.1\n1,nan\n30,1\n",
            "has 1; where packets are lost, kind must",
        ),
        (f"{HEADER}0,nan\n30,\n", "must have a delay that is a number"),
        (f"{HEADER}0,0.1\n5,0.1\n", "at least as long as the duration, 25 s, not 5 s"),
        (f"{HEADER}0,0.1\n1,0.1\n1,0.2\n30,1\n", "packets overtake each other"),
    ],
)
def test_traces_that_a_variable_delay_refuses(text, message, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(text)
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


@pytest.mark.parametrize("kind", ["variable", "network"])
def test_the_notes_of_a_run_say_what_was_read(kind, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("t_ms;round\n0;40\n20000;44\n")
    trace = {"file": str(path), "columns": {"time": 1, "rtt": "round"}}
    trace["units"] = {"rtt": "ms"}
    channel = {"kind": kind, "delay": 0.0, "trace": trace}
    if kind == "network":
        channel["sample_period"] = 0.01
    overrides = {"forward_channel": channel, "duration": 0.1}
    run = simulate(LoadScenario("one_dof", overrides))
    assert run.notes == [
        "forward_channel: 2 packets in 20 s, 0 lost, median 21 ms, 20 to 22 ms (half "
        "of rtt), clock: seconds"
    ]


def test_a_loss_of_a_slow_trace_is_one_of_many_packets(tmp_path):
    """One ping a second under packets of 10 ms: a lost one stands for a hundred."""
    path = tmp_path / "t.csv"
    path.write_text(f"{HEADER}0,0.02\n1,lost\n2,0.02\n3,0.02\n")
    channel = NetworkChannelConfig(delay=0.0, sample_period=0.01, trace=str(path))
    assert np.isinf(channel.Network(3.0).Arrivals(300)).sum() == 100
    block = channel.MakeChannel(size=1, initial_value=[0.0], duration=3.0)
    block.set_name("there")
    (_, note) = block.RunNotes(np.array([0.0, 3.0]), {})
    assert note == (
        "there: a packet that was lost in the trace stands for about 100 packets, "
        "because its entries are 1 s apart and the packets 0.01 s; `loss` loses "
        "packets one by one"
    )
    channel.sample_period = 0.8
    block = channel.MakeChannel(size=1, initial_value=[0.0], duration=3.0)
    assert len(block.RunNotes(np.array([0.0, 3.0]), {})) == 1


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
