"""Tests of teleop_drake.loops.delays.netem: lines of netem, read and written."""

import shutil
import subprocess

import pytest

from teleop_drake.cli import main
from teleop_drake.loops.delays.netem import (
    DISTRIBUTIONS,
    Chance,
    GilbertElliott,
    Netem,
    ParseNetem,
)
from teleop_drake.loops.framework.validation import ScenarioError

MS = 1_000_000

LINES = {
    "delay 100ms": Netem(delay=100 * MS),
    "latency 0.1s 5000us": Netem(delay=100 * MS, jitter=5 * MS),
    "delay 100ms 10ms 25% loss 0.3% duplicate 1% reorder 25% 50%": Netem(
        delay=100 * MS,
        jitter=10 * MS,
        correlation=0.25,
        loss=Chance(share=0.003),
        duplicate=Chance(share=0.01),
        reorder=Chance(share=0.25, correlation=0.5),
    ),
    "delay 1ms 200us distribution paretonormal": Netem(
        delay=MS, jitter=200_000, distribution="paretonormal"
    ),
    "loss random 5% 10%": Netem(loss=Chance(share=0.05, correlation=0.1)),
    "drop 5": Netem(loss=Chance(share=0.05)),
    # tc's defaults: r = 1 - p, 1-h = 100 %, 1-k = 0.
    "loss gemodel 10%": Netem(loss=GilbertElliott(to_bad=0.1, to_good=0.9)),
    "loss gemodel 1% 20% 90% 2%": Netem(
        loss=GilbertElliott(to_bad=0.01, to_good=0.2, bad_loss=0.9, good_loss=0.02)
    ),
    "delay 5ms reorder 100% gap 5": Netem(
        delay=5 * MS, reorder=Chance(share=1.0), gap=5
    ),
    "limit 20 delay 5ms": Netem(delay=5 * MS, limit=20),
    "sudo tc qdisc add dev eth0 root netem delay 3ms": Netem(delay=3 * MS),
    "qdisc netem 8001: root refcnt 2 limit 1000 delay 3.0ms  1.0ms": Netem(
        delay=3 * MS, jitter=MS
    ),
    "qdisc netem 8001: dev eth0 root refcnt 2 limit 1000 delay 3ms": Netem(
        delay=3 * MS
    ),
    "netem loss gemodel p 1% r 20% 1-h 100% 1-k 0%": Netem(
        loss=GilbertElliott(to_bad=0.01, to_good=0.2)
    ),
    "": Netem(),
}


@pytest.mark.parametrize("line", LINES)
def test_lines_are_read(line):
    assert ParseNetem("netem", line) == LINES[line]


@pytest.mark.parametrize("line", LINES)
def test_what_is_written_is_read_again(line):
    assert ParseNetem("netem", LINES[line].Line()) == LINES[line]


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("line", LINES)
def test_tc_reads_what_is_written(line, distribution):
    """tc looks for the device after it has read the options."""
    if shutil.which("tc") is None:
        pytest.skip("tc is not installed")
    text = LINES[line].Line()
    if LINES[line].jitter:
        text = Netem(delay=MS, jitter=MS, distribution=distribution).Line()
    device = "no-such-device"
    command = ["tc", "qdisc", "add", "dev", device, "root", "netem", *text.split()]
    said = subprocess.run(command, capture_output=True, check=False, text=True).stderr
    assert device in said, said
    assert "What is" not in said
    assert "Illegal" not in said


REFUSED = {
    "x": "options of netem; 'x' must be one of delay, loss",
    "delay 5": "delay is a time with a unit, as 100ms or 5us",
    "delay": "delay is a time with a unit",
    "delay 5ms 3s": "jitter is at most 2.147 s",
    "delay 5ms distribution normal": "a distribution has a jitter",
    "delay 5ms 1ms distribution gamma": "distribution is one of uniform, normal",
    "loss 120%": "loss is 0% to 100%",
    "loss gemodel": "p of gemodel is 0% to 100%",
    "loss state 1%": "without state, because a channel does not model losses of four",
    "corrupt 1%": "without corrupt, because a channel does not model corrupted bits",
    "rate 1mbit": "without rate, because a channel does not model the size of packets",
    "slot 20ms": "without slot",
    "reorder 5%": "what is reordered has a delay",
    "delay 5ms gap 3": "a gap has a percentage to reorder",
    "limit 0": "limit is a whole number >= 1",
}


