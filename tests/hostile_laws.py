"""Laws that machine code has right, or refuses with the line that is marked."""

# ruff: noqa: B006
import contextlib
import datetime
import enum
import functools
import itertools
import math
import operator
from datetime import date
from types import SimpleNamespace

import numpy as np
from numpy.linalg import norm

from teleop_drake.loops.numerics.jacobi import singular_values


# Helpers that write under a condition, or return what they got.
def limit_list(F, limit):
    size = math.sqrt(F[0] ** 2 + F[1] ** 2)
    if size > limit:
        F[0], F[1] = F[0] * limit / size, F[1] * limit / size
    return size


def limit_object(state, F, limit):
    state.is_limited = abs(F) > limit
    if state.is_limited:
        state.F = limit if F > 0 else -limit


def limit_dictionary(state, F, limit):
    if limit < F:
        state["F"] = limit
    elif -limit > F:
        state["F"] = -limit
        state["low"] = 1.0


def wave(x):
    if x[0] > 0:
        return math.exp(x[1])
    return math.cos(x[2])


def twice_if(condition, value):
    if condition:
        return 2 * value
    return 0.5


def limited(F, limit):
    size = np.linalg.norm(F)
    return F * (limit / size) if size > limit else F


def limited_in_place(F, limit):
    if np.linalg.norm(F) > limit:
        F *= limit / np.linalg.norm(F)
    return F[1:]


def longer(a, b):
    return a if len(a) and a[0] > b[0] else b


def swapped(items, x):
    if x > 0:
        items[0], items[1] = items[1], items[0]
    else:
        items[0][1] = 4.0


def counted(counts, x):
    counts[0 if x > 0 else 1] += 1


def called(function, x):
    if x > 0:
        function(x)


def kind_of(x):
    return "push" if x > 0 else None


def twice(x):
    y = 2 * x if x[0] > 0 else 3 * x
    return y, y


def twice_in_a_list(x):
    y = [x[0], 2 * x[1] if x[0] > 0 else 3.0]
    return y, y


def twice_inside(x):
    y = 2 * x if x[0] > 0 else 3 * x
    return y, [y]


def zeros_of(x):
    return np.array([0, 0]) if x > 0 else np.zeros(2)


TABLE_32 = np.full(6, 0.1, np.float32)
NUMBER_32 = np.float32(0.1)
TABLE_8 = np.array([1, 2, 3, 4], np.int8)
LARGE = np.array([2**53 + 1, 2**53])
TABLE = np.array([1.0, 4.0, 9.0, 16.0])
PLACES = np.array([3, 1, 2, 0])


def inverse(A):
    try:
        return np.linalg.inv(A)
    except np.linalg.LinAlgError:
        return 0 * A


COUNTS = [0]
NOTES = {"last": 0.0}
SPRING = SimpleNamespace(k=2.0)

NUMBERS = itertools.count()
WORK = np.ones(6)
TOTAL = 0


class Calls:
    number = 0


def shifted(x):
    return x + 1.0


shifted.__module__ = "timers"  # It begins as `time` does, which is refused.


HOOKS = [lambda x: x]


class Spring:
    def force(self, x):
        return -2.0 * max(x, 0.0)  # A tracer cannot get in between here.


def affine(a, b, x):
    return a * x + b if x > 0 else b


class Damper:
    limits = [0.5]  # noqa: RUF012

    def __init__(self):
        self.gains = {"b": 2.0}
        self.used = []

    def force(self, x):
        return -self.gains["b"] * min(x, self.limits[0])

    def noted(self, x):
        self.used.append(1)  # here
        return x

    @property
    def stiffness(self):
        return 10.0 * self.gains["b"]

    @property
    def uses(self):
        self.used.append(1)  # here
        return len(self.used)

    def __call__(self, x):
        return self.force(x) + 1.0


DAMPER = Damper()
FORCES = {math.sin: 2.0, shifted: 3.0}


@functools.cache
def matrix(n):
    return np.eye(n) + 1.0


class Mode(enum.Enum):
    FREE = 1
    HELD = 2


