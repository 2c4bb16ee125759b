"""User-defined control laws: a class of systems, or a plain function.

Both can be named in a scenario as `kind: my_module:MyLaw`. The keywords of the class's
constructor, or the arguments of the function beyond LAW_INPUTS, are the fields in the
mapping `parameters`.
"""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.loops.framework.arrays import Array, ArrayLike, Record
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckChoice,
    Config,
    Refuse,
    ScenarioError,
)
from teleop_drake.loops.kernel import Kernel
from teleop_drake.loops.kernel.terms import WORDS
from teleop_drake.model.blocks.architectures.base import (
    LAW_INPUTS,
    ControlLawConfig,
    Facts,
    LawBlock,
)

Law = Callable[..., ArrayLike]

_FIELD_TYPES = (float, int, bool, str, np.ndarray)


class FunctionLaw(LawBlock):
    """Applies a plain function: F_c = function(F_h, v_d, p_WT, v_WT, F_e, gains...).

    | port | name              | size | unit |
    |------|-------------------|------|------|
    | in   | haptic_force      | n    | N    |
    | in   | velocity_command  | n    | m/s  |
    | in   | tool_position     | n    | m    |
    | in   | tool_velocity     | n    | m/s  |
    | in   | environment_force | n    | N    |
    | out  | control_force     | n    | N    |

    Parameters: the gains, in the order of the function's arguments.

    State: none.

    Direct feedthrough: from all inputs.

    The function is the block's kernel. It can be compiled to machine code and run in a
    page if it computes with NumPy's functions. Its result must depend only on its
    arguments.

    Args:
        function: Takes the five inputs in the order of the ports, arrays of n entries,
            and then its gains. Returns F_c in N (n).
        start: p_WT at time 0 in m (n).
        gains: Values of the gains by name; the others have their default values.

    Raises:
        ScenarioError: If the arguments or the result of the function are not as above.
    """

    def __init__(
        self,
        function: Law,
        start: ArrayLike,
        gains: Mapping[str, float | ArrayLike] | None = None,
    ):
        position = np.array(start, dtype=float)
        parameters = _Gains(function, gains or {})
        _CheckForce(function, position, parameters)
        # The units of the gains are unknown.
        self.numeric_parameters = dict.fromkeys(parameters, "")  # type: ignore[misc]
        LawBlock.__init__(
            self,
            _NameOf(function),
            Kernel(
                parameters=parameters,
                outputs={"control_force": (function, *LAW_INPUTS, *parameters)},
            ),
            position.size,
        )


@Config
class _OwnLawConfig(ControlLawConfig):
    """Base of the configs that LawConfig() makes.

    Attributes:
        law: The class of systems, or the function.
    """

    law: ClassVar[Any]

    def Check(self, path: str, num_axes: int) -> None:
        """Refuses a parameter that has neither a value nor a default."""
        super().Check(path, num_axes)
        for name, value in vars(self).items():
            if value is REQUIRED:
                Refuse(f"{path}.{name}", value, "given: the law has no default for it")

    def MakeControlLaw(self, facts: Facts, path: str) -> System:
        """Makes the law; any error of its constructor becomes a ScenarioError."""
        if not isinstance(self.law, type):
            return FunctionLaw(self.law, facts.start, vars(self))
        arguments = dict(vars(self))
        if "num_axes" in inspect.signature(self.law).parameters:
            arguments["num_axes"] = facts.num_axes
        try:
            law: System = self.law(**arguments)
        except Exception as error:
            # Whatever the user's constructor raises.
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise ScenarioError(f"{path}: {self.kind} raised {reason}") from error
        return law


@functools.cache
def LawConfig(law: Any) -> type[Any] | None:
    """Returns the config of a class of systems or of a function, otherwise None.

    Raises:
        ScenarioError: If a parameter of the law cannot be a field of a scenario.
    """
    is_class = isinstance(law, type) and issubclass(law, System)
    if not is_class and not inspect.isfunction(law):
        return None
    fields = []
    for name, kind, default in _FieldsOf(law):
        # The default is made anew for each config, so that no two share an array.
        make = functools.partial(_Value, kind, default)
        fields.append((name, kind, dataclasses.field(default_factory=make)))
    place = f"{law.__module__}:{law.__qualname__}"
    return dataclasses.make_dataclass(
        law.__name__,
        fields,
        bases=(_OwnLawConfig,),
        namespace={"law": law if is_class else staticmethod(law), "kind": place},
        kw_only=True,
        eq=False,
    )


