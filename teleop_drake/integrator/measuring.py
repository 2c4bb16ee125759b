"""Events and metrics of a run, found on the polynomials of its steps.

Instants are roots of the polynomials, peaks are their extremes, and integrals are exact
for them: what is measured converges with the solver, not with the sampling. measures.py
says what is measured. All functions here are in the part of Python that
machine_code/typed_code compiles, for this processor and for a page.
"""

import math
from typing import NamedTuple

import numpy as np

from teleop_drake.arrays import Array, Indices
from teleop_drake.integrator.problem import ROWS, Memory
from teleop_drake.numerics.step_polynomials import DEGREE, to_powers

TIME, BEFORE, SETTLING, MAXIMUM, MINIMUM, VARIATION, RMS, DISTANCE = range(8)
"""What is measured from one instant to another; see _measure_one()."""

# The places in `counts`.
NUM_INSTANTS, NUM_PIECES, NUM_STEPS = range(3)

# The coefficients of a polynomial in [0, 1] from five values, times 3: whole numbers.
_TO_POWERS = np.rint(3 * to_powers(DEGREE))

# Longer than what instants are rounded by, s.
_INSTANT = 1e-11


class Rows(NamedTuple):
    """The rows of a run; those of integrator.problem.Memory."""

    counts: Indices
    row_times: Array
    row_ends: Indices
    rows: Array


AnyRows = Memory | Rows


class Record(NamedTuple):
    """What is measured of a run, and room for what comes out.

    A form is a sum of weights times c columns of the rows. There are k of them.

    Attributes:
        delay: Of the command, s (1).
        places: Number of columns that are taken as they are, the others as they were a
            delay ago; of the forms that are events where they cross 0, of which the
            last is the command; the column of the operator's mode, -1 without; whether
            the run ended too early, after which nothing has settled (4).
        columns: The columns (c).
        forms: Their weights and that of 1; whether the form has the direction of the
            command; and for SETTLING how long the vector may be whose last form it is,
            or, as a share of where that ends, how far from there; and whether a vector
            begins with it (k, c + 5).
        table: Operation, first form, the one after the last, the event at which it
            begins (-1: the run) and two of which it ends at the first that comes, the
            second only if the first does not (r, 6). Twice the number of its form is
            an event upwards, one more downwards; behind these are the mode's changes.
        counts: Instants, pieces and steps (3).
        instants: Time and event, -1 for none, in their order (i, 2).
        pieces: Begin, end, and the sign of the command (p, 3).
        piece_rows: The row that ends the step in which the piece lies (p).
        ends: The rows that end the steps (s).
        weights: Of five rows in a value between them (5).
        values: Of a form at five instants of a piece (k, 5).
        powers: The same as coefficients (k, 5).
        slope: Coefficients of the derivative (4).
        trace: Values between which a form is monotonic (6).
        around: What forms come to rest at, the square of how near the vector must be
            up to this form, and whether it begins there (k, 3).
        results: Of the measures; not a number where there is none (r).
    """

    delay: Array
    places: Indices
    columns: Indices
    forms: Array
    table: Indices
    counts: Indices
    instants: Array
    pieces: Array
    piece_rows: Indices
    ends: Indices
    weights: Array
    values: Array
    powers: Array
    slope: Array
    trace: Array
    around: Array
    results: Array


def weigh(t: float, row: int, record: Record, memory: AnyRows) -> None:
    """Finds the weights of the rows of the step that ends with a row."""
    begin, end = memory.row_times[row - 4], memory.row_times[row]
    x = 4 * min(max((t - begin) / (end - begin), 0.0), 1.0) if end > begin else 0.0
    near = int(x + 0.5)
    is_row = abs(x - near) < 1e-12  # A row is exactly what it is.
    for a in range(5):
        share = 1.0
        if is_row:
            share = 1.0 if a == near else 0.0
        else:
            for b in range(5):
                if a != b:
                    share *= (x - b) / (a - b)
        record.weights[a] = share


def mix(column: int, row: int, record: Record, memory: AnyRows) -> float:
    """Returns what a column is with these weights."""
    total = 0.0
    for a in range(5):
        total += record.weights[a] * memory.rows[row - 4 + a, column]
    return total


def _value(c: Array, x: float) -> float:
    """Returns a polynomial at a place."""
    total: float = 0.0
    for a in range(len(c) - 1, -1, -1):
        total = total * x + c[a]
    return total


