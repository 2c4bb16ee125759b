"""Kernels of Drake's own systems."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, PortDataType, System
from pydrake.systems.primitives import (
    AffineSystem,
    LinearSystem,
    MatrixGain,
    WrapToSystem,
)

from teleop_drake.arrays import Array
from teleop_drake.engine.symbolic_kernel import IsOfDrake, SymbolicKernel
from teleop_drake.kernel import Kernel, Name, Term, Transition

# Farther away than the intervals of angles, and how many bisections find their ends.
_FAR = 1e3
_NUM_BISECTIONS = 100


def affine(constant: Array, A: Array, x: Array) -> Array:
    """Returns A x + constant."""
    return A @ x + constant


def affine_of_two(constant: Array, A: Array, x: Array, B: Array, u: Array) -> Array:
    """Returns A x + B u + constant."""
    return A @ x + B @ u + constant


def wrapped(lows: Array, periods: Array, sizes: Array, u: Array) -> Array:
    """Returns what is left of each signal in its interval.

    Args:
        lows: Where the intervals begin.
        periods: Their lengths; 1 without an interval.
        sizes: Their lengths; 0 without an interval.
        u: The signals.
    """
    rest: Array = u - sizes * np.floor((u - lows) / periods)
    return rest


def PrimitiveKernel(system: System, context: Context) -> Kernel | None:
    """Returns the kernel of one of Drake's own systems, None if it has none.

    Raises:
        UnsupportedSystem: If only a part of what it computes can be compiled.
    """
    if IsSink(system, context):
        return Kernel(unused=tuple(map(str, _Inputs(system))))
    make = KERNELS.get(type(system))
    return SymbolicKernel(system, context) if make is None else make(system)


def IsSink(system: System, context: Context) -> bool:
    """Returns whether no number depends on one of Drake's systems.

    Logs, visualizers and a SceneGraph have neither numbers as a state nor an output
    that is a vector.
    """
    ports = map(system.get_output_port, range(system.num_output_ports()))
    has_numbers = (
        any(port.get_data_type() == PortDataType.kVectorValued for port in ports)
        or context.num_continuous_states() > 0
        or context.num_discrete_state_groups() > 0
    )
    return IsOfDrake(system) and not has_numbers


def _Inputs(system: System) -> list[Name]:
    ports = map(system.get_input_port, range(system.num_input_ports()))
    return [port.get_name() for port in ports]


def _AffineKernel(system: AffineSystem) -> Kernel:
    """Returns the kernel of matrices, which may be other ones in the same program."""
    inputs = _Inputs(system)
    has_state = system.num_states() > 0
    is_discrete = has_state and system.time_period() > 0
    state = "mode" if is_discrete else "state"
    output: Term = (affine, "y0", "C", state)
    if system.HasAnyDirectFeedthrough():
        output = (affine_of_two, "y0", "C", state, "D", *inputs)
    law: Term = (affine, "f0", "A", state)
    if inputs:
        law = (affine_of_two, "f0", "A", state, "B", *inputs)
    step = Transition(mode=law, period=system.time_period(), is_discrete=True)
    outputs = {}
    if system.num_output_ports() > 0:
        outputs[system.get_output_port(0).get_name()] = output
    return Kernel(
        parameters={
            name: getattr(system, name)() for name in ("A", "B", "C", "D", "f0", "y0")
        },
        outputs=outputs,
        rate=law if has_state and not is_discrete else None,
        transitions={"steps": step} if is_discrete else {},
        # Without state, and with D = 0, nothing depends on them.
        unused=tuple(map(str, inputs)),
    )


def _WrapKernel(system: WrapToSystem) -> Kernel:
    """Returns the kernel of a system whose intervals only its outputs tell."""
    context = system.CreateDefaultContext()
    size = system.get_input_port().size()

    def At(u: Array) -> Array:
        system.get_input_port().FixValue(context, u)
        y: Array = system.get_output_port().Eval(context)
        return y

    inside = At(np.zeros(size))
    outside = inside + _FAR
    is_wrapped = At(outside) != outside
    # The ends of the intervals are the first values that do not stay as they are.
    below = inside
    for _ in range(_NUM_BISECTIONS):
        middle = (below + outside) / 2
        stays = At(middle) == middle
        below = np.where(stays, middle, below)
        outside = np.where(stays, outside, middle)
    lows = np.where(is_wrapped, At(outside), 0.0)
    sizes = np.where(is_wrapped, outside - lows, 0.0)
    periods = np.where(is_wrapped, sizes, 1.0)
    return Kernel(
        outputs={"y0": (wrapped, "lows", "periods", "sizes", "u0")},
        parameters={"lows": lows, "periods": periods, "sizes": sizes},
    )


KERNELS: dict[type[System], Callable[[Any], Kernel]] = {
    AffineSystem: _AffineKernel,
    LinearSystem: _AffineKernel,
    MatrixGain: _AffineKernel,
    WrapToSystem: _WrapKernel,
}
"""Kernels that are not made of the symbolic form of a system, by its class itself."""
