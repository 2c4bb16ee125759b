"""Kernels of Drake's own blocks."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, System
from pydrake.systems.primitives import (
    Adder,
    AffineSystem,
    ConstantVectorSource,
    Demultiplexer,
    Gain,
    Integrator,
    Multiplexer,
    PassThrough,
    Saturation,
    Sine,
    VectorLogSink,
    ZeroOrderHold,
)

from teleop_drake.compiler.flatten import UnsupportedSystem
from teleop_drake.kernel import Kernel, Term, Transition, times

Array = NDArray[np.float64]


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
    for kind, make in _KERNELS.items():
        if isinstance(system, kind):
            return make(system, context)
    return None


def _Inputs(system: System) -> list[str]:
    return [
        system.get_input_port(i).get_name() for i in range(system.num_input_ports())
    ]


def _Output(system: System, term: Term) -> dict[str, Term]:
    return {system.get_output_port(0).get_name(): term}


def _Response(system: System, u: float) -> Array:
    """Returns what a block without state delivers for an input of equal elements."""
    context = system.CreateDefaultContext()
    port = system.get_input_port(0)
    port.FixValue(context, np.full(port.size(), u))
    return np.array(system.get_output_port(0).Eval(context))


def _Gain(system: Gain, context: Context) -> Kernel:
    return Kernel(
        parameters={"gain": _Response(system, 1.0)},
        outputs=_Output(system, (times, "gain", *_Inputs(system))),
    )


def _Adder(system: Adder, context: Context) -> Kernel:
    return Kernel(outputs=_Output(system, (total, *_Inputs(system))))


def _Multiplexer(system: Multiplexer, context: Context) -> Kernel:
    return Kernel(outputs=_Output(system, [*_Inputs(system)]))


def _Demultiplexer(system: Demultiplexer, context: Context) -> Kernel:
    outputs: dict[str, Term] = {}
    end = 0
    for i, size in enumerate(system.get_output_ports_sizes()):
        first, end = end, end + size
        name = system.get_output_port(i).get_name()
        outputs[name] = (_Inputs(system)[0], first, end)
    return Kernel(outputs=outputs)


def _AffineSystem(system: AffineSystem, context: Context) -> Kernel:
    inputs = _Inputs(system)
    has_state = system.num_states() > 0
    is_discrete = has_state and system.time_period() > 0
    state = "mode" if is_discrete else "state"
    outputs: dict[str, Term] = {}
    if system.num_output_ports() > 0:
        outputs = _Output(system, (affine, "y0", "C", state))
        if system.HasAnyDirectFeedthrough():
            outputs = _Output(system, (affine_of_two, "y0", "C", state, "D", *inputs))
    law: Term | None = None
    if has_state:
        law = (affine, "f0", "A", state)
        if inputs:
            law = (affine_of_two, "f0", "A", state, "B", *inputs)
    return Kernel(
        parameters={
            name: getattr(system, name)() for name in ("A", "B", "C", "D", "f0", "y0")
        },
        outputs=outputs,
        rate=None if is_discrete else law,
        transitions={
            "steps": Transition(mode=law, period=system.time_period(), is_discrete=True)
        }
        if is_discrete and law is not None
        else {},
    )


def _Integrator(system: Integrator, context: Context) -> Kernel:
    (u,) = _Inputs(system)
    return Kernel(outputs=_Output(system, "state"), rate=u)


def _ConstantVectorSource(system: ConstantVectorSource, context: Context) -> Kernel:
    value = np.array(system.get_source_value(context).value())
    return Kernel(parameters={"value": value}, outputs=_Output(system, "value"))


def _Saturation(system: Saturation, context: Context) -> Kernel:
    return Kernel(
        parameters={
            "lower": _Response(system, -np.inf),
            "upper": _Response(system, np.inf),
        },
        outputs=_Output(system, (limited, *_Inputs(system), "lower", "upper")),
    )


def _Sine(system: Sine, context: Context) -> Kernel:
    u = _Inputs(system)[0] if system.num_input_ports() > 0 else "time"
    # Drake does not tell its numbers, but a, f and p can be seen in its outputs, which
    # are a sin(f u + p) and its first two derivatives.
    values = np.array([_SineAt(system, x) for x in (0.0, 0.1, 0.25, 0.7, 1.9)])
    best = np.abs(values[:, 0]).argmax(axis=0)
    value, slope, curvature = values[best, :, np.arange(len(best))].T
    where = np.array([0.0, 0.1, 0.25, 0.7, 1.9])[best]
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


def _SineAt(system: Sine, u: float) -> list[Array]:
    """Returns the three outputs at a time, or for inputs that are all u."""
    context = system.CreateDefaultContext()
    if system.num_input_ports() == 0:
        context.SetTime(u)
    else:
        port = system.get_input_port(0)
        port.FixValue(context, np.full(port.size(), u))
    return [np.array(system.get_output_port(i).Eval(context)) for i in range(3)]


def _ZeroOrderHold(system: ZeroOrderHold, context: Context) -> Kernel:
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


def _PassThrough(system: PassThrough, context: Context) -> Kernel:
    (u,) = _Inputs(system)
    return Kernel(outputs=_Output(system, u))


def _VectorLogSink(system: VectorLogSink, context: Context) -> Kernel:
    return Kernel(unused=tuple(_Inputs(system)))


# A class before those it derives from.
_KERNELS: dict[type[System], Callable[[Any, Context], Kernel]] = {
    Gain: _Gain,
    Adder: _Adder,
    Multiplexer: _Multiplexer,
    Demultiplexer: _Demultiplexer,
    AffineSystem: _AffineSystem,
    Integrator: _Integrator,
    ConstantVectorSource: _ConstantVectorSource,
    Saturation: _Saturation,
    Sine: _Sine,
    ZeroOrderHold: _ZeroOrderHold,
    PassThrough: _PassThrough,
    VectorLogSink: _VectorLogSink,
}
