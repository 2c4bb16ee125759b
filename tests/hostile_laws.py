"""Laws that machine code has right, or refuses with the line that is marked."""

# ruff: noqa: B006
import contextlib
import functools
import itertools
import math
from types import SimpleNamespace

import numpy as np
from numpy.linalg import norm


# Helpers that write under a condition, or return what they got.
def limit_list(F, limit):
    size = math.sqrt(F[0] ** 2 + F[1] ** 2)
    if size > limit:
        F[0], F[1] = F[0] * limit / size, F[1] * limit / size
    return size


def limit_object(state, F, limit):
    state.is_limited = abs(F) > limit
    if state.is_limited:
        state.F = math.copysign(limit, F)


def limit_dictionary(state, F, limit):
    if limit < F:
        state["F"] = limit
    elif -limit > F:
        state["F"], state["low"] = -limit, 1.0


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


def zeros_of(x):
    return np.array([0, 0]) if x > 0 else np.zeros(2)


TABLE, PLACES = np.array([1.0, 4.0, 9.0, 16.0]), np.array([3, 1, 2, 0])


def inverse(A):
    try:
        return np.linalg.inv(A)
    except np.linalg.LinAlgError:
        return 0 * A


COUNTS, NOTES, SPRING = [0], {"last": 0.0}, SimpleNamespace(k=2.0)

NUMBERS, WORK, TOTAL = itertools.count(), np.ones(6), 0


class Calls:
    number = 0


def shifted(x):
    return x + 1.0


shifted.__module__ = "timers"  # It begins as `time` does, which is refused.


class Spring:
    def force(self, x):
        return -2.0 * max(x, 0.0)  # A tracer cannot get in between here.


