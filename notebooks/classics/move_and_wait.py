"""Move and wait: completion time against delay. (Sheridan and Ferrell.)

People who control a remote hand through a delay move a part of the way, wait until they
see the result, and move again. The completion time then grows by one round trip T for
each move, t(T) = t(0) + N T, where the number N of moves depends on how exact the task
is and not on the delay. Whoever does not wait, but corrects what is seen all the time
with the crossover frequency w_c, is stable only for w_c T < pi/2.

Source: T. B. Sheridan and W. R. Ferrell, "Remote manipulative control with transmission
delay", IEEE Trans. Human Factors in Electronics 4 (1963), for strategy and law; W. R.
Ferrell, "Remote manipulation with transmission delay", ibid. 6 (1965), for the
prediction of N from data without delay. The number of moves of an operator who covers a
share of what remains, and the limit of a delayed integrator, are derived here:
N = ceil(ln(tolerance)/ln(1 - share)).
"""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import Adder, ConstantVectorSource, Gain, Integrator

from classics import InPageStyle
from teleop_drake import MoveAndWaitConfig, Recording, TransportDelay, simulate
from teleop_drake.study.figures.style import COLORS, LINES, Figure

WAY = 0.1  # m
SPEED = 0.1  # m/s
TOLERANCES = (0.1, 0.02)  # as shares of the way
SHARE = 0.8
CROSSOVER = 3.0  # rad/s; McRuer's and Jex's is 3 to 5 without a delay
ROUND_TRIPS = (0.0, 0.5, 1.0, 2.0, 3.0)  # s


def AddRemoteTool(
    builder: DiagramBuilder, command: System, round_trip: float
) -> tuple[System, System]:
    """Adds a tool that moves with the command, late, and that is seen, late.

    Returns what shows the position and what shows the velocity that is seen.
    """
    forward = builder.AddNamedSystem("forward", TransportDelay(round_trip / 2, 1))
    tool = builder.AddNamedSystem("tool", Integrator(1))
    position = builder.AddNamedSystem("position", TransportDelay(round_trip / 2, 1))
    velocity = builder.AddNamedSystem("velocity", TransportDelay(round_trip / 2, 1))
    builder.Connect(command, forward.get_input_port())
    builder.Connect(forward.get_output_port(), tool.get_input_port())
    builder.Connect(forward.get_output_port(), velocity.get_input_port())
    builder.Connect(tool.get_output_port(), position.get_input_port())
    builder.ExportOutput(position.get_output_port(), "seen_position")
    return position, velocity


def MakeMoveAndWait(round_trip: float, tolerance: float) -> Diagram:
    """Makes the loop of an operator who moves and waits."""
    builder = DiagramBuilder()
    config = MoveAndWaitConfig(
        velocity=np.array([SPEED]),
        goal=np.array([WAY]),
        tolerance=tolerance,
        share=SHARE,
    )
    operator = builder.AddNamedSystem("operator", config.MakeOperator(start=[0.0]))
    position, velocity = AddRemoteTool(
        builder, operator.GetOutputPort("velocity_command"), round_trip
    )
    no_force = builder.AddNamedSystem("no_force", ConstantVectorSource([0.0]))
    for name, source in (
        ("felt_position", position),
        ("felt_velocity", velocity),
        ("haptic_force", no_force),
    ):
        builder.Connect(source.get_output_port(), operator.GetInputPort(name))
    diagram = builder.Build()
    diagram.set_name("move_and_wait")
    return diagram


def MakeContinuous(round_trip: float) -> Diagram:
    """Makes the loop of an operator who corrects what is seen all the time."""
    builder = DiagramBuilder()
    goal = builder.AddNamedSystem("goal", ConstantVectorSource([WAY]))
    error = builder.AddNamedSystem("error", Adder(2, 1))
    crossover = builder.AddNamedSystem("crossover", Gain(CROSSOVER, 1))
    minus = builder.AddNamedSystem("minus", Gain(-1.0, 1))
    position, _ = AddRemoteTool(builder, crossover.get_output_port(), round_trip)
    builder.Connect(position.get_output_port(), minus.get_input_port())
    builder.Connect(goal.get_output_port(), error.get_input_port(0))
    builder.Connect(minus.get_output_port(), error.get_input_port(1))
    builder.Connect(error.get_output_port(), crossover.get_input_port())
    diagram = builder.Build()
    diagram.set_name("continuous")
    return diagram


def CompletionTime(recording: Recording, tolerance: float) -> float:
    """Returns from when on the tool is seen at the goal, in s; infinity: never."""
    distance = np.abs(recording["seen_position"][:, 0] - WAY)
    outside = np.flatnonzero(distance > tolerance * WAY)
    if outside[-1] + 1 == len(distance):
        return np.inf
    last, next_one = recording.time[outside[-1] : outside[-1] + 2]
    times = np.linspace(last, next_one, 100)
    inside = np.abs(recording.Interpolate("seen_position", times)[:, 0] - WAY)
    return float(times[np.argmax(inside <= tolerance * WAY)])


def MoveAndWaitTime(round_trip: float, tolerance: float) -> float:
    """Returns the completion time of an operator who moves and waits."""
    loop = MakeMoveAndWait(round_trip, tolerance)
    recording = simulate(loop, duration=8.0 + 4 * round_trip)
    return CompletionTime(recording, tolerance)


def ContinuousTime(
    round_trip: float, tolerance: float, duration: float = 20.0
) -> float:
    """Returns the completion time of an operator who does not wait."""
    recording = simulate(MakeContinuous(round_trip), duration=duration)
    return CompletionTime(recording, tolerance)


def Slope(tolerance: float) -> float:
    """Returns by how many seconds the time grows for each second of round trip."""
    first, last = (MoveAndWaitTime(x, tolerance) for x in (ROUND_TRIPS[1], 3.0))
    return (last - first) / (3.0 - ROUND_TRIPS[1])


@InPageStyle
def Draw() -> Figure:
    """Draws completion times, and both strategies at one delay."""
    figure = Figure(figsize=(7.0, 2.2))
    left, right = figure.subplots(1, 2)
    for i, tolerance in enumerate(TOLERANCES):
        found = [MoveAndWaitTime(x, tolerance) for x in ROUND_TRIPS]
        name = f"move and wait, to {100 * tolerance:g} %"
        left.plot(ROUND_TRIPS, found, "o-", ms=3.5, color=COLORS[i], label=name)
    trips = np.linspace(0, 0.5, 11)
    found = [ContinuousTime(x, TOLERANCES[1]) for x in trips]
    left.plot(
        trips, found, ls=LINES[1], color=COLORS[2], label="without waiting, to 2 %"
    )
    left.set(ylim=(0, 18), xlabel="round trip [s]", ylabel="completion time [s]")
    left.legend(loc="upper right")
    for i, (name, loop) in enumerate(
        (
            ("move and wait", MakeMoveAndWait(1.0, TOLERANCES[1])),
            ("without waiting", MakeContinuous(1.0)),
        )
    ):
        run = simulate(loop, duration=8.0)
        position = 100 * run["seen_position"][:, 0]
        right.plot(run.time, position, ls=LINES[i], color=COLORS[(1, 2)[i]], label=name)
    right.set(ylim=(-10, 30), xlabel="time [s]", ylabel="seen position [cm]")
    right.set_title("round trip 1 s")
    right.legend()
    return figure
