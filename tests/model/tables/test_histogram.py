"""A histogram of delays as the trace of a network."""

import numpy as np
import pytest

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.channels.variable import VariableChannelConfig
from teleop_drake.model.tables import ReadPackets
from teleop_drake.model.tables.packets import ReadMeasured


def write(tmp_path, text):
    path = tmp_path / "histogram.csv"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    "text",
    [
        "value_ms,count\n30,1\n10,2\n20,0\n",
        "Delay [s];Frequency\n0,01;2\n0,02;0\n0,03;1\n",
        "count\trtt_us\n2\t20000\n0\t40000\n1\t60000\n",
    ],
)
def test_a_histogram_is_a_distribution(text, tmp_path):
    histogram = ReadMeasured("trace", write(tmp_path, text))
    assert histogram.delays.tolist() == pytest.approx([0.01, 0.02, 0.03])
    assert histogram.counts.tolist() == [2, 0, 1]
    # Two thirds of the packets take 10 ms, one third 30 ms, and none 20 ms.
    shares = np.array([0, 0.66, 0.67, 1 - 1e-16])
    found = histogram.Quantiles(shares)
    assert found.tolist() == pytest.approx([0.01, 0.01, 0.03, 0.03])
    assert histogram.Summary().startswith(
        "histogram of 3 packets, median 10 ms, mean 16.67 ms, 10 to 30 ms ("
    )


def test_a_network_draws_from_it(tmp_path):
    """The shares of the drawn delays are those of the counts, for each seed anew."""
    file = write(tmp_path, "value_ms,count\n10,2\n20,5\n40,3\n")
    fields = {"delay": 0.05, "sample_period": 0.001, "trace": file}
    channel = NetworkChannelConfig(**fields)
    channel.Check("forward_channel", 20.0)
    sent = np.arange(20_000) * 0.001

    def Delays(stream="forward_channel", **more):
        network = NetworkChannelConfig(**fields, **more).Network(20.0, stream=stream)
        return np.round(1e3 * (network.Arrivals(20_000) - sent), 6)

    delays = Delays()
    values, counts = np.unique(delays, return_counts=True)
    assert values.tolist() == [60, 70, 90]
    # Three standard deviations of a share p of n packets, sqrt(p (1 - p) / n).
    assert counts / 20_000 == pytest.approx([0.2, 0.5, 0.3], abs=3 * 0.0035)
    assert np.corrcoef(delays[1:], delays[:-1])[0, 1] == pytest.approx(0, abs=0.022)
    assert (Delays() == delays).all()
    assert (Delays(seed=1) != delays).any()
    assert (Delays(stream="return_channel") != delays).any()
    # A longer run begins with the same packets.
    longer = NetworkChannelConfig(**fields).Network(40.0, stream="forward_channel")
    assert (np.round(1e3 * (longer.Arrivals(20_000) - sent), 6) == delays).all()
    block = channel.MakeChannel(size=1, initial_value=[0.0], duration=20.0)
    assert "drawn anew for each packet" in block.notes[0]


def test_where_there_are_no_packets_it_is_refused(tmp_path):
    file = write(tmp_path, "value_ms,count\n10,2\n20,5\n")
    channel = VariableChannelConfig(delay=0.05, trace=file)
    with pytest.raises(ScenarioError, match="only a channel of kind network draws"):
        channel.Check("forward_channel", 20.0)
    with pytest.raises(ScenarioError, match="must have a column of times"):
        ReadPackets("trace", file)
    file = write(tmp_path, "delay_ms,cumulative_count\n10,2\n20,5\n")
    with pytest.raises(ScenarioError, match="must have the time when a packet"):
        ReadMeasured("trace", file)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("value,count\n1,2\n", "column 'value': unit '': must be one of s, ms, us, ns"),
        ("value_ms,count\n-2,2\n", "line 2: must be a delay and a count, >= 0"),
        ("value_ms,count\n2,NA\n", "line 2: must be a delay and a count, >= 0"),
        ("value_ms,count\n2,0\n", "must have a count > 0"),
        ("value_ms,count\n2,x\n", "column 'count': line 2, 'x': must be a finite"),
    ],
)
def test_refused(text, message, tmp_path):
    with pytest.raises(ScenarioError) as error:
        ReadMeasured("trace", write(tmp_path, text))
    assert message in str(error.value)
