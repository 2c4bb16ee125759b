"""The system as arrays; test_advance.py integrates it."""

import numpy as np

from teleop_drake.loops.engine import problem
from teleop_drake.loops.engine.problem import (
    BREAKS,
    FIRST,
    Delays,
    Past,
    Problem,
    Transitions,
    make_memory,
)


def test_the_counts_have_places_of_their_own():
    names = "STEPS EVALUATIONS END BREAKS ROWS TRIES FIRST"
    places = [getattr(problem, name) for name in names.split()]
    assert sorted(places) == list(range(7))


def test_there_is_room_for_what_is_kept():
    packets = np.array([[0.5, 0.1, -np.inf], [0.6, 0.2, -np.inf]])
    places = np.zeros(4, int)
    delays = Delays(
        *(np.array([0.1, np.inf]), places, places, places),
        packet_ranges=np.array([[0, 0], [0, 2]]),
        packets=packets,
        piece_ranges=np.zeros((2, 2), int),
        knots=np.empty((0, 2)),
        coefficients=np.empty((0, 8)),
    )
    transitions = Transitions(
        *(np.array([0, -1, -1, -1]), places, places, places),
        periods=np.array([np.inf, 0.3, np.inf, np.inf]),
        offsets=np.array([np.inf, 0.0, 1.9, 2.1]),
        are_discrete=places,
    )
    memory = make_memory(
        Problem(np.empty(0), delays, transitions),
        x=np.zeros(4),
        m=np.zeros(1),
        y=np.zeros(10),
        time=2.0,
        room=30,
    )
    assert memory.clock.tolist() == [2.0, 1e-3, 2.0]
    assert memory.rows.shape == (30, 10)
    assert memory.stages.shape == (7, 4)
    # Both packets were shown before.
    assert memory.next_packets.tolist() == [0, 2]
    # With a guard; every 0.3 s; once and gone; once and to come.
    assert memory.ticks.tolist() == [0, 7, 1, 0]


def test_all_jumps_under_way_have_room():
    """More than a run has room for at first."""
    empty = np.empty(0)
    none = np.empty(0, np.int64)
    delays = Delays(empty, none, none, none, none, empty, none, empty, empty)
    delays = delays._replace(packet_ranges=np.empty((0, 2), np.int64))
    transitions = Transitions(*[none] * 4, empty, empty, none)
    times = np.array([0.0, 0.0, 1.0, 2.0, 3.0, 4.0])
    past = Past(times, np.ones((6, 1)), np.arange(5.0, 3000.0))
    memory = make_memory(
        Problem(empty, delays, transitions),
        x=empty,
        m=empty,
        y=np.zeros(1),
        time=4.0,
        past=past,
    )
    num = memory.counts[BREAKS]
    assert memory.breaks[:num, 0].tolist() == past.arrivals.tolist()
    assert num < len(memory.breaks)
    assert memory.row_ends[:6].tolist() == [0, 0, 0, 0, 0, 1]
    assert memory.counts[FIRST] == 6
    assert memory.clock[2] == 0.0