def _root(c: Array, low: float, high: float, is_positive: bool) -> float:
    """Returns where a polynomial changes its sign, which is known at the lower end."""
    middle = (low + high) / 2
    while low < middle < high:
        if (_value(c, middle) >= 0.0) == is_positive:
            low = middle
        else:
            high = middle
        middle = (low + high) / 2
    return high


def _row_at(t: float, record: Record, memory: AnyRows) -> int:
    """Returns the end of the step with a time; of a jump the one before it."""
    low, high = 0, record.counts[NUM_STEPS] - 1
    while low < high:
        middle = (low + high) // 2
        if memory.row_times[record.ends[middle]] < t:
            low = middle + 1
        else:
            high = middle
    return record.ends[low]


def _sample(k: int, i: int, record: Record, memory: AnyRows) -> None:
    """Finds the values and the powers of a form in a piece."""
    columns, weights, num_now = record.columns, record.forms[k], record.places[0]
    begin, end, row = record.pieces[i, 0], record.pieces[i, 1], record.piece_rows[i]
    y, num = record.values[k], len(columns)
    is_step = begin == memory.row_times[row - 4] and end == memory.row_times[row]
    # A jump at an end of the piece has happened, or has not.
    inwards = min(_INSTANT, (end - begin) / 8)
    for node in range(5):
        y[node] = weights[num]
        t = begin + node * (end - begin) / 4
        if not is_step:
            weigh(t, row, record, memory)
            for w in range(num_now):
                if weights[w] != 0.0:
                    y[node] += weights[w] * mix(columns[w], row, record, memory)
        sent = t - record.delay[0]
        if node == 0:
            sent += inwards
        elif node == 4:
            sent -= inwards
        if num > num_now and sent >= 0.0:
            last = _row_at(sent, record, memory)
            weigh(sent, last, record, memory)
            for w in range(num_now, num):
                if weights[w] != 0.0:
                    y[node] += weights[w] * mix(columns[w], last, record, memory)
    for w in range(num_now if is_step else 0):
        if weights[w] != 0.0:
            for node in range(5):
                y[node] += weights[w] * memory.rows[row - 4 + node, columns[w]]
    if weights[num + 1] != 0.0:
        for node in range(5):
            y[node] *= record.pieces[i, 2]
    _fit(y, record.powers[k])


def _fit(y: Array, c: Array) -> None:
    """Finds the powers of a polynomial from its values."""
    for a in range(5):
        c[a] = 0.0
        for b in range(5):
            c[a] += _TO_POWERS[a, b] * y[b] / 3


def _trace(k: int, i: int, record: Record, memory: AnyRows) -> int:
    """Finds values between which a form is monotonic in a piece; returns how many."""
    _sample(k, i, record, memory)
    c, slope, num = record.powers[k], record.slope, 1
    record.trace[0] = record.values[k, 0]
    for a in range(4):
        slope[a] = (a + 1) * c[a + 1]
    for j in range(4):
        low, high = j / 4, (j + 1) / 4
        is_up = _value(slope, low) >= 0.0
        if (_value(slope, high) >= 0.0) != is_up:
            record.trace[num] = _value(c, _root(slope, low, high, is_up))
            num += 1
    record.trace[num] = record.values[k, 4]
    return num + 1


def _add_instant(t: float, event: int, record: Record) -> None:
    """Puts an instant among the others, which stand in their order."""
    instants, i = record.instants, record.counts[NUM_INSTANTS]
    record.counts[NUM_INSTANTS] = i + 1
    while i > 0 and instants[i - 1, 0] > t:
        instants[i, 0], instants[i, 1] = instants[i - 1, 0], instants[i - 1, 1]
        i -= 1
    instants[i, 0], instants[i, 1] = t, event


def _split(record: Record, memory: AnyRows) -> None:
    """Makes pieces of the steps, which end at the instants as well."""
    instants, pieces, counts = record.instants, record.pieces, record.counts
    k, num = 0, 0
    for step in range(counts[NUM_STEPS]):
        row = record.ends[step]
        begin, end = memory.row_times[row - 4], memory.row_times[row]
        is_new = True
        while begin < end or is_new:
            is_new = False
            while k < counts[NUM_INSTANTS] and instants[k, 0] <= begin:
                k += 1
            until = end
            if k < counts[NUM_INSTANTS]:
                until = min(end, instants[k, 0])
            pieces[num, 0], pieces[num, 1], pieces[num, 2] = begin, until, 1.0
            record.piece_rows[num] = row
            num += 1
            begin = until
    counts[NUM_PIECES] = num


