"""Stand-ins for a MultibodyPlant that a block has inside, and for its forces.

The plant is evaluated as a tree of links; see plant_tree. Its positions and velocities
are those that the function sets itself, in this call.
"""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces

from teleop_drake.loops.engine.leaf_tracing.inner_systems import InnerContext
from teleop_drake.loops.engine.leaf_tracing.stand_ins import Copied, StandIn
from teleop_drake.loops.engine.plant_springs import ForceElements
from teleop_drake.loops.engine.plant_tree import NoTree, PlantTree, ReadPlantTree
from teleop_drake.loops.jit.following import Follow, Original
from teleop_drake.loops.jit.symbolic_arrays import AsNumbers, Objects
from teleop_drake.loops.jit.symbols import Untraceable
from teleop_drake.loops.numerics import rigid_body

# Methods that return the same in each call.
_CONSTANT = (
    "GetBodyByName", "GetFrameByName", "GetJointByName", "GetModelInstanceByName",
    "MakeActuationMatrix", "gravity_field", "num_actuators", "num_multibody_states",
    "num_positions", "num_velocities", "time_step", "world_body", "world_frame",
)  # fmt: skip


class InnerForces(StandIn):
    """Stands for MultibodyForces: forces on the joints, and perhaps gravity."""

    what = "forces"
    kind = MultibodyForces

    def __init__(self, plant: "InnerPlant"):
        self.values = AsNumbers(np.full(plant.num_velocities(), 0.0, object))
        self.has_gravity = False

    def SetZero(self) -> None:
        self.values[:] = 0.0
        self.has_gravity = False

    def generalized_forces(self) -> Any:
        return Copied(self.values)

    def mutable_generalized_forces(self) -> Any:
        return self.values


