"""A sensor that samples at a fixed rate."""

from collections.abc import Sequence
from dataclasses import field

import numpy as np

from teleop_drake.loops.framework.validation import (
    CheckNumber,
    Config,
    FixedFields,
    Number,
    Refuse,
)
from teleop_drake.loops.kernel import FixedBlock, Kernel, Transition
from teleop_drake.model.laws.actuators import next_sample

SHORTEST_PERIOD = 1e-6
"""Shortest sample period in s. No step of a simulation is longer than the period."""


class SampledSensor(FixedBlock):
    """Samples a signal, quantises it, and holds it until the next sample.

        sample_k = q floor((signal(k h) + noise_k)/q + 1/2)      held for
        rate_k   = (sample_k - sample_{k-1})/h                   k h < t <= (k + 1) h

    with the sample period h and the resolution q; q = 0 does not quantise. The noise
    is normal, and independent from sample to sample and from axis to axis. `rate` is
    the velocity that is computed from an encoder's positions; it is a multiple of q/h.

    | port | name   | size | unit            |
    |------|--------|------|-----------------|
    | in   | signal | n    | any             |
    | out  | sample | n    | of signal       |
    | out  | rate   | n    | of signal per s |

    State (discrete): [number of samples so far; sample; rate; random generators]
    (1 + 4n). It changes in unrestricted updates, so that blocks that record jumps see
    both sides of the jump; see kernel.events. The signal is sampled before the other
    updates of the same instant.

    Initial value: `initial_value` and no rate, until the sample at t = 0, whose rate is
    0 as well. Direct feedthrough: none.

    The noise depends on the seed and the stream only. It is the same in Drake's
    Simulator and in a compiled run.

    Args:
        sample_period: h in s, > 0.
        initial_value: The output before the first sample (n).
        resolution: q in the unit of the signal, >= 0.
        noise: Standard deviation of the noise in the unit of the signal, >= 0.
        seed: Seed of the noise, >= 0.
        stream: Name of the sensor; sensors of different names have independent noise.
    """

    def __init__(
        self,
        sample_period: float,
        initial_value: Sequence[float],
        *,
        resolution: float = 0.0,
        noise: float = 0.0,
        seed: int = 0,
        stream: str = "",
    ):
        CheckNumber("sample_period", sample_period, "s", above=0)
        CheckNumber("resolution", resolution, minimum=0)
        CheckNumber("noise", noise, minimum=0)
        if seed < 0:
            Refuse("seed", seed, "a whole number >= 0")
        n = len(initial_value)
        # Two seeds for each axis, from 1 to 2147483398, as next_random() takes them.
        sequence = np.random.SeedSequence(seed, spawn_key=tuple(stream.encode()))
        generator = 1 + sequence.generate_state(2 * n, np.uint64) % 2147483398
        law = {
            "resolution": float(resolution),
            "noise": float(noise),
            "sample_period": float(sample_period),
        }
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters=law,
                outputs={
                    "sample": ("mode", 1, 1 + n),
                    "rate": ("mode", 1 + n, 1 + 2 * n),
                },
                transitions={
                    "samples": Transition(
                        mode=(next_sample, "mode", "signal", *law),
                        period=law["sample_period"],
                    )
                },
            ),
            inputs={"signal": n},
            outputs={"sample": n, "rate": n},
            # Number of samples, sample, rate and generators.
            mode=[0.0, *initial_value, *[0.0] * n, *generator.astype(float)],
        )


@Config
class SamplingConfig(FixedFields):
    """The sampling of one sensor. The sensors of the thesis are ideal."""

    # Time between samples, s, > 0. Null: the sensor is continuous and exact.
    sample_period: float | None = Number(None, "s", minimum=SHORTEST_PERIOD)
    # Resolution of the samples, in the unit of the signal, >= 0.
    resolution: float = Number(0.0, minimum=0)
    # Standard deviation of the noise, in the unit of the signal, >= 0.
    noise: float = Number(0.0, minimum=0)

    def Check(self, path: str) -> None:
        """Checks every field."""
        self.CheckNumbers(path)
        for name in ("resolution", "noise"):
            value = getattr(self, name)
            if value > 0 and self.sample_period is None:
                Refuse(f"{path}.{name}", value, "0 without a sample_period")


@Config
class SensorConfig(FixedFields):
    """The sensors of the slave: an encoder at the tool, and the force sensor."""

    # Position of the tool, in m. Its velocity is the difference of successive samples
    # divided by the sample period.
    encoder: SamplingConfig = field(default_factory=SamplingConfig)
    # Force on the environment, in N.
    force: SamplingConfig = field(default_factory=SamplingConfig)
    # Seed of the noise, a whole number >= 0.
    seed: int = 0

    @property
    def is_ideal(self) -> bool:
        """Whether all sensors are continuous and exact, as in the thesis."""
        return all(x.sample_period is None for x in self.sampled.values())

    @property
    def sampled(self) -> dict[str, SamplingConfig]:
        """The sensors by their names."""
        return {"encoder": self.encoder, "force": self.force}

    def Check(self, path: str) -> None:
        """Checks every field."""
        for name, config in self.sampled.items():
            config.Check(f"{path}.{name}")
        if self.seed < 0:
            Refuse(f"{path}.seed", self.seed, "a whole number >= 0")