def _find_instants(record: Record, memory: AnyRows) -> None:
    """Finds what happens, and the pieces that it cuts."""
    times, rows, counts = memory.row_times, memory.rows, record.counts
    counts[NUM_INSTANTS], counts[NUM_STEPS] = 0, 0
    num_now, num_forms, mode = record.places[0], record.places[1], record.places[2]
    for row in range(memory.counts[ROWS]):
        if memory.row_ends[row] != 0:
            record.ends[counts[NUM_STEPS]] = row
            counts[NUM_STEPS] += 1
        has_jumped = row == 0
        if row > 0 and times[row] == times[row - 1]:
            for w in range(num_now, len(record.columns)):
                column = record.columns[w]
                if rows[row, column] != rows[row - 1, column]:
                    has_jumped = True
        if has_jumped and len(record.columns) > num_now:
            _add_instant(times[row] + record.delay[0], -1, record)
        if row > 0 and mode >= 0 and rows[row, mode] != rows[row - 1, mode]:
            event = 2 * num_forms if rows[row, mode] == 1.0 else 2 * num_forms + 1
            _add_instant(times[row], event, record)
    _split(record, memory)
    for k in range(num_forms):
        for i in range(counts[NUM_PIECES]):
            _sample(k, i, record, memory)
            y, begin, end = record.values[k], record.pieces[i, 0], record.pieces[i, 1]
            for j in range(4):
                is_in = y[j] >= 0.0
                if (y[j + 1] >= 0.0) != is_in:
                    x = _root(record.powers[k], j / 4, (j + 1) / 4, is_in)
                    event = 2 * k + 1 if is_in else 2 * k
                    _add_instant(begin + x * (end - begin), event, record)
    _split(record, memory)
    for i in range(counts[NUM_PIECES] if num_forms > 0 else 0):
        _sample(num_forms - 1, i, record, memory)
        total = 0.0
        for node in range(5):
            total += record.values[num_forms - 1, node]
        record.pieces[i, 2] = -1.0 if total < 0.0 else 1.0


def _piece_after(event: int, first: int, record: Record) -> int:
    """Returns the first piece behind an event, which is behind a piece; -1 if none."""
    pieces = record.pieces
    for k in range(record.counts[NUM_INSTANTS] if event >= 0 else 0):
        t, i = record.instants[k, 0], 0
        if int(record.instants[k, 1]) == event:
            while i < record.counts[NUM_PIECES] and pieces[i, 0] + pieces[i, 1] < 2 * t:
                i += 1
            if i > first:
                return i
    return -1


def measure(record: Record, memory: AnyRows) -> None:
    """Finds what happened in a run, and measures it."""
    _find_instants(record, memory)
    num = record.counts[NUM_PIECES]
    for r in range(len(record.table)):
        begin, end = 0, -1
        if record.table[r, 3] >= 0:
            begin = _piece_after(record.table[r, 3], -1, record)
        after = begin if record.table[r, 3] >= 0 else -1
        for which in range(4, 6):
            if end < 0:
                end = _piece_after(record.table[r, which], after, record)
        record.results[r] = math.nan
        if begin >= 0:
            end = num if end < 0 else end
            record.results[r] = _measure_one(r, begin, end, record, memory)


def _measure_one(r: int, i: int, end: int, record: Record, memory: AnyRows) -> float:
    """Returns a measure of the pieces from one to before another.

    TIME: that of the begin. BEFORE: the value before it. MAXIMUM: of all forms; without
    a piece the value before. MINIMUM: of one. RMS: over the time. VARIATION: the total
    one. DISTANCE: the rms of how far the integral of the first form, from where the
    second one begins, is from that. SETTLING: how long until all forms stay where they
    come to rest.
    """
    operation, first, last = record.table[r, 0], record.table[r, 1], record.table[r, 2]
    pieces, values, num = record.pieces, record.values, record.counts[NUM_PIECES]
    if operation == TIME:
        return pieces[i, 0] if i < num else pieces[num - 1, 1]
    if operation == SETTLING:
        return _settling(first, last, i, record, memory)
    if operation == BEFORE:
        end = i
    sign = -1.0 if operation == MINIMUM else 1.0
    if i == end:  # The forms just before.
        largest = -math.inf
        for k in range(first, last):
            _sample(k, max(i - 1, 0), record, memory)
            largest = max(largest, sign * values[k, 4 if i > 0 else 0])
        return sign * largest
    total, largest, at, before, duration = 0.0, -math.inf, 0.0, 0.0, 0.0
    for piece in range(i, end):
        h = pieces[piece, 1] - pieces[piece, 0]
        h = h if h > 0.0 else 1.0  # The only piece of a run without steps.
        duration += h
        for k in range(first, last):
            if operation >= RMS:
                _sample(k, piece, record, memory)
                continue
            for j in range(_trace(k, piece, record, memory)):
                y = record.trace[j]
                largest = max(largest, sign * y)
                if operation == VARIATION:
                    total += abs(y - before) if piece > i or j > 0 else 0.0
                before = y
        if operation == DISTANCE:
            at = values[first + 1, 0] if piece == i else at
            at = _move(at, h, record.powers[first], values[first], values[first + 1])
            _fit(values[first], record.powers[first])
        if operation >= RMS:
            c = record.powers[first]
            for a in range(5):
                for b in range(5):
                    total += h * c[a] * c[b] / (a + b + 1)
    if operation <= MINIMUM:
        return sign * largest
    return total if operation == VARIATION else (total / duration) ** 0.5


