import dataclasses
import itertools
import re

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal
from scene_recordings import SOLVER
from surfaces import Border

from teleop_drake.loops.run.recording import Event, Recording
from teleop_drake.model.scenario import ARCHITECTURES, LoadScenario
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks.panels import SignalRow
from teleop_drake.study.figures.runs import (
    PlotComparison,
    PlotRows,
    PlotRun,
    SaveFigure,
)
from teleop_drake.study.figures.saving import DescribeFigure
from teleop_drake.study.figures.selection import SelectTime
from teleop_drake.study.figures.style import COLORS, RunStyle

TASKS = {"one_dof": 1, "two_dof_combined": 2}


def MakeRecording(name: str, kind: str, growth: float = 0.0) -> TaskRecording:
    """Makes up a run which oscillates by 1 %, times exp(growth) at the end."""
    scenario = LoadScenario(name, {"controller.kind": kind})
    n = scenario.num_axes
    x0 = scenario.robot.start
    v_d = scenario.surgeon.velocity
    assert Border(scenario, "puncture") is not None
    t_puncture = float((Border(scenario, "puncture") - x0[0]) / v_d[0])
    duration = 3 * t_puncture
    half = np.linspace(0, t_puncture, 40)
    t = np.concatenate([half, np.linspace(t_puncture, duration, 80)])
    speed = np.linalg.norm(v_d)
    wave = speed * 0.01 * np.exp(growth * t / duration) * np.sin(40 * t / duration)
    v = np.tile(v_d, (len(t), 1)) + wave[:, None]
    F_e = np.zeros((len(t), n))
    F_e[: len(half), 0] = 0.5 * v[: len(half), 0]
    command = np.hstack([0.5 * v, np.tile(v_d, (len(t), 1))])
    signals = {
        "tool_position": x0 + np.outer(t, v_d) + 0.1 * wave[:, None],
        "tool_velocity": v,
        "environment_force": F_e,
        "control_force": 0.5 * v,
        "forward_packet_sent": command,
    }
    if kind == "adaptive_backstepping":
        signals["psi"] = np.tile(4.0 * np.eye(n).ravel(), (len(t), 1))
        signals["weights_1"] = np.outer(wave, np.arange(1, 5 * n + 1))
        signals["weights_3"] = -signals["weights_1"]
    return TaskRecording(
        scenario=scenario,
        time=t,
        signals=signals,
        surfaces=scenario.Surfaces(),
        events=[Event(name="puncture", time=t_puncture)],
        solver=SOLVER,
        termination="diverged" if growth > 0 else "completed",
    )


def Pair(name: str, growth: float = 0.0) -> dict[str, TaskRecording]:
    return {
        "direct force": MakeRecording(name, "direct_force", growth),
        "adaptive": MakeRecording(name, "adaptive_backstepping"),
    }


@pytest.fixture(scope="module")
def comparison():
    return PlotComparison(Pair("one_dof"))


def Panel(figure: Figure, label: str, column: int = 0) -> Axes:
    """Returns the panel whose row has the label."""
    rows = [ax.get_ylabel() for ax in figure.axes[::2]]
    matches = [i for i, text in enumerate(rows) if label in text]
    assert len(matches) == 1, rows
    return figure.axes[2 * matches[0] + column]


def Curves(ax: Axes) -> list:
    """Returns the lines that show a signal: not those across a panel, not markers."""
    return [
        line
        for line in ax.lines
        if len(line.get_xdata()) > 2 and line.get_linestyle() != "None"
    ]


def test_comparison_shows_every_signal():
    figure = PlotComparison(Pair("two_dof_combined"))
    labels = ["velocity $v_x", "sensed force $F_{e,x}", "position $x"]
    labels += ["control force $F_{c,x}"]
    labels += ["velocity $v_y", "position $y", "control force $F_{c,y}"]
    assert len(figure.axes) == 2 * len(labels)
    for label in labels:
        for column in (0, 1):
            ax = Panel(figure, label, column)
            if (label, column) == ("position $x", 1):
                assert not ax.get_visible()
                continue
            curves = Curves(ax)
            # Both runs, and what is commanded to either.
            assert len(curves) == (4 if "velocity" in label else 2)
            colors = {curve.get_color() for curve in curves[-2:]}
            styles = {curve.get_linestyle() for curve in curves[-2:]}
            assert len(colors) == len(styles) == 2
        assert re.search(r"\[[mµ]?(m|m/s|N)\]$", Panel(figure, label).get_ylabel())
    assert figure.axes[-2].get_xlabel() == "time [s]"
    assert re.fullmatch(r"position \$x\$ \[m?m\]", figure.axes[-1].get_xlabel())
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["direct force", "adaptive", "commanded velocity", "puncture"]


