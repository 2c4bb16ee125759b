"""Kernels of Drake's own systems, most of them made from the system's symbolic form.

The symbolic form, `system.ToSymbolicMaybe()`, provides expressions of the rate of the
continuous state, the periodic discrete update and the vector outputs. The numeric
parameters of the Context and the constants in the expressions become parameters of the
kernel. New values of them therefore need no new compilation, unless Drake simplifies an
expression because a value is 0 or 1. Matrices and gains often have such elements, so
the kernels of systems with matrices or gains are written by hand.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.symbolic import Expression, MakeVectorVariable, Variable
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus, PortDataType, System
from pydrake.systems.primitives import (
    AffineSystem,
    Gain,
    RandomSource,
    WrapToSystem,
)

from teleop_drake.loops.engine.constants import ConstantsOf
from teleop_drake.loops.engine.expression_tape import MakeTape, UnknownExpression
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import DiscreteState, SetDiscreteState
from teleop_drake.loops.framework.signals import IsOfDrake, IsPlainLeaf, VectorOutputs
from teleop_drake.loops.framework.wiring import InputPorts, OutputPorts
from teleop_drake.loops.kernel import Kernel, Term, Transition
from teleop_drake.loops.kernel.kernel import times

# A distance greater than the length of a WrapToSystem's intervals of angles, and the
# number of bisections that locate the end of an interval.
_FAR = 1e3
_NUM_BISECTIONS = 100


# Longer than the period of any random source, s.
_LONG = 1e12

DRAW = "draw"
"""The name of the transition of a random source."""

_NO_TRAJECTORY = (
    "pydrake does not tell its trajectory; teleop_drake.TrajectorySource(trajectory) "
    "takes its place"
)

_NO_NUMBERS = "its outputs are no vectors"

_NO_FORM = "Drake has no symbolic form of it"

_NO_KERNEL = (
    "it offers no kernel; write it as a plain function of its inputs, or give it a "
    'method Kernel() (guide.md, "Machine code of your own block")'
)


# Systems with a plant inside, whose symbolic form takes Drake four times as long with
# each further joint: seconds for eight, hours for twelve. None so large is read.
_WITH_PLANT = ("InverseDynamics", "JointStiffnessController")
_MOST_STATES = 14


def PrimitiveKernel(system: System, context: Context) -> Kernel:
    """Returns the kernel of one of Drake's own systems.

    A user's subclass in Python is refused, because its symbolic form is that of the
    base class.

    Args:
        context: The system's Context, with the values of its parameters.

    Raises:
        UnsupportedSystem: If the system has no symbolic form, or if a part of its
            computation is missing there.
    """
    if IsSink(system, context):
        return Kernel(unused=_InputNames(system))
    is_of_drake = IsOfDrake(system)
    if is_of_drake and type(system).__name__ == "JointSliders":
        return _SlidersKernel(system)
    if is_of_drake and type(system).__name__ == "TrajectorySource":
        raise UnsupportedSystem(system, _NO_TRAJECTORY)
    make = KERNELS.get(type(system).__name__) if is_of_drake else None
    written = None if make is None else make(system)
    if written is not None:
        return written
    if is_of_drake and type(system).__name__ in _WITH_PLANT:
        size = system.get_input_port(0).size()
        if size > _MOST_STATES:
            reason = f"it has no symbolic form: there are {size} states, too many"
            raise UnsupportedSystem(system, reason)
    symbolic = None
    if is_of_drake or IsPlainLeaf(system):
        symbolic = system.ToSymbolicMaybe()
    if symbolic is None:
        types = [port.get_data_type() for port in OutputPorts(system)]
        is_abstract = PortDataType.kAbstractValued in types and not VectorOutputs(
            system
        )
        if is_abstract:
            raise UnsupportedSystem(system, _NO_NUMBERS)
        raise UnsupportedSystem(system, _NO_FORM if is_of_drake else _NO_KERNEL)
    if context.num_abstract_states() > 0 or context.num_abstract_parameters() > 0:
        raise UnsupportedSystem(
            system, "it has a state or parameter that is not a vector"
        )
    try:
        return _SymbolicReader(system, symbolic, context).Kernel()
    except (UnknownExpression, RuntimeError) as error:
        # Drake names a variable on which a number or a branch would depend.
        reason = f"it has no symbolic form: {str(error).strip().splitlines()[0]}"
        raise UnsupportedSystem(system, reason) from error


def IsSink(system: System, context: Context) -> bool:
    """Returns whether no signal or state depends on a system.

    Examples are logs, visualizers and a SceneGraph of Drake's. They have no continuous
    or discrete state and no vector output. A user's system in Python is a sink if it
    has no output at all.
    """
    is_own_sink = IsPlainLeaf(system) and system.num_output_ports() == 0
    return (IsOfDrake(system) or is_own_sink) and IsSilent(system, context)


def IsSilent(system: System, context: Context) -> bool:
    """Returns whether a system has no vector output and no state of numbers.

    Such a system of Drake's, or of a user in Python, is left out where nothing that is
    recorded depends on it.
    """
    has_numbers = (
        bool(VectorOutputs(system))
        or context.num_continuous_states() > 0
        or context.num_discrete_state_groups() > 0
    )
    return (IsOfDrake(system) or IsPlainLeaf(system)) and not has_numbers


def _InputNames(system: System) -> tuple[str, ...]:
    return tuple(port.get_name() for port in InputPorts(system))


class _SymbolicReader:
    """Makes a kernel from a system's symbolic form, in a Context of variables.

    Args:
        system: The system.
        symbolic: Its symbolic form, a System of Expressions.
        context: A Context of `system`, which provides the sizes of its vectors and the
            values of its parameters.
    """

    def __init__(self, system: System, symbolic: Any, context: Context):
        self._system = system
        self._symbolic = symbolic
        self._parameters: dict[str, Any] = {}
        # The variables of each vector, keyed by the vector's name in the kernel.
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
        for name in _InputNames(system):
            port = symbolic.GetInputPort(name)
            # An input without a value remains open; primitives need all of theirs.
            is_given = type(system).__module__ == "pydrake.systems.primitives"
            is_given = is_given or system.GetInputPort(name).HasValue(context)
            if is_given and port.get_data_type() == PortDataType.kVectorValued:
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
            # An input that is listed here may still occur in a term.
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
        """Returns the elements of a vector of the kernel as new variables."""
        self._variables[name] = list(MakeVectorVariable(size, name))
        return np.array([Expression(x) for x in self._variables[name]], object)

    def _Term(self, name: str, expressions: Array) -> Term:
        """Returns the term that computes expressions from the vectors in them.

        Args:
            name: The name of the computed vector: `rate`, `update` or an output.
            expressions: The elements of that vector (k).
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
    """Returns a constant vector plus products, each of a matrix and a vector.

    Args:
        products: Matrices and vectors in turn: A, x, B, u, ...
    """
    total = constant
    for k in range(0, len(products), 2):
        total = total + products[k] @ products[k + 1]
    return total


