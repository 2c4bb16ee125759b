"""Delays of single fields of a packet, before the packet is sent."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import Demultiplexer, Multiplexer

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.framework.arrays import Names
from teleop_drake.loops.framework.validation import CheckChoice, Refuse
from teleop_drake.loops.framework.wiring import Wire


def WithFieldDelays(
    channel: System,
    fields: Mapping[str, Any],
    names: Names,
    initial_value: Sequence[float],
    path: str,
) -> System:
    """Returns a channel that delays fields of its packets before it sends them.

        signal -> split -> delay of a field -> packet -> channel -> delayed_signal

    Args:
        channel: The channel.
        fields: The delays of fields, {name: {delay: s}}; empty: the channel itself is
            returned.
        names: The names of the fields of a packet, which have equal widths.
        initial_value: What a field is before its delay has passed.
        path: The channel's field in a scenario, for messages.

    Raises:
        ScenarioError: If the packet has no field of a name.
    """
    if not fields:
        return channel
    if not names:
        Refuse(f"{path}.fields", list(fields), "left out: the packet names no fields")
    for name in fields:
        CheckChoice(f"{path}.fields", name, names)
    width = len(initial_value) // len(names)
    systems: dict[str, System] = {
        "split": Demultiplexer([width] * len(names)),
        "packet": Multiplexer([width] * len(names)),
        "channel": channel,
    }
    connections = {"channel": "packet"}
    for i, name in enumerate(names):
        source = f"split.{systems['split'].get_output_port(i).get_name()}"
        target = f"packet.{systems['packet'].get_input_port(i).get_name()}"
        delay = fields.get(name, {}).get("delay", 0.0)
        if delay > 0:
            systems[name] = TransportDelay(
                delay=delay,
                size=width,
                initial_value=initial_value[i * width : (i + 1) * width],
                max_sample_interval=math.inf,
            )
            connections[name] = source
            source = name
        connections[target] = source
    return Wire(
        Diagram(),
        path,
        systems,
        inputs={"signal": ["split"]},
        connections=connections,
        outputs={"delayed_signal": "channel"},
    )
