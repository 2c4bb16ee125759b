"""Models of drives, joints and sensors: friction and sampled measurements."""

import numpy as np

from teleop_drake.loops.framework.arrays import Array


def delivered_force(friction: Array, F: Array, v: Array) -> Array:
    """Returns the force of a drive minus the friction of its gears, N (n).

        F - F_C v/sqrt(v^2 + v_s^2) - B v          on each axis

    The friction is Coulomb's, smoothed by the speed v_s, and viscous. Well below v_s
    the gears do not stick but creep, as with a viscous damper F_C/v_s.

    Args:
        friction: [F_C in N, v_s in m/s, B in N s/m]; F_C, B >= 0, v_s > 0.
        F: Force of the drive in N (n).
        v: Velocity of the tool in m/s (n).
    """
    F_C = friction[0]
    v_s = friction[1]
    B = friction[2]
    return F - (F_C * v / np.sqrt(v * v + v_s**2) + B * v)


def friction_torque(forward: Array, backward: Array, speed: float, v: Array) -> Array:
    """Returns the torque of Coulomb friction on joints, smooth at rest (nv).

        tau = -s (mean + half s),  s = v/sqrt(v^2 + v_s^2),
        mean = (C_+ + C_-)/2,  half = (C_+ - C_-)/2

    C_+ and C_- are the friction torques while a joint moves forward and backward. For
    |v| >> v_s, tau is -C_+ or C_-. At rest tau is 0 with the slope -mean/v_s: a joint
    does not stick, but creeps at about v_s or less under a smaller torque than C.
    Because |half| <= mean, tau v <= 0: friction only dissipates energy.

    Args:
        forward: C_+ of each joint, >= 0, N m or N (nv).
        backward: C_- of each joint, >= 0, N m or N (nv).
        speed: v_s in rad/s or m/s, > 0.
        v: Velocities of the joints in rad/s or m/s (nv).
    """
    s = v / np.sqrt(v * v + speed * speed)
    return -s * ((forward + backward) / 2 + (forward - backward) / 2 * s)


def quantized(resolution: float, value: Array) -> Array:
    """Returns the nearest multiples of a resolution, halves rounded up (n).

    Args:
        resolution: Resolution of the sensor in the unit of the value, >= 0; with 0 the
            value is returned.
        value: The measured value (n).
    """
    if resolution == 0:
        return value.copy()
    return resolution * np.floor(value / resolution + 0.5)


def next_random(generator: Array) -> tuple[Array, Array]:
    """Returns random numbers between 0 and 1, and the next states of the generators.

    L'Ecuyer's combination of two multiplicative generators, each exact in floating
    point because its products stay below 2^53. Its period is 2.3e18.

    Source: P. L'Ecuyer, "Efficient and portable combined random number generators",
    Communications of the ACM 31 (1988).

    Args:
        generator: States [x_1; x_2] of n generators, whole numbers from 1 to 2147483398
            (2n).

    Returns:
        The numbers (n), and the next [x_1; x_2] (2n).
    """
    n = generator.size // 2
    x_1 = 40014 * generator[:n]
    x_2 = 40692 * generator[n:]
    x_1 = x_1 - 2147483563 * np.floor(x_1 / 2147483563)
    x_2 = x_2 - 2147483399 * np.floor(x_2 / 2147483399)
    difference = x_1 - x_2
    # The difference is reduced to the range from 1 to 2147483562.
    difference = difference - 2147483562 * np.floor((difference - 1) / 2147483562)
    return difference / 2147483563, np.concatenate((x_1, x_2))


def next_normal(generator: Array) -> tuple[Array, Array]:
    """Returns normally distributed numbers, and the next states of the generators.

    The method is that of Box and Muller. The argument is that of next_random().

    Returns:
        Numbers of mean 0 and variance 1 (n), and the next states (2n).
    """
    radius, generator = next_random(generator)
    angle, generator = next_random(generator)
    return np.sqrt(-2 * np.log(radius)) * np.cos(2 * np.pi * angle), generator


def next_sample(
    mode: Array, signal: Array, resolution: float, noise: float, sample_period: float
) -> Array:
    """Returns the discrete state of a sensor after a sample (1 + 4n).

    Args:
        mode: The state before: [number of samples; last sample; its rate; states of
            the generators] (1 + 4n).
        signal: The measured signal (n).
        resolution: The resolution of the samples; see quantized().
        noise: Standard deviation of the noise, in the unit of the signal.
        sample_period: The sample period in s.
    """
    n = signal.size
    normal, generator = next_normal(mode[1 + 2 * n :])
    sample = quantized(resolution, signal + noise * normal)
    rate = (sample - mode[1 : 1 + n]) / sample_period
    if mode[0] == 0:
        rate = np.zeros(n)
    return np.concatenate((mode[:1] + 1, sample, rate, generator))
