"""The runs that the claims are measured on."""

from collections.abc import Mapping
from typing import Any

DIRECT: dict[str, Any] = {"controller.kind": "direct_force"}
ADAPTIVE: dict[str, Any] = {"controller.kind": "adaptive_backstepping"}
TASKS = ("one_dof", "two_dof_puncture", "two_dof_collision", "two_dof_combined")
NETWORKS = ("network_tracking_linear", "network_tracking_coupled")

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
DOUBLE_DELAY = {"forward_channel.delay": 0.2, "return_channel.delay": 0.2}
FOURFOLD_DELAY = {
    "forward_channel.delay": 0.4,
    "return_channel.delay": 0.4,
    "duration": 6.0,
}


def Variant(
    name: str, kind: Mapping[str, Any], change: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Returns the short run of a task with a controller and a change.

    Args:
        name: The task.
        kind: DIRECT or ADAPTIVE.
        change: What else differs from the scenario, by dotted paths.
    """
    return name, {**kind, **SHORT[name], **change}


_VARIANTS = [
    *(Variant(name, DIRECT, RETUNED) for name in TASKS),
    *(Variant(name, ADAPTIVE, NO_ADAPTATION) for name in TASKS if "punc" not in name),
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
