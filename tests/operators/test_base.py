"""What is refused of operators, of whatever kind."""

import pytest

from teleop_drake.scenario import LoadScenario, ScenarioError


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("surgeon.kind=sin", "surgeon.kind = 'sin': must be one of constant_velocity"),
        (
            "surgeon.kind=human surgeon.goal=force",
            "surgeon.goal = 'force': must be one",
        ),
        (
            "surgeon.kind=human surgeon.reaction_delay=1e-9",
            "surgeon.reaction_delay = 1e-09: must be 0 or a finite number >= 1e-06",
        ),
        ("surgeon.kind=human surgeon.arm_mass=0", "surgeon.arm_mass = 0.0: must be a"),
        ("surgeon.kind=sine surgeon.frequency=0", "surgeon.frequency = 0.0: must be a"),
        ("surgeon.kind=trapezoid surgeon.rise_time=0", "surgeon.rise_time = 0.0: must"),
        ("surgeon.kind=sine surgeon.velocity=[0]", "surgeon.velocity = [0.0]: must be"),
        (
            "surgeon.kind=minimum_jerk surgeon.waypoints=[[0.1],[0.1]]",
            "surgeon.waypoints.1 = [0.1]: must be another point than the waypoint",
        ),
        (
            "surgeon.kind=minimum_jerk surgeon.waypoints=[[0.1,0]]",
            "surgeon.waypoints.0 = [0.1, 0.0]: must be a list of 1 finite number (m)",
        ),
        (
            "surgeon.kind=recorded",
            "surgeon.file = null: must be the path of a CSV file",
        ),
        (
            "surgeon.kind=sine surgeon.rise_time=2",
            "surgeon.rise_time = 2.0: must be 0.5 for a sine operator",
        ),
    ],
)
def test_refused(override, message):
    with pytest.raises(ScenarioError) as error:
        LoadScenario("one_dof", override.split())
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)
