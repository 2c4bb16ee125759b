"""Where the surfaces of a scenario are."""


def Border(scenario, name):
    """Returns where a surface is along x in m, None where there is none.

    Args:
        scenario: A teleoperation.
        name: `contact` or `puncture`.
    """
    surface = scenario.FindSurface(name)
    return None if surface is None else float(surface.point_W[0])
