"""Random numbers of networks: one for each packet, by its number.

Every random number is a pure function of (seed, stream, impairment, k), computed by
NumPy's counter-based Philox generator. It depends neither on the order of evaluation
nor on the parameters of other impairments.
"""

import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from teleop_drake.loops.delays.packet_options import Jitter, Loss
from teleop_drake.loops.framework.arrays import Array

BLOCK = 1024
"""Number of packets whose random numbers are drawn together."""


class PacketRandom:
    """The random numbers of a network.

    Args:
        seed: Seed of the random numbers, >= 0.
        stream: Name of the channel; each name has random numbers of its own.
    """

    def __init__(self, seed: int, stream: str):
        self._seed = seed
        self._stream = stream

    def Draw(
        self, impairment: str, num_blocks: int, draw: Callable[..., Array], *of: float
    ) -> Array:
        """Returns random numbers of an impairment, one for each packet of some blocks.

        Args:
            draw: The method of a Generator that draws them.
            of: The parameters of their distribution.
        """
        name = f"{self._stream}/{impairment}".encode()
        sequence = np.random.SeedSequence(self._seed, spawn_key=tuple(name))
        key = sequence.generate_state(2, np.uint64)
        numbers = []
        for block in range(num_blocks):
            # The upper half of the counter's 256 bits is the number of the block.
            bits = np.random.Philox(key=key, counter=block << 128)
            numbers.append(draw(np.random.Generator(bits), *of, BLOCK))
        return np.concatenate(numbers)

    def Jitters(
        self, jitter: Jitter, mean: float, step: float, num_blocks: int, copy: str = ""
    ) -> Array:
        """Returns the jitter of the packets of the first blocks in s.

        Args:
            jitter: The distribution.
            mean: The mean of what is jittered, s.
            step: The time between packets, s, for the correlation.
            num_blocks: The number of blocks of BLOCK packets.
            copy: The beginning of the names of random numbers; empty: of the packets
                themselves.
        """
        if jitter.kind == "none" or jitter.std == 0:
            return np.zeros(num_blocks * BLOCK)
        name = f"{copy}jitter"
        if jitter.kind == "gamma" and not jitter.correlation_time:
            excess = mean - jitter.minimum
            of = (excess / jitter.std) ** 2, jitter.std**2 / excess
            jitters = self.Draw(name, num_blocks, Generator.gamma, *of) - excess
        else:
            shares = self._Shares(jitter.correlation_time, step, num_blocks, name)
            jitters = _JittersOf(jitter, mean, shares)
        if not jitter.hold:
            return jitters
        u = self.Draw(f"{copy}hold", num_blocks, Generator.random)
        # The first packet has nothing to hold.
        fresh = np.where(u < jitter.hold, 0, np.arange(len(u)))
        return jitters[np.maximum.accumulate(fresh)]

    def _Shares(
        self, correlation_time: float, step: float, num_blocks: int, name: str
    ) -> Array:
        """Returns the value of the jitter's distribution function for each packet."""
        if not correlation_time:
            return self.Draw(name, num_blocks, Generator.random)
        a = math.exp(-step / correlation_time)
        noise = self.Draw(name, num_blocks, Generator.standard_normal)

        def Next(g: float, n: float) -> float:
            return a * g + math.sqrt(1 - a * a) * n

        from scipy.special import ndtr

        shares: Array = ndtr(list(itertools.accumulate(noise.tolist(), Next)))
        return shares

    def Losses(self, loss: Loss, num_blocks: int, copy: str) -> NDArray[np.bool_]:
        """Returns whether each packet of the first blocks, or its copy, is lost."""
        probability: float | Array = loss.probability
        if loss.kind in ("burst", "gilbert_elliott"):
            is_bad = self._Bursts(loss, num_blocks)
            probability = np.where(is_bad, loss.bad_loss, loss.good_loss)
        return self.Draw(f"{copy}loss", num_blocks, Generator.random) < probability

    def _Bursts(self, loss: Loss, num_blocks: int) -> list[bool]:
        """Returns whether the chain of bursts is in its bad state at each packet."""
        share, to_bad, to_good = loss.Chain()

        def Next(is_bad: bool, step: float) -> bool:
            return step >= to_good if is_bad else step < to_bad

        first, *others = self.Draw("burst", num_blocks, Generator.random).tolist()
        return list(itertools.accumulate(others, Next, initial=first < share))


def _JittersOf(jitter: Jitter, mean: float, shares: Array) -> Array:
    """Returns the jitter in s at values of its distribution function."""
    from scipy.special import gammaincinv, ndtr, ndtri  # The import takes 0.1 s.

    std = jitter.std
    excess = mean - jitter.minimum
    u = np.clip(shares, 2.0**-53, 1 - 2.0**-53)
    jitters: Array
    if jitter.kind == "gamma":
        jitters = gammaincinv((excess / std) ** 2, u) * std**2 / excess - excess
    elif jitter.kind == "uniform":
        jitters = math.sqrt(3) * std * (2 * u - 1)
    else:
        # The inverse of the cumulative distribution above the minimum.
        jitters = np.maximum(-std * ndtri(u * ndtr(excess / std)), -excess)
    return jitters
