"""Tests of laws.two_port against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from phasors import TerminatedPort
from scattering import delay_two_port, scattering_norm

from teleop_drake.model.laws.two_port import llewellyn

W = np.linspace(0.05, 40, 400)


def test_scattering_norm_of_a_raw_delay():
    """|tan w T| + |sec w T| (Anderson and Spong, 1989)."""
    T = 0.13
    matrix = delay_two_port(W, forward_delay=T, return_delay=T)
    expected = np.abs(np.tan(W * T)) + np.abs(1 / np.cos(W * T))
    assert_allclose(scattering_norm(matrix), expected, rtol=1e-9)
    # However small the delay is, it is not passive: the norm is 1 + w T + ...
    assert scattering_norm(matrix[:1])[0] > 1


def test_without_delay_the_channel_is_lossless():
    matrix = delay_two_port(W, forward_delay=0.0, return_delay=0.0)
    assert_allclose(scattering_norm(matrix), 1.0, rtol=1e-12)
    assert_allclose(llewellyn(matrix), 1.0)


def test_scattering_norm_of_a_dashpot():
    """A dashpot in parallel between the ports, which is passive."""
    matrix = np.array([[[3.0, 1], [-1, 0]]], dtype=complex)
    S = (matrix[0] - np.eye(2)) @ np.linalg.inv(matrix[0] + np.eye(2))
    norm = scattering_norm(matrix)[0]
    assert norm == pytest.approx(np.linalg.norm(S, 2), rel=1e-12)
    assert norm <= 1 + 1e-12


def test_llewellyn_of_a_raw_delay_with_dampers():
    """Dampers at both ends: eta = 2 d1 d2 + cos w T, which is >= 1 if d1 d2 >= 1."""
    matrix = delay_two_port(W, forward_delay=0.2, return_delay=0.2)
    matrix[:, 0, 0] = 2.0
    matrix[:, 1, 1] = 0.5
    assert_allclose(llewellyn(matrix), 2 + np.cos(0.4 * W))


def test_llewellyn_is_what_passive_loads_can_do():
    """If and only if eta < 1, some passive load makes the other port active."""
    random = np.random.default_rng(1)
    z = random.normal(size=(40, 2, 2)) + 1j * random.normal(size=(40, 2, 2))
    z[:, 0, 0] += 2
    z[:, 1, 1] += 2
    resistance, reactance = np.meshgrid(
        np.concatenate([[0], np.geomspace(1e-3, 1e3, 60)]),
        np.concatenate([-np.geomspace(1e-3, 1e3, 400), np.geomspace(1e-3, 1e3, 400)]),
    )
    loads = (resistance + 1j * reactance).ravel()
    for p, eta in zip(z, llewellyn(z), strict=True):
        if abs(eta - 1) < 0.02:
            continue
        seen = TerminatedPort(np.broadcast_to(p, (len(loads), 2, 2)), loads)
        assert (seen.real.min() < 0) == (eta < 1)


def test_ports_that_do_not_know_of_each_other():
    assert llewellyn([[[1, 2], [0, 1]]])[0] == np.inf
    assert llewellyn([[[1, 0], [0, -1]]])[0] == -np.inf
