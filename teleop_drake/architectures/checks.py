"""Checks that both sides of an architecture share."""

from teleop_drake.validation import CheckNumber, Refuse


def CheckWavePath(scaling: float, bandwidth: float | None) -> None:
    """Refuses what no arriving wave can go through.

    Args:
        scaling: Factor, 0 < f <= 1.
        bandwidth: Corner of the low-pass in rad/s, > 0, or None.

    Raises:
        ScenarioError: If one of them is refused.
    """
    CheckNumber("scaling", scaling, above=0, maximum=1)
    if bandwidth is not None:
        CheckNumber("bandwidth", bandwidth, "rad/s", above=0)


def CheckFourChannel(acceleration_bandwidth: float | None, **factors: float) -> None:
    """Refuses parameters that neither end can have.

    Args:
        acceleration_bandwidth: None, or rad/s, > 0.
        **factors: Finite numbers.

    Raises:
        ScenarioError: If one of them is refused.
    """
    for name, value in factors.items():
        CheckNumber(name, value)
    if acceleration_bandwidth is not None:
        CheckNumber("acceleration_bandwidth", acceleration_bandwidth, "rad/s", above=0)


def CheckPassivity(num_axes: int, **values: float) -> None:
    """Refuses parameters that neither end can have.

    Args:
        num_axes: >= 1.
        **values: Finite numbers > 0.

    Raises:
        ScenarioError: If one of them is refused.
    """
    if num_axes < 1:
        Refuse("num_axes", num_axes, "a whole number >= 1")
    for name, value in values.items():
        CheckNumber(name, value, above=0)
