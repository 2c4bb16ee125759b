"""The tool of a MultibodyPlant, as the laws of laws.task_space take it."""

from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.loops.engine.plant_tree import ReadPlantTree
from teleop_drake.model.laws.task_space import Tool


def ReadTool(plant: MultibodyPlant, frame_name: str, num_axes: int) -> Tool:
    """Returns the tool of a plant, as the laws of laws.task_space take it.

    Args:
        plant: The plant.
        frame_name: Name of the frame whose origin is the tool.
        num_axes: n, number of task axes.

    Raises:
        ScenarioError: If ReadPlantTree() cannot read the plant.
    """
    read = ReadPlantTree(plant, plant.CreateDefaultContext())
    frame = plant.GetFrameByName(frame_name)
    link, X_LB = read.poses[int(frame.body().index())]
    X_LT = X_LB @ frame.GetFixedPoseInBodyFrame()
    return Tool(read.tree, link, X_LT.GetAsMatrix34(), num_axes)
