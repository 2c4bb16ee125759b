"""Parameters and initial states in a diagram's Context, by name.

The name of a parameter is the path of its system, a dot and its own name, as in
`controller/law.damping`. An element of an array is selected by its indices, as in
`law.G1(0,1)`, or by its own name, as in `environment.stiffness(bone)`.

The name of an initial state is the path of its system, a dot, its own name and `(0)`,
as in `plant.theta(0)`; the older spelling `plant/theta(0)` is accepted. The name
`delay` stands for the delays of all blocks.
"""

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import Context, Diagram, System
from pydrake.systems.primitives import ConstantVectorSource

from teleop_drake.loops.engine.components import FieldsOf, StateNamesOf
from teleop_drake.loops.engine.constants import ConstantsOf
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.signals import (
    CheckContext,
    CheckSystem,
    IsPlant,
    PathsIn,
)
from teleop_drake.loops.framework.validation import Choices, GainMatrix, Range, Refuse
from teleop_drake.loops.kernel import KernelBlock

_FIXED = (
    "left to Compile(...).Run() or to a page: Drake keeps it as a constant of the "
    "system, which no Context can change"
)

# The end of an older name of a state: a slash, and no dot behind it.
_OLD_STATE = re.compile(r"/([^/.]+\(0\))$")


class ParameterValue(NamedTuple):
    """The value of a parameter in a Context, a number or an array, and its unit.

    The unit is empty if the system does not report it.
    """

    value: float | Array
    unit: str


class Scalar(NamedTuple):
    """One number in a Context.

    Attributes:
        value: The value in the Context.
        unit: The unit; empty if the system does not report it.
        paths: The paths of the systems that have this number.
        is_delay: Whether it is a constant delay of a signal.
        is_state: Whether it is an initial state, not a parameter.
        range: The values that it may have; None: any finite number.
        is_constant: Whether Drake keeps it as a constant, see engine.constants.
    """

    value: float
    unit: str
    paths: list[str]
    is_delay: bool = False
    is_state: bool = False
    range: Range | None = None
    is_constant: bool = False


class _Parameter(NamedTuple):
    """A numeric parameter or initial state of one system, a number or an array.

    The functions `read` and `write` access its value in a Context. `elements` contains
    the names of its elements, if they have names. `range` is as in Scalar; `path` and
    `system` are the system's.
    """

    name: str
    unit: str
    read: Callable[[], ArrayLike]
    write: Callable[[Array], None]
    elements: tuple[str, ...] = ()
    is_delay: bool = False
    is_state: bool = False
    path: str = ""
    system: System | None = None
    range: Range | None = None
    is_constant: bool = False

    @property
    def value(self) -> Array:
        """The present value as an array."""
        return np.array(self.read(), dtype=float)

    def Check(self, name: str, value: Array) -> None:
        """Refuses a value that is out of the range; `name` is its full name."""
        if self.range is not None:
            self.range.Check(name, value)

    def InDictionary(self, values: dict[str, Array]) -> "_Parameter":
        """Returns this parameter with its value in a dictionary, by name."""
        return self._replace(
            read=lambda: values.get(self.name, self.value),
            write=lambda value: values.update({self.name: value}),
        )

    @property
    def places(self) -> dict[str, tuple[int, ...]]:
        """The indices of each element, keyed by their text, then by its name."""
        indices = np.ndindex(self.value.shape)
        places = {",".join(map(str, place)): place for place in indices if place}
        return places | {name: (i,) for i, name in enumerate(self.elements)}


def NamedParameters(
    diagram: System, context: Context | None = None
) -> dict[str, ParameterValue]:
    """Returns the numeric parameters of all systems in a diagram, by name.

    Drake's own systems are included. The parameters of a MultibodyPlant are the mass of
    each body, the damping of each joint, and the gear ratio and the rotor inertia of
    each actuator. Numbers that Drake keeps as constants are included: `k` of a Gain,
    `kp`, `ki` and `kd` of a PidController, `min_value` and `max_value` of a Saturation,
    and the matrices of linear and affine systems. No Context has them; runs of
    Compile() and pages can change them.

    Args:
        diagram: A Diagram, or a system by itself.
        context: The Context of the diagram; None: the default Context.

    Returns:
        The value and the unit of each parameter, by `system/path.parameter`.
    """
    CheckSystem("diagram", diagram)
    context = context or diagram.CreateDefaultContext()
    CheckContext(diagram, context)
    return {
        name: ParameterValue(_AsNumber(parameter.value), parameter.unit)
        for name, parameter in _NumbersIn(diagram, context).items()
        if not parameter.is_state
    }


