"""Where the surfaces of a scenario are."""


def Border(scenario, name):
    """Returns where `contact` or `puncture` is along x in m, None where it is not."""
    surface = scenario.FindSurface(name)
    return None if surface is None else float(surface.point_W[0])
