"""The figures of the thesis, made from new simulations.

Each has the same number as in the thesis and shows the same quantities. Units have SI
prefixes where these make the numbers readable.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure
from pydrake.systems.framework import Diagram

from teleop_drake.loops.draw.block_diagram import WriteDiagram
from teleop_drake.study.figures.runs import SaveFigure
from teleop_drake.thesis import plots


@dataclass(kw_only=True)
class ThesisFigure:
    """A figure of the thesis, or a template of such figures for several tasks.

    Attributes:
        number: The number in the thesis, for instance "4.1"; "" for a template.
        title: The contents in a few words.
        caption: The explanation of the contents.
        make: The function that makes a matplotlib Figure, or a Diagram to draw, from
            runs. In a template it takes the `task` as well.
        task: The scenario whose runs it shows; "" if it shows no run.
        live: The signals that the report plots from its own runs; if empty, the report
            has a picture.
    """

    number: str = ""
    title: str
    caption: str
    make: Callable[..., Figure | Diagram]
    task: str = ""
    live: Sequence[str] = ()

    @property
    def stem(self) -> str:
        """Name of its files without the suffix, for instance `figure_4_1`."""
        return "figure_" + self.number.replace(".", "_")


def WritePicture(
    picture: Figure | Diagram, stem: Path, formats: Sequence[str] = ("png", "svg")
) -> list[Path]:
    """Writes a figure or a block diagram in some formats.

    The same picture gives the same bytes. Each file appears complete or not at all.

    Args:
        picture: A figure, or a diagram, drawn as the boxes of its own parts.
        stem: The path without the suffix, in an existing folder.
        formats: The suffixes, without a dot.

    Raises:
        RuntimeError: If no program is installed that can lay out a block diagram.
    """
    paths = [stem.with_name(f"{stem.name}.{suffix}") for suffix in formats]
    if isinstance(picture, Figure):
        SaveFigure(picture, *paths)
    else:
        for path in paths:
            WriteDiagram(picture, path, max_depth=1)
    return paths


# Templates of figures for several tasks.

_TRACKING = ThesisFigure(
    title="Tracking",
    caption="Position of the tool, in grey the trajectory that it is to follow, and "
    "the tracking error. The axis y is the thesis's z.",
    make=partial(plots.PlotTracking, signal="tool_position"),
)
_DISTURBANCE = ThesisFigure(
    title="Disturbance and its estimate",
    caption="The force, and in grey what the network makes of it. The axis y is the "
    "thesis's z.",
    make=partial(plots.PlotTracking, signal="environment_force"),
)
_VELOCITY = ThesisFigure(
    title="Velocity of the tool",
    caption="Velocity of the tool with either controller, and in grey what the surgeon "
    "commands.",
    make=partial(
        plots.PlotBoth, signal="tool_velocity", label="velocity $v_{axis}$", unit="m/s"
    ),
    live=["tool_velocity"],
)
_SENSED_FORCE = ThesisFigure(
    title="Sensed force",
    caption="Force of the robot on its environment, as the sensor at the tool reads "
    "it.",
    make=partial(
        plots.PlotBoth,
        signal="environment_force",
        label="sensed force $F_{{e,{axis}}}$",
        unit="N",
    ),
    live=["environment_force"],
)
_CONTROL_FORCE = ThesisFigure(
    title="Control force",
    caption="Force that the controller asks of the robot: the delayed haptic force "
    "under direct force, the state of the backstepping law otherwise.",
    make=partial(
        plots.PlotBoth,
        signal="control_force",
        label="control force $F_{{c,{axis}}}$",
        unit="N",
    ),
    live=["control_force"],
)
_WEIGHTS_1 = ThesisFigure(
    title="Weights of the first network",
    caption=(
        "Weights for the unknown dynamics of the robot and its environment, a curve"
        " for each Gaussian, in the colour of its centre's x."
    ),
    make=partial(plots.PlotWeights, signal="weights_1"),
    live=["weights_1"],
)
_PSI = ThesisFigure(
    title="Estimate of the inverse inertia",
    caption=(
        "Entries of the matrix that stands for the inverse inertia, and below how "
        "far each is from its initial value."
    ),
    make=plots.PlotPsi,
    live=["psi", "change of psi"],
)
_WEIGHTS_3 = ThesisFigure(
    title="Weights of the third network",
    caption=(
        "Weights for the rate of change of the environment's force, a curve for "
        "each Gaussian, in the colour of its centre's x."
    ),
    make=partial(plots.PlotWeights, signal="weights_3"),
    live=["weights_3"],
)
_POSITION = ThesisFigure(
    title="Position of the tool",
    caption=("Position of the tool with either controller."),
    make=partial(
        plots.PlotBoth, signal="tool_position", label="position ${axis}$", unit="m"
    ),
    live=["tool_position"],
)
_LEARNED = [_WEIGHTS_1, _PSI, _WEIGHTS_3]


def _Group(
    *, chapter: int, first: int, task: str, about: str, kinds: Sequence[ThesisFigure]
) -> list[ThesisFigure]:
    """Returns the figures of a task, with consecutive numbers.

    Args:
        chapter: The number of the chapter.
        first: The number of the first figure within the chapter.
        task: The scenario of the figures.
        about: The first words of each caption.
        kinds: The templates of the figures.
    """
    return [
        replace(
            kind,
            number=f"{chapter}.{number}",
            caption=f"{about} {kind.caption}",
            make=partial(kind.make, task=task),
            task=task,
        )
        for number, kind in enumerate(kinds, first)
    ]


_ALL = [
    ThesisFigure(
        number="2.1",
        title="The loop",
        caption=(
            "Surgeon and haptic device, the two channels, controller, robot and "
            "environment, drawn from the very diagram that is simulated."
        ),
        make=plots.MakeLoop,
    ),
    ThesisFigure(
        number="2.4",
        title="Stiffness profile",
        caption=(
            "Force of the environment's springs against the position of the tool: on "
            "the left at the scale of the tissue, on the right at that of the bone. "
            "Damping is left out."
        ),
        make=plots.PlotStiffness,
    ),
    *_Group(
        chapter=3,
        first=2,
        task="network_tracking_linear",
        about=(
            "Planar arm under gravity, disturbed by a force that is proportional to the"
            " position on each axis (case I)."
        ),
        kinds=[_TRACKING, _DISTURBANCE],
    ),
    *_Group(
        chapter=3,
        first=4,
        task="network_tracking_coupled",
        about=(
            "Planar arm under gravity, disturbed by a force that is nonlinear and "
            "couples the axes (case II)."
        ),
        kinds=[_TRACKING, _DISTURBANCE],
    ),
    *_Group(
        chapter=4,
        first=1,
        task="one_dof",
        about=(
            "The slider of chapter 4 goes through tissue into free space and on to "
            "bone."
        ),
        kinds=[_VELOCITY, _SENSED_FORCE, _CONTROL_FORCE, *_LEARNED],
    ),
    *_Group(
        chapter=5,
        first=1,
        task="two_dof_puncture",
        about="Planar arm, case I: through tissue into free space.",
        kinds=[_VELOCITY, _SENSED_FORCE, _CONTROL_FORCE, *_LEARNED],
    ),
    *_Group(
        chapter=5,
        first=7,
        task="two_dof_collision",
        about="Planar arm, case II: through free space on to bone.",
        kinds=[_VELOCITY, _SENSED_FORCE, _POSITION, _CONTROL_FORCE, *_LEARNED],
    ),
    *_Group(
        chapter=5,
        first=14,
        task="two_dof_combined",
        about="Planar arm, case III: through tissue into free space and on to bone.",
        kinds=[_VELOCITY, _SENSED_FORCE, _POSITION, _CONTROL_FORCE, *_LEARNED],
    ),
]

FIGURES = {figure.number: figure for figure in _ALL}
"""All figures by their number, in the thesis's order."""
