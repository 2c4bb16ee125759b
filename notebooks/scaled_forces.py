"""The same motion with other forces and masses."""

from typing import Any

import numpy as np

from teleop_drake.loops.framework.validation import CheckNumber, Refuse
from teleop_drake.model.blocks.robots import RobotConfig
from teleop_drake.model.scenario.scenario import Scenario
from teleop_drake.model.scenario.tree import FromTree, ToTree

# The fields that go by a power of the factor; the others stay. P s goes by f^2 as z
# does by f, so that V2 keeps its form and goes by f^2 as a whole. The rates follow from
# the update laws: dW1/dt keeps its size, dPsi/dt goes by 1/f, dW3/dt by f.
_POWERS = {
    1: """
        robot.mass robot.damping haptic_device.numerator
        surgeon.contact_force
        surgeon.arm_mass surgeon.arm_damping surgeon.arm_stiffness
        environment.stiffness environment.branch_stiffness environment.drag
        environment.layers.stiffness environment.layers.damping
        environment.layers.lateral_stiffness
        controller.robust.force_rate_bound controller.robust.force_width
        controller.damped_force.damping
        controller.wave_variables.impedance controller.wave_variables.master_damping
        controller.time_domain_passivity.maximum_damping
        controller.time_domain_passivity.initial_energy
        controller.time_domain_passivity.local_damping
        controller.proportional_damping.master_mass
        controller.proportional_damping.master_damping
        controller.proportional_damping.slave_damping
        controller.proportional_damping.stiffness
        controller.four_channel.master_mass controller.four_channel.master_damping
        controller.four_channel.slave_damping
        controller.four_channel.C_m.damping controller.four_channel.C_m.stiffness
        controller.four_channel.C_s.damping controller.four_channel.C_s.stiffness
        controller.smith_predictor.mass controller.smith_predictor.local_damping
        controller.smith_predictor.damping controller.smith_predictor.stiffness
        actuator.force_limit actuator.coulomb_friction actuator.viscous_friction
        sensor.force.resolution sensor.force.noise
    """,
    2: "controller.P controller.robust.velocity_width",
    -1: """
        controller.Lambda controller.initial_psi controller.minimum_psi
        controller.time_domain_passivity.maximum_mobility
    """,
    -2: "controller.beta1",
    -4: "controller.beta2",
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
    for name in ("surgeon", "environment", "controller"):
        config = getattr(scenario, name)
        kind = config.Chosen() if name == "controller" else config
        if not type(kind).__module__.startswith("teleop_drake."):
            Refuse(f"{name}.kind", config.kind, "a kind of the package to be scaled")
    tree = ToTree(scenario)
    gains = tree["controller"]
    for name in ("beta1", "beta2", "beta3"):
        if gains[name] is None:
            gains[name] = gains["adaptation_rate"]
    for power, paths in _POWERS.items():
        for path in paths.split():
            _Scale(tree, path.split("."), factor**power)
    scaled = FromTree(tree, Scenario)
    if robot is not None:
        scaled.robot = robot
    scaled.Validate()
    return scaled


def _Scale(tree: Any, keys: list[str], factor: float) -> None:
    """Scales the value at a path, in each element of a list, if there is one."""
    if isinstance(tree, list):
        for item in tree:
            _Scale(item, keys, factor)
    elif len(keys) > 1:
        _Scale(tree.get(keys[0], {}), keys[1:], factor)
    elif not (tree.get(keys[0]) is None or isinstance(tree[keys[0]], str)):
        tree[keys[0]] = (np.asarray(tree[keys[0]]) * factor).tolist()
