"""Writes the living diagram: one HTML file in which a block diagram simulates."""

import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from pydrake.systems.framework import Context, System

from teleop_drake.loops.framework.validation import Refuse, RefuseGiven
from teleop_drake.loops.page import diagram_page
from teleop_drake.loops.page.diagram_page import DURATION
from teleop_drake.loops.page.document import Page
from teleop_drake.loops.page.sliders import Ranges

if TYPE_CHECKING:
    from teleop_drake.model.scenario import AnyScenario
    from teleop_drake.model.scenario.overrides import Overrides

# A scenario, its name or file; a system; or a function that makes one.
Shown: TypeAlias = (
    "str | os.PathLike[str] | AnyScenario | System | Callable[[], System]"
)


def Explore(
    scenario_or_diagram: Shown,
    overrides: "Overrides" = (),
    *,
    controllers: Sequence[str] | None = None,
    signals: Sequence[str] = (),
    context: Context | None = None,
    **ranges: Sequence[Any],
) -> Page:
    """Returns the living diagram for a notebook, with a slider for each range.

    Args:
        context: The initial Context of the runs of a diagram.
        **ranges: As `vary` of MakePage(), except that the range of a number may be
            given by any values, of which the least and the largest are its ends. All
            other arguments and errors are those of MakePage().
    """
    for key, values in ranges.items():
        if np.ndim(values) == 0 or not len(values):
            Refuse(key, values, "values to vary it: (LEAST, LARGEST), or several kinds")
    vary = {
        key: values if isinstance(values[0], str) else (min(values), max(values))
        for key, values in ranges.items()
    }
    return MakePage(
        scenario_or_diagram,
        controllers=controllers,
        signals=signals,
        vary=vary or None,
        overrides=overrides,
        context=context,
    )


def WritePage(
    scenario_or_diagram: Shown,
    path: str | os.PathLike[str],
    *,
    controllers: Sequence[str] | None = None,
    signals: Sequence[str] = (),
    vary: Ranges | None = None,
    overrides: "Overrides" = (),
    duration: float = DURATION,
    context: Context | None = None,
    suppress_initialization_events: bool = False,
    has_hand: bool = False,
    delays: str | None = None,
) -> list[str]:
    """Writes a living diagram.

    All arguments except the path are those of MakePage().

    Returns:
        Sentences on missing parts of the page, with reasons.

    Raises:
        OSError: If the file cannot be written. All others are those of MakePage().
    """
    page = MakePage(
        scenario_or_diagram,
        controllers=controllers,
        signals=signals,
        vary=vary,
        overrides=overrides,
        duration=duration,
        context=context,
        suppress_initialization_events=suppress_initialization_events,
        has_hand=has_hand,
        delays=delays,
    )
    page.Save(path)
    return page.notes


def MakePage(
    scenario_or_diagram: Shown,
    *,
    controllers: Sequence[str] | None = None,
    signals: Sequence[str] = (),
    vary: Ranges | None = None,
    overrides: "Overrides" = (),
    duration: float = DURATION,
    context: Context | None = None,
    suppress_initialization_events: bool = False,
    has_hand: bool = False,
    delays: str | None = None,
) -> Page:
    """Makes a page that shows a block diagram and simulates it.

    The page opens from disk in any current browser. It needs no network and loads no
    other file. A run that grows without bound is drawn until a recorded signal is
    10 000 times as large as in the first run; signals below 1 in SI units count as 1.

    Args:
        scenario_or_diagram: A scenario, its name or file; any system whose blocks have
            kernels; or a function that makes one, whose docstring is the page's story.
        controllers: The kinds of controllers to show side by side; None: those that the
            task compares. A diagram has none.
        signals: The signals that the scopes show at first, by their names in
            recordings; empty: velocity, force and position of the tool.
        vary: The numbers that can be changed, each with its least and largest value.
            Constant delays of a scenario can always be changed. A field that is not a
            number, such as `surgeon.kind`, has the values to choose from, each with a
            separate program. For a diagram, the keys are names of parameters and
            initial states, or `delay`; see SetNumbers(). None: all delays and, of a
            diagram, four parameters. Its other parameters have fields in the boxes of
            blocks.
        overrides: Overrides of the scenario, as for LoadScenario().
        duration: The duration of a diagram's runs, s.
        context: The initial Context of a diagram's runs, with parameters and fixed
            inputs; None: the default Context.
        suppress_initialization_events: As for simulate(), for a diagram's runs.
        has_hand: Whether the user of the page takes the operator's place.
        delays: "all": each connection of vectors has a delay of 0 s that can be
            changed; a click on it shows the delay and the margin by DelayMargins(),
            linearised where the run begins. None: only the delays of blocks.

    Raises:
        UnsupportedSystem: If a block has no kernel; the message names the block.
        ScenarioError: If a scenario or a range is not allowed, or if the changes of a
            number by two of `vary` do not add up.
    """
    if isinstance(scenario_or_diagram, System) or callable(scenario_or_diagram):
        if controllers or overrides or has_hand:
            Refuse("controllers, overrides, has_hand", "given", "left out of a diagram")
        return diagram_page.MakePage(
            scenario_or_diagram,
            signals=signals,
            vary=vary,
            duration=duration,
            context=context,
            suppress_initialization_events=suppress_initialization_events,
            delays=delays,
        )
    diagram_page.CheckDelays(delays, has_hand=has_hand)
    RefuseGiven(
        "left out where a page is of a scenario",
        context=context,
        suppress_initialization_events=suppress_initialization_events,
    )
    from teleop_drake.study.page.scenario_page import DataOfScenario

    notes: list[str] = []
    story, data = DataOfScenario(
        scenario_or_diagram,
        overrides,
        controllers,
        vary or {},
        notes,
        has_hand=has_hand,
        has_late_wires=delays is not None,
    )
    return diagram_page.FinishPage(story, data, signals, notes)
