"""Kernels of LeafSystems that users wrote in Python, which have no method Kernel().

The function behind each callback is found (callbacks), followed with stand-ins for the
block, its Context, its ports and Drake's result (stand_ins), and written as a tape. The
block is not changed, and no line of its code runs before it has been followed.
"""

import itertools
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.systems.framework import (
    BasicVector,
    CacheEntry,
    Context,
    ContinuousState,
    DiscreteValues,
    EventStatus,
    InputPort,
    OutputPort,
    PortDataType,
    State,
    VectorSystem,
)
from pydrake.trajectories import PiecewisePolynomial

from teleop_drake.loops.engine.flatten import UnreadableLeaf
from teleop_drake.loops.engine.leaf_tracing.advice import Advised
from teleop_drake.loops.engine.leaf_tracing.block_stand_ins import (
    OwnBlock,
    OwnCache,
    OwnContext,
    OwnInput,
    OwnMeshcat,
    OwnOutput,
    SuperIn,
)
from teleop_drake.loops.engine.leaf_tracing.callbacks import (
    FindCallback,
    Found,
    IsPassed,
    Passed,
)
from teleop_drake.loops.engine.leaf_tracing.drake_math import (
    MATH,
    Index,
    NameOfClass,
)
from teleop_drake.loops.engine.leaf_tracing.graph_tape import TapeOf
from teleop_drake.loops.engine.leaf_tracing.handlers import EventFinder, Handler
from teleop_drake.loops.engine.leaf_tracing.inner_systems import (
    InnerContext,
    InnerSystem,
    IsInner,
)
from teleop_drake.loops.engine.leaf_tracing.stand_ins import (
    Cell,
    Groups,
    Rates,
    Result,
    StandIn,
    Status,
    StatusClass,
    WrittenState,
)
from teleop_drake.loops.engine.leaf_tracing.trajectories import Trajectory
from teleop_drake.loops.framework.contexts import DiscreteState
from teleop_drake.loops.framework.signals import IsPlainLeaf, IsPlant, VectorOutputs
from teleop_drake.loops.framework.wiring import InputPorts
from teleop_drake.loops.jit.following import Follow
from teleop_drake.loops.jit.symbolic_arrays import AsFloats, AsNumbers
from teleop_drake.loops.jit.symbols import IsSame, Untraceable
from teleop_drake.loops.jit.tracing import Graph
from teleop_drake.loops.kernel import Kernel, Term, Transition

# The operations by which a smooth function of time becomes one that may jump.
_JUMPING = frozenset({"select", "floor", "ceil", "trunc", "fmod"})

# The begin of the names of numbers that no result may depend on.
_UNSET = "unset "

# The value of each input where known handlers are executed.
_INPUT = 0.5

_ENGINE = Path(__file__).parents[1]