def test_curves_are_the_signals(comparison):
    direct = MakeRecording("one_dof", "direct_force")
    time, position = (Panel(comparison, "velocity", k) for k in (0, 1))
    assert "[mm/s]" in time.get_ylabel()
    curve = Curves(time)[-2]
    against_x = Curves(position)[-2]
    t = curve.get_xdata()
    v = curve.get_ydata()
    assert np.all(np.diff(t) >= 0)
    assert len(t) > 1000  # Smooth, although there are 120 samples.
    unique = np.unique(direct.time)
    expected = direct.Interpolate("tool_velocity", unique)[:, 0]
    assert_allclose(np.interp(unique, t, v), 1e3 * expected, rtol=1e-12)
    x = direct.Interpolate("tool_position", unique)[:, 0]
    assert_allclose(
        np.interp(unique, t, against_x.get_xdata()), 1e3 * x, rtol=1e-12, atol=1e-12
    )
    assert_array_equal(against_x.get_ydata(), v)


def test_a_jump_stays_a_jump(comparison):
    curve = Curves(Panel(comparison, "sensed force"))[-1]
    t = curve.get_xdata()
    F = curve.get_ydata()
    (i,) = np.flatnonzero(np.diff(t) == 0)
    assert F[i] > 0.3
    assert np.all(F[i + 1 :] == 0)
    assert np.all(F[:i] > 0.3)


def test_puncture_and_contact_are_marked(comparison):
    ax = Panel(comparison, "sensed force")
    markers = [line for line in ax.lines if line.get_marker() == "^"]
    assert len(markers) == 2
    for marker in markers:
        assert marker.get_xdata() == [pytest.approx(7.5)]
        assert marker.get_ydata()[0] > 0.3  # As it was just before.
    # The contact surface is a border in the range, but nothing touched it: no square.
    texts = [text.get_text() for text in comparison.axes[1].texts]
    assert texts == ["puncture", "contact"]
    assert not any(line.get_marker() == "s" for line in ax.lines)

    recordings = Pair("one_dof")
    recordings["adaptive"].events.append(Event(name="contact", time=15.0))
    recordings["adaptive"].events.append(Event(name="contact", time=16.0))
    figure = PlotComparison(recordings, signals=["environment_force"])
    ax = Panel(figure, "sensed force")
    (square,) = [line for line in ax.lines if line.get_marker() == "s"]
    assert square.get_xdata() == [15.0]


def test_divergence_leaves_the_range_useful():
    recordings = Pair("one_dof", growth=10.0)
    direct, adaptive = (x["tool_velocity"][:, 0] for x in recordings.values())
    assert np.ptp(direct) > 1e3 * np.ptp(adaptive)
    figure = PlotComparison(recordings, signals=["tool_velocity"])
    ax = Panel(figure, "velocity $v_x")
    assert np.ptp(ax.get_ylim()) < 5 * np.ptp(Curves(ax)[-1].get_ydata())
    (end,) = [line for line in ax.lines if line.get_marker() == "x"]
    assert end.get_xdata() == [recordings["direct force"].time[-1]]
    low, high = ax.get_ylim()
    assert low <= end.get_ydata()[0] <= high
    legend = figure.legends[0].get_texts()[0].get_text()
    assert re.fullmatch(r"direct force \(diverges at [0-9.]+ s\)", legend)


def test_a_run_that_diverges_alone_is_visible():
    recording = MakeRecording("one_dof", "direct_force", growth=20.0)
    ax = Panel(PlotRun(recording, signals=["tool_velocity"]), "velocity")
    curve = Curves(ax)[-1]
    v = curve.get_ydata()
    early = v[curve.get_xdata() <= 0.7 * recording.time[-1]]
    low, high = ax.get_ylim()
    assert low < early.min() < early.max() < high
    assert high - low < 0.2 * np.ptp(v)


@pytest.mark.parametrize(
    ("size", "unit"),
    [(9e-5, "µN"), (200.0, "kN"), (0.0, "N")],
)
def test_units_have_suitable_prefixes(size, unit):
    recording = MakeRecording("one_dof", "direct_force")
    recording.signals["control_force"] = (
        size * np.linspace(0, 1, len(recording.time))[:, None]
    )
    ax = Panel(PlotRun(recording, signals=["control_force"]), "control force")
    assert ax.get_ylabel().endswith(f"[{unit}]")
    scale = {"n": 1e9, "µ": 1e6, "m": 1e3, "N": 1, "k": 1e-3}[unit[0]]
    assert max(Curves(ax)[0].get_ydata()) == pytest.approx(size * scale)
    low, high = ax.get_ylim()
    assert low < 0 < size * scale < high or size == 0


