"""The kernels of blocks: their own, those of Drake's blocks, and users' in Python."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pydrake.systems.framework import Context, NumericParameterIndex, System

from teleop_drake.loops.engine.constants import WithConstants
from teleop_drake.loops.engine.flatten import UnreadableLeaf, UnsupportedSystem
from teleop_drake.loops.engine.primitives import IsSilent, PrimitiveKernel
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.signals import IsOfDrake, IsPlainLeaf, IsPlant
from teleop_drake.loops.framework.wiring import OutputNames
from teleop_drake.loops.kernel import Kernel, KernelBlock, KernelIn

if TYPE_CHECKING:
    from teleop_drake.loops.engine.leaf_tracing import LeafReader


def KernelOf(
    system: System, context: Context, constants: Mapping[str, Array] | None = None
) -> Kernel:
    """Returns the kernel of a block, whose events are not compared: see CheckEvents().

    Args:
        system: The block: a system with a method Kernel(), one of Drake's primitives,
            or a MultibodyPlant. A subclass of one of Drake's classes is refused.
        context: The Context of the block.
        constants: Other values of the block's constants, see engine.constants.

    Raises:
        UnsupportedSystem: If the block has no kernel, or one that lacks a part of the
            block's computation.
        ScenarioError: If Drake does not allow the constants.
    """
    if hasattr(system, "Kernel"):
        return _OwnKernel(system, context)
    if IsOfDrake(system) and IsPlant(system):
        # Systems without a plant need none of this.
        from teleop_drake.loops.engine.plant_kernel import PlantKernel

        return PlantKernel(system, context)
    if IsReadable(system, context):
        # Systems without such a block need none of this.
        from teleop_drake.loops.engine.leaf_tracing import LeafReader

        return ReadLeaf(LeafReader(system), context, constants)
    return PrimitiveKernel(WithConstants(system, constants or {}), context)


def IsReadable(system: System, context: Context) -> bool:
    """Returns whether a system is a user's in Python, with numbers but no kernel."""
    return IsPlainLeaf(system) and not IsSilent(system, context)


def ReadLeaf(
    reader: "LeafReader", context: Context, constants: Mapping[str, Array] | None = None
) -> Kernel:
    """Returns the kernel of a user's block in Python, as it stands.

    If its functions cannot be followed, the symbolic form serves that a TemplateSystem
    has.

    Raises:
        UnsupportedSystem: If there is neither.
    """
    try:
        return reader.Read(context, constants)
    except UnreadableLeaf:
        try:
            kernel = PrimitiveKernel(reader.system, context)
        except UnsupportedSystem:
            kernel = None
        if kernel is None:
            raise
        reader.is_symbolic = True
        return kernel


def _OwnKernel(system: Any, context: Context) -> Kernel:
    """Returns the kernel of a block's method Kernel(), with the Context's parameters.

    In the kernel of a user's LeafSystem, the value of a parameter may be the index of a
    numeric parameter, which stands for its value in the Context: what
    DeclareNumericParameter() returns, in pydrake a plain int, or a
    NumericParameterIndex. A number is therefore written as a float, unless it is an int
    that is the index of no parameter.
    """
    if isinstance(system, KernelBlock):
        kernel = KernelIn(system, context)
    else:
        kernel = system.Kernel()
        parameters = dict(kernel.parameters)
        for name, value in parameters.items():
            if _IsIndex(value, context):
                vector = context.get_numeric_parameter(value)
                parameters[name] = vector.CopyToVector()
        kernel = replace(kernel, parameters=parameters)
    _CheckIsWhole(system, kernel)
    return kernel


def _IsIndex(value: Any, context: Context) -> bool:
    """Returns whether a value is the index of a numeric parameter of a Context."""
    if type(value) is int:
        return 0 <= value < context.num_numeric_parameter_groups()
    return isinstance(value, NumericParameterIndex)


def _CheckIsWhole(system: System, kernel: Kernel) -> None:
    """Raises UnsupportedSystem if a block computes more than its kernel.

    The block may have an output that the kernel lacks. It may also be of a subclass
    that inherits the kernel, and that overrides a callback of Drake.
    """
    known = {*kernel.outputs, *(delay.output for delay in kernel.delays)}
    for name in OutputNames(system):
        if name not in known:
            raise UnsupportedSystem(system, f"its kernel has no output {name!r}")
    for cls in type(system).__mro__:
        if "Kernel" in vars(cls):
            return
        for name in vars(cls):
            if name.startswith(("DoCalc", "DoGetWitness")):
                reason = f"{cls.__name__} has a {name}() that its kernel does not know"
                raise UnsupportedSystem(system, reason)
