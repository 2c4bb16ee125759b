"""Tests of recordings in notebooks and in pandas, and of their deferred fields."""

import copy
import dataclasses
import math
import pickle
import re

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from runs import Run

from teleop_drake.loops.run.recording import Event, Recording, UnknownSignal
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.figures.runs import PlotRun

NETWORK = ("forward_channel.kind=network", "forward_channel.sample_period=0.01")


def ShortRun(name: str = "two_dof_combined") -> Recording:
    return Run(
        name,
        "adaptive_backstepping",
        "duration=0.2",
        "simulator.accuracy=1e-4",
        *NETWORK,
    )


def test_repr_is_short_and_says_what_happened():
    recording = ShortRun()
    text = repr(recording)
    assert text.startswith(
        "<Recording of two_dof_combined, adaptive_backstepping: 0.2 s in "
    )
    assert len(text) < 200 and "\n" not in text and "completed" in text
    recording = dataclasses.replace(recording)
    recording.events = [Event(name=f"e{i}", time=0.1 * i) for i in range(5)]
    assert "e0 at 0 s, e1 at 0.1 s, e2 at 0.2 s, 2 more events" in repr(recording)


def test_html_has_every_metric_with_its_unit_and_a_figure():
    recording = ShortRun("one_dof")
    html = recording._repr_html_()
    overshoot = RunMetrics(recording)["start_velocity_overshoot"]
    # In the unit of the figure, whose panel begins with the velocity.
    speed = np.abs(recording["tool_velocity"]).max()
    exponent = 3 * math.floor(math.log10(10 * speed) / 3)
    unit = {-6: "\N{MICRO SIGN}m/s", -3: "mm/s", 0: "m/s"}[exponent]
    shown = f"{overshoot / 10.0**exponent:.5g}"
    row = f"start velocity overshoot</td><td>{shown}</td><td>{unit}</td>"
    assert row in html
    assert f"panels: velocity v_x [{unit}]" in html
    assert "align-items: flex-start" in html
    assert "forward channel sent</td><td>20</td>" in html
    assert re.search(r'<img alt="\d+ panels: velocity v_x \[m', html)
    assert "data:image/png;base64,iVBOR" in html


def test_events_and_notes_are_found_once_and_when_they_are_asked_for():
    recording = dataclasses.replace(ShortRun())
    calls = []

    def FindEvents(run):
        calls.append(run)
        return [Event(name="contact", time=0.1)]

    recording.FindLater({"events": FindEvents, "notes": lambda run: ["a note"]})
    assert calls == []
    for other in (recording, copy.copy(recording), dataclasses.replace(recording)):
        assert other.EventTimes("contact") == [0.1]
        assert other.notes == ["a note"]
    assert calls == [recording]
    assert pickle.loads(pickle.dumps(recording)).notes == ["a note"]
    with pytest.raises(AttributeError, match="a Recording has no attribute 'evens'"):
        recording.evens  # noqa: B018


def test_html_of_a_run_without_a_number_says_so():
    recording = dataclasses.replace(ShortRun())
    recording.signals = {
        n: np.full_like(x, np.nan) for n, x in recording.signals.items()
    }
    recording.reason = "1 < 2"
    html = recording._repr_html_()
    assert "1 &lt; 2" in html and "<table>" not in html


def test_a_notebook_shows_the_figure_of_a_run():
    figure = PlotRun(ShortRun("one_dof"), signals=["tool_velocity"])
    # A notebook shows the figure without pyplot.
    assert figure._repr_png_()[0].startswith(b"\x89PNG")
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert any("velocity" in label for label in labels)


def test_signals_are_completed_and_a_wrong_one_is_named():
    recording = ShortRun()
    assert recording._ipython_key_completions_() == list(recording)
    assert "psi" in recording and "Psi" not in recording
    with pytest.raises(KeyError) as info:
        recording["tool_velocty"]
    assert str(info.value).endswith("(did you mean 'tool_velocity'?)")
    with pytest.raises(UnknownSignal):
        recording.Interpolate("tool", np.array([0.1]))


def test_dataframe_has_every_sample():
    recording = ShortRun()
    table = recording.to_dataframe()
    assert_array_equal(table.index, recording.time)
    for name in recording:
        assert_array_equal(table[name], recording[name])
    assert table["psi", 3].iloc[-1] == recording["psi"][-1, 3]
    assert list(table["forward_packet_sent"]) == ["F_h x", "F_h y", "v_d x", "v_d y"]