@pytest.mark.parametrize("line", REFUSED)
def test_what_is_no_line_of_netem_is_refused(line):
    with pytest.raises(ScenarioError) as error:
        ParseNetem("forward_channel.netem", line)
    assert str(error.value).startswith(f"forward_channel.netem = {line!r}: must be")
    assert REFUSED[line] in str(error.value)


def Shown(capsys, *overrides):
    options = [x for item in overrides for x in ("--set", f"forward_channel.{item}")]
    assert main(["show", "one_dof", "--netem", *options]) == 0
    out = capsys.readouterr().out
    forward, _, _ = out.partition("# return_channel")
    _, command, *missing = forward.splitlines()
    return command.removeprefix("tc qdisc add dev DEV root netem "), missing


NETWORK = ("kind=network", "sample_period=0.01")
LIKE = [
    ([], "delay 100ms", []),
    (["kind=sampled", "sample_period=0.01"], "delay 100ms", ["a packet every 0.01 s"]),
    (
        [
            *NETWORK,
            "jitter={kind: uniform, std: 0.01}",
            "loss={kind: independent, probability: 0.02}",
            "duplicates=0.01",
        ],
        # The half width of a uniform distribution is sqrt 3 standard deviations.
        "delay 100ms 17.320508ms loss 2% duplicate 1%",
        ["a packet every 0.01 s"],
    ),
    (
        [
            *NETWORK,
            "jitter={kind: gamma, std: 0.01, minimum: 0.05, hold: 0.5}",
            "loss={kind: burst, probability: 0.1, burst_length: 5}",
        ],
        # To bad: 0.1/0.9/5.
        "delay 100ms 10ms distribution normal loss gemodel 2.22222222% 20% 100% 0%",
        ["a packet every", "gamma distribution", "a least delay", "that are held"],
    ),
    (
        [*NETWORK, "netem=delay 100ms 5ms reorder 5%", "receiver.policy=newest"],
        "delay 100ms 5ms reorder 5%",
        ["a packet every 0.01 s"],
    ),
    (
        [*NETWORK, "netem=delay 100ms", "receiver={policy: playout, depth: 0.01}"],
        "delay 100ms",
        ["a packet every 0.01 s", "the receiver, playout"],
    ),
    (
        ["fields={force: {delay: 0.02}, velocity: {delay: 0.0}}"],
        "delay 100ms",
        ["the older field force, which the sender has to delay by 0.02 s"],
    ),
    (
        ["kind=variable", "sinusoid={amplitude: 0.01, frequency: 3}", "drift=0.001"],
        # The mean over 25 s: 0.1 + 0.0125 + 0.01 (1 - cos 75)/75.
        "delay 112.510433ms",
        ["a delay that varies with time (drift, sinusoid)"],
    ),
    (
        [*NETWORK, "sample_period=0.0001"],
        "delay 100ms limit 4000",
        ["a packet every 0.0001 s"],
    ),
]


def CheckShown(shown, line, lacks):
    command, missing = shown
    assert command == line
    assert len(missing) == len(lacks)
    for found, expected in zip(missing, lacks, strict=True):
        assert found.startswith("# not in netem: ")
        assert expected in found


@pytest.mark.parametrize(("overrides", "line", "lacks"), LIKE)
def test_show_prints_the_line_and_what_it_lacks(overrides, line, lacks, capsys):
    CheckShown(Shown(capsys, *overrides, "delay=0.1"), line, lacks)


def test_losses_of_a_trace_are_named(tmp_path, capsys):
    """The second of its entries stands for 10 s of 25 s."""
    trace = tmp_path / "trace.csv"
    trace.write_text("time_s,delay_ms\n0,10\n10,NA\n20,10\n30,10\n")
    shown = Shown(capsys, *NETWORK, "delay=0.1", f"trace={trace}")
    varies = "a delay that varies with time (trace)"
    lacks = ["a packet", varies, "the losses of the trace, 40 % of packets"]
    CheckShown(shown, "delay 110ms", lacks)