def _move(at: float, h: float, c: Array, distance: Array, p: Array) -> float:
    """Finds how far from p one is who moves with speed c; returns where that ends."""
    mean: float = 0.0
    for node in range(5):
        mean = 0.0
        for a in range(4, -1, -1):
            mean = mean * (node / 4) + c[a] / (a + 1)
        distance[node] = at + h * (node / 4) * mean - p[node]
    return at + h * mean


def _is_moving(x: float, first: int, last: int, record: Record) -> bool:
    """Returns whether a vector is not at rest, at a place in the piece."""
    square = 0.0
    for k in range(first, last):
        value = _value(record.powers[k], x) - record.around[k, 0]
        square = value * value + (square if record.around[k, 2] == 0.0 else 0.0)
        if square >= record.around[k, 1]:
            return True
    return False


def _is_nothing(first: int, last: int, record: Record, memory: AnyRows) -> bool:
    """Returns whether forms are 0 all the time."""
    for i in range(record.counts[NUM_PIECES]):
        for k in range(first, last):
            _sample(k, i, record, memory)
            for node in range(5):
                if record.values[k, node] != 0.0:
                    return False
    return True


def _find_rest(first: int, last: int, record: Record, memory: AnyRows) -> None:
    """Finds where vectors come to rest, and how near they must be."""
    n, around, start, square = len(record.columns) + 2, record.around, first, 0.0
    for k in range(first, last):
        limit, share = record.forms[k, n], record.forms[k, n + 1]
        _sample(k, record.counts[NUM_PIECES] - 1, record, memory)
        around[k, 0] = record.values[k, 4] if share > 0.0 else 0.0
        around[k, 1], around[k, 2] = math.inf, record.forms[k, n + 2]
        if around[k, 2] != 0.0:
            start, square = k, 0.0
        square += around[k, 0] ** 2
        # The whole vector is known behind its last form.
        if k + 1 == last or record.forms[k + 1, n + 2] != 0.0:
            around[k, 1] = limit**2
            if share > 0.0:
                around[k, 1] = share**2 * square
                if square == 0.0 and _is_nothing(start, k + 1, record, memory):
                    around[k, 1] = math.inf


def _settling(first: int, last: int, i: int, record: Record, memory: AnyRows) -> float:
    """Returns how long from a piece on until vectors rest, which must last longest."""
    num = record.counts[NUM_PIECES]
    if i == num or record.places[3] != 0:
        return math.nan
    _find_rest(first, last, record, memory)
    begin, longest, was_moving = record.pieces[i, 0], 0.0, False
    since = begin
    for piece in range(i, num):
        t, h = (
            record.pieces[piece, 0],
            record.pieces[piece, 1] - record.pieces[piece, 0],
        )
        for k in range(first, last):
            _sample(k, piece, record, memory)
        for j in range(5):
            if _is_moving(j / 4, first, last, record) != was_moving:
                low, high = max(j - 1, 0) / 4, j / 4
                middle = (low + high) / 2
                while low < middle < high:
                    if _is_moving(middle, first, last, record) == was_moving:
                        low = middle
                    else:
                        high = middle
                    middle = (low + high) / 2
                if not was_moving:
                    longest = max(longest, t + h * high - since)
                since, was_moving = t + h * high, not was_moving
    end = record.pieces[num - 1, 1]
    return math.nan if was_moving or end - since <= longest else since - begin