class InnerPlant(StandIn):
    """A MultibodyPlant that a block has inside.

    Args:
        plant: The plant.
        reader: The reader of the block, with the graph.
        memory: As for InnerContext.
    """

    what = "a plant inside"

    def __init__(self, plant: Any, reader: Any, memory: dict[Any, Any]):
        for reason in NoTree(plant):
            raise Untraceable(f"a plant inside: {reason}")
        self._plant = plant
        self._reader = reader
        self._memory = memory
        self.kind = type(plant)
        self._trees: dict[Any, PlantTree] = {}

    def __getattr__(self, name: str) -> Any:
        if name not in _CONSTANT:
            raise Untraceable(f"it calls {name}() of a plant inside")
        method = getattr(self._plant, name)

        def Call(*arguments: Any) -> Any:
            value = method(*map(Original, arguments))
            is_array = isinstance(value, np.ndarray)
            return AsNumbers(value) if is_array else value

        return Call

    # The Context.

    def CreateDefaultContext(self) -> InnerContext:
        own = self._plant.CreateDefaultContext()
        context = InnerContext(own, self._memory)
        self.SetPositions(context, self._plant.GetPositions(own))
        self.SetVelocities(context, self._plant.GetVelocities(own))
        return context

    def SetPositions(self, context: InnerContext, *q: Any) -> None:
        context.others["positions"] = self._Whole(q)

    def SetVelocities(self, context: InnerContext, *v: Any) -> None:
        context.others["velocities"] = self._Whole(v)

    def SetPositionsAndVelocities(self, context: InnerContext, *x: Any) -> None:
        n = self._plant.num_positions()
        self.SetPositions(context, x[-1][:n])
        self.SetVelocities(context, x[-1][n:])

    def GetPositions(self, context: InnerContext) -> Any:
        return Copied(self._Given(context, "positions"))

    def GetVelocities(self, context: InnerContext) -> Any:
        return Copied(self._Given(context, "velocities"))

    def _Whole(self, arguments: tuple[Any, ...]) -> Any:
        """Returns the values of all joints, perhaps after their model instance."""
        values = Objects(arguments[-1]).ravel()
        if len(values) != self._plant.num_velocities():
            raise Untraceable("it sets a part of the state of a plant inside")
        return AsNumbers(values)

    def _Given(self, context: InnerContext, name: str) -> Any:
        if type(context) is not InnerContext:
            raise Untraceable("it evaluates a plant inside in another Context")
        if name not in context.others:
            raise Untraceable(f"it does not set the {name} of a plant inside")
        return context.others[name]

    def _Tree(self, context: InnerContext) -> PlantTree:
        """Returns the plant with the parameters of a Context."""
        own = context.original
        if own not in self._trees:
            self._trees[own] = ReadPlantTree(self._plant, own)
        return self._trees[own]

    # Dynamics.

    def CalcMassMatrix(self, context: InnerContext) -> Any:
        q = self._Given(context, "positions")
        return self._Dynamics(self._Tree(context).tree, q, 0.0 * q)[0]

    CalcMassMatrixViaInverseDynamics = CalcMassMatrix

    def CalcBiasTerm(self, context: InnerContext) -> Any:
        q = self._Given(context, "positions")
        v = self._Given(context, "velocities")
        weightless = self._Tree(context).tree._replace(gravity=np.zeros(3))
        return self._Dynamics(weightless, q, v)[1]

    def CalcGravityGeneralizedForces(self, context: InnerContext) -> Any:
        q = self._Given(context, "positions")
        return -self._Dynamics(self._Tree(context).tree, q, 0.0 * q)[1]

    def CalcForceElementsContribution(
        self, context: InnerContext, forces: InnerForces
    ) -> None:
        if any(ForceElements(self._plant)):
            raise Untraceable("a plant inside has springs")
        v = self._Given(context, "velocities")
        forces.values[:] = -AsNumbers(self._Tree(context).tree.damping) * v
        forces.has_gravity = True

    def CalcInverseDynamics(
        self, context: InnerContext, known_vdot: Any, external_forces: InnerForces
    ) -> Any:
        total = self.CalcMassMatrix(context) @ AsNumbers(Objects(known_vdot).ravel())
        total = total + self.CalcBiasTerm(context)
        return total - self.CalcGeneralizedForces(context, external_forces)

    def CalcGeneralizedForces(self, context: InnerContext, forces: InnerForces) -> Any:
        if forces.has_gravity:
            return forces.values + self.CalcGravityGeneralizedForces(context)
        return forces.generalized_forces()

    def _Dynamics(self, tree: Any, q: Any, v: Any) -> Any:
        """Returns the mass matrix, and the bias with gravity."""

        def Calc(tree: Any, q: Any, v: Any) -> Any:
            motion = rigid_body.calc_motion(tree, q, v)
            return rigid_body.calc_dynamics(tree, motion, v)

        return self._Call(Calc, tree, q, v)

    # Kinematics of points.

    def CalcJacobianSpatialVelocity(
        self, context: InnerContext, *arguments: Any
    ) -> Any:
        return self._Point(context, *arguments)[1]

    def CalcJacobianTranslationalVelocity(
        self, context: InnerContext, *arguments: Any
    ) -> Any:
        return self._Point(context, *arguments)[1][3:]

    def CalcPointsPositions(
        self, context: InnerContext, frame_B: Any, p_BQi: Any, frame_A: Any
    ) -> Any:
        kV = JacobianWrtVariable.kV
        p = self._Point(context, kV, frame_B, p_BQi, frame_A, frame_A)[0]
        return p[:, np.newaxis]

    def _Point(
        self,
        context: InnerContext,
        variable: Any,
        frame_B: Any,
        p_BP: Any,
        *frames: Any,
    ) -> Any:
        """Returns the position of a point in the world, and its spatial Jacobian."""
        world = self._plant.world_frame().index()
        if any(Original(frame).index() != world for frame in frames):
            raise Untraceable("it takes a Jacobian in another frame than the world's")
        if Original(variable) != JacobianWrtVariable.kV:
            raise Untraceable("it takes a Jacobian with respect to positions")
        frame = Original(frame_B)
        q = self._Given(context, "positions")
        read = self._Tree(context)
        link, X_LB = read.poses[int(frame.body().index())]
        X_LF = X_LB @ frame.GetFixedPoseInBodyFrame()
        offset = AsNumbers(Objects(p_BP).ravel())
        point = AsNumbers(X_LF.rotation().matrix()) @ offset + X_LF.translation()

        def Calc(tree: Any, q: Any, link: int, point: Any) -> Any:
            motion = rigid_body.calc_motion(tree, q, 0.0 * q)
            return rigid_body.calc_jacobian(tree, motion, link, point)

        return self._Call(Calc, read.tree, q, link, point)

    def _Call(self, function: Callable[..., Any], tree: Any, *numbers: Any) -> Any:
        """Calls a function of the package's, which computes as Drake does.

        Args:
            numbers: Its other arguments. Vectors in them are taken to be finite, so
                that 0 times one is 0.
        """
        graph = self._reader.graph
        vectors = [x for x in numbers if isinstance(x, np.ndarray)]
        with graph.TakenAsFinite(itertools.chain(*vectors)):
            followed = Follow(graph, tree, "a plant inside")
            return Follow(graph, function, "a plant inside")(followed, *numbers)
