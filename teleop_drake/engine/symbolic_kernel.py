"""Kernels of Drake's systems, made of their symbolic form."""

from typing import Any

import numpy as np
from pydrake.symbolic import Expression, Variable
from pydrake.systems.framework import Context, PortDataType, System

from teleop_drake.arrays import Array
from teleop_drake.engine.expression_tape import (
    MakeTape,
    UnknownExpression,
    evaluate_tape,
)
from teleop_drake.engine.flatten import UnsupportedSystem
from teleop_drake.kernel import Kernel, Term, Transition


def IsOfDrake(system: System) -> bool:
    """Returns whether the class of a system is one of pydrake's, and no subclass."""
    return type(system).__module__.partition(".")[0] == "pydrake"


def SymbolicKernel(system: System, context: Context) -> Kernel | None:
    """Returns the kernel of one of Drake's systems in C++; None: it has no such form.

    The rate of the continuous state, the periodic discrete update and the vector
    outputs are those of `system.ToSymbolicMaybe()`. The numeric parameters of the
    Context are parameters of the kernel, so that other numbers compile nothing anew.

    A subclass in Python has no such form, because its symbolic form is that of its
    base.

    Args:
        context: Of the system.

    Raises:
        UnsupportedSystem: If there is a symbolic form, but not of all that the system
            computes.
    """
    symbolic = system.ToSymbolicMaybe() if IsOfDrake(system) else None
    if symbolic is None:
        return None
    if context.num_abstract_states() > 0 or context.num_abstract_parameters() > 0:
        raise UnsupportedSystem(system, "it has a state or parameter that is no vector")
    try:
        reader = _SymbolicReader(system, symbolic, context)
        return Kernel(
            outputs=reader.Outputs(),
            rate=reader.Rate(),
            transitions=reader.Transitions(),
            parameters=reader.parameters,
            unused=reader.UnusedInputs(),
        )
    except (UnknownExpression, RuntimeError) as error:
        reason = f"it has no symbolic form: {error}"
        raise UnsupportedSystem(system, reason) from error


class _SymbolicReader:
    """Reads what a system computes from a Context of its symbolic form.

    Attributes:
        parameters: The parameters of the terms that were read, and the numbers of the
            numeric parameters.

    Args:
        symbolic: The symbolic form of the system.
        context: Of the system itself.
    """

    def __init__(self, system: System, symbolic: Any, context: Context):
        self.parameters: dict[str, Any] = {}
        self._system = system
        self._symbolic = symbolic
        self._time = Variable("time")
        # The variables of each vector, by its name in the kernel.
        self._vectors: dict[str, list[Variable]] = {}
        self._used: set[str] = set()
        self._context = symbolic.CreateDefaultContext()
        self._context.SetTime(Expression(self._time))
        self._SetState(context)
        self._SetParameters(context)
        self._FixInputs()

    def Rate(self) -> Term | None:
        """Returns the term of the time derivatives; None without continuous state."""
        if "state" not in self._vectors:
            return None
        derivatives = self._symbolic.EvalTimeDerivatives(self._context)
        return self._Term("rate", derivatives.CopyToVector())

    def Outputs(self) -> dict[str, Term]:
        """Returns the terms of the vector outputs."""
        outputs = {}
        for i in range(self._system.num_output_ports()):
            port = self._system.get_output_port(i)
            if port.get_data_type() == PortDataType.kVectorValued:
                value = self._symbolic.get_output_port(i).Eval(self._context)
                outputs[port.get_name()] = self._Term(port.get_name(), value)
        return outputs

    def Transitions(self) -> dict[str, Transition]:
        """Returns the periodic discrete update of the system, if it has one."""
        timing = self._symbolic.GetUniquePeriodicDiscreteUpdateAttribute()
        if timing is None:
            if "mode" in self._vectors:
                reason = "its discrete states have no common period"
                raise UnsupportedSystem(self._system, reason)
            return {}
        values = self._symbolic.EvalUniquePeriodicDiscreteUpdate(self._context)
        groups = [
            values.get_vector(i).CopyToVector() for i in range(values.num_groups())
        ]
        step = Transition(
            mode=self._Term("update", np.concatenate(groups)),
            period=timing.period_sec(),
            offset=timing.offset_sec(),
            is_discrete=True,
        )
        return {"steps": step}

    def UnusedInputs(self) -> tuple[str, ...]:
        """Returns the inputs that no term that was read depends on."""
        ports = map(self._system.get_input_port, range(self._system.num_input_ports()))
        names = [port.get_name() for port in ports]
        return tuple(name for name in names if name not in self._used)

    def _SetState(self, context: Context) -> None:
        """Sets the state of the symbolic Context to variables."""
        size = context.num_continuous_states()
        if size > 0:
            self._context.SetContinuousState(self._New("state", size))
        num_groups = context.num_discrete_state_groups()
        if num_groups == 0:
            return
        groups = [context.get_discrete_state(i).size() for i in range(num_groups)]
        mode = self._New("mode", sum(groups))
        first = 0
        for i, size in enumerate(groups):
            self._context.SetDiscreteState(i, mode[first : first + size])
            first += size

    def _SetParameters(self, context: Context) -> None:
        """Sets the numeric parameters of the symbolic Context to variables."""
        for i in range(context.num_numeric_parameter_groups()):
            numbers = context.get_numeric_parameter(i).CopyToVector()
            name = f"parameter{i}"
            self.parameters[name] = numbers
            variables = self._New(name, len(numbers))
            self._context.get_mutable_numeric_parameter(i).SetFromVector(variables)

    def _FixInputs(self) -> None:
        """Fixes the vector inputs of the symbolic system to variables."""
        for i in range(self._system.num_input_ports()):
            port = self._system.get_input_port(i)
            if port.get_data_type() == PortDataType.kVectorValued:
                variables = self._New(port.get_name(), port.size())
                self._symbolic.get_input_port(i).FixValue(self._context, variables)

    def _New(self, name: str, size: int) -> Array:
        """Returns new variables for a vector of the kernel."""
        self._vectors[name] = [Variable(f"{name}[{i}]") for i in range(size)]
        return np.array([Expression(x) for x in self._vectors[name]], object)

    def _Term(self, name: str, expressions: Array) -> Term:
        """Returns the term of expressions, with the vectors that they depend on.

        Args:
            name: Of what the expressions stand for.
            expressions: A vector of them.
        """
        depends_on = {x.get_id() for e in expressions for x in e.GetVariables()}
        names = [
            vector
            for vector, variables in self._vectors.items()
            if any(x.get_id() in depends_on for x in variables)
        ]
        self._used |= set(names)
        tape = f"tape of {name}"
        vectors = [self._vectors[vector] for vector in names]
        self.parameters[tape] = MakeTape(expressions, self._time, vectors)
        return (evaluate_tape, tape, "time", *names)
