"""The operator of least jerk."""

import numpy as np

from teleop_drake.numerics.piecewise_polynomial import (
    differentiate_pieces,
    evaluate_pieces,
    largest_norm,
)
from teleop_drake.operators.minimum_jerk import MinimumJerkConfig


def test_reaches_the_waypoints_with_the_speed_asked_for():
    points = [[0.1, 0.0], [0.2, 0.1], [0.2, 0.3]]
    config = MinimumJerkConfig(velocity=np.array([0.06, 0.08]), waypoints=points)
    breaks, path = config.Path()
    assert np.isclose(largest_norm(breaks, differentiate_pieces(path)), 0.1)
    for k, point in enumerate(points):
        np.testing.assert_allclose(
            evaluate_pieces(np.nextafter(breaks[k + 1], 0), breaks, path),
            point,
            atol=1e-12,
        )
    dut = config.MakeOperator(start=[0.0, 0.0])
    context = dut.CreateDefaultContext()
    context.SetTime(breaks[1])
    v = dut.GetOutputPort("velocity_command").Eval(context)
    assert np.linalg.norm(v) > 0.05  # It does not stop there.
    context.SetTime(breaks[-1])
    assert not dut.GetOutputPort("velocity_command").Eval(context).any()


def test_without_waypoints_it_goes_where_the_velocity_points():
    breaks, path = MinimumJerkConfig(velocity=np.array([0.1]), reach_time=2.0).Path()
    # The mean speed of one piece is 8/15 of its peak.
    assert np.isclose(breaks[-1], 15 / 8 * 2.0)
    end = evaluate_pieces(np.nextafter(breaks[-1], 0), breaks, path)
    assert np.isclose(end, 0.2)