def _AffineKernel(system: AffineSystem) -> Kernel:
    """Returns the kernel of an affine system, with its matrices as parameters."""
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
        # If there is no state and D = 0, no term has the input.
        unused=inputs,
    )


def wrapped(lows: Array, sizes: Array, u: Array) -> Array:
    """Returns each signal, wrapped to its interval.

    Args:
        lows: The lower ends of the intervals (n).
        sizes: The lengths of the intervals (n); 0: the signal is not wrapped.
        u: The signals (n).
    """
    periods = np.where(sizes > 0, sizes, 1.0)
    rest: Array = u - sizes * np.floor((u - lows) / periods)
    return rest


def _WrapKernel(system: WrapToSystem) -> Kernel:
    """Returns the kernel of a WrapToSystem.

    pydrake does not bind the intervals, so they are found by evaluating the output.
    """
    context = system.CreateDefaultContext()
    port = system.get_input_port()

    def At(u: Array) -> Array:
        port.FixValue(context, u)
        y: Array = system.get_output_port().Eval(context)
        return y

    # Bisection locates the upper end of each interval, the lowest value that the system
    # changes. Its output there is the lower end. Without an interval, no value changes,
    # both ends are at `outside`, and the length is 0.
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


def _RandomKernel(source: RandomSource) -> Kernel:
    """Returns the kernel of a random source, whose mode is its output.

    Drake draws the numbers; see random_sources. pydrake does not bind the period, which
    is the time of the second draw; the first one is at 0.
    """
    simulator = Simulator(source)

    def EndAfterAStep(context: Context) -> EventStatus:
        if context.get_time() > 0:
            return EventStatus.ReachedTermination(source, "a step")
        return EventStatus.DidNothing()

    simulator.set_monitor(EndAfterAStep)
    simulator.AdvanceTo(_LONG)
    simulator.clear_monitor()
    draw = Transition(mode=None, period=simulator.get_context().get_time())
    return Kernel(outputs={"output": "mode"}, transitions={DRAW: draw})


