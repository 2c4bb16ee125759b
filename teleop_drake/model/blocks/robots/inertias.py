"""Finds the link of an arm that lacks an inertia, so that a joint moves nothing."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

# The mass matrix is singular if an eigenvalue is less than this share of the largest.
_SINGULAR = 1e-13

# A joint belongs to a motion without kinetic energy if it has this share in it.
_SHARE = 0.1


def LinkWithoutInertia(plant: MultibodyPlant, context: Context) -> str:
    """Returns the link that a joint moves without kinetic energy, "" if there is none.

    The mass matrix is singular there, so that the plant has no acceleration. Among the
    links of the joints that take part in such a motion, a link without a mass is
    returned or, if all of them have one, the last link.

    Args:
        context: The pose, and the inertias.
    """
    M = plant.CalcMassMatrix(context)
    sizes, motions = np.linalg.eigh(M)
    if sizes.size == 0 or sizes[0] > _SINGULAR * sizes[-1]:
        return ""
    shares = np.abs(motions[:, 0])
    links = [
        joint.child_body()
        for joint in map(plant.get_joint, plant.GetJointIndices())
        if any(
            shares[joint.velocity_start() + i] >= _SHARE * shares.max()
            for i in range(joint.num_velocities())
        )
    ]
    massless = [link for link in links if link.get_mass(context) == 0]
    name: str = (massless or links[-1:])[0].name()
    return name
