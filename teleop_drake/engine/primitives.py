"""Kernels of Drake's own systems, most of them made of their symbolic form.

The rate of the continuous state, the periodic discrete update and the vector outputs
are those of `system.ToSymbolicMaybe()`. The numeric parameters of the Context are
parameters of the kernel, and so are the constants of the expressions. Therefore other
numbers compile nothing anew, unless Drake leaves a 0 or a 1 out of its expressions.
Matrices often have such elements, so that linear systems have a kernel of their own.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.symbolic import Expression, MakeVectorVariable, Variable
from pydrake.systems.framework import Context, PortDataType, System
from pydrake.systems.primitives import (
    AffineSystem,
    LinearSystem,
    MatrixGain,
    WrapToSystem,
)

from teleop_drake.arrays import Array
from teleop_drake.contexts import DiscreteState, SetDiscreteState
from teleop_drake.engine.expression_tape import MakeTape, UnknownExpression
from teleop_drake.engine.flatten import UnsupportedSystem
from teleop_drake.kernel import Kernel, Term, Transition
from teleop_drake.signals import VectorOutputs

# Farther away than the intervals of angles, and how many bisections find their ends.
_FAR = 1e3
_NUM_BISECTIONS = 100


_NO_KERNEL = (
    "it offers no kernel; write it as a plain function of its inputs, or give it a "
    'method Kernel() (guide.md, "Machine code of your own block")'
)


def PrimitiveKernel(system: System, context: Context) -> Kernel:
    """Returns the kernel of one of Drake's own systems.

    A subclass in Python has none, because its symbolic form is that of its base.

    Raises:
        UnsupportedSystem: If it has none, or one of only a part of what it computes.
    """
    if IsSink(system, context):
        return Kernel(unused=_InputNames(system))
    if type(system) in KERNELS:
        return KERNELS[type(system)](system)
    symbolic = system.ToSymbolicMaybe() if _IsOfDrake(system) else None
    if symbolic is None:
        raise UnsupportedSystem(system, _NO_KERNEL)
    if context.num_abstract_states() > 0 or context.num_abstract_parameters() > 0:
        raise UnsupportedSystem(system, "it has a state or parameter that is no vector")
    try:
        return _SymbolicReader(system, symbolic, context).Kernel()
    except (UnknownExpression, RuntimeError) as error:
        reason = f"it has no symbolic form: {error}"
        raise UnsupportedSystem(system, reason) from error


def IsSink(system: System, context: Context) -> bool:
    """Returns whether no number depends on one of Drake's systems.

    Logs, visualizers and a SceneGraph have neither numbers as a state nor an output
    that is a vector.
    """
    has_numbers = (
        bool(VectorOutputs(system))
        or context.num_continuous_states() > 0
        or context.num_discrete_state_groups() > 0
    )
    return _IsOfDrake(system) and not has_numbers


def _InputNames(system: System) -> tuple[str, ...]:
    ports = map(system.get_input_port, range(system.num_input_ports()))
    return tuple(port.get_name() for port in ports)


def _IsOfDrake(system: System) -> bool:
    """Returns whether the class of a system is one of pydrake's, and no subclass."""
    return type(system).__module__.partition(".")[0] == "pydrake"


