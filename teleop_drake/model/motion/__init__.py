"""Recorded motions of a hand: a table becomes velocities at equal distances in time."""
