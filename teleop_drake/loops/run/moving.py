"""How outputs change within a step of Drake's Simulator, where no event happens.

Drake tells by its cache what depends on time or on continuous states. But a block that
declares no prerequisites depends on everything by default, and so do most of Drake's
own. Of those that are known to compute from inputs and discrete states only, nothing
moves unless an input does. What is affine in the continuous states need not be computed
by Drake where these are known.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from pydrake.systems.framework import Context, LeafOutputPort, OutputPort, System

from teleop_drake.loops.engine.flatten import Flatten, OutputOf, Reached, Source
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.signals import IsOfDrake
from teleop_drake.loops.kernel import KernelBlock
from teleop_drake.loops.run.readings import Readings

# Classes of Drake whose outputs depend on time only by way of inputs and states.
_TIMELESS = {
    "pydrake.systems.primitives": (
        "Adder",
        "AffineSystem",
        "BarycentricMeshSystem",
        "BusCreator",
        "BusSelector",
        "ConstantValueSource",
        "ConstantVectorSource",
        "Demultiplexer",
        "DiscreteDerivative",
        "DiscreteTimeDelay",
        "DiscreteTimeIntegrator",
        "Gain",
        "LinearSystem",
        "MatrixGain",
        "MultilayerPerceptron",
        "Multiplexer",
        "PassThrough",
        "PortSwitch",
        "RandomSource",
        "Saturation",
        "Selector",
        "SparseMatrixGain",
        "StateInterpolatorWithDiscreteDerivative",
        "WrapToSystem",
        "ZeroOrderHold",
    ),
    "pydrake.systems.controllers": ("InverseDynamics", "JointStiffnessController"),
    "pydrake.systems.rendering": ("MultibodyPositionToGeometryPose",),
    "pydrake.multibody.plant": (
        "ExternallyAppliedSpatialForceMultiplexer",
        "MultibodyPlant",
    ),
    "pydrake.geometry": ("SceneGraph",),
}


# Classes of Drake whose outputs are affine functions of their inputs and states.
_AFFINE = {
    "pydrake.systems.primitives": (
        "Adder",
        "AffineSystem",
        "Demultiplexer",
        "FirstOrderLowPassFilter",
        "Gain",
        "Integrator",
        "LinearSystem",
        "MatrixGain",
        "Multiplexer",
        "PassThrough",
        "SparseMatrixGain",
    ),
    "pydrake.systems.controllers": ("PidController",),
}


class Motion:
    """What is known of the outputs of a System's blocks, for one of its runs.

    Attributes:
        system: The simulated System.
        context: A Context of the System, for what is evaluated within steps.

    Args:
        system: The System.
        root_context: A Context of the System, in which its outputs were evaluated.
    """

    def __init__(self, system: System, root_context: Context):
        self.system = system
        self.context = root_context.Clone()
        self._blocks = Flatten(system)
        self._contexts = self._ContextsOfBlocks(self.context)
        # A clone has the outputs that were evaluated, until something changes.
        state = root_context.get_continuous_state_vector().CopyToVector()
        time = root_context.get_time() + 1.0
        self.context.SetTimeAndContinuousState(time, state)
        self._with_new_abstract_states = self._contexts
        if system.num_abstract_states():
            other = root_context.Clone()
            for i in range(system.num_abstract_states()):
                other.get_mutable_abstract_state(i)
            self._with_new_abstract_states = self._ContextsOfBlocks(other)
        self._sources: dict[OutputPort, Source] = {}
        self._is_fed: dict[Source, bool] = {}
        self._out_of_date: dict[Source, bool] = {}
        self._affine: dict[Source, bool] = {}
        is_timeless = [*map(self._IsTimeless, range(len(self._blocks)))]
        moving = [i for i, is_one in enumerate(is_timeless) if not is_one]
        fed: dict[int, set[int]] = {i: set() for i, _ in enumerate(self._blocks)}
        for i, block in enumerate(self._blocks):
            if is_timeless[i]:
                for source in block.inputs.values():
                    if self._IsOutOfDate(source):
                        fed[source.block].add(i)
        self._reached = Reached(moving, fed)

    def Moves(self, port: OutputPort) -> bool:
        """Returns whether an output may change within a step."""
        return self._Moves(self._SourceOf(port))

    def DependsOnAbstract(self, port: OutputPort) -> bool:
        """Returns whether an output may depend on abstract states."""
        return self._IsOpaque(self._SourceOf(port))

    def JumpsUnseen(self) -> bool:
        """Returns whether an event may change an abstract state between two samples.

        Blocks of this package announce what makes their outputs jump, and samples are
        taken on both sides.
        """
        return any(
            context.num_abstract_states() and not isinstance(block.system, KernelBlock)
            for block, context in zip(self._blocks, self._contexts, strict=True)
        )

    def HasOpaqueRates(self) -> bool:
        """Returns whether continuous states may change with abstract ones."""
        return any(
            context.num_abstract_states()
            or any(map(self._IsOpaque, block.inputs.values()))
            for block, context in zip(self._blocks, self._contexts, strict=True)
            if context.num_continuous_states()
        )

    def IsAffine(self, port: OutputPort) -> bool:
        """Returns whether an output is affine in the continuous state within a step.

        What it adds to the share of the state changes where a step begins only.
        """
        if not self.system.num_continuous_states() or self.DependsOnAbstract(port):
            return False
        return self._IsAffine(self._SourceOf(port))

    def ReadingsOf(self, ports: Sequence[OutputPort]) -> Readings:
        """Returns what reads some outputs in the Context for what is within steps."""
        readings = Readings(ports, self.context)
        readings.EvaluateOnly(self.Readers(ports))
        return readings

    def Readers(self, ports: Sequence[OutputPort]) -> list[int]:
        """Returns the indices of those outputs with which all others are evaluated.

        An output from which another one is computed need not be evaluated by itself.
        """
        sources = [self._SourceOf(port) for port in ports]
        read = {x for source in sources for x in self._ReadBy(source)}
        return [i for i, source in enumerate(sources) if source not in read]

    def _ReadBy(self, source: Source) -> Iterable[Source]:
        """Returns outputs that are evaluated whenever an output is computed.

        Those of affine blocks are computed from all inputs, if from any.
        """
        block = self._blocks[source.block]
        if not _IsOneOf(_AFFINE, block.system) or not self._IsFed(source):
            return ()
        return block.inputs.values()

    def _IsFed(self, source: Source) -> bool:
        """Returns whether an output depends on an input at the same instant."""
        if source not in self._is_fed:
            system = self._blocks[source.block].system
            index = int(system.GetOutputPort(source.port).get_index())
            self._is_fed[source] = system.HasDirectFeedthrough(index)
        return self._is_fed[source]

    def _IsOpaque(self, source: Source) -> bool:
        if not self.system.num_abstract_states():
            return False
        context = self._with_new_abstract_states[source.block]
        return _IsOutOfDate(self._blocks[source.block].system, source.port, context)

    def _ContextsOfBlocks(self, root_context: Context) -> list[Context]:
        """Returns the Contexts of the blocks in a Context of the System."""
        contexts = ContextsIn(self.system, root_context)
        return [contexts[block.system] for block in self._blocks]

    def _SourceOf(self, port: OutputPort) -> Source:
        if port not in self._sources:
            index = int(port.get_index())
            self._sources[port] = OutputOf(self._blocks, port.get_system(), index)
        return self._sources[port]

    def _Moves(self, source: Source) -> bool:
        return source.block in self._reached and self._IsOutOfDate(source)

    def _IsTimeless(self, i: int) -> bool:
        """Returns whether outputs change only where inputs or discrete states do."""
        is_known = _IsOneOf(_TIMELESS, self._blocks[i].system)
        return is_known and self._contexts[i].num_continuous_states() == 0

    def _IsOutOfDate(self, source: Source) -> bool:
        if source not in self._out_of_date:
            system = self._blocks[source.block].system
            context = self._contexts[source.block]
            self._out_of_date[source] = _IsOutOfDate(system, source.port, context)
        return self._out_of_date[source]

    def _IsAffine(self, source: Source) -> bool:
        if source not in self._affine:
            self._affine[source] = False  # In a loop.
            self._affine[source] = self._FindAffine(source)
        return self._affine[source]

    def _FindAffine(self, source: Source) -> bool:
        """Returns whether an output is affine; see IsAffine()."""
        if not self._Moves(source):
            return True
        block = self._blocks[source.block]
        if not _IsOneOf(_AFFINE, block.system):
            return self._IsOfState(source)
        return not self._IsFed(source) or all(
            map(self._IsAffine, block.inputs.values())
        )

    def _IsOfState(self, source: Source) -> bool:
        """Returns whether an output of a block of Drake's consists of its states.

        Those whose names say so are compared with the state at two random points.
        """
        system = self._blocks[source.block].system
        if not (IsOfDrake(system) and source.port.endswith("state")):
            return False
        if self._IsFed(source):
            return False
        port = system.GetOutputPort(source.port)
        context = self._contexts[source.block]
        random = np.random.default_rng(1)
        size = self.context.num_continuous_states()
        for scale in (1.0, 1e3):
            self.context.SetContinuousState(scale * random.standard_normal(size))
            state = context.get_continuous_state_vector().CopyToVector()
            if not np.isin(port.Eval(context), state).all():
                return False
        return True


def _IsOneOf(classes: Mapping[str, Collection[str]], system: System) -> bool:
    """Returns whether a system's class is among those of a table, by their modules."""
    kind = type(system)
    return kind.__name__ in classes.get(kind.__module__, ())


def _IsOutOfDate(system: System, port: str, context: Context) -> bool:
    """Returns whether an output must be computed again in a Context.

    Args:
        system: A block.
        port: The name of its output, which has been evaluated in the Context before.
        context: The Context of the block.
    """
    output = system.GetOutputPort(port)
    if not isinstance(output, LeafOutputPort):
        return True  # Some Diagrams of Drake's are known as Systems only.
    entry = output.cache_entry()
    return bool(entry.is_cache_entry_disabled(context) or entry.is_out_of_date(context))