def NumberName(name: str) -> str:
    """Returns the name of a number; `plant/theta(0)` is an older one of a state."""
    return _OLD_STATE.sub(r".\1", name)


def SetNumbers(
    diagram: System,
    context: Context,
    numbers: Mapping[str, ArrayLike],
    constants: dict[System, dict[str, Array]] | None = None,
) -> set[System]:
    """Sets parameters, elements of parameters, or initial states in a Context.

    Args:
        numbers: New values, by the names of NamedParameters() and ScalarsIn(), or
            `delay`. A parameter of several elements takes an array of its shape, or one
            number: a gain is that number times the identity, and the elements of any
            other parameter are that number.
        constants: A dictionary to which the numbers are added that Drake keeps as
            constants, by system and name; None: such numbers are refused.

    Returns:
        The systems that have these numbers.

    Raises:
        ScenarioError: If there is no such number, or the value is not allowed.
    """
    numbers = {NumberName(name): value for name, value in numbers.items()}
    known = _NumbersIn(diagram, context, numbers)
    delays = [name for name, parameter in known.items() if parameter.is_delay]
    changed = {}
    for name, value in numbers.items():
        try:
            number = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            Refuse(name, value, "a number or an array of numbers")
        if not np.isfinite(number).all():
            Refuse(name, value, "finite")
        for each in delays if name == "delay" and delays else [name]:
            whole = each if each in known else each.partition("(")[0]
            if whole not in known:
                names = list(_NumbersIn(diagram, context))
                Refuse("parameter", name, Choices(name, names))
            parameter = known[whole]
            if parameter.is_constant:
                if constants is None:
                    Refuse(name, value, _FIXED)
                own = constants.setdefault(parameter.system, {})
                parameter = parameter.InDictionary(own)
            _Set(parameter, whole, each, number)
            changed[parameter.path] = parameter.system
    # What is not allowed together is refused when all are set.
    contexts = ContextsIn(diagram, context)
    for path, system in changed.items():
        if isinstance(system, KernelBlock):
            system.kernel_parameters.Check(contexts[system], path)
    return set(changed.values())


def CheckNumbers(diagram: System, context: Context) -> None:
    """Refuses parameters of a Context that are not allowed, by their full names.

    They are those of this package's blocks, and of MultibodyPlants.

    Args:
        diagram: A Diagram, or a system by itself.
        context: The Context of the diagram.

    Raises:
        ScenarioError: If a parameter is out of its range.
    """
    contexts = ContextsIn(diagram, context)
    for system, path in PathsIn(diagram):
        own = contexts[system]
        if IsPlant(system):
            for number in _ParametersOfPlant(system, own):
                name = f"{path}.{number.name}" if path else number.name
                number.Check(name, number.value)
        elif isinstance(system, KernelBlock):
            system.kernel_parameters.Check(own, path)


def ScalarsIn(diagram: System, context: Context) -> dict[str, Scalar]:
    """Returns every element of every parameter, and every state, by name.

    The states of a system are its continuous states or, if it has none, its first group
    of discrete states. The discrete state of a block with a kernel is left out. The
    states of a MultibodyPlant and of Drake's example systems have Drake's names. The
    states of all other systems are named x0, x1, ... `delay` is among the names if
    there are delays of blocks and all of them are equal.
    """
    scalars = {}
    for name, parameter in _NumbersIn(diagram, context).items():
        value = parameter.value
        # An element's own name comes last, and replaces its indices.
        places = {place: f"({inside})" for inside, place in parameter.places.items()}
        if value.size == 1:
            places = {(): ""}
        for place, inside in places.items():
            scalars[f"{name}{inside}"] = Scalar(
                value[place].item(),
                parameter.unit,
                [parameter.path],
                parameter.is_delay,
                parameter.is_state,
                parameter.range and parameter.range.Of(place),
                parameter.is_constant,
            )
    delays = [number for number in scalars.values() if number.is_delay]
    if len({delay.value for delay in delays}) == 1:
        paths = [path for delay in delays for path in delay.paths]
        scalars["delay"] = delays[0]._replace(unit="s", paths=paths)
    return scalars


