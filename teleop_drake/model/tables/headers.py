"""Names of columns: the quantity that a header names, and its unit.

time_s   Time [ms]   RTT (us)   timeMs   v_m_s   x_mm   linear.x   tool position (mm)
"""

import itertools
import re
from typing import NamedTuple


class Unit(NamedTuple):
    """A unit of measurement.

    Attributes:
        quantity: The quantity that it measures.
        factor: The value of one unit in SI.
    """

    quantity: str
    factor: float


_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_ANGLES = {"rad": 1.0, "deg": 0.017453292519943295}
_PER_SECOND = ("{}/s", "{}_s", "{}_per_s", "{}.s-1", "{} s-1")

_TIMES = {
    1.0: ("s", "sec", "secs", "second", "seconds"),
    1e-3: ("ms", "msec", "msecs", "millis", "milliseconds", "millisecond"),
    1e-6: ("us", "usec", "usecs", "micros", "microseconds", "microsecond"),
    1e-9: (
        "ns",
        "nsec",
        "nsecs",
        "nanosec",
        "nanosecs",
        "nanos",
        "nanoseconds",
        "nanosecond",
    ),
}

UNITS = {
    **{name: Unit("time", x) for x, names in _TIMES.items() for name in names},
    **{name: Unit("length", x) for name, x in _LENGTHS.items()},
    **{name: Unit("angle", x) for name, x in _ANGLES.items()},
    **{
        form.format(name): Unit("speed", x)
        for name, x in _LENGTHS.items()
        for form in _PER_SECOND
    },
    **{
        form.format(name): Unit("turning speed", x)
        for name, x in _ANGLES.items()
        for form in _PER_SECOND
    },
    "mps": Unit("speed", 1.0),
    "N": Unit("force", 1.0),
    "mN": Unit("force", 1e-3),
}
"""The known units, by their names."""

_BRACKETS = re.compile(r"(.*?)[\s_]*(?:\[([^\[\]]*)\]|\(([^()]*)\)|/ ?(\w+))\s*")
# The longest name first: `v_mm_s` is in mm/s, not in s.
_SUFFIX = re.compile(
    r"(.+?)[_ .-]+("
    + "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True))
    + ")"
)
# `timeMs`
_CAMEL = re.compile(r"(.*[a-z])(Ms|Us|Ns|Sec|Millis|Seconds)")


# The last words of the name of a time.
TIME_WORDS = "t|time|times|time_of_day|timestamp|stamp|datetime|date|ts|epoch|elapsed"


def IsTime(key: str) -> bool:
    """Returns whether a Header.key is that of a time."""
    return re.fullmatch(rf"(.+_)?({TIME_WORDS})", key) is not None


class Header(NamedTuple):
    """What the name of a column tells.

    Attributes:
        words: The words of the name without the unit, in lower case.
        unit: The name of the unit; empty if there is none.
    """

    words: tuple[str, ...]
    unit: str

    @property
    def key(self) -> str:
        """Returns the words, joined by `_`."""
        return "_".join(self.words)


def ParseHeader(name: str) -> Header:
    """Returns the words and the unit of a column's name.

    Text in square brackets is a unit, known or not, except for the number of a
    component, as in `tool_velocity[0]`. Text in parentheses is one if it is known or
    has a `/`, and text behind a `/` or a `_` only if it is known.
    """
    name = name.strip().strip("\"'")
    # `seconds`, `nanosec`, `millis` alone are times; `s` and `ms` may be anything.
    alone = CleanUnit(name)
    if len(alone) > 2 and alone in UNITS and UNITS[alone].quantity == "time":
        return Header(("time",), alone)
    found = _BRACKETS.fullmatch(name)
    if found and found[1] and not (found[2] or "").strip().isdecimal():
        unit = CleanUnit(next(x for x in found.groups()[1:] if x is not None))
        if unit in UNITS or found[2] is not None or "/" in unit:
            return Header(_Words(found[1]), unit)
    spellings = (name, name.lower()) if name.isupper() else (name,)
    for form, spelling in itertools.product((_SUFFIX, _CAMEL), spellings):
        found = form.fullmatch(spelling)
        if found:
            return Header(_Words(found[1]), CleanUnit(found[2]))
    return Header(_Words(name), "")


def CleanUnit(unit: str) -> str:
    """Returns the name of a unit in the spelling of UNITS, if it is known."""
    unit = unit.strip().replace("µ", "u").replace("μ", "u").replace("·", ".")
    unit = unit.replace("⁻¹", "-1").replace("^-1", "-1")
    unit = re.sub(r"(?: ?/ ?| per )s(?:ec|econd)?$", "/s", unit)
    return unit if unit in UNITS else unit.lower()


def _Words(name: str) -> tuple[str, ...]:
    # `sendTime` has two words.
    name = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", name)
    return tuple(re.findall(r"[^\W_]+", name.lower()))