MODES = [Mode.HELD]
NAMES = {"free", "held"}


def friction(v, level=0.3):
    if v > 0.1:
        return level
    return -level if v < -0.1 else 3 * v


PARTIAL = functools.partial(affine, 2.0, 1.0)


def closure():
    number = 0

    def counting_outside(x):
        nonlocal number
        number += 1  # here
        return x

    return counting_outside


class Right:
    """Laws that machine code has right."""

    def a_branch_that_two_others_need(x):
        value = wave(x)
        return np.array([twice_if(x[1] > 0.1, value), twice_if(x[2] > 0.1, value)])

    def force_limits(x):
        F = [3 * x[0] - x[1], x[1] * 2]
        state = SimpleNamespace(F=x[0], is_limited=False)
        size = limit_list(F, 0.8)
        values = {"F": x[2]}
        limit_object(state, x[0], 0.8)
        limit_dictionary(values, x[2], 0.5)
        return np.array([*F, size, state.F, state.is_limited, values["F"], len(values)])

    def alias_returned_one_way(x):
        raw = 2 * x[:2]
        other = 3 * x[2:4]
        F = limited(raw, 1.0)
        G = limited(other, 1.0)
        F -= 0.1 * x[2:4]
        other[0] = 7.0
        return np.concatenate((F, raw, G, other))

    def view_returned(x):
        raw = 2 * x
        F = limited_in_place(raw, 1.0)
        F[0] += 1.0
        return np.concatenate((F, raw))

    def arrays_in_lists(x):
        a = 1 * x
        b = 2 * x
        counts = np.zeros(2, dtype=int)
        longer(a, b)[2] = 9.0
        swapped(items := [a, b], x[0])
        items[0][0] = 8.0
        counted(counts, x[0])
        counted(counts, x[1])
        return np.concatenate((a, b, counts * 1.0))

    def whatever_helpers_return(x):
        seen = [0.0]
        zeros = zeros_of(x[2])
        called(seen.append, x[0])
        called(lambda value: seen.append(2 * value), x[1])
        zeros[0] = 0.7
        return np.array(
            [sum(seen), {"push": 1.0, None: -2.0}[kind_of(x[0])], *zeros * 1.0]
        )

    def many_cases(x):
        for i in range(200):
            if 100 * x[0] < i:
                return x[1:2] * i
        return x[:1]

    def yes_and_no(x):
        a = x[0] > 0
        b = x[1] > 0
        stored = np.zeros(3)
        stored[0], stored[1] = a, stored[0] + b
        numbers = [float(a) + float(b), a * 2 + b * 3.0, np.sum(x > 0), sum([a, b])]
        numbers += [math.exp(float(a)), math.exp(a)]
        logic = [a & b, a | b, np.logical_or(x[0], b), not a, abs(a), max(a, b)]
        logic += [np.any(x > 0), np.all(x > -1), np.where(a, True, b), int(a) / 2]
        return np.array([*numbers, *logic, *stored, *np.where(~(x > 0), x, 2.0)])

    def yes_of_numbers(x):
        return np.array([x.any() * x[1], (0 * x).all() * x[2], float(x[:2].all())])

    def indices(x):
        y = 2 * x
        y[y > 1] = 1.0
        y[:2][x[:2] < 0] *= 0.5
        table = TABLE[int(np.floor(2 * x[1]))]
        return np.array(
            [y[int(3 * x[0])], y[-1], table, PLACES[int(x[2])], y[int(7 * x[0])]]
        )

    def without_warnings(x):
        with np.errstate(divide="ignore"):
            y = np.log(np.abs(x))
        with np.errstate(invalid="ignore"):
            return y + np.sqrt(np.abs(x))

    def types(x):
        y = np.array(x, dtype=float) + np.asarray(x, float) + np.zeros(6, dtype=float)
        return y if isinstance(x, np.ndarray) and not isinstance(x, (float, str)) else x

    # What is no number.
    def not_numbers(x):
        big = x / (0.0 * x)
        none = big - big
        pairs = np.minimum(none, x), np.maximum(x, none), np.clip(none, 0, 1), 0.0 * big
        sums = 0 * np.exp(1e4 * abs(x)), 0.0 / (x - x)
        choices = min(none[0], 1.0), min(1.0, none[0]), max(1.0, none[0])
        return np.concatenate((*pairs, *sums, choices))

    # arctan2(0.0, -1) is pi, and arctan2(-0.0, -1) is -pi.
    def signs_of_zero(x):
        none = -0.0 * abs(x[0])
        zeros = int(-0.3 / (1 + abs(x[0]))), none + 0.0, 0.0 - none, none - none
        return np.array([np.arctan2(zero, -1.0) for zero in zeros])

    def array_returned_twice(x):
        a, b = twice(x)
        a[0] = 7.0
        return np.concatenate((a, b))

    def list_returned_twice(x):
        a, b = twice_in_a_list(x)
        a[0] = 7.0
        return np.array([*a, *b])

    def array_inside_of_a_result(x):
        a, (b,) = twice_inside(x)
        b[0] = 7.0
        return np.concatenate((a, b))

    def whole_numbers(x):
        k = int(3 * x[0])
        sign = 1 if x[1] > 0 else -1
        array = np.array([sign, 2])
        array[0] = 2 * sign
        return np.array([k / 2, float(k) * 3, 2 * sign - 1, *(0.5 * array)])

    def constants(x):
        return SPRING.k * x * len(COUNTS)

    # Functions.
    def functions(x):
        a = x[0]
        b = x[1]
        u = math.tanh(x[2])
        angles = np.arctan2(a, b), math.atan2(a, b), np.arccos(u), math.acos(u)
        waves = np.arcsin(u), np.cosh(a), math.sinh(a), np.sinh(b), np.arctan(b)
        rests = np.floor(a), norm(x), norm([a, b]), abs(a) ** b, 2**a, a**-1
        lists = np.sum([a, 1.0]), np.clip([a], -0.1, 0.1)[0], np.searchsorted([0, 1], a)
        return np.array([*angles, *waves, *rests, *lists, *x[::-1]])

    def remainders_and_lengths(x):
        a = x[0]
        b = x[1]
        rests = a % 0.7, a % -0.7, np.mod(a, b), 2.5 % b, math.fmod(a, 0.3), np.sign(a)
        lengths = np.hypot(1e200 * a, 1e200), math.hypot(a, b), np.trunc(3 * a)
        ends = np.max(x), np.min(x), np.mean(x), math.radians(a), np.rad2deg(b)
        table = np.interp(a, [-0.5, 0.0, 1.0], [1.0, -1.0, 2.0]), np.isclose(a, b)
        counts = int(7 * a) % 3, int(7 * a) % -3
        return np.array([*rests, *lengths, *ends, *table, *counts])

    def matrices_of_numpy(x):
        A = np.outer(x[:3], x[3:]) + np.diag(x[1:4])
        M = x.reshape(2, 3)
        solutions = np.linalg.solve(A, x[:3]), np.linalg.inv(A)[0], np.sum(M, axis=0)
        return np.concatenate(([norm(M), np.trace(A)], *solutions, (M @ A)[0]))

    def vectors_with_their_signs(x):
        A = np.outer(x[:3], x[3:]) + np.diag([x[0], 0.5, 2.0])
        U, sigma, Vt = singular_values(A)
        return np.concatenate((sigma, *U, *Vt))

    def singular_matrix(x):
        U, sigma, Vt = singular_values(np.outer(x[:3], x[3:]))
        return np.concatenate((sigma, *(Vt @ Vt.T), [np.nan * U[0, 2]]))

    def helper_of_a_module(x):
        return shifted(x)

    def objects_from_outside(x):
        forces = [DAMPER.force(value) for value in x[:3]] + Damper.limits
        kinds = isinstance(DAMPER, Damper), isinstance(DAMPER.limits, list)
        others = DAMPER(x[3]), len(DAMPER.gains), DAMPER.stiffness
        return np.array([*forces, *kinds, *others])

    def names_and_modes(x):
        y = 2 * x if MODES[0] == Mode.HELD else x
        return y + 1.0 if "held" in NAMES else y

    def keys_that_are_functions(x):
        return x * FORCES[math.sin] + FORCES.get(shifted, 5.0)

    def many_cases_of_helpers(x):
        return np.array([friction(v) + friction(2 * v, level=0.1) for v in x])

    def written_into_its_argument(x):
        if x[0] > 0.2:
            x[0] = 0.2
        x += 1.0
        return x

    def calls(x):
        gains = [PARTIAL(value) for value in x] + list(matrix(6) @ x)
        return np.array([*gains, any(v > 0 for v in x), *map(abs, x), *sorted(x[:3])])


