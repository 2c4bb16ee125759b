"""The same motion with other forces and masses."""

from typing import Any

import numpy as np

from teleop_drake.architectures import ARCHITECTURES
from teleop_drake.robots import RobotConfig
from teleop_drake.scenario.scenario import Scenario
from teleop_drake.scenario.tree import FromTree, ToTree
from teleop_drake.validation import CheckNumber, Refuse

# By which power of the factor each field goes; the others stay. P s goes by f^2 as z
# does by f, so that V2 keeps its form and goes by f^2 as a whole. The rates follow from
# the update laws: dW1/dt keeps its size, dPsi/dt goes by 1/f, dW3/dt by f.
_STATION = {"damping": 1, "stiffness": 1}
_POWERS: dict[str, Any] = {
    "robot": {"mass": 1, "damping": 1},
    "surgeon": {
        "contact_force": 1,
        "arm_mass": 1,
        "arm_damping": 1,
        "arm_stiffness": 1,
    },
    "haptic_device": {"numerator": 1},
    "environment": {
        "layers": {"stiffness": 1, "damping": 1, "lateral_stiffness": 1},
        # That of a wall; its damping is in s/m.
        "stiffness": 1,
        "branch_stiffness": 1,
    },
    "controller": {
        "Lambda": -1,
        "P": 2,
        "beta1": -2,
        "beta2": -4,
        "initial_psi": -1,
        "minimum_psi": -1,
        "robust": {"velocity_width": 2, "force_rate_bound": 1, "force_width": 1},
        "damped_force": {"damping": 1},
        "wave_variables": {"impedance": 1, "master_damping": 1},
        "time_domain_passivity": {
            "maximum_damping": 1,
            "maximum_mobility": -1,
            "initial_energy": 1,
            "local_damping": 1,
        },
        "proportional_damping": {
            "master_mass": 1,
            "master_damping": 1,
            "slave_damping": 1,
            "stiffness": 1,
        },
        "four_channel": {
            "master_mass": 1,
            "master_damping": 1,
            "slave_mass": 1,
            "slave_damping": 1,
            "C_m": _STATION,
            "C_s": _STATION,
        },
        "smith_predictor": {"mass": 1, "local_damping": 1, **_STATION},
    },
    "actuator": {"force_limit": 1, "coulomb_friction": 1, "viscous_friction": 1},
    "sensor": {"force": {"resolution": 1, "noise": 1}},
}


def ScaleForces(
    scenario: Scenario, factor: float, *, robot: RobotConfig | None = None
) -> Scenario:
    """Returns a scenario with all forces and masses times f at the same motion.

    The gains of the adaptive law are in different units, and each goes by its own power
    of f:

        P f^2,   Lambda/f,   Psi0/f,   Psi_min/f,   beta1/f^2,   beta2/f^4,   beta3

    So this is also the way to the gains for a robot that is f times as heavy. The loop
    is the same but for what the law forgets, beta1 nu and beta2 Upsilon, which goes by
    1/f^2 and 1/f^4: the same `leakage` serves W1 and W3, and `supervision` is at most
    1. Without either it is the same exactly.

    The accuracy of the solver stays; it is absolute, and some states go by f.

    Args:
        factor: f, > 0.
        robot: What takes the place of the scenario's robot, about f times as heavy at
            the tool; None: a slider's mass and damping are scaled.

    Raises:
        ScenarioError: If the robot has its masses from a model, or what is scaled is a
            kind of a user's own, whose units are not known.
    """
    CheckNumber("factor", factor, above=0)
    if robot is None and (
        scenario.robot.kind != "slider"
        or None in (scenario.robot.mass, scenario.robot.damping)  # type: ignore[attr-defined]
    ):
        allowed = "a slider with mass and damping, or `robot` given, f times as heavy"
        Refuse("robot.model", scenario.robot.kind, allowed)
    for name in ("surgeon", "environment"):
        config = getattr(scenario, name)
        if not type(config).__module__.startswith("teleop_drake."):
            Refuse(f"{name}.kind", config.kind, "a kind of the package to be scaled")
    if scenario.controller.kind not in ARCHITECTURES:
        allowed = "a kind of the package to be scaled"
        Refuse("controller.kind", scenario.controller.kind, allowed)
    tree = ToTree(scenario)
    gains = tree["controller"]
    for name in ("beta1", "beta2", "beta3"):
        if gains[name] is None:
            gains[name] = gains["adaptation_rate"]
    scaled = FromTree(_Scaled(tree, _POWERS, factor), Scenario)
    if robot is not None:
        scaled.robot = robot
    scaled.Validate()
    return scaled


def _Scaled(value: Any, powers: Any, factor: float) -> Any:
    """Returns what a tree has at a place, scaled; `powers` is a power or by keys."""
    if isinstance(powers, int):
        if value is None or isinstance(value, str):
            return value
        return (np.asarray(value) * factor**powers).tolist()
    if isinstance(value, list):
        return [_Scaled(item, powers, factor) for item in value]
    return {
        key: _Scaled(item, powers[key], factor) if key in powers else item
        for key, item in value.items()
    }