def test_constant_signal_is_not_blown_up():
    recording = MakeRecording("one_dof", "adaptive_backstepping")
    recording["psi"][-1] += 1e-9
    ax = Panel(PlotRun(recording, signals=["psi"]), "Psi")
    low, high = ax.get_ylim()
    assert high - low == pytest.approx(0.08, rel=1e-3)


@pytest.mark.slow
def test_run_shows_what_an_adaptive_controller_learns(subtests):
    recording = MakeRecording("two_dof_combined", "adaptive_backstepping")
    figure = PlotRun(recording)
    for label, unit, count in (
        ("Psi", "1/kg", 4),
        ("W_1", "m/s²", 10),
        ("W_3", "N/s", 10),
    ):
        with subtests.test(label=label):
            ax = Panel(figure, label)
            assert ax.get_ylabel().endswith(f"[{unit}]")
            assert len(Curves(ax)) == len(Curves(Panel(figure, label, 1))) == count
            texts = [text.get_text() for text in ax.get_legend().get_texts()]
            if count == 4:
                assert texts == [rf"$\Psi_{{{k}}}$" for k in ("11", "12", "21", "22")]
            else:
                assert texts == ["5 of axis $x$", "5 of axis $y$"]
                # A row of the matrix has one colour.
                colors = [to_hex(line.get_color()) for line in Curves(ax)]
                assert colors == [colors[0]] * 5 + [colors[5]] * 5
                assert colors[0] != colors[5]
    slider = MakeRecording("one_dof", "adaptive_backstepping")
    legend = PlotRun(slider, signals=["weights_1"]).axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["all 5"]
    assert "W_1" not in DescribeFigure(
        PlotRun(MakeRecording("one_dof", "direct_force"))
    )


def test_a_diagram_of_ones_own_has_a_panel_for_each_signal():
    """Also a constant, and a signal of several components."""
    time = np.linspace(0, 2, 11)
    waves = np.stack([np.sin(time), np.cos(time)], 1)
    run = Recording(
        time=time,
        signals={"some_waves": waves, "level": np.ones((11, 1))},
        events=[],
        solver=MakeRecording("one_dof", "direct_force").solver,
    )
    figure = PlotRun(run)
    assert [ax.get_ylabel() for ax in figure.axes] == ["some waves", "level"]
    assert [len(Curves(ax)) for ax in figure.axes] == [2, 1]
    assert figure.axes[1].get_xlim() == (0.0, 2.0)
    assert len(PlotRun(run, signals=["level"], columns=1).axes) == 1
    names = ["theta", "thetadot"]
    named = dataclasses.replace(run, components={"some_waves": names})
    legend = PlotRun(named).axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == names
    with pytest.raises(ValueError, match=r"^signals = \[\]: must be"):
        PlotRun(run, signals=[])


def test_many_runs_differ_in_colour_or_style():
    run = MakeRecording("one_dof", "direct_force")
    figure = PlotComparison(
        {f"run {k}": run for k in range(36)}, signals=["tool_position"]
    )
    curves = Curves(Panel(figure, "position"))
    assert len(curves) == 36
    looks = {(to_hex(line.get_color()), str(line._dash_pattern)) for line in curves}
    assert len(looks) == 36


def test_one_sample_can_be_drawn():
    recording = MakeRecording("one_dof", "adaptive_backstepping")
    first = dataclasses.replace(
        recording,
        time=recording.time[:1],
        steps=np.empty((0, 0), int),
        signals={name: x[:1] for name, x in recording.signals.items()},
        events=[],
    )
    PlotRun(first, signals=["tool_velocity", "psi"]).draw_without_rendering()


def test_a_part_of_the_time_and_some_signals_are_shown():
    recording = MakeRecording("two_dof_combined", "adaptive_backstepping")
    figure = PlotRun(
        recording, signals=["tool_velocity", "forward_packet_sent"], time=(0.33, 1.9)
    )
    labels = [" ".join(ax.get_ylabel().split()) for ax in figure.axes[::2]]
    assert labels == ["velocity $v_x$ [m/s]", "velocity $v_y$ [mm/s]", PACKET]
    assert figure.axes[0].get_xlim() == (0.33, 1.9)
    times = np.array([0.33, 1.0, 1.9])
    line = Curves(figure.axes[0])[-1]
    shown = np.interp(times, line.get_xdata(), line.get_ydata())
    expected = recording.Interpolate("tool_velocity", times)[:, 0]
    assert_allclose(shown, expected, atol=1e-7)