def _FieldsOf(law: Any) -> list[tuple[str, Any, Any]]:
    """Returns the fields that a law has in a scenario: name, type and default.

    They are the parameters of the constructor except `num_axes`, or those of the
    function after the first five. The default is REQUIRED if the law has none.
    """
    try:
        signature = inspect.signature(law, eval_str=True)
    except (NameError, ValueError):
        # An annotation that cannot be evaluated, or a signature that is not known.
        signature = inspect.signature(law)
    parameters = list(signature.parameters.values())
    if isinstance(law, type):
        variadic = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
        chosen = [
            x for x in parameters if x.kind not in variadic and x.name != "num_axes"
        ]
    else:
        _CheckArguments(law, parameters)
        chosen = parameters[len(LAW_INPUTS) :]
    fields = []
    for parameter in chosen:
        has_default = parameter.default is not parameter.empty
        default = parameter.default if has_default else REQUIRED
        fields.append((parameter.name, _FieldType(law, parameter), default))
    return fields


def _CheckArguments(law: Law, parameters: list[inspect.Parameter]) -> None:
    """Refuses a function that does not take the five inputs, and then gains."""
    positional = (
        inspect.Parameter.POSITIONAL_ONLY,
        inspect.Parameter.POSITIONAL_OR_KEYWORD,
    )
    names = [x.name for x in parameters]
    gains = parameters[len(LAW_INPUTS) :]
    has_inputs = len(parameters) >= len(LAW_INPUTS)
    if not has_inputs or any(x.kind not in positional for x in parameters):
        shown = f"{_NameOf(law)}({', '.join(names)})"
        inputs = ", ".join(LAW_INPUTS)
        Refuse(
            "control_law",
            shown,
            f"a function of ({inputs}), then of gains, none of them keyword-only",
        )
    for gain in gains:
        if gain.name in (*LAW_INPUTS, *WORDS, "rate", "control_force"):
            Refuse("control_law", gain.name, "another name for a gain")


def _Gains(function: Law, given: Mapping[str, Any]) -> Record:
    """Returns the gains of a function in the order of its arguments, as numbers."""
    gains = {}
    place = f"gains of {_NameOf(function)}"
    known = _FieldsOf(function)
    for name in given:
        CheckChoice(place, name, [field for field, _, _ in known])
    for name, kind, default in known:
        value = given.get(name, default)
        if value is REQUIRED:
            Refuse(place, name, "given: it has no default")
        if kind not in (float, np.ndarray):
            Refuse(f"{_NameOf(function)}: {name}", value, "a number or an array")
        gains[name] = _Value(kind, value)
    return gains


def _FieldType(law: Any, parameter: inspect.Parameter) -> Any:  # noqa: RET503
    """Returns the type of a field: its annotation, or the type of its default value.

    A number without an annotation is a float.
    """
    default = parameter.default
    if parameter.annotation in _FIELD_TYPES:
        return parameter.annotation
    if isinstance(default, (list, tuple, np.ndarray)):
        return np.ndarray
    if isinstance(default, (bool, str)):
        return type(default)
    if default is parameter.empty or isinstance(default, (int, float)):
        return float
    Refuse(
        f"{_NameOf(law)}: {parameter.name}",
        default,
        "a number, text, true or false, or an array, to be a field of a scenario",
    )


def _Value(kind: Any, value: Any) -> Any:
    """Returns the value of a field as its type: numbers as floats, arrays copied."""
    if value is REQUIRED:
        return REQUIRED
    return np.array(value, dtype=float) if kind is np.ndarray else kind(value)


def _CheckForce(law: Law, position: Array, parameters: Mapping[str, Any]) -> None:
    """Refuses a function whose force at the start does not have n entries."""
    at_rest = np.zeros(position.size)
    with np.errstate(all="ignore"):
        force = law(at_rest, at_rest, position, at_rest, at_rest, *parameters.values())
    if np.shape(force) != position.shape:
        one_each = f"one number for each axis of the task ({position.size})"
        Refuse(f"control_law: force of {_NameOf(law)}", force, one_each)


def _NameOf(law: Any) -> str:
    """Returns the name of a law; that of a lambda is control_law."""
    name: str = getattr(law, "__name__", type(law).__name__)
    return name if name.isidentifier() else "control_law"
