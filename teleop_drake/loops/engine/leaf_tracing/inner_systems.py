"""Stand-ins for a system of Drake's, and its Context, that a block has inside.

The inner system is evaluated through its symbolic form. Its time, state and inputs are
those that the function sets itself, in this call; its parameters are constants.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.symbolic import Expression, MakeVectorVariable
from pydrake.systems.framework import Context, System

from teleop_drake.loops.engine.expression_tape import MakeTape
from teleop_drake.loops.engine.leaf_tracing.stand_ins import Copied, StandIn, Vector
from teleop_drake.loops.jit.symbolic_arrays import AsNumbers, Objects
from teleop_drake.loops.jit.symbols import Untraceable

TIME = -1
"""The key of the time among the values that a function sets in a Context."""

_ENERGIES = (
    "EvalPotentialEnergy", "EvalKineticEnergy", "CalcPotentialEnergy",
    "CalcKineticEnergy",
)  # fmt: skip


class Parameters(StandIn):
    """A vector of parameters of an inner system, such as PendulumParams: constants."""

    what = "a vector of parameters"

    def __init__(self, vector: Any):
        self._vector = vector

    def __getattr__(self, name: str) -> Any:
        if name.startswith(("set", "Set", "get_mutable")):
            raise Untraceable(f"it changes a parameter by {name}()")
        return getattr(self._vector, name)

    def __getitem__(self, index: Any) -> Any:
        return self._vector[index]


class _Written(Vector):
    """The mutable state of an inner Context."""

    def SetFromVector(self, values: Any) -> None:
        self.values[:] = Objects(values).ravel()

    set_value = SetFromVector

    def SetAtIndex(self, index: Any, value: Any) -> None:
        self.values[int(index)] = value

    __setitem__ = SetAtIndex


class InnerContext(StandIn):
    """The Context of an inner system.

    Attributes:
        original: The Context, of which the parameters are taken.
        state: The elements of the continuous state; None: not set.
        others: The values of input ports that are fixed, by index, and the time as -1;
            the positions and velocities of a plant by name.

    Args:
        original: The Context.
        memory: The state and the other values of each Context that the function has
            set so far in this call, by the Context.
    """

    what = "a Context of its own"
    kind = Context

    def __init__(self, original: Context, memory: dict[Context, Any]):
        self.original = original
        if original not in memory:
            state = np.full(original.num_continuous_states(), None, object)
            memory[original] = state, {}
        self.state: Any
        self.others: dict[int | str, Any]
        self.state, self.others = memory[original]

    def SetTime(self, time: Any) -> None:
        self.others[TIME] = time

    def SetContinuousState(self, values: Any) -> None:
        _Written(self.state).SetFromVector(values)

    def SetTimeAndContinuousState(self, time: Any, values: Any) -> None:
        self.SetTime(time)
        self.SetContinuousState(values)

    def get_mutable_continuous_state_vector(self) -> Any:
        return _Written(self.state)

    def get_continuous_state_vector(self) -> Any:
        self.CheckIsSet()
        return Vector(Copied(self.state))

    def get_numeric_parameter(self, index: Any) -> Parameters:
        return Parameters(self.original.get_numeric_parameter(int(index)))

    def CheckIsSet(self) -> None:
        """Refuses a state that the function has not set in this call."""
        if any(x is None for x in self.state):
            raise Untraceable(
                "it reads a state of a Context of its own that it has not set"
            )


class _InnerPort(StandIn):
    """A port of an inner system."""

    what = "a port of a system inside"

    def __init__(self, inner: "InnerSystem", port: Any):
        self._inner = inner
        self._port = port

    def FixValue(self, context: InnerContext, value: Any) -> None:
        context.others[int(self._port.get_index())] = Objects(value).ravel()

    def Eval(self, context: InnerContext) -> Any:
        name = self._port.get_name()
        return self._inner.Evaluate(
            context, lambda symbolic, own: symbolic.GetOutputPort(name).Eval(own)
        )

    def size(self) -> int:
        return int(self._port.size())


class InnerSystem(StandIn):
    """A system of Drake's that a block has inside.

    Args:
        system: The system.
        symbolic: Its symbolic form.
        memory: As for InnerContext.
    """

    what = "a system inside"

    def __init__(self, system: System, symbolic: Any, memory: dict[Context, Any]):
        self._system = system
        self._symbolic = symbolic
        self._memory = memory
        self.kind = type(system)

    def __getattr__(self, name: str) -> Any:
        if name not in _ENERGIES:
            raise Untraceable(f"it calls {name}() of a system inside")
        return lambda context: self.Evaluate(
            context, lambda symbolic, own: [getattr(symbolic, name)(own)]
        )[0]

    def CreateDefaultContext(self) -> InnerContext:
        return InnerContext(self._system.CreateDefaultContext(), self._memory)

    def get_parameters(self, context: InnerContext) -> Parameters:
        return context.get_numeric_parameter(0)

    def EvalTimeDerivatives(self, context: InnerContext) -> Any:
        return Vector(
            self.Evaluate(
                context, lambda symbolic, own: symbolic.EvalTimeDerivatives(own)
            )
        )

    def Port(self, port: Any) -> _InnerPort:
        """Returns the stand-in for a port of the system."""
        return _InnerPort(self, port)

    def get_input_port(self, index: Any = 0) -> _InnerPort:
        return self.Port(self._system.get_input_port(int(index)))

    def get_output_port(self, index: Any = 0) -> _InnerPort:
        return self.Port(self._system.get_output_port(int(index)))

    def GetInputPort(self, name: str) -> _InnerPort:
        return self.Port(self._system.GetInputPort(name))

    def GetOutputPort(self, name: str) -> _InnerPort:
        return self.Port(self._system.GetOutputPort(name))

    def Evaluate(
        self, context: InnerContext, compute: Callable[[Any, Any], Any]
    ) -> Any:
        """Returns what a function computes of the symbolic form, as Numbers.

        Args:
            context: The Context, with Numbers.
            compute: A function of the symbolic form and its Context.
        """
        if not isinstance(context, InnerContext):
            raise Untraceable("it evaluates a system inside in another Context")
        context.CheckIsSet()
        own = self._symbolic.CreateDefaultContext()
        for i in range(context.original.num_numeric_parameter_groups()):
            numbers = context.original.get_numeric_parameter(i).CopyToVector()
            vector = own.get_mutable_numeric_parameter(i)
            vector.SetFromVector([Expression(x) for x in numbers])
        variables: list[Any] = []
        values: list[Any] = []

        def New(elements: Any) -> Any:
            new = list(MakeVectorVariable(len(elements), f"v{len(variables)}"))
            variables.extend(new)
            values.extend(elements)
            return np.array([Expression(x) for x in new], object)

        if len(context.state) > 0:
            own.SetContinuousState(New(context.state))
        for key, elements in context.others.items():
            if key == TIME:
                own.SetTime(New([elements])[0])
            elif isinstance(key, int):
                self._symbolic.get_input_port(key).FixValue(own, New(elements))
        try:
            result = compute(self._symbolic, own)
        except Exception as error:
            raise Untraceable(f"a system inside: {error}") from error
        result = getattr(result, "CopyToVector", lambda: result)()
        tape, constants = MakeTape(np.ravel(result).tolist(), variables)
        return AsNumbers(tape(constants, np.array([*values, None], object)[:-1]))


def IsInner(value: Any) -> bool:
    """Returns whether a value is a system of Drake's, as a block may have inside."""
    is_of_drake = type(value).__module__.partition(".")[0] == "pydrake"
    return is_of_drake and isinstance(value, System)
