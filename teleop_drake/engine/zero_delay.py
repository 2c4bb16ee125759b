"""Delays that may be 0 in a program whose delays are numbers.

A program takes what comes out of a delay as given, so that a signal may depend on
itself through a delay. Where the delay can be 0, its output is computed from its signal
instead, which must not depend on the output then.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.arrays import Array
from teleop_drake.blocks.channels.transport import TransportDelay
from teleop_drake.kernel import Delay, Kernel


def pass_at_zero(delay: float, delayed: Array, signal: Array) -> Array:
    """Returns what comes out of a delay: the signal itself if the delay is 0 s."""
    passed: Array = np.where(delay > 0.0, delayed, signal)
    return passed


def PassAtZero(system: System, kernel: Kernel) -> Kernel:
    """Returns a block's kernel, whose constant delays pass signals on where they are 0.

    It is one kernel for all delays, 0 included.
    """
    delays = list(kernel.delays)
    if isinstance(system, TransportDelay) and not delays:
        value = system.initial_value
        delay = Delay(
            signal="signal", output="delayed_signal", initial_value=value, time=0.0
        )
        delays.append(delay)
    outputs: dict[str, Any] = dict(kernel.outputs)
    parameters = dict(kernel.parameters)
    for k, delay in enumerate(delays):
        if delay.shown is not None or callable(delay.time):
            continue
        time = f"time of {delay.output}"
        under_way = f"{delay.output} under way"
        parameters[time] = delay.time
        outputs[delay.output] = pass_at_zero, time, under_way, delay.signal
        delays[k] = replace(delay, output=under_way)
    return replace(kernel, outputs=outputs, parameters=parameters, delays=delays)