def _GainKernel(system: Gain) -> Kernel:
    """Returns the kernel of a Gain, with its factors as a parameter."""
    return Kernel(outputs={"y0": (times, "k", "u0")}, parameters=ConstantsOf(system))


def pid_control(
    kp: Array, ki: Array, kd: Array, integral: Array, estimated: Array, desired: Array
) -> Array:
    """Returns the control of a PID controller (n).

    Args:
        kp: The gains on the error (n).
        ki: The gains on the integral of the error (n).
        kd: The gains on the rate of the error (n).
        integral: The integral of the error (n).
        estimated: The estimated positions and velocities (2 n).
        desired: The desired positions and velocities (2 n).
    """
    error, rate = np.split(desired - estimated, 2)
    control: Array = kp * error + kd * rate + ki * integral
    return control


def position_error(estimated: Array, desired: Array) -> Array:
    """Returns the error of the positions (n); see pid_control()."""
    n = len(desired) // 2
    return desired[:n] - estimated[:n]


def _PidKernel(system: System) -> Kernel | None:
    """Returns the kernel of a PidController, with its gains as parameters.

    Returns None if it selects the controlled states; pydrake does not tell which.
    """
    gains = ConstantsOf(system)
    if not gains:
        return None
    inputs = ("estimated_state", "desired_state")
    return Kernel(
        outputs={"control": (pid_control, *gains, "state", *inputs)},
        rate=(position_error, *inputs),
        parameters=gains,
    )


def _MeshKernel(system: Any) -> Kernel:
    """Returns the kernel of a BarycentricMeshSystem."""
    from teleop_drake.loops.engine.mesh_kernel import MeshKernel

    return MeshKernel(system)


def _SlidersKernel(system: Any) -> Kernel:
    """Returns the kernel of sliders in Meshcat, with their present values."""
    port = system.get_output_port()
    values = port.Eval(system.CreateDefaultContext())
    return Kernel(outputs={port.get_name(): "values"}, parameters={"values": values})


KERNELS: dict[str, Callable[[Any], Kernel | None]] = {
    "AffineSystem": _AffineKernel,
    "BarycentricMeshSystem": _MeshKernel,
    "Gain": _GainKernel,
    "LinearSystem": _AffineKernel,
    "MatrixGain": _AffineKernel,
    "PidController": _PidKernel,
    "RandomSource": _RandomKernel,
    "WrapToSystem": _WrapKernel,
}
"""Makers of the kernels that are written by hand, keyed by the name of Drake's class.

A maker returns None if it does not know the system; its symbolic form is taken then."""
