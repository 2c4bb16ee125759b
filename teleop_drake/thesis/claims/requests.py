"""The runs that the claims are measured on."""

from collections.abc import Mapping
from typing import Any

from teleop_drake.architectures.adaptive_backstepping import AdaptiveBacksteppingConfig
from teleop_drake.scenario import AsTeleoperation, LoadScenario
from teleop_drake.scenario.tree import ToTree
from teleop_drake.thesis.claims.separate_updates import SeparateUpdatesConfig

DIRECT: dict[str, Any] = {"controller.kind": "direct_force"}
DAMPED: dict[str, Any] = {"controller.kind": "damped_force"}
ADAPTIVE: dict[str, Any] = {"controller.kind": "adaptive_backstepping"}
TASKS = ("one_dof", "two_dof_puncture", "two_dof_collision", "two_dof_combined")
NETWORKS = ("network_tracking_linear", "network_tracking_coupled")
LEARNING = "two_dof_learning"
"""The scenario with settings with which the networks learn."""

SHORT: dict[str, dict[str, Any]] = {
    name: {
        "duration": duration,
        "simulator.max_step_size": 0.1,
        "simulator.accuracy": 1e-9 if name == "one_dof" else 1e-7,
    }
    for name, duration in zip(TASKS, (18.0, 6.0, 5.0, 5.0), strict=True)
}
"""Settings of each task with which every metric agrees with its full run to 0.1 %."""

NO_ADAPTATION = {"controller.adaptation_rate": 0.0}
NO_DELAY = {"forward_channel.delay": 0.0, "return_channel.delay": 0.0}
RETUNED = {"haptic_device.numerator": [25.0, 5.0]}
DAMPER = {"controller.damped_force.damping": 2.0}
DOUBLE_DELAY = {"forward_channel.delay": 0.2, "return_channel.delay": 0.2}
FOURFOLD_DELAY = {
    "forward_channel.delay": 0.4,
    "return_channel.delay": 0.4,
    "duration": 6.0,
}
NEVER_SWITCHING = {
    "forward_channel.delay": 0.5,
    "return_channel.delay": 0.5,
    "surgeon.contact_force": None,
    "duration": 16.0,
}
LARGER_GAINS = [{"controller.G1": 4.0 * x, "controller.G2": 30.0 * x} for x in (1.5, 2)]
TRACKING_GAIN = {"controller.G1": 4.0}

_BONE = "environment.layers.bone.stiffness"
ENVIRONMENTS: dict[str, tuple[str, dict[str, Any]]] = {
    "case II, bone of 1500 N/m": ("two_dof_collision", {_BONE: 1500.0}),
    "case II, Psi0 = 2": ("two_dof_collision", {"controller.initial_psi": 2.0}),
    "case III, bone of 15 N/m": ("two_dof_combined", {_BONE: 15.0}),
    "case III, bone of 1500 N/m": ("two_dof_combined", {_BONE: 1500.0}),
    "case III, tissue of 0.1 N s/m": (
        "two_dof_combined",
        {"environment.layers.tissue.damping": 0.1},
    ),
    "case III, tissue of 2.5 N s/m": (
        "two_dof_combined",
        {"environment.layers.tissue.damping": 2.5},
    ),
    "case III, Psi0 = 8": ("two_dof_combined", {"controller.initial_psi": 8.0}),
}
"""Environments and estimates that the design of chapter 5 does not know."""


def Variant(
    name: str, kind: Mapping[str, Any], change: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Returns the short run of a task with a controller and a change."""
    return name, {**kind, **SHORT[name], **change}


_VARIANTS = [
    *(Variant(name, DIRECT, RETUNED) for name in TASKS),
    *(Variant(name, DAMPED, DAMPER) for name in TASKS if "puncture" not in name),
    *(Variant(name, ADAPTIVE, NO_ADAPTATION) for name in TASKS),
    *(Variant("one_dof", kind, NO_DELAY) for kind in (DIRECT, ADAPTIVE)),
    *(Variant("two_dof_combined", kind, NO_DELAY) for kind in (DIRECT, ADAPTIVE)),
    *(Variant("two_dof_combined", kind, DOUBLE_DELAY) for kind in (DIRECT, ADAPTIVE)),
    Variant("two_dof_combined", ADAPTIVE, FOURFOLD_DELAY),
    Variant("two_dof_combined", ADAPTIVE, RETUNED),
]

REQUESTS: list[tuple[str, dict[str, Any]]] = [
    *((name, dict(kind)) for name in TASKS for kind in (DIRECT, ADAPTIVE)),
    *((name, {}) for name in NETWORKS),
    (NETWORKS[0], NO_ADAPTATION),
    *_VARIANTS,
]
"""The runs that the ledger looks at, as ThesisRuns.Prefetch takes them."""


def Separate(name: str) -> dict[str, Any]:
    """Returns what takes the tuning functions out of a task's controller."""
    scenario = AsTeleoperation(LoadScenario(name))
    config = AdaptiveBacksteppingConfig.Of(scenario.controller)
    return {
        "controller.kind": SeparateUpdatesConfig.kind,
        "controller.parameters": dict(ToTree(config)),
    }


def Alike() -> list[tuple[str, dict[str, Any]]]:
    """Returns more of them, many of which differ in numbers only."""
    return [
        *(
            ("two_dof_collision", {**ADAPTIVE, **gains, **delay})
            for delay in ({}, NO_DELAY)
            for gains in ({}, *LARGER_GAINS)
        ),
        *((name, {**ADAPTIVE, **NEVER_SWITCHING}) for name in TASKS[2:]),
        *(
            (name, {**ADAPTIVE, **change, **learning})
            for name, change in ENVIRONMENTS.values()
            for learning in ({}, NO_ADAPTATION)
        ),
        *((name, TRACKING_GAIN) for name in NETWORKS),
        *((name, Separate(name)) for name in (TASKS[-1], LEARNING)),
        (LEARNING, {}),
        (TASKS[-1], {**ADAPTIVE, **NO_ADAPTATION}),
    ]
