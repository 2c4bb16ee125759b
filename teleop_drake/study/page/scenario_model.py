"""The model of a scenario's run in a page: a diagram's, with bounds and metrics."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.signals import SystemsByPath
from teleop_drake.loops.numerics.instants import SAME
from teleop_drake.loops.page.late_wires import LateWires
from teleop_drake.loops.page.model import PERIOD, Flat, MakeModel, Model
from teleop_drake.model.blocks.operators.hand import HandOperator
from teleop_drake.model.channels import ChannelConfig
from teleop_drake.model.run.ending import BoundsOf
from teleop_drake.model.run.scenario_run import BoundOf, HasConstantCommand
from teleop_drake.model.scenario import AnyScenario, AsTeleoperation
from teleop_drake.model.signals import NamedSignals, UnitOf
from teleop_drake.model.tasks import Task, TaskOf
from teleop_drake.model.tasks.metrics import MetricUnits
from teleop_drake.model.teleoperator import MakeTeleoperator

# The time until which packets are drawn in a drive, whose duration is only a bound, s.
_LONGEST_FLIGHTS = 60.0


def ModelOf(
    scenario: AnyScenario, *, has_hand: bool = False, has_late_wires: bool = False
) -> Model:
    """Returns the model of a scenario's run.

    Args:
        scenario: A valid scenario.
        has_hand: Whether the user of the page takes the operator's place.
        has_late_wires: Whether each connection has a delay, of 0 s.

    Raises:
        UnsupportedSystem: If a block has no kernel; the message names the block.
    """
    task = TaskOf(scenario)
    diagram = task.MakeDiagram(scenario)
    if has_hand:
        operator = HandOperator(num_axes=AsTeleoperation(scenario).num_axes)
        diagram = MakeTeleoperator(AsTeleoperation(scenario), operator=operator)
    channels = task.Channels(scenario)
    model = MakeModel(
        diagram,
        scenario.simulator,
        scenario.duration,
        signals=NamedSignals(diagram.GetSystems()),
        late=LateWires.Of(diagram) if has_late_wires else None,
    )
    ports = model.Ports()
    signals = {name: ports[port] for name, port in model.Signals().items()}
    sizes = {name: size for name, (_, size, _) in signals.items()}
    # Each bound is given by the columns of its signal in a row of y.
    bounds = BoundsOf(SystemsByPath(diagram), sizes, BoundOf(task, scenario))
    rows = [
        (signals[bound.signal][0] + bound.first, bound.size, bound.lower, bound.upper)
        for bound in bounds
    ]
    numbers: dict[str, ArrayLike] = {"bounds": rows}
    for name, channel in channels.items():
        way = name.partition("_")[0]
        numbers[way] = _Lags(channel, name, scenario.duration)
    if "forward_channel" in channels:
        numbers["command"] = AsTeleoperation(scenario).surgeon.velocity
        numbers["command_delay"] = channels["forward_channel"].delay
    metrics = _PageMetrics(task)
    return replace(
        model,
        unit_of=UnitOf,
        numbers=model.numbers | Flat(numbers),
        facts={
            **model.facts,
            "feed": _FeedOf(model) if has_hand else None,
            "reasons": [bound.name for bound in bounds],
            "metrics": metrics,
            "labels": _Labels(scenario) if metrics else {},
            "has_constant_command": HasConstantCommand(SystemsByPath(diagram)),
        },
    )


def _FeedOf(model: Model) -> tuple[int, int]:
    """Returns begin and size in y of the hand's command."""
    fed = model.run.evaluator.program.fed
    blocks = model.run.evaluator.blocks
    (place,) = (fed[x] for x in fed if isinstance(blocks[x.block].system, HandOperator))
    return place.start, place.stop - place.start


def _PageMetrics(task: Task[Any]) -> str:
    """Returns the function that computes a task's metrics in a page.

    See Task.page_metrics. It is defined by the class that defines Metrics(). If this
    class does not define it, the result is "".
    """
    defining = next(x for x in type(task).__mro__ if "Metrics" in vars(x))
    name: str = vars(defining).get("page_metrics", "")
    return name


def _Labels(scenario: AnyScenario) -> dict[str, str]:
    """Returns the label of each metric in a page, with its unit.

    The ending of a run has another row in the page, and packets are not counted.
    """
    labels = {}
    channels = TaskOf(scenario).Channels(scenario)
    for name, unit in MetricUnits(scenario).items():
        if name.partition(".")[0] in ("diverged", "diverged_at", *channels):
            continue
        label = name.replace("_", " ").replace(".", ": ")
        labels[name] = f"{label} [{unit}]" if unit else label
    return labels


def _Lags(channel: ChannelConfig, name: str, duration: float) -> Array:
    """Returns how long each packet is under way, s, if one is sent every PERIOD.

    A lost packet is under way for an infinite time. If the time is constant, the result
    has one element.
    """
    sent = np.arange(0.0, min(duration, _LONGEST_FLIGHTS), PERIOD)
    lags = channel.Arrivals(sent, duration, name) - sent
    is_constant = np.abs(lags - lags[0]).max() < SAME
    return np.array([channel.delay]) if is_constant else lags