def _Set(parameter: _Parameter, whole: str, name: str, number: Array) -> None:
    """Sets one parameter, or one element of it.

    Args:
        whole: The full name of the parameter.
        name: The full name of the parameter or of its element.
    """
    value = parameter.value
    if name == whole:
        if number.shape not in ((), value.shape):
            Refuse(name, number, f"a number or an array of shape {value.shape}")
        is_scaled = parameter.range is not None and parameter.range.is_matrix
        value[...] = GainMatrix(number, len(value)) if is_scaled else number
    else:
        if number.ndim:
            Refuse(name, number, "a number")
        words = name.partition("(")[2].removesuffix(")").split(",")
        place = parameter.places.get(",".join(word.strip() for word in words))
        if place is None:
            allowed = f"a place in an array of shape {value.shape}"
            if parameter.elements:
                allowed += f", or one of {', '.join(parameter.elements)}"
            Refuse("parameter", name, allowed)
        value[place] = number
    parameter.Check(whole, value)
    parameter.write(value)


def _AsNumber(array: Array) -> float | Array:
    return array.item() if array.ndim == 0 else array


def _NumbersIn(
    diagram: System, context: Context, names: Collection[str] | None = None
) -> dict[str, _Parameter]:
    """Returns the parameters and states of the systems in a diagram by full names.

    Args:
        names: If given, only those systems are read that may have these numbers.
    """
    contexts = ContextsIn(diagram, context)
    found = {}
    for system, path in PathsIn(diagram):
        if isinstance(system, Diagram):
            continue
        if names is not None and not any(_MayBe(x, system, path) for x in names):
            continue
        own = contexts[system]
        for number in (*_ParametersOf(system, own), *_StatesOf(system, own)):
            name = f"{path}.{number.name}" if path else number.name
            found[name] = number._replace(path=path, system=system)
    return found


def _MayBe(name: str, system: System, path: str) -> bool:
    """Returns whether a system with a path may have a number of a full name."""
    if name == "delay" and isinstance(system, KernelBlock) and system.delays:
        return True
    return not path or name.startswith(f"{path}.")


def _InVector(
    name: str,
    unit: str,
    vector: Callable[[], Any],
    places: slice,
    shape: tuple[int, ...] = (),
) -> _Parameter:
    """Returns the parameter that consists of some elements of a Context's vector.

    Args:
        vector: A function that returns the mutable vector from the Context. The call
            marks dependent cache entries as out of date.
        places: The elements of the vector.
        shape: The shape of the parameter's value.
    """

    def Read() -> Array:
        return cast(Array, vector().CopyToVector()[places].reshape(shape))

    def Write(value: Array) -> None:
        numbers = vector().CopyToVector()
        numbers[places] = value.ravel()
        vector().SetFromVector(numbers)

    return _Parameter(name, unit, Read, Write)


def _StatesOf(system: System, context: Context) -> Iterator[_Parameter]:
    """Yields the states of a system that is no diagram."""
    vector: Callable[[], Any] = context.get_mutable_continuous_state_vector
    if context.num_continuous_states() == 0 and context.num_discrete_state_groups() > 0:
        if hasattr(system, "Kernel"):
            return  # The discrete state of a kernel is a mode.
        vector = partial(context.get_mutable_discrete_state, 0)
    for i, name in enumerate(_StateNames(system, vector())):
        state = _InVector(f"{name}(0)", "", vector, slice(i, i + 1))
        yield state._replace(is_state=True)


def _StateNames(system: System, vector: Any) -> list[str]:
    """Returns the names of a system's states."""
    if IsPlant(system):
        return StateNamesOf(system)
    if type(vector).__module__ == "pydrake.examples":
        fields = FieldsOf(vector)
        return sorted(fields, key=lambda name: fields[name])
    return [f"x{i}" for i in range(vector.size())]


