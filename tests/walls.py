"""The environments behind one plane, as scenarios name them."""

import pytest

from teleop_drake.scenario import LoadScenario, ScenarioError

KINDS = {
    "hunt_crossley": "stiffness: 2000, damping: 1.5",
    "friction_wall": "stiffness: 150, damping: 1, friction: 0.4",
    "standard_linear_solid": "stiffness: 40, branch_stiffness: 160",
}
"""Kinds and their fields, without where they are."""


def Refusal(kind, change):
    """Returns what is said of a scenario with a wall.

    Args:
        kind: One of KINDS.
        change: A field and its value, in YAML.
    """
    fields = [*f"start: 1.0, {KINDS[kind]}".split(", "), change]
    text = ", ".join(
        f"{x}: {y}" for x, y in dict(x.split(": ") for x in fields).items()
    )
    with pytest.raises(ScenarioError) as error:
        LoadScenario("two_dof_collision", [f"environment={{kind: {kind}, {text}}}"])
    return str(error.value)