def affine(a, b, x):
    return a * x + b if x > 0 else b


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
        F, state = (
            [3 * x[0] - x[1], x[1] * 2],
            SimpleNamespace(F=x[0], is_limited=False),
        )
        size, values = limit_list(F, 0.8), {"F": x[2]}
        limit_object(state, x[0], 0.8)
        limit_dictionary(values, x[2], 0.5)
        return np.array([*F, size, state.F, state.is_limited, values["F"], len(values)])

    def alias_returned_one_way(x):
        raw, other = 2 * x[:2], 3 * x[2:4]
        F, G = limited(raw, 1.0), limited(other, 1.0)
        F -= 0.1 * x[2:4]
        other[0] = 7.0
        return np.concatenate((F, raw, G, other))

    def view_returned(x):
        raw = 2 * x
        F = limited_in_place(raw, 1.0)
        F[0] += 1.0
        return np.concatenate((F, raw))

    def arrays_in_lists(x):
        a, b, counts = 1 * x, 2 * x, np.zeros(2, dtype=int)
        longer(a, b)[2] = 9.0
        swapped(items := [a, b], x[0])
        items[0][0] = 8.0
        counted(counts, x[0])
        counted(counts, x[1])
        return np.concatenate((a, b, counts * 1.0))

    def whatever_helpers_return(x):
        seen, zeros = [0.0], zeros_of(x[2])
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
        a, b = x[0] > 0, x[1] > 0
        stored = np.zeros(3)
        stored[0], stored[1] = a, stored[0] + b
        numbers = [float(a) + float(b), a * 2 + b * 3.0, np.sum(x > 0), sum([a, b])]
        numbers += [
            np.mean(x > 0),
            np.count_nonzero(x),
            math.exp(float(a)),
            math.exp(a),
        ]
        logic = [a & b, a | b, a ^ b, np.logical_or(x[0], b), not a, abs(a), max(a, b)]
        logic += [np.any(x > 0), np.all(x > -1), np.where(a, True, b), int(a) / 2, 2**b]
        return np.array([*numbers, *logic, *stored, *np.where(~(x > 0), x, 2.0)])

    def yes_of_numbers(x):
        signs = np.copysign(math.isfinite(1.0), x[0]), np.hypot(np.isfinite(2.0), x[1])
        return np.array(
            [x.any() * x[1], (0 * x).all() * x[2], float(x[:2].all()), *signs]
        )

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
            return np.log(np.abs(x))

    def types(x):
        y = np.array(x, dtype=float) + np.asarray(x, float) + np.zeros(6, dtype=float)
        y += x.astype(int) + x.astype(float) + np.full_like(x, x[0]) + np.full(6, x[1])
        return y if isinstance(x, np.ndarray) and not isinstance(x, (float, str)) else x

    # What is no number.
    def not_numbers(x):
        big = x / (0.0 * x)
        none = big - big
        pairs = np.minimum(none, x), np.maximum(x, none), np.clip(none, 0, 1), 0.0 * big
        sums = (
            0 * np.exp(1e4 * abs(x)),
            0.0 / (x - x),
            np.sort(none),
            big // 1.0,
            x // big,
        )
        signs = np.sign(big), np.sign(none), np.isnan(none), np.isinf(big)
        choices = (
            min(none[0], 1.0),
            min(1.0, none[0]),
            max(1.0, none[0]),
            np.argmax(none),
        )
        return np.concatenate((*pairs, *sums, *signs, choices))

    def signs_of_zero(x):
        none, y = -0.0 * abs(x[0]), -0.3 / (1 + abs(x[0]))
        zeros = int(y), round(y), math.ceil(y), math.trunc(y), np.ceil(y), 2 * y % y
        zeros += none + 0.0, 0.0 - none, none - none, np.sign(none), none // 2
        return np.array([math.copysign(1, zero) for zero in zeros])

    def constants(x):
        return SPRING.k * x * len(COUNTS)

    # Functions.
    def functions(x):
        a, b, u = x[0], x[1], math.tanh(x[2])
        angles = np.arctan2(a, b), math.atan2(a, b), np.arccos(u), math.acos(u)
        waves = np.arcsin(u), np.cosh(a), math.sinh(a), np.sinh(b), math.degrees(b)
        rests = (
            a % b,
            a // b,
            np.mod(a, b),
            a % 0.7,
            5.0 // b,
            -7.5 % b,
            math.fmod(a, b),
        )
        whole = (
            *(np.ceil(a), math.ceil(b), round(a)),
            *(np.round(a, 1), round(b, 2), np.rint(a)),
        )
        sizes = np.hypot(a, b), math.hypot(a, b, 2), norm(x), norm([a, b]), math.fabs(a)
        signs = (
            np.copysign(a, 0.0),
            np.copysign(a, -0.0),
            np.copysign(3, a),
            abs(a) ** b,
        )
        steps = math.copysign(a, b), np.deg2rad(a), 2**a, a**-1
        tables = (
            np.interp(a, [-1, 0, 0.5], [2, 3, -1]),
            np.interp(b, [0, 1], x[:2], left=a),
        )
        lists = np.max([a, b]), np.sum([a, 1.0]), np.clip([a], -0.1, 0.1)[0]
        numbers = (
            *angles,
            *waves,
            *rests,
            *whole,
            *sizes,
            *signs,
            *steps,
            *tables,
            *lists,
        )
        clipped = np.clip(x, None, 0.5), x.clip(-1, b)
        return np.concatenate((numbers, *clipped, x[::-1]))

    def matrices_of_numpy(x):
        A, M = np.outer(x[:3], x[3:]) + np.diag(x[1:4]), x.reshape(2, 3)
        norms = norm(M), norm(A[0], np.inf), norm(A[0], 1), *norm(M, axis=1)
        determinants = np.linalg.det(A), np.linalg.det(A[:2, :2]), np.linalg.det(0 * A)
        solutions = np.linalg.solve(A, x[:3]), np.linalg.eigh(A)[0], M.mean(axis=0)
        products = norm(M, axis=0), np.einsum("ij,kj->ik", M, M)[0]
        return np.concatenate((norms, determinants, *solutions, *products))

    def matrices_of_rank_two(x):
        A = np.outer(x[:3], x[3:]) + np.diag([x[0], 0.0, 2.0])
        U, sigma, Vt = np.linalg.svd(A)
        return np.concatenate((*(U.T @ U), *(Vt @ Vt.T), sigma, *(U * sigma @ Vt)))

    def singular_matrix(x):
        U, sigma, Vt = np.linalg.svd(np.outer(x[:3], x[3:]))
        return np.concatenate((sigma, *(Vt @ Vt.T), [np.nan * U[0, 2]]))

    def helper_of_a_module(x):
        return shifted(x)

    def calls(x):
        gains = [PARTIAL(value) for value in x]
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
        y = x.astype(int)
        y[0] = 0.7  # here
        return y

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
        change = x[0] - NOTES["last"]  # here
        NOTES["last"] = x[0]
        return np.array([change])

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

    counting_outside = closure()


RIGHT, REFUSED = (
    [law for law in vars(kind).values() if callable(law)] for kind in (Right, Refused)
)
