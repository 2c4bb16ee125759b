"""Kernels of Drake's own blocks."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.systems import primitives
from pydrake.systems.framework import Context, System

from teleop_drake.arrays import Array
from teleop_drake.compiler.flatten import UnsupportedSystem
from teleop_drake.kernel import Kernel, Name, Term, Transition, times


def affine(constant: Array, A: Array, x: Array) -> Array:
    """Returns A x + constant."""
    return A @ x + constant


def affine_of_two(constant: Array, A: Array, x: Array, B: Array, u: Array) -> Array:
    """Returns A x + B u + constant."""
    return A @ x + B @ u + constant


def total(*terms: Array) -> Array:
    """Returns the sum of vectors."""
    result = np.zeros(len(terms[0]))
    for term in terms:
        for i in range(len(result)):
            result[i] += term[i]
    return result


def limited(u: Array, lower: Array, upper: Array) -> Array:
    """Returns u, no less than `lower` and no more than `upper`."""
    return np.minimum(np.maximum(u, lower), upper)


def sine(order: int, u: Any, amplitude: Array, frequency: Array, phase: Array) -> Array:
    """Returns a derivative of amplitude sin(frequency u + phase).

    Args:
        order: Of the derivative, 0 to 2.
        u: The time, or as many numbers as there are amplitudes.
        phase: Phases in rad.
    """
    quarter_turns = order * (np.pi / 2)
    angle = frequency * u + phase + quarter_turns
    result: Array = amplitude * frequency**order * np.sin(angle)
    return result


def PrimitiveKernel(system: System, context: Context) -> Kernel | None:
    """Returns the kernel of one of Drake's own blocks, None if it is none of them.

    Raises:
        UnsupportedSystem: If it is one, but not in a form that can be compiled.
    """
    make = KERNELS.get(type(system))
    return None if make is None else make(system, context)


def _Inputs(system: System) -> list[Name]:
    ports = map(system.get_input_port, range(system.num_input_ports()))
    return [port.get_name() for port in ports]


def _Output(system: System, term: Term) -> dict[str, Term]:
    return {system.get_output_port(0).get_name(): term}


def _Responses(system: System, u: float) -> list[Array]:
    """Returns the outputs of a block without state at a time u, or for inputs u."""
    context = system.CreateDefaultContext()
    context.SetTime(max(u, 0.0))
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
        port.FixValue(context, np.full(port.size(), u))
    ports = map(system.get_output_port, range(system.num_output_ports()))
    return [np.array(port.Eval(context)) for port in ports]


def _Gain(system: primitives.Gain, context: Context) -> Kernel:
    return Kernel(
        parameters={"gain": _Responses(system, 1.0)[0]},
        outputs=_Output(system, (times, "gain", *_Inputs(system))),
    )


def _Demultiplexer(system: primitives.Demultiplexer, context: Context) -> Kernel:
    outputs: dict[str, Term] = {}
    end = 0
    for i, size in enumerate(system.get_output_ports_sizes()):
        first, end = end, end + size
        name = system.get_output_port(i).get_name()
        outputs[name] = (_Inputs(system)[0], first, end)
    return Kernel(outputs=outputs)


def _AffineSystem(system: primitives.AffineSystem, context: Context) -> Kernel:
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
    return Kernel(
        parameters={
            name: getattr(system, name)() for name in ("A", "B", "C", "D", "f0", "y0")
        },
        outputs=_Output(system, output) if system.num_output_ports() > 0 else {},
        rate=law if has_state and not is_discrete else None,
        transitions={"steps": step} if is_discrete else {},
    )


def _Saturation(system: primitives.Saturation, context: Context) -> Kernel:
    return Kernel(
        parameters={
            "lower": _Responses(system, -np.inf)[0],
            "upper": _Responses(system, np.inf)[0],
        },
        outputs=_Output(system, (limited, *_Inputs(system), "lower", "upper")),
    )


def _Sine(system: primitives.Sine, context: Context) -> Kernel:
    u = _Inputs(system)[0] if system.num_input_ports() > 0 else "time"
    # Drake does not tell its numbers, but a, f and p can be seen in its outputs, which
    # are a sin(f u + p) and its first two derivatives.
    places = np.array([0.0, 0.1, 0.25, 0.7, 1.9])
    values = np.array([_Responses(system, x) for x in places])
    best = np.abs(values[:, 0]).argmax(axis=0)
    value, slope, curvature = values[best, :, np.arange(len(best))].T
    where = places[best]
    f = np.sqrt(np.maximum(-curvature / np.where(value == 0, 1.0, value), 0.0))
    along = slope / np.where(f == 0, 1.0, f)
    parameters = {
        "amplitude": np.hypot(value, along),
        "frequency": f,
        "phase": np.arctan2(value, along) - f * where,
    }
    return Kernel(
        parameters=parameters,
        outputs={
            system.get_output_port(i).get_name(): (sine, i, u, *parameters)
            for i in range(3)
        },
    )


def _ZeroOrderHold(system: primitives.ZeroOrderHold, context: Context) -> Kernel:
    (u,) = _Inputs(system)
    if context.num_abstract_states() > 0:
        raise UnsupportedSystem(system, "it holds values that are no vectors")
    return Kernel(
        outputs=_Output(system, "mode"),
        transitions={
            "samples": Transition(
                mode=u,
                period=system.period(),
                offset=system.offset(),
                is_discrete=True,
            )
        },
    )


# Of each class its own instances only: a subclass may compute something else.
KERNELS: dict[type[System], Callable[[Any, Context], Kernel]] = {
    primitives.Gain: _Gain,
    primitives.Adder: lambda x, _: Kernel(outputs=_Output(x, (total, *_Inputs(x)))),
    primitives.Multiplexer: lambda x, _: Kernel(outputs=_Output(x, _Inputs(x))),
    primitives.Demultiplexer: _Demultiplexer,
    primitives.AffineSystem: _AffineSystem,
    primitives.LinearSystem: _AffineSystem,
    primitives.MatrixGain: _AffineSystem,
    primitives.Integrator: lambda x, _: Kernel(
        outputs=_Output(x, "state"), rate=_Inputs(x)[0]
    ),
    primitives.ConstantVectorSource: lambda x, context: Kernel(
        parameters={"value": np.array(x.get_source_value(context).value())},
        outputs=_Output(x, "value"),
    ),
    primitives.Saturation: _Saturation,
    primitives.Sine: _Sine,
    primitives.ZeroOrderHold: _ZeroOrderHold,
    primitives.PassThrough: lambda x, _: Kernel(outputs=_Output(x, _Inputs(x)[0])),
    primitives.VectorLogSink: lambda x, _: Kernel(unused=tuple(map(str, _Inputs(x)))),
}
