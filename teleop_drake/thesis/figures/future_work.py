"""Figures on what section 6.3 leaves to future work. They are ours."""

from matplotlib.figure import Figure

from teleop_drake.figures.style import COLORS, FONT_SIZE, LINES
from teleop_drake.thesis.claims.future_work import (
    AS_IN_THE_THESIS,
    PUMA,
    Varying,
)
from teleop_drake.thesis.claims.learning import PathDistance, WeightDrift
from teleop_drake.thesis.claims.measures import NetworkOutput
from teleop_drake.thesis.claims.requests import (
    ADAPTIVE,
    DIRECT,
    LEARNING,
    NO_ADAPTATION,
)
from teleop_drake.thesis.figures.figure import AddLegendAbove, ThesisFigure, TimeFigure
from teleop_drake.thesis.runs import ThesisRuns

_SETTINGS = {
    "direct force": DIRECT,
    "no adaptation": NO_ADAPTATION,
    "as in the thesis": AS_IN_THE_THESIS,
    "these settings": {},
}

# Samples from one to the next at which the closed form is computed.
_EVERY = 30


def _PlotLearning(runs: ThesisRuns) -> Figure:
    """Plots distances from the path, and below what the first network says along y."""
    recordings = {name: runs(LEARNING, **x) for name, x in _SETTINGS.items()}
    last = recordings["these settings"]
    figure, (above, below) = TimeFigure(last, 2)
    for i, (name, recording) in enumerate(recordings.items()):
        style = {
            "color": COLORS[i],
            "linestyle": LINES[i % len(LINES)],
            "linewidth": 1.1,
            "label": name,
        }
        above.plot(recording.time, 1e3 * PathDistance(recording), **style)
        if "weights_1" in recording.signals:
            estimate = NetworkOutput(recording, "weights_1")[:, 1]
            below.plot(recording.time, estimate, **style)
    drift = WeightDrift(last.teleoperation, last["tool_position"][::_EVERY])[:, 1]
    below.plot(last.time[::_EVERY], drift, color="black", lw=1.1, label="true")
    above.set_ylabel("distance from the path [mm]", fontsize=FONT_SIZE)
    below.set_ylabel("$W_1 \\Phi$, y [m/s²]", fontsize=FONT_SIZE)
    curves = above.get_lines()[-len(recordings) :]
    AddLegendAbove(figure, [*curves, below.get_lines()[-1]])
    return figure


_PUMA = {
    "direct force": DIRECT,
    "adaptive": ADAPTIVE,
    "direct force, varying delays": {**DIRECT, **Varying(10.0)},
    "adaptive, varying delays": {**ADAPTIVE, **Varying(10.0)},
}


def _PlotPuma(runs: ThesisRuns) -> Figure:
    """Plots velocity and sensed force along x of the runs on the Puma 560."""
    recordings = {name: runs(PUMA, **x) for name, x in _PUMA.items()}
    figure, (above, below) = TimeFigure(recordings["adaptive"], 2)
    for i, (name, recording) in enumerate(recordings.items()):
        style = {
            "color": COLORS[i],
            "linestyle": LINES[i // 2],
            "linewidth": 1.1,
            "label": name,
        }
        velocity, force = recording["tool_velocity"], recording["environment_force"]
        above.plot(recording.time, velocity[:, 0], **style)
        below.plot(recording.time, force[:, 0], **style)
    above.set_ylabel("velocity $v_x$ [m/s]", fontsize=FONT_SIZE)
    below.set_ylabel("sensed force $F_{e,x}$ [N]", fontsize=FONT_SIZE)
    AddLegendAbove(figure, below.get_lines()[-len(recordings) :])
    return figure


FIGURES = [
    ThesisFigure(
        number="6.1",
        title="A weight that the law does not know",
        caption="The motors of the planar arm leave a tenth of its weight, which acts "
        "along y, while the hand goes round. Above, how far the tool is "
        "from where the command has led it. Below, what the first network says "
        "along y, and what the weight really adds to ds/dt.",
        requests=[(LEARNING, dict(x)) for x in _SETTINGS.values()],
        make=_PlotLearning,
    ),
    ThesisFigure(
        number="6.2",
        title="A Puma 560, with delays that vary",
        caption="The task of case III on a Puma 560. The delays are 0.1 s each way, or "
        "swing by half of it at 10 rad/s.",
        requests=[(PUMA, dict(x)) for x in _PUMA.values()],
        make=_PlotPuma,
    ),
]
"""The figures of the chapter by ascending number."""