PACKET = "forward packet sent"


def test_a_run_that_diverges_after_the_window_does_not_end_in_it():
    run = MakeRecording("one_dof", "direct_force", growth=3.0)
    end = float(run.time[-1])
    assert SelectTime(run, (0.1, end / 2)).termination == "completed"
    assert SelectTime(run, (0.1, end + 1)).termination == "diverged"
    assert SelectTime(run, None) is run
    for window, reason in (((2.0, 1.0), "later one"), ((end, end + 1), "has ended")):
        with pytest.raises(ValueError, match=reason):
            SelectTime(run, window)


def test_one_printed_column_has_the_panels_against_time():
    signals = ["tool_velocity", "tool_position"]
    figure = PlotComparison(Pair("one_dof"), signals=signals, columns=1)
    assert figure.get_figwidth() < 3.5
    assert all(ax.get_xlim()[0] == 0 for ax in figure.axes)
    figure.draw_without_rendering()
    box = figure.get_tightbbox()
    assert box.x0 >= -0.01 and box.x1 <= figure.get_figwidth() + 0.01


def test_more_than_three_runs_have_a_column_each():
    runs = {f"law {i}": MakeRecording("one_dof", "direct_force") for i in range(4)}
    runs["law 2"] = MakeRecording("one_dof", "direct_force", growth=3.0)
    figure = PlotComparison(runs, signals=["tool_velocity", "control_force"])
    assert len(figure.axes) == 8
    assert [ax.get_title().split("\n")[0] for ax in figure.axes[:4]] == list(runs)
    assert "diverges at" in figure.axes[2].get_title()
    assert "control force F_c,x [mN]; of law 0, law 1, law 2" in DescribeFigure(figure)
    for i, ax in enumerate(figure.axes[:4]):
        colors = {to_hex(line.get_color()) for line in Curves(ax)}
        assert to_hex(RunStyle(i)["color"]) in colors
        assert to_hex(RunStyle((i + 1) % 4)["color"]) not in colors


def test_runs_of_every_architecture_fit_on_a_page():
    kinds = [kind.replace("_", " ") for kind in ARCHITECTURES]
    run = MakeRecording("one_dof", "direct_force")
    figure = PlotComparison(dict.fromkeys(kinds, run), signals=["control_force"])
    figure.draw_without_rendering()
    axes = [ax for ax in figure.axes if ax.get_visible()]
    titled = [ax for ax in axes if ax.get_title()]
    assert [" ".join(ax.get_title().split()) for ax in titled] == kinds
    assert len({ax.title.get_color() for ax in titled}) == len(kinds)
    texts = [ax.title for ax in titled] + [ax.yaxis.label for ax in axes]
    boxes = [text.get_window_extent() for text in texts if text.get_text()]
    assert len(boxes) > len(kinds)
    for first, second in itertools.combinations(boxes, 2):
        assert not first.overlaps(second)
    for ax in axes:
        low, high = ax.get_xlim()
        assert sum(low <= tick <= high for tick in ax.get_xticks()) >= 3


# Linear RGB as it is seen without red, green and blue cones: Machado, Oliveira and
# Fernandes, "A physiologically-based model ..." (2009).
CONES = {
    "all": "1 0 0; 0 1 0; 0 0 1",
    "no red": "0.152286 1.052583 -0.204868; 0.114503 0.786281 0.099216; "
    "-0.003882 -0.048116 1.051998",
    "no green": "0.367322 0.860646 -0.227968; 0.280085 0.672501 0.047413; "
    "-0.011820 0.042940 0.968881",
    "no blue": "1.255528 -0.076749 -0.178779; -0.078411 0.930809 0.147602; "
    "0.004733 0.691367 0.303900",
}
TO_XYZ = "0.4339 0.3762 0.1899; 0.2126 0.7152 0.0722; 0.0177 0.1095 0.8729"


def Matrix(text):
    return np.array([row.split() for row in text.split(";")], dtype=float)


@pytest.mark.parametrize("cones", CONES)
def test_the_colour_blind_can_tell_the_runs_apart(cones):
    """Distances in CIE Lab, of which 2.3 is just noticeable."""
    rgb = np.array([to_rgb(color) for color in COLORS])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ Matrix(CONES[cones]).T, 0, 1)
    xyz = seen @ Matrix(TO_XYZ).T
    X, Y, Z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116).T
    lab = np.array([116 * Y, 500 * (X - Y), 200 * (Y - Z)]).T
    distances = [np.linalg.norm(a - b) for a, b in itertools.combinations(lab, 2)]
    assert min(distances) > 15