def _ParametersOf(system: System, context: Context) -> Iterator[_Parameter]:
    if IsPlant(system):
        yield from _ParametersOfPlant(system, context)
    elif hasattr(system, "kernel_parameters"):
        yield from _ParametersOfKernel(system, context)
    else:
        yield from _NumericParameters(system, context)
        for name, value in ConstantsOf(system).items():
            yield _Parameter(
                name, "", partial(np.array, value), _WriteNothing, is_constant=True
            )


def _WriteNothing(value: Array) -> None:
    """Stands for the write function of a constant, which no Context has."""


def _ParametersOfKernel(block: Any, context: Context) -> Iterator[_Parameter]:
    """Yields the parameters of one of this package's blocks."""
    delays = block.Kernel().delays
    for name, number, unit, own_range, shape in block.kernel_parameters.named:
        vector = partial(context.get_mutable_numeric_parameter, number)
        yield _InVector(name, unit, vector, slice(None), shape)._replace(
            elements=tuple(block.element_names.get(name, ())),
            is_delay=bool(delays) and name.partition(".")[0] == "delay",
            range=own_range,
        )


def _NumericParameters(system: System, context: Context) -> Iterator[_Parameter]:
    """Yields the numeric parameters of one of Drake's systems, or of a user's own."""
    if isinstance(system, ConstantVectorSource):
        vector = partial(context.get_mutable_numeric_parameter, 0)
        yield _InVector("value", "", vector, slice(None), (vector().size(),))
        return
    for number in range(context.num_numeric_parameter_groups()):
        vector = partial(context.get_mutable_numeric_parameter, number)
        size = vector().size()
        fields = FieldsOf(vector())
        for name, i in fields.items():
            yield _InVector(name, "", vector, slice(i, i + 1))
        if not fields:
            yield _InVector(f"parameter{number}", "", vector, slice(None), (size,))


def _ParametersOfPlant(plant: Any, context: Context) -> Iterator[_Parameter]:
    """Yields the mass of each body, the damping of each joint, and the gears of motors.

    A new mass does not change the centre of mass and the unit inertia of the body.
    Drake would end the process for a negative damping.
    """
    from pydrake.multibody.tree import BodyIndex  # Not where there is no plant.

    for number in range(1, plant.num_bodies()):  # 0 is the world.
        body = plant.get_body(BodyIndex(number))

        def WriteMass(value: Array, body: Any = body) -> None:
            body.SetMass(context, value.item())

        yield _Parameter(
            f"{body.name()}.mass",
            "kg",
            partial(body.get_mass, context),
            WriteMass,
            range=Range("kg", minimum=0),
        )
    for joint_index in plant.GetJointIndices():
        joint = plant.get_joint(joint_index)
        if joint.num_velocities() == 0:
            continue

        def WriteDamping(value: Array, joint: Any = joint) -> None:
            joint.SetDampingVector(context, value)

        unit = "N m s/rad" if joint.type_name() == "revolute" else "N s/m"
        yield _Parameter(
            f"{joint.name()}.damping",
            unit,
            partial(joint.GetDampingVector, context),
            WriteDamping,
            range=Range(unit, minimum=0),
        )
    for actuator_index in plant.GetJointActuatorIndices():
        yield from _ParametersOfMotor(plant.get_joint_actuator(actuator_index), context)


def _ParametersOfMotor(motor: Any, context: Context) -> Iterator[_Parameter]:
    """Yields the gear ratio and the rotor inertia of a joint's actuator."""

    def WriteRatio(value: Array) -> None:
        motor.SetGearRatio(context, value.item())

    def WriteInertia(value: Array) -> None:
        motor.SetRotorInertia(context, value.item())

    name = motor.name()
    ratio = partial(motor.gear_ratio, context)
    yield _Parameter(f"{name}.gear_ratio", "", ratio, WriteRatio)
    unit = "kg m^2" if motor.joint().type_name() == "revolute" else "kg"
    yield _Parameter(
        f"{name}.rotor_inertia",
        unit,
        partial(motor.rotor_inertia, context),
        WriteInertia,
        range=Range(unit, minimum=0),
    )
