"""Tests of teleop_drake.loops.delays.packet_random."""

import numpy as np
import pytest
from numpy.random import Generator

from teleop_drake.loops.delays.packet_options import Jitter, Loss
from teleop_drake.loops.delays.packet_random import BLOCK, PacketRandom


def test_numbers_are_those_of_seed_stream_and_impairment():
    numbers = PacketRandom(3, "forward").Draw("loss", 3, Generator.random)
    assert len(numbers) == 3 * BLOCK
    # Fewer blocks are the first of more.
    fewer = PacketRandom(3, "forward").Draw("loss", 1, Generator.random)
    assert np.array_equal(fewer, numbers[:BLOCK])
    assert 0 <= numbers.min() < numbers.max() < 1
    others = [
        PacketRandom(4, "forward").Draw("loss", 3, Generator.random),
        PacketRandom(3, "return").Draw("loss", 3, Generator.random),
        PacketRandom(3, "forward").Draw("jitter", 3, Generator.random),
    ]
    for other in others:
        assert abs(np.corrcoef(numbers, other)[0, 1]) < 4 / np.sqrt(3 * BLOCK)


@pytest.mark.parametrize("kind", ["uniform", "normal", "gamma"])
def test_jitter_is_about_any_mean(kind):
    """Delays and times between packets are jittered alike."""
    jitter = Jitter(kind=kind, std=0.01)
    jitters = PacketRandom(1, "").Jitters(jitter, 0.05, 0.001, 20)
    error = 4 * 0.01 / np.sqrt(len(jitters))
    assert jitters.mean() == pytest.approx(0, abs=error)
    assert jitters.std() == pytest.approx(0.01, rel=0.05)
    assert jitters.min() >= -0.05


def test_copies_have_jitter_and_losses_of_their_own():
    random = PacketRandom(1, "")
    jitter = Jitter(kind="uniform", std=0.01)
    first = random.Jitters(jitter, 0.05, 0.001, 4)
    second = random.Jitters(jitter, 0.05, 0.001, 4, "copy ")
    assert abs(np.corrcoef(first, second)[0, 1]) < 4 / np.sqrt(len(first))
    loss = Loss(kind="independent", probability=0.3)
    lost = [random.Losses(loss, 4, copy) for copy in ("", "copy ")]
    both = np.mean(lost[0] & lost[1])
    assert both == pytest.approx(0.09, abs=4 * np.sqrt(0.09 / len(first)))