class Refused:
    """Laws that it refuses, with the marked line."""

    def until_converged(x):
        while x[0] > 1e-3:  # here
            x = x / 2
        return x

    def by_its_numbers(x):
        return x[:3] if x[0] > 0 else x

    # Yes and no.
    def sum_of_comparisons(x):
        return np.array([(x[0] > 0) + (x[1] > 0)])  # here

    def sum_of_masks(x):
        return 1.0 * ((x[:3] > 0) + (x[3:] > 0))  # here

    def opposite(x):
        return np.array([1.0 if ~(x[0] > 0) else 2.0])  # here

    def opposite_of_whole_numbers(x):
        return ~np.array([int(x[0]), 1]) * 1.0  # here

    def is_true(x):
        return np.array([1.0 if (x[0] > 0) is True else 2.0])  # here

    def mask_of_numbers(x):
        mask = x > 0
        mask[0] = 0.5  # here
        return mask * 1.0

    def index_of_column(x):
        return np.array([x.reshape(2, 3)[0, int(x[0])]])  # here

    def index_of_list(x):
        return np.array([[1.0, 2.0][int(x[0])]])  # here

    def indices_of_elements(x):
        return x[np.floor(x).astype(int)]  # here

    def written_at_index(x):
        x[int(x[0])] = 1.0  # here
        return x

    # Errors.
    def caught(x):
        try:
            return np.array([math.sqrt(x[0])])  # here
        except ValueError:
            return x

    def caught_by_helper(x):
        return inverse(np.outer(x, x))

    def caught_besides_warnings(x):
        with np.errstate(all="ignore"):  # here
            try:
                return np.array([math.sqrt(x[0])])  # here
            except ValueError:
                return x

    def suppressed(x):
        with contextlib.suppress(ValueError):
            return np.array([math.sqrt(x[0])])
        return x

    def raised(x):
        if x[0] > 1:
            raise ValueError("too large")  # here
        return x

    # Types.
    def of_type(x):
        return x if type(x[0]) is float else 2 * x  # here

    def matched(x):
        match x[0]:
            case float():
                return x
        return 2 * x

    def kept_as(x):
        return x if x.dtype == float else 2 * x  # here

    def as_text(x):
        return x * len(f"{x[0]}")  # here

    def written_into_whole_numbers(x):
        y = np.zeros(3, dtype=int)
        y[0] = x[0]  # here
        return y

    def written_into_cut_numbers(x):
        y = np.array([int(x[0]), int(x[1])])
        y[0] = 0.7  # here
        return y

    def written_into_signs(x):
        y = np.where(x > 0, 1, -1)
        y[0] = 0.7  # here
        return y

    def converted(x):
        return x.astype(int) / 2  # here

    # What would round in another way.
    def decimals(x):
        return np.array([round(float(x[0]), 2)])  # here

    def decimals_of_numpy(x):
        return np.round(x, 2)  # here

    def buffer_of_16_bits(x):
        y = np.zeros(6, dtype=np.float16)  # here
        y[:] = x
        return y

    def buffer_of_32_bits(x):
        y = np.zeros(6, np.float32)  # here
        y[:] = x
        return y

    def array_of_32_bits(x):
        return np.array(x, dtype=np.float32)  # here

    def table_of_32_bits(x):
        return TABLE_32 * float(x[0])

    def number_of_32_bits(x):
        return np.array([NUMBER_32 * float(x[0])])  # here

    def element_of_8_bits(x):
        return np.array([TABLE_8[int(abs(x[0]))] * 100 + x[0]])  # here

    def filled_with_whole_numbers(x):
        return np.full_like(PLACES, x[0])  # here

    def filled_like_whole_numbers(x):
        return np.full_like([1, 2], x[0])  # here

    def zeros_like_whole_numbers(x):
        y = np.zeros_like([int(x[0]), int(x[1])])  # here
        y[0] = 0.7
        return y

    def signs_of_eigenvectors(x):
        return np.linalg.eigh(np.outer(x, x))[1][0]  # here

    def signs_of_singular_vectors(x):
        return np.linalg.svd(x.reshape(2, 3))[0][0]  # here

    def quotient(x):
        return np.array([x[0] // 0.7])  # here

    # Whole numbers, which Python has beyond 2^53.
    def power_beyond_floats(x):
        return np.array([int(x[0]) ** 40 * 1.0])  # here

    def power_of_yes(x):
        return np.array([2 ** (x[0] > 0) * 1.0])  # here

    def compared_beyond_floats(x):
        return np.array([1.0 if int(1e17 * x[0]) < 2**53 + 1 else 2.0])  # here

    def element_beyond_floats(x):
        return np.array([LARGE[int(abs(x[0]) > 1)] - 2.0**53])  # here

    # Whether one thing is another one.
    def is_same_number(x):
        return np.array([1.0 if x[0] is x[0] else 2.0])  # here

    def is_first_of(x):
        return np.array([1.0 if x[0] is not x[1] else 2.0])  # here

    def is_by_operator(x):
        return np.array([1.0 if operator.is_(x[0], x[0]) else 2.0])  # here

    def counting(x):
        COUNTS[0] += 1  # here
        return x

    def counting_in_class(x):
        Calls.number += 1  # here
        return x

    def counting_in_default(x, seen=[]):
        seen.append(x[0])
        return x

    def counting_in_global(x):
        global TOTAL
        TOTAL += 1  # here
        return x

    def remembering(x):
        change = x[0] - NOTES["last"]
        NOTES["last"] = x[0]  # here
        return np.array([change])

    def counting_in_function(x):
        shifted.count = x[0]  # here
        return x

    def counting_in_function_of_a_list(x):
        HOOKS[0].count = 1.0  # here
        return x

    def time_of_day(x):
        return x + datetime.datetime.now().microsecond  # here

    def today(x):
        return x + date.today().day  # here

    def time_of_numpy(x):
        return x + np.datetime64("now").astype(float)  # here

    def working_outside(x):
        WORK[0] = x[0]  # here
        return WORK

    def drawing(x):
        return x + np.random.normal()  # here

    def taking_the_next(x):
        return x + next(NUMBERS)  # here

    def unknown_of_numpy(x):
        return np.gradient(x)  # here

    def unknown_argument(x):
        return np.sqrt(x, where=x > 0, out=np.zeros(6))  # here

    def method(x):
        return np.array([Spring().force(x[0])])

    def changing_an_object(x):
        return DAMPER.noted(x)

    def changing_a_set(x):
        NAMES.add("caught")  # here
        return x

    def changing_by_a_property(x):
        return x + DAMPER.uses

    def changing_a_list_of_a_class(x):
        DAMPER.limits[0] += 1  # here
        return x

    def changing_a_class_of_an_object(x):
        DAMPER.__class__.limits = x
        return x

    def asking_what_is_called(x):
        return 2 * x if callable(SPRING) else x  # here

    def asking_for_the_type(x):
        return 2 * x if type(DAMPER) == Damper else x  # noqa: E721  # here

    def comparing_objects(x):
        return 2 * x if DAMPER == SPRING else x  # here

    def asking_whether_it_is_true(x):
        return 2 * x if DAMPER else x  # here

    counting_outside = closure()


RIGHT, REFUSED = (
    [law for law in vars(kind).values() if callable(law)] for kind in (Right, Refused)
)
