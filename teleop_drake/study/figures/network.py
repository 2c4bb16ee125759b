"""Figure of the packets of a run's networks, against time."""

import numpy as np
from matplotlib.axes import Axes

from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Receiver
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks import TaskOf
from teleop_drake.study.figures import style
from teleop_drake.study.figures.layout import MakeMultiples
from teleop_drake.study.figures.style import COLORS, GREY, MARK_STYLE, Figure, Key, Look

_HEIGHT = 4.9  # inches; of three rows

# The number of time spans, each of which has a share of lost packets.
_NUM_SPANS = 40

_LOST_STYLE: Look = {"marker": "x", "color": COLORS[1]}
_LOSS_STYLE: Look = {"color": GREY, "linewidth": 0.9, "linestyle": "--"}


def Networks(recording: TaskRecording) -> dict[str, NetworkChannelConfig]:
    """Returns the channels of a run that are networks, keyed by their fields."""
    channels = TaskOf(recording.scenario).Channels(recording.scenario)
    return {
        name: config
        for name, config in channels.items()
        if isinstance(config, NetworkChannelConfig)
    }


def PlotNetwork(recording: TaskRecording, *, columns: int = 2) -> Figure:
    """Plots delay, age of information and loss of each network against time.

    The delay of a packet is drawn at the time when the packet was sent; crosses above
    the panel mark lost packets. The age of information is the age of the packet that
    the receiver shows. The loss is the share of lost packets among those sent in a span
    of time. The packets are computed again, because they depend on the scenario only;
    a trace needs its file.

    Args:
        recording: A run with a channel of kind `network` or with a named network.
        columns: Columns of a printed page that the figure spans, 1 or 2.

    Raises:
        ValueError: If the run has no such channel.
    """
    networks = Networks(recording)
    if not networks:
        Refuse("recording", recording.scenario.name, "a run with a channel of packets")
    figure, axes = MakeMultiples(
        [name.replace("_", " ") for name in networks],
        "time [s]",
        ["delay of packets [ms]", "age of information [ms]", "packets lost [%]"],
        height=_HEIGHT,
        width=style.WidthOf(columns),
        padding=0.1,
    )
    # A run that was stopped at its start covers no time.
    end = recording.time[-1] or recording.scenario.duration
    for name, (delay, age, loss) in zip(networks, axes.T, strict=True):
        config = networks[name]
        network = config.Network(recording.scenario.duration, stream=name)
        _DrawPackets(delay, loss, network, end)
        _DrawAge(age, network, config.receiver, end)
    for ax in axes.flat:
        style.FormatAxes(ax)
        # Without lost packets, an automatic range would show rounding errors.
        ax.set(xlim=(0.0, end), ylim=(0.0, max(ax.get_ylim()[1], 1.0)))
    figure.align_ylabels()
    handles = [
        Key("lost packet", **_LOST_STYLE, **MARK_STYLE),
        Key("lost in all", **_LOSS_STYLE),
    ]
    style.AddLegend(figure, handles, fontsize=style.SMALL_FONT_SIZE)
    return figure


def _DrawPackets(delay: Axes, loss: Axes, network: PacketNetwork, end: float) -> None:
    """Draws the delays of packets, and the share of lost ones by span and overall.

    Lost packets are marked above the panel of the delay.
    """
    sent = network.SentTimes(network.CountUntil(end))
    arrivals = network.Arrivals(len(sent))
    is_lost = np.isinf(arrivals)
    delays = 1e3 * (arrivals - sent)
    delay.plot(sent[~is_lost], delays[~is_lost], ".", color=COLORS[0], markersize=2.5)
    style.MarkAbove(delay, sent[is_lost], **_LOST_STYLE)
    edges = np.linspace(0.0, end, _NUM_SPANS + 1)
    number, _ = np.histogram(sent, edges)
    lost, _ = np.histogram(sent[is_lost], edges)
    shares = 100.0 * lost / np.maximum(number, 1)
    loss.stairs(shares, edges, color=COLORS[0], fill=True, alpha=0.6)
    loss.axhline(100.0 * is_lost.mean(), **_LOSS_STYLE)


def _DrawAge(ax: Axes, network: PacketNetwork, receiver: Receiver, end: float) -> None:
    """Draws the age of the packet that a receiver shows, a sawtooth."""
    shown, sent = network.ShownUntil(receiver, end)
    # Both sides of each jump.
    times = np.append(np.repeat(shown, 2), end)[1:]
    ages = times - np.repeat(sent, 2)
    ax.plot(times, 1e3 * ages, color=COLORS[0], lw=0.9)
