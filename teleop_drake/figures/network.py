"""Figure of the packets of a run's networks, against time."""

import numpy as np
from matplotlib.axes import Axes

from teleop_drake.arrays import Array
from teleop_drake.blocks.channels import NetworkChannelConfig
from teleop_drake.blocks.channels.packet_network import PacketNetwork, Receiver
from teleop_drake.figures import style
from teleop_drake.figures.layout import MakePanels, NameAxes, NameColumns
from teleop_drake.figures.style import COLORS, Figure, Look
from teleop_drake.recording import Recording
from teleop_drake.tasks import TaskOf
from teleop_drake.validation import Refuse

_ROW_HEIGHT = 1.5  # inches

# Spans of time over which a share of lost packets is taken.
_NUM_SPANS = 40


def HasNetwork(recording: Recording) -> bool:
    """Returns whether PlotNetwork() has something to show."""
    return bool(_Networks(recording))


def PlotNetwork(recording: Recording, *, columns: int = 2) -> Figure:
    """Plots delay, age of information and loss of each network against time.

    The delay is that of each packet, over the time when it was sent; a cross at the top
    is one that was lost. The age is how old what the receiver shows is, and the loss
    the share of what was sent around a time. The packets are drawn again: they are
    functions of the scenario alone. Those of a trace need its file.

    Args:
        recording: A run with a channel of kind `network`, or of one of its names.
        columns: Columns of a printed page that the figure spans, 1 or 2.

    Raises:
        ValueError: If it has no such channel.
    """
    networks = _Networks(recording)
    if not networks:
        Refuse("recording", recording.scenario.name, "a run with a channel of packets")
    figure, axes = MakePanels(
        3,
        len(networks),
        height=3 * _ROW_HEIGHT + 0.4,
        width=style.WidthOf(columns),
        share_x="all",
        share_y="row",
        padding=0.1,
    )
    end = float(recording.time[-1])
    for column, (name, config) in zip(axes.T, networks.items(), strict=True):
        network = config.Network(recording.scenario.duration, stream=name)
        sent = np.arange(0.0, end, network.sample_period)
        arrivals = network.Arrivals(len(sent))
        delay, age, loss = column
        _DrawDelays(delay, sent, arrivals)
        age.plot(*_Age(network, config.receiver, end), color=COLORS[0], lw=0.9)
        _DrawLoss(loss, sent, np.isinf(arrivals), end)
        loss.set_xlim(0.0, end or 1.0)
        for ax in column:
            style.FormatAxes(ax)
    labels = ("delay of packets [ms]", "age of information [ms]", "packets lost [%]")
    NameColumns(axes, [name.replace("_", " ") for name in networks])
    NameAxes(axes, "time [s]", *labels)
    for ax in axes[:, 0]:
        # Where nothing is lost a range of its own would be rounding.
        ax.set_ylim(0.0, max(ax.get_ylim()[1], 1.0))
    figure.align_ylabels(axes[:, 0])
    lines = [line for ax in axes[:, 0] for line in ax.get_lines()]
    handles = [x for x in lines if x.get_label() in ("lost packet", "lost in all")]
    style.AddLegend(figure, handles, fontsize=style.SMALL_FONT_SIZE)
    return figure


def _Networks(recording: Recording) -> dict[str, NetworkChannelConfig]:
    """Returns the channels of a run that are networks, by the names of their fields."""
    channels = TaskOf(recording.scenario).Channels(recording.scenario)
    return {
        name: config
        for name, config in channels.items()
        if isinstance(config, NetworkChannelConfig)
    }


def _DrawDelays(ax: Axes, sent: Array, arrivals: Array) -> None:
    """Draws the delay of each packet, and the lost ones above the panel."""
    has_arrived = np.isfinite(arrivals)
    delays = 1e3 * (arrivals - sent)[has_arrived]
    ax.plot(sent[has_arrived], delays, ".", color=COLORS[0], markersize=2.5)
    lost = sent[~has_arrived]
    ax.plot(
        lost,
        np.full(len(lost), 1.03),
        transform=ax.get_xaxis_transform(),
        clip_on=False,
        in_layout=False,
        marker="x",
        linestyle="none",
        markersize=3,
        markeredgewidth=0.7,
        color=COLORS[1],
        label="lost packet",
    )


def _Age(network: PacketNetwork, receiver: Receiver, end: float) -> tuple[Array, Array]:
    """Returns the age of what is shown in ms, a saw tooth, and its times in s."""
    shown, sent = network.ShownUntil(receiver, end)
    until = np.append(shown[1:], end) if len(shown) else shown
    times = np.column_stack([shown, until]).ravel()
    ages = np.column_stack([shown - sent, until - sent]).ravel()
    return times, 1e3 * ages


def _DrawLoss(ax: Axes, sent: Array, is_lost: Array, end: float) -> None:
    """Draws the share of packets that was lost, in spans of time and in all."""
    edges = np.linspace(0.0, end or 1.0, _NUM_SPANS + 1)
    number, _ = np.histogram(sent, edges)
    lost, _ = np.histogram(sent[is_lost], edges)
    share = np.divide(100.0 * lost, number, out=np.zeros(len(lost)), where=number > 0)
    ax.stairs(share, edges, color=COLORS[0], fill=True, alpha=0.6)
    if len(sent):
        dashes: Look = {"color": style.GREY, "lw": 0.9, "linestyle": "--"}
        ax.axhline(100.0 * is_lost.mean(), **dashes, label="lost in all")
