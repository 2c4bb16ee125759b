"""Robots with forces on their tool."""


def context_with_forces(robot, F_c, F_e):
    """Returns a Context of a robot with these forces on its tool."""
    context = robot.CreateDefaultContext()
    robot.GetInputPort("control_force").FixValue(context, F_c)
    robot.GetInputPort("environment_force").FixValue(context, F_e)
    return context