class LeafReader:
    """Makes the kernel of a LeafSystem.

    Attributes:
        graph: The graph of the function that is being followed.
        is_symbolic: Whether another form of the block was taken, see ReadLeaf().
        may_jump: Whether the outputs are functions of time alone that may jump.

    Args:
        system: The LeafSystem.
    """

    def __init__(self, system: Any):
        self.system = system
        self.context: Any = None
        self.graph: Any = None
        self.is_symbolic = False
        self.may_jump = False
        self._handlers: list[Handler] | None = None
        self._terms: dict[int, Term] = {}
        self._symbolic: dict[Any, Any] = {}
        self._memory: dict[Any, Any] = {}
        self._inside: dict[Any, Any] = {}
        self._own: Any = None
        self._constants: Mapping[str, Any] = {}
        self._lock = threading.Lock()

    def Read(
        self, context: Context, constants: Mapping[str, Any] | None = None
    ) -> Kernel:
        """Returns the kernel in a Context of the block.

        The events are found once; all else is followed anew, because what the functions
        read from outside may have changed.

        Args:
            context: The Context, whose parameters are taken, and which has the inputs.
            constants: Other values of sliders in Meshcat, by name.

        Raises:
            UnreadableLeaf: If a callback cannot be followed; the message names the
                function and the line.
        """
        with self._lock:
            self._constants = constants or {}
            return self._Read(context)

    def _Read(self, context: Context) -> Kernel:
        self._Use(context)
        try:
            return self._Kernel()
        except Untraceable as error:
            raise UnreadableLeaf(self.system, Advised(str(error))) from error
        finally:
            self.graph = self.context = self._own = None
            self._inside.clear()

    def _Use(self, context: Context) -> None:
        """Takes the sizes and the parameters of a Context."""
        system = self.system
        self.may_jump = False
        self.context = context
        self.num_states = context.num_continuous_states()
        groups = range(context.num_discrete_state_groups())
        sizes = [context.get_discrete_state(i).size() for i in groups]
        ends = np.cumsum([0, *sizes]).tolist()
        self.groups = [slice(a, b) for a, b in itertools.pairwise(ends)]
        self.num_modes = ends[-1]
        self._parameters: dict[str, Any] = {
            f"parameter{i}": context.get_numeric_parameter(i).CopyToVector()
            for i in range(context.num_numeric_parameter_groups())
        }
        self._sizes = {"time": 1, "state": self.num_states, "mode": self.num_modes}
        self._sizes |= {name: len(x) for name, x in self._parameters.items()}
        # A Context of its own, in which the callbacks are found.
        self._own = system.CreateDefaultContext()
        self._own.SetTimeStateAndParametersFrom(context)
        for port in InputPorts(system):
            if port.get_data_type() == PortDataType.kVectorValued:
                self._sizes[f"input {port.get_name()}"] = port.size()
                port.FixValue(self._own, np.full(port.size(), _INPUT))
        self._own.DisableCaching()

    def _Kernel(self) -> Kernel:
        own = self._own
        if own.num_abstract_states() or own.num_abstract_parameters():
            raise Untraceable("it has a state or parameter that is not a vector")
        rate = None
        if self.num_states:
            found = FindCallback(lambda x: self.system.EvalTimeDerivatives(x), own)
            if found is None:
                raise Untraceable("its rate is no Python function")
            rate = self._Term("rate", found, self.num_states)
        outputs: dict[str, Term] = {}
        for port in VectorOutputs(self.system):
            found = self.CallbackOf(port)
            name = port.get_name()
            if found is None:
                outputs[name] = self._Copied(port)
            else:
                outputs[name] = self._Term(name, found, port.size())
        witnesses = FindCallback(lambda x: self.system.GetWitnessFunctions(x), own)
        if witnesses is not None:
            raise Untraceable("it has witness functions")
        return Kernel(
            outputs=outputs,
            rate=rate,
            transitions=self._Transitions(),
            parameters=self._parameters,
            unused=tuple(port.get_name() for port in InputPorts(self.system)),
        )

    def CallbackOf(self, port: Any) -> Found | None:
        """Returns the function of an output port or a cache entry; None: no Python."""
        return FindCallback(lambda context: port.Eval(context), self._own)

    def _Transitions(self) -> dict[str, Transition]:
        """Returns the periodic events."""
        terms: dict[int, Term] = {}
        changed: set[int] = set()

        def FollowOne(handler: Handler) -> None:
            name = f"event {len(terms)}"
            term, elements = self._Update(name, handler.found)
            if changed & elements:
                raise Untraceable(f"two events change one state, {handler.found.name}")
            changed.update(elements)
            terms[len(terms)] = term

        if self._handlers is None:
            self._handlers = EventFinder(self.system, self._own, FollowOne).Find()
        else:
            for handler in self._handlers:
                FollowOne(handler)
        transitions = {}
        for k, handler in enumerate(self._handlers):
            period, offset = handler.Timing()
            transitions[f"event {k}"] = Transition(
                mode=terms[k],
                period=period,
                offset=offset,
                is_discrete=handler.is_discrete,
            )
        return transitions

    def _Copied(self, port: Any) -> Term:
        """Returns the term of an output that Drake copies from a state."""
        rng = np.random.default_rng(0)
        own = self._own.Clone()
        if self.num_states:
            own.SetContinuousState(rng.random(self.num_states))
        for i, part in enumerate(self.groups):
            own.SetDiscreteState(i, rng.random(part.stop - part.start))
        value = port.Eval(own)
        if np.array_equal(value, own.get_continuous_state_vector().CopyToVector()):
            return "state"
        mode = DiscreteState(own)
        for part in self.groups:
            if np.array_equal(value, mode[part]):
                return ("mode", part.start, part.stop)
        raise Untraceable(f"its output {port.get_name()} is no Python function")

    # Functions that are followed.

    def _Term(self, name: str, found: Found, size: int) -> Term:
        """Returns the term of a callback that writes a vector."""
        return self._Tape(name, self._Traced(found, lambda: self.Call(found, size)))

    def _Update(self, name: str, found: Found) -> tuple[Term, set[int]]:
        """Returns the term of a handler, and the elements of the mode it may change."""
        values = self._Traced(found, lambda: self.Call(found, self.num_modes))
        before = self.Load("mode")
        changed = {i for i, x in enumerate(values) if not IsSame(x, before[i])}
        return self._Tape(name, values), changed

    def _Traced(self, found: Found, call: Any) -> Any:
        """Returns the values that a function writes, in a new graph."""
        graph = Graph(is_given_finite=False, stand_in=self.StandIn, folders=(_ENGINE,))
        self.graph = graph
        for vector, size in self._sizes.items():
            graph.Given(vector, size)

        def Once() -> Any:
            self._memory.clear()
            return call()

        try:
            values = AsFloats(graph.CallLaw(Once))
            is_source = not (self.num_states or self.num_modes)
            if is_source and not self.system.num_input_ports():
                operations = {node.operation for node in graph.nodes}
                self.may_jump |= not operations.isdisjoint(_JUMPING)
            return values
        except Untraceable as error:
            error.place = error.place or found.name
            raise

    def _Tape(self, name: str, values: Any) -> Term:
        tape, constants, names = TapeOf(self.graph, values, self._sizes)
        for vector in names:
            if vector.startswith(_UNSET):
                raise Untraceable(f"it does not set {vector.removeprefix(_UNSET)}")
        self._parameters[f"numbers in {name}"] = constants
        arguments: list[Any] = [
            ("input", x.removeprefix("input ")) if x.startswith("input ") else x
            for x in names
        ]
        return (tape, f"numbers in {name}", *arguments)

    def Load(self, name: str) -> Any:
        """Returns the elements of a given vector."""
        size = self._sizes[name]
        values = [self.graph.Add("load", name, i) for i in range(size)]
        return AsNumbers(np.array([*values, None], object)[:-1])

    def Slider(self, meshcat: Meshcat, name: str) -> Any:
        """Returns the value of a slider in Meshcat, a parameter of the kernel."""
        vector = f"slider {name}"
        if vector not in self._sizes:
            value = self._constants.get(name, meshcat.GetSliderValue(name))
            self._parameters[vector] = np.array([value], float).ravel()
        return self._Further(vector)[0]

    def Unset(self, what: str) -> Any:
        """Returns a number that may be read, and on which no result may depend."""
        return self._Further(f"{_UNSET}{what}")

    def _Further(self, vector: str) -> Any:
        """Returns a vector of one number that is given from now on."""
        self._sizes[vector] = 1
        if vector not in self.graph.given:
            self.graph.Given(vector, 1)
        return self.Load(vector)

    def Input(self, port: Any) -> Any:
        """Returns the elements of an input port."""
        if port.get_data_type() != PortDataType.kVectorValued:
            raise Untraceable(f"its input {port.get_name()} is not a vector")
        return self.Load(f"input {port.get_name()}")

    def Call(self, found: Found, size: int) -> Any:
        """Calls a function with stand-ins; returns the vector that it writes."""
        written = AsNumbers(np.full(size, None, object))
        is_update = self._IsUpdate(found)
        if is_update:
            written[:] = self.Load("mode")
        arguments = [
            self._Argument(found, k, value, written)
            for k, value in enumerate(found.arguments)
        ]
        keywords = {
            name: self._Follow(value, name) for name, value in found.keywords.items()
        }
        status = self._Follow(found.function, found.name)(*arguments, **keywords)
        if is_update:
            self._CheckStatus(status, written)
        missing = [i for i, x in enumerate(written) if x is None]
        if missing:
            raise Untraceable(f"it does not write element {missing[0]} of its result")
        return written

    def _CheckStatus(self, status: Any, written: Any) -> None:
        """Refuses a handler that writes a state and returns that it did nothing."""
        if status is None:
            return
        if type(status) is not Status:
            raise Untraceable("it returns something else than an EventStatus")
        pairs = zip(written, self.Load("mode"), strict=True)
        if not status.has_changed and not all(IsSame(a, b) for a, b in pairs):
            raise Untraceable("it changes a state and returns DidNothing")

    def _IsUpdate(self, found: Found) -> bool:
        if found.function.__name__ == "DoCalcVectorDiscreteVariableUpdates":
            return isinstance(self.system, VectorSystem)
        return any(IsPassed(x, DiscreteValues, State) for x in found.arguments)

    def _Argument(self, found: Found, k: int, value: Any, written: Any) -> Any:
        """Returns the stand-in for an argument.

        Args:
            k: The place of the argument.
            value: The argument.
            written: The vector that the function writes.
        """
        name = found.function.__name__
        is_of_vectors = isinstance(self.system, VectorSystem) and k >= 2
        if is_of_vectors and name.startswith("DoCalcVector"):
            if k == 2:
                return self._VectorInput(np.size(value))
            if k == 3:
                return self.Load("state" if self.num_states else "mode")
            return written
        if not isinstance(value, Passed):
            return self._Follow(value, "an argument")
        if IsPassed(value, Context):
            return OwnContext(self)
        if IsPassed(value, ContinuousState):
            return Rates(written, self.context.get_continuous_state())
        if IsPassed(value, DiscreteValues):
            return Groups(written, self.groups, Result)
        if IsPassed(value, State):
            return WrittenState(Groups(written, self.groups, Result))
        if IsPassed(value, BasicVector):
            return Result(written)
        return StandIn()  # An event.

    def _VectorInput(self, size: int) -> Any:
        """Returns the input of a VectorSystem; empty if Drake leaves it out."""
        return self.Input(self.system.get_input_port(0)) if size else np.zeros(0)

    def Inline(self, port: Any) -> Any:
        """Returns the value of one of the block's own outputs."""
        found = self.CallbackOf(port)
        if found is None:
            raise Untraceable("it reads an output that is no Python function")
        return self.Call(found, port.size())

    def InlineCache(self, entry: Any) -> Any:
        """Returns the value of one of the block's cache entries."""
        found = self.CallbackOf(entry)
        if found is None:
            raise Untraceable("it reads a cache entry that is no Python function")
        cell = Cell()
        arguments: list[Any] = []
        for value in found.arguments:
            if IsPassed(value, Context):
                arguments.append(OwnContext(self))
            elif IsPassed(value, AbstractValue):
                arguments.append(cell)
            else:
                arguments.append(self._Follow(value, "an argument"))
        self._Follow(found.function, found.name)(*arguments)
        return cell.written

    # Values from outside of the functions.

    def _Follow(self, value: Any, name: str) -> Any:
        return Follow(self.graph, value, name)

    def StandIn(self, value: Any, name: str) -> Any:
        """Returns the stand-in for a value from outside; None for most."""
        if value is self.system:
            return OwnBlock(self)
        if value is super:
            return SuperIn
        if value is EventStatus:
            return StatusClass()
        if isinstance(value, Index):
            return int(value)
        if isinstance(value, InputPort | OutputPort):
            owner = value.get_system()
            if owner is self.system:
                return self.Port(value)
            if IsPlainLeaf(owner):
                return self._Inside(owner).Port(value)
            return self._Inner(owner).Port(value)
        if IsPlainLeaf(value):
            return OwnBlock(self._Inside(value))
        if isinstance(value, CacheEntry):
            return OwnCache(self, value)
        if isinstance(value, PiecewisePolynomial):
            return Trajectory(value)
        if isinstance(value, Meshcat):
            return OwnMeshcat(self, value)
        if NameOfClass(value) in ("MultibodyForces", "MultibodyForces_"):
            from teleop_drake.loops.engine.leaf_tracing.inner_plants import InnerForces

            return InnerForces
        if isinstance(value, Context):
            return InnerContext(value, self._memory)
        if IsInner(value):
            return self._Inner(value)
        module = getattr(value, "__module__", None)
        is_math = isinstance(module, str) and module.startswith("pydrake")
        if is_math and callable(value) and not isinstance(value, type):
            usual = MATH.get(getattr(value, "__name__", ""))
            return None if usual is None else self._Follow(usual, name)
        return None

    def Port(self, port: Any) -> Any:
        """Returns the stand-in for a port of the block."""
        kind = OwnInput if isinstance(port, InputPort) else OwnOutput
        return kind(self, port)

    def _Inside(self, system: Any) -> "LeafReader":
        """Returns the reader of another block in Python that the block has inside."""
        from teleop_drake.loops.engine.leaf_tracing.inner_leaves import InnerReader

        if system not in self._inside:
            self._inside[system] = InnerReader(system, self, self._memory)
        reader = self._inside[system]
        reader.graph = self.graph
        return reader

    def _Inner(self, system: Any) -> Any:
        """Returns the stand-in for a system of Drake's that the block has inside."""
        if IsPlant(system):
            from teleop_drake.loops.engine.leaf_tracing.inner_plants import InnerPlant

            if system not in self._inside:
                self._inside[system] = InnerPlant(system, self, self._memory)
            return self._inside[system]
        if system not in self._symbolic:
            self._symbolic[system] = system.ToSymbolicMaybe()
        symbolic = self._symbolic[system]
        if symbolic is None:
            raise Untraceable(f"it has a {type(system).__name__} inside")
        return InnerSystem(system, symbolic, self._memory)
