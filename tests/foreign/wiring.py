"""How systems that others published are written down here: one function each.

The function wires its systems in a DiagramBuilder and returns where they start: the
initial state of some of them. What it is made of is taken from the public text; none
of its code is.
"""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    LeafSystem,
    System,
)
from pydrake.systems.primitives import AffineSystem, ConstantVectorSource

Start = Mapping[System, object]


class Published(NamedTuple):
    """A published system.

    Attributes:
        name: What it is.
        wire: Adds it to a builder and returns where it starts.
        stands_for: What the package has to do for such systems.
        obstacle: Why it does not compile, the begin of what the package says; empty: it
            compiles.
    """

    name: str
    wire: Callable[[DiagramBuilder], Start]
    stands_for: str
    obstacle: str = ""

    def Make(self) -> tuple[Diagram, Context]:
        """Returns the diagram, and a Context with its start."""
        builder = DiagramBuilder()
        start = self.wire(builder)
        diagram = builder.Build()
        diagram.set_name(self.name)
        context = diagram.CreateDefaultContext()
        for system, x in start.items():
            own = system.GetMyMutableContextFromRoot(context)
            if own.num_continuous_states() > 0:
                own.SetContinuousState(x)
            else:
                own.SetDiscreteState(x)
        return diagram, context


class Own(LeafSystem):
    """A system that somebody wrote in Python.

    Its output is output(t, x, u), and dx/dt = rate(t, x, u).

    Args:
        sizes: Of u, x and y.
        period: x is discrete and becomes rate(t, x, u) with this period, s; 0: it is
            continuous.
    """

    def __init__(self, sizes, output, rate=None, period=0.0):
        LeafSystem.__init__(self)
        num_inputs, num_states, num_outputs = sizes
        self._output = output
        self._rate = rate
        self._is_discrete = period > 0
        if num_inputs > 0:
            self.DeclareVectorInputPort("u", num_inputs)
        if self._is_discrete:
            self.DeclareDiscreteState(num_states)
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._Update)
        elif num_states > 0:
            self.DeclareContinuousState(num_states)
        self.DeclareVectorOutputPort("y", num_outputs, self._Calc)

    def _Arguments(self, context):
        x = context.get_continuous_state_vector().CopyToVector()
        if self._is_discrete:
            x = context.get_discrete_state_vector().CopyToVector()
        has_input = self.num_input_ports() > 0
        u = self.get_input_port(0).Eval(context) if has_input else np.empty(0)
        return context.get_time(), x, u

    def _Calc(self, context, output):
        output.SetFromVector(self._output(*self._Arguments(context)))

    def _Update(self, context, values):
        values.set_value(0, self._rate(*self._Arguments(context)))

    def DoCalcTimeDerivatives(self, context, derivatives):
        if self._rate is not None:
            rate = self._rate(*self._Arguments(context))
            derivatives.get_mutable_vector().SetFromVector(rate)


def Add(builder: DiagramBuilder, name: str, system: System) -> System:
    """Adds a system with a name and returns it."""
    return builder.AddNamedSystem(name, system)


def Loop(builder: DiagramBuilder, *systems: System) -> None:
    """Connects the first output of each system to the first input of the next one.

    The last one is connected to the first one.
    """
    Chain(builder, *systems)
    builder.Connect(systems[-1].get_output_port(0), systems[0].get_input_port(0))


def Chain(builder: DiagramBuilder, *systems: System) -> None:
    """Connects the first output of each system to the first input of the next one."""
    for source, target in pairwise(systems):
        builder.Connect(source.get_output_port(0), target.get_input_port(0))


def Feed(builder: DiagramBuilder, system: System, values: list[float]) -> None:
    """Connects a constant to the first input of a system."""
    source = Add(builder, f"input of {system.get_name()}", ConstantVectorSource(values))
    Chain(builder, source, system)


def StateFeedback(K, x0, u0) -> AffineSystem:
    """Returns u = u0 - K (x - x0)."""
    K = np.atleast_2d(K)
    num_inputs, num_states = K.shape
    return AffineSystem(
        A=np.zeros((0, 0)),
        B=np.zeros((0, num_states)),
        f0=np.zeros(0),
        C=np.zeros((num_inputs, 0)),
        D=-K,
        y0=np.asarray(u0) + K @ np.asarray(x0),
    )


def SerialArm(lengths, *, time_step=0.0, actuated=None, limits=(-np.inf, np.inf)):
    """Returns a planar arm that hangs from the world, a rod for each joint.

    Args:
        actuated: The joints with a motor; None: all.
        limits: Of each joint, rad.
    """
    plant = MultibodyPlant(time_step)
    plant.set_name("plant")
    arm = plant.AddModelInstance("arm")
    parent = plant.world_frame()
    for i, length in enumerate(lengths):
        centre = np.array([0.0, 0.0, -length / 2])
        inertia = UnitInertia.SolidBox(0.05, 0.05, length)
        rod = plant.AddRigidBody(
            f"rod {i}",
            arm,
            SpatialInertia(1.0, centre, inertia.ShiftFromCenterOfMass(-centre)),
        )
        joint = RevoluteJoint(
            f"joint {i}", parent, rod.body_frame(), [0, 1, 0], *limits, damping=0.1
        )
        joint = plant.AddJoint(joint)
        if actuated is None or i in actuated:
            plant.AddJointActuator(f"motor {i}", joint)
        X_BE = RigidTransform([0, 0, -length])
        parent = plant.AddFrame(FixedOffsetFrame(f"end {i}", rod.body_frame(), X_BE))
    plant.Finalize()
    return plant
