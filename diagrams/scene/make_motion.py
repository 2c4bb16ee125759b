"""Makes motion.gif, the animation at the top of the README.

    python diagrams/scene/make_motion.py [FILE.gif]

simulates case III with both controllers and delays of 0.1 s each way: an arm pushes its
tool through tissue on to bone. The animation shows both arms and, below them, the
velocity of both tools over time. The script needs no browser.
"""

import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from teleop_drake import Figure, LoadScenario, simulate
from teleop_drake.study.figures.style import COLORS

SCENARIO = "two_dof_combined"
TITLES = {
    "direct_force": "force passed straight on",
    "adaptive_backstepping": "adaptive controller",
}
END = 5.0  # s
NUM_FRAMES, FRAME_MS = 60, 100
SIZE, DOTS_PER_INCH = (8.3, 4.4), 100  # inches: 830 pixels wide
LINK_LENGTH = 0.75  # m, of each link


def DrawPlace(ax, title):
    """Draws tissue and bone; returns the line of the arm."""
    ax.axvspan(0.8, 1.0, color="#F3D2C1", lw=0)
    ax.axvspan(1.1, 1.2, color="#C9C2B2", lw=0)
    ax.text(0.9, 0.085, "tissue", ha="center", fontsize=11)
    ax.text(1.15, 0.085, "bone", ha="center", fontsize=11)
    ax.set(xlim=(0.8, 1.2), ylim=(-0.05, 0.12), xticks=[], yticks=[])
    ax.set_title(title, fontsize=13)
    ax.spines[["left", "bottom"]].set_visible(False)
    return ax.plot([], [], "-", color="#404040", lw=5, solid_capstyle="round")[0]


def Elbow(position):
    """Returns the position of the elbow, above the line from the base to the tool."""
    half = position / 2
    height = np.sqrt(LINK_LENGTH**2 - half @ half)
    return half + height * np.array([-position[1], position[0]]) / np.hypot(*position)


def Frames(runs):
    """Yields the frames of the animation."""
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH)
    panels = figure.subplot_mosaic([list(runs), ["velocity"] * 2], height_ratios=[1, 1])
    below = panels["velocity"]
    below.axhline(0.1, color="#808080", lw=1)
    below.text(4.95, 0.112, "commanded", color="#606060", fontsize=11, ha="right")
    below.set(xlim=(0, END), ylim=(-0.21, 0.21))
    below.set_xlabel("time [s], 0.1 s of delay each way", fontsize=12)
    below.set_ylabel("tool velocity [m/s]", fontsize=12)
    arms, tools, curves = {}, {}, {}
    for (name, _), color in zip(runs.items(), COLORS, strict=False):
        arms[name] = DrawPlace(panels[name], TITLES[name])
        (tools[name],) = panels[name].plot([], [], "o", color=color, ms=13)
        (curves[name],) = below.plot([], [], color=color, lw=2, label=TITLES[name])
    below.legend(loc="lower left", fontsize=11, frameon=False)
    for end in np.linspace(0.05, END, NUM_FRAMES):
        for name, run in runs.items():
            tool = run.Interpolate("tool_position", [end])[0]
            arms[name].set_data(*np.transpose([Elbow(tool), tool]))
            tools[name].set_data([tool[0]], [tool[1]])
            times = np.linspace(0, end, 400)
            velocity = run.Interpolate("tool_velocity", times)[:, 0]
            curves[name].set_data(times, velocity)
        picture = io.BytesIO()
        figure.savefig(picture, format="png", dpi=DOTS_PER_INCH)
        yield Image.open(picture).convert("RGB")


def main(file: Path) -> None:
    """Writes the animation, which shows its last frame for two seconds."""
    runs = {
        kind: simulate(LoadScenario(SCENARIO, {"controller.kind": kind}))
        for kind in TITLES
    }
    frames = list(Frames(runs))
    palette = frames[-1].quantize(64)
    first, *others = [x.quantize(palette=palette, dither=0) for x in frames]
    durations = [FRAME_MS] * len(others) + [2000]
    first.save(
        file,
        save_all=True,
        append_images=others,
        duration=durations,
        loop=0,
        optimize=True,
    )
    print(f"Written: {file}")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2] or [Path(__file__).with_name("motion.gif")]))