class _SymbolicReader:
    """Reads what a system computes from a Context of its symbolic form.

    Args:
        system: The system.
        symbolic: Its symbolic form.
        context: Of the system itself.
    """

    def __init__(self, system: System, symbolic: Any, context: Context):
        self._system = system
        self._symbolic = symbolic
        self._parameters: dict[str, Any] = {}
        # The variables of each vector, by its name in the kernel.
        self._variables: dict[str, list[Variable]] = {}
        own = symbolic.CreateDefaultContext()
        own.SetTime(self._New("time", 1)[0])
        own.SetContinuousState(self._New("state", context.num_continuous_states()))
        SetDiscreteState(own, self._New("mode", len(DiscreteState(context))))
        for i in range(context.num_numeric_parameter_groups()):
            name = f"parameter{i}"
            numbers = context.get_numeric_parameter(i).CopyToVector()
            self._parameters[name] = numbers
            vector = own.get_mutable_numeric_parameter(i)
            vector.SetFromVector(self._New(name, len(numbers)))
        for name in _InputNames(symbolic):
            port = symbolic.GetInputPort(name)
            if port.get_data_type() == PortDataType.kVectorValued:
                port.FixValue(own, self._New(name, port.size()))
        self._context = own

    def Kernel(self) -> Kernel:
        """Returns the kernel of the system."""
        rate = None
        if self._variables["state"]:
            derivatives = self._symbolic.EvalTimeDerivatives(self._context)
            rate = self._Term("rate", derivatives.CopyToVector())
        outputs = {}
        for port in VectorOutputs(self._symbolic):
            name = port.get_name()
            outputs[name] = self._Term(name, port.Eval(self._context))
        return Kernel(
            outputs=outputs,
            rate=rate,
            transitions=self._Transitions(),
            parameters=self._parameters,
            # Terms may take some of these.
            unused=_InputNames(self._system),
        )

    def _Transitions(self) -> dict[str, Transition]:
        """Returns the periodic discrete update of the system, if it has one."""
        timing = self._symbolic.GetUniquePeriodicDiscreteUpdateAttribute()
        if timing is None and self._variables["mode"]:
            reason = "its discrete states have no common period"
            raise UnsupportedSystem(self._system, reason)
        if timing is None:
            return {}
        values = self._symbolic.EvalUniquePeriodicDiscreteUpdate(self._context)
        mode = np.concatenate([group.CopyToVector() for group in values.get_data()])
        step = Transition(
            mode=self._Term("update", mode),
            period=timing.period_sec(),
            offset=timing.offset_sec(),
            is_discrete=True,
        )
        return {"steps": step}

    def _New(self, name: str, size: int) -> Array:
        """Returns new variables for a vector of the kernel."""
        self._variables[name] = list(MakeVectorVariable(size, name))
        return np.array([Expression(x) for x in self._variables[name]], object)

    def _Term(self, name: str, expressions: Array) -> Term:
        """Returns the term of expressions, with the vectors that they depend on.

        Args:
            name: Of what the expressions stand for.
            expressions: A vector of them.
        """
        found = {x.get_id() for e in expressions for x in e.GetVariables()}
        vectors = []
        variables: list[Variable] = []
        for vector, own in self._variables.items():
            if any(x.get_id() in found for x in own):
                vectors.append(vector)
                variables += own
        tape, constants = MakeTape(expressions, variables)
        numbers = f"numbers in {name}"
        self._parameters[numbers] = constants
        return (tape, numbers, *vectors)


def affine(constant: Array, *products: Array) -> Array:
    """Returns a constant vector plus products, each of a matrix and a vector."""
    total = constant
    for k in range(0, len(products), 2):
        total = total + products[k] @ products[k + 1]
    return total


def _AffineKernel(system: AffineSystem) -> Kernel:
    """Returns the kernel of matrices, which may be other ones in the same program."""
    inputs = _InputNames(system)
    has_state = system.num_states() > 0
    is_discrete = has_state and system.time_period() > 0
    state = "mode" if is_discrete else "state"
    law: Term = (affine, "f0", "A", state)
    if inputs:
        law = (*law, "B", *inputs)
    output: Term = (affine, "y0", "C", state)
    if system.HasAnyDirectFeedthrough():
        output = (*output, "D", *inputs)
    step = Transition(mode=law, period=system.time_period(), is_discrete=True)
    names = ("A", "B", "C", "D", "f0", "y0")
    return Kernel(
        parameters={name: getattr(system, name)() for name in names},
        outputs={"y0": output} if system.num_output_ports() > 0 else {},
        rate=law if has_state and not is_discrete else None,
        transitions={"steps": step} if is_discrete else {},
        # Without state, and with D = 0, nothing depends on them.
        unused=inputs,
    )


def wrapped(lows: Array, sizes: Array, u: Array) -> Array:
    """Returns what is left of each signal in its interval.

    Args:
        lows: Where the intervals begin.
        sizes: Their lengths; 0 without an interval.
        u: The signals.
    """
    periods = np.where(sizes > 0, sizes, 1.0)
    rest: Array = u - sizes * np.floor((u - lows) / periods)
    return rest


def _WrapKernel(system: WrapToSystem) -> Kernel:
    """Returns the kernel of a system whose intervals only its outputs tell."""
    context = system.CreateDefaultContext()
    port = system.get_input_port()

    def At(u: Array) -> Array:
        port.FixValue(context, u)
        y: Array = system.get_output_port().Eval(context)
        return y

    # The ends of the intervals are the first values that do not stay as they are.
    inside = At(np.zeros(port.size()))
    outside = inside + _FAR
    for _ in range(_NUM_BISECTIONS):
        middle = (inside + outside) / 2
        stays = At(middle) == middle
        inside = np.where(stays, middle, inside)
        outside = np.where(stays, outside, middle)
    lows = At(outside)
    return Kernel(
        outputs={"y0": (wrapped, "lows", "sizes", "u0")},
        parameters={"lows": lows, "sizes": outside - lows},
    )


KERNELS: dict[type[System], Callable[[Any], Kernel]] = {
    AffineSystem: _AffineKernel,
    LinearSystem: _AffineKernel,
    MatrixGain: _AffineKernel,
    WrapToSystem: _WrapKernel,
}
"""Kernels that are not made of the symbolic form of a system, by its class itself."""
