"""Energy that goes into the channels and does not come out."""

import numpy as np


def ChannelEnergy(recording):
    """Returns it at each sample, per axis (J)."""
    power = recording["master_power"] - recording["slave_power"]
    steps = np.diff(recording.time)[:, None] * (power[1:] + power[:-1]) / 2
    return np.vstack([np.zeros(power.shape[1]), np.cumsum(steps, axis=0)])
