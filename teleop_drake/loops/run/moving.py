"""How outputs change within a step of Drake's Simulator, where no event happens.

Drake tells by its cache what depends on time or on continuous states. But a block that
declares no prerequisites depends on everything by default, and so do most of Drake's
own. Of those that are known to compute from inputs and discrete states only, nothing
moves unless an input does. What is affine in the continuous states need not be computed
by Drake where these are known.
"""

from collections.abc import Collection, Mapping

import numpy as np
from pydrake.systems.framework import (
    CacheIndex,
    Context,
    LeafSystem,
    OutputPort,
    System,
)

from teleop_drake.loops.engine.flatten import Flatten, OutputOf, Reached, Source
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.signals import IsOfDrake

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

    Args:
        system: The simulated System.
        later: A Context of the System in which outputs were evaluated, and whose time
            and continuous state have been set since then. The object changes it.
    """

    def __init__(self, system: System, later: Context):
        self._blocks = Flatten(system)
        self._later = later
        contexts = ContextsIn(system, later)
        self._contexts = [contexts[block.system] for block in self._blocks]
        # Events change abstract states unseen, and with them what an output adds.
        self._may_be_affine = (
            system.num_continuous_states() > 0 and system.num_abstract_states() == 0
        )
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

    def IsAffine(self, port: OutputPort) -> bool:
        """Returns whether an output is affine in the continuous state within a step.

        What it adds to the share of the state changes where a step begins only.
        """
        return self._may_be_affine and self._IsAffine(self._SourceOf(port))

    def _SourceOf(self, port: OutputPort) -> Source:
        return OutputOf(self._blocks, port.get_system(), int(port.get_index()))

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
        port = block.system.GetOutputPort(source.port)
        if not _IsOneOf(_AFFINE, block.system):
            return self._IsOfState(port, self._contexts[source.block])
        is_fed = block.system.HasDirectFeedthrough(int(port.get_index()))
        return not is_fed or all(map(self._IsAffine, block.inputs.values()))

    def _IsOfState(self, port: OutputPort, context: Context) -> bool:
        """Returns whether an output of a block of Drake's consists of its states.

        Those whose names say so are compared with the state at two random points.
        """
        system = port.get_system()
        if not (IsOfDrake(system) and port.get_name().endswith("state")):
            return False
        if system.HasDirectFeedthrough(int(port.get_index())):
            return False
        random = np.random.default_rng(1)
        size = self._later.num_continuous_states()
        for scale in (1.0, 1e3):
            self._later.SetContinuousState(scale * random.standard_normal(size))
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
    if not isinstance(system, LeafSystem):
        return True  # Some Diagrams of Drake's are known as Systems only.
    index = int(system.GetOutputPort(port).get_index())
    # Drake names the cache entry of each output of a leaf in this way.
    name = f"output port {index}({port}) cache"
    i = 0
    while system.get_cache_entry(CacheIndex(i)).description() != name:
        i += 1
    entry = system.get_cache_entry(CacheIndex(i))
    return bool(entry.is_cache_entry_disabled(context) or entry.is_out_of_date(context))