def test_figures_are_described_in_words(tmp_path):
    figure = PlotComparison(Pair("one_dof"), signals=["tool_velocity"])
    text = DescribeFigure(figure)
    assert text.startswith("2 panels: velocity v_x [mm/s]; against time [s] and posit")
    assert "Legend: direct force, adaptive, commanded velocity" in text
    SaveFigure(figure, tmp_path / "a.svg")
    assert "<title>2 panels: velocity v_x" in (tmp_path / "a.svg").read_text()
    SaveFigure(figure, tmp_path / "a.png")
    assert b"Description\x002 panels: velocity v_x" in (tmp_path / "a.png").read_bytes()


def test_bad_arguments():
    run = MakeRecording("one_dof", "direct_force")
    with pytest.raises(KeyError, match="did you mean 'tool_velocity'"):
        PlotRun(run, signals=["tool_velocty"])
    with pytest.raises(ValueError, match=r"^columns = 3: must be 1 or 2"):
        PlotRun(run, columns=3)
    with pytest.raises(ValueError, match=r"recordings = \{\}"):
        PlotComparison({})
    with pytest.raises(ValueError, match=r"num_axes = \[1, 2\]: must be the same"):
        PlotComparison({name: MakeRecording(name, "direct_force") for name in TASKS})


def test_no_global_state_changes(tmp_path):
    before = dict(matplotlib.rcParams)
    figures = pyplot.get_fignums()
    with matplotlib.rc_context({"axes.prop_cycle": "cycler('color', ['r'])"}):
        red = PlotComparison(Pair("one_dof"), signals=["tool_velocity"])
    SaveFigure(red, tmp_path / "figure.svg")
    assert dict(matplotlib.rcParams) == before
    assert pyplot.get_fignums() == figures


def test_saved_figures_are_reproducible(tmp_path, monkeypatch, subtests):
    magic = {"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}
    for k in range(2):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", str(10**6 * k))  # Days later.
        figure = Figure(figsize=(1, 1))
        figure.add_subplot().plot([0, 1], marker="x", label="clipped")
        for suffix in magic:
            SaveFigure(figure, tmp_path / f"figure{k}.{suffix}")
    for suffix, start in magic.items():
        with subtests.test(suffix=suffix):
            first, second = (
                (tmp_path / f"figure{k}.{suffix}").read_bytes() for k in range(2)
            )
            assert first == second and first.startswith(start)
    assert len(list(tmp_path.iterdir())) == 6


def test_saving_fails_without_leftovers(tmp_path):
    recording = MakeRecording("one_dof", "direct_force")
    figure = PlotRun(recording, signals=["tool_velocity"])
    with pytest.raises(ValueError, match=r"figure\.gif': must be \*\.png"):
        SaveFigure(figure, tmp_path / "figure.gif")
    with pytest.raises(OSError, match="missing"):
        SaveFigure(figure, tmp_path / "missing" / "figure.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_nothing_overlaps():
    """Labels, legend and panels keep clear of each other."""
    recordings = Pair("one_dof", growth=5.0)
    for recording in recordings.values():
        recording.events.append(Event(name="contact", time=recording.time[-1]))
    figure = PlotComparison(recordings)
    figure.draw_without_rendering()
    boxes = [figure.legends[0].get_window_extent()]
    boxes += [
        ax.get_tightbbox()
        for ax in figure.axes[::2] + figure.axes[1::2]
        if ax.get_visible()
    ]
    for i, first in enumerate(boxes):
        assert first.x0 >= 0
        assert first.x1 <= figure.bbox.width
        for second in boxes[i + 1 :]:
            width = min(first.x1, second.x1) - max(first.x0, second.x0)
            height = min(first.y1, second.y1) - max(first.y0, second.y0)
            # Two points: the cross of a diverged run may reach over its panel.
            assert min(width, height) < 2 * figure.dpi / 72


def test_an_event_is_marked_on_a_curve_with_a_reference():
    """The curve is the signal without itself: 0."""
    row = SignalRow(
        label="error",
        unit="m/s",
        signal="tool_velocity",
        components=(0,),
        reference="tool_velocity",
    )
    figure = PlotRows({"run": MakeRecording("one_dof", "direct_force")}, [row])
    lines = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 1]
    assert [line.get_ydata().tolist() for line in lines] == [[0.0]]
