"""Models of drives, joints and sensors: friction and sampled measurements."""

import numpy as np

from teleop_drake.arrays import Array


def delivered_force(friction: Array, F: Array, v: Array) -> Array:
    """Returns the force F of a drive without what the friction of gears takes, N (n).

        F - F_C v/sqrt(v^2 + v_s^2) - B v          on each axis

    Coulomb's friction, which the speed v_s makes smooth, and viscous friction. Well
    below v_s the gears creep as in a fluid of F_C/v_s; they do not stick.

    Args:
        friction: [F_C in N, v_s in m/s, B in N s/m]; F_C, B >= 0, v_s > 0.
        v: Velocity of the tool in m/s (n).
    """
    F_C = friction[0]
    v_s = friction[1]
    B = friction[2]
    return F - (F_C * v / np.sqrt(v * v + v_s**2) + B * v)


def friction_torque(forward: Array, backward: Array, speed: float, v: Array) -> Array:
    """Returns the torque of Coulomb friction of joints, smooth through rest (nv).

        tau = -s (mean + half s),  s = v/sqrt(v^2 + v_s^2),
        mean = (C_+ + C_-)/2,  half = (C_+ - C_-)/2

    C_+ and C_- are the friction torques while a joint moves forward and backward. For
    |v| >> v_s it is -C_+ or C_-. At rest it is 0 and has the slope -mean/v_s: a joint
    that a torque below C pushes creeps at less than v_s or so, and does not stick.
    Because |half| <= mean, tau v <= 0: it takes energy and never gives any.
    """
    s = v / np.sqrt(v * v + speed * speed)
    return -s * ((forward + backward) / 2 + (forward - backward) / 2 * s)


def quantized(resolution: float, value: Array) -> Array:
    """Returns the nearest multiples of a resolution, halves up (n).

    Args:
        resolution: Of the sensor, in the unit of the value, >= 0; 0: the value itself.
        value: What is measured (n).
    """
    if resolution == 0:
        return value.copy()
    return resolution * np.floor(value / resolution + 0.5)


def next_random(generator: Array) -> tuple[Array, Array]:
    """Returns numbers between 0 and 1, and the generators after them.

    L'Ecuyer's combination of two multiplicative generators, each exact in floating
    point because its products stay below 2^53. Its period is 2.3e18.

    Source: P. L'Ecuyer, "Efficient and portable combined random number generators",
    Communications of the ACM 31 (1988).

    Args:
        generator: [x_1; x_2] of n generators, whole numbers from 1 to 2147483398 (2n).

    Returns:
        The numbers (n), and [x_1; x_2] (2n).
    """
    n = generator.size // 2
    x_1 = 40014 * generator[:n]
    x_2 = 40692 * generator[n:]
    x_1 = x_1 - 2147483563 * np.floor(x_1 / 2147483563)
    x_2 = x_2 - 2147483399 * np.floor(x_2 / 2147483399)
    difference = x_1 - x_2
    # From 1 to 2147483562.
    difference = difference - 2147483562 * np.floor((difference - 1) / 2147483562)
    return difference / 2147483563, np.concatenate((x_1, x_2))


def next_normal(generator: Array) -> tuple[Array, Array]:
    """Returns normally distributed numbers, and the generators after them.

    By the method of Box and Muller.

    Returns:
        Numbers of mean 0 and variance 1 (n), and the generators (2n).
    """
    radius, generator = next_random(generator)
    angle, generator = next_random(generator)
    return np.sqrt(-2 * np.log(radius)) * np.cos(2 * np.pi * angle), generator


def next_sample(
    mode: Array, signal: Array, resolution: float, noise: float, sample_period: float
) -> Array:
    """Returns the state of a sensor after a sample.

    Args:
        mode: [number of samples so far; last sample; its rate; generators] (1 + 4n).
        signal: What is measured (n).
        resolution: See quantized().
        noise: Standard deviation of the noise, in the unit of the signal.
        sample_period: In s.
    """
    n = signal.size
    normal, generator = next_normal(mode[1 + 2 * n :])
    sample = quantized(resolution, signal + noise * normal)
    rate = (sample - mode[1 : 1 + n]) / sample_period
    if mode[0] == 0:
        rate = np.zeros(n)
    return np.concatenate((mode[:1] + 1, sample, rate, generator))
