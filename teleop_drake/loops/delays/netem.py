"""The options of netem, the network emulator of Linux, read from a line and written.

    delay TIME [JITTER [CORRELATION]] [distribution NAME]
    loss [random] PERCENT [CORRELATION]      or  loss gemodel P [R [1-H [1-K]]]
    duplicate PERCENT [CORRELATION]
    reorder PERCENT [CORRELATION] [gap DISTANCE]
    limit PACKETS

The words are those of `man tc-netem`. A whole command `tc qdisc ... netem ...`, and
what `tc qdisc show` prints, are read as well. netem_queue tells what the options do.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NoReturn

from teleop_drake.loops.framework.validation import Choices, Refuse

DISTRIBUTIONS = ("uniform", "normal", "pareto", "paretonormal")
"""The distributions of jitter that netem has."""

_NOT_READ = {
    "corrupt": "corrupted bits",
    "rate": "the size of packets",
    "slot": "slots",
    "ecn": "marks of packets",
    "state": "losses of four states; gemodel has two",
    "seed": "Linux's random numbers; the key `seed` sets those of the channel",
}
"""Options of netem that a channel does not have, and what they are about."""

_UNITS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
_SPELLINGS = {"sec": "s", "msec": "ms", "usec": "us", "nsec": "ns"}
_TIME = re.compile(r"([0-9.]+(?:e-?[0-9]+)?)(s|ms|us|ns|sec|msec|usec|nsec)s?")
_PERCENT = re.compile(r"([0-9.]+(?:e-?[0-9]+)?)%?")

# What names the place of a queue in what tc prints; most have a value.
_PLACES = ("dev", "root", "parent", "refcnt")

# netem stores jitter as a signed number of 32 bits.
_MOST_JITTER = 2**31 - 1


@dataclass(frozen=True, kw_only=True)
class Chance:
    """A probability, whose random numbers may be correlated.

    Attributes:
        share: The probability, 0 to 1.
        correlation: The correlation of the random numbers, 0 to 1; see netem_queue.
    """

    share: float = 0.0
    correlation: float = 0.0


@dataclass(frozen=True, kw_only=True)
class GilbertElliott:
    """netem's loss model of two states, the numbers of `loss gemodel`.

    Attributes:
        to_bad: p, the probability to go from the good to the bad state at a packet.
        to_good: r, the probability to go back.
        bad_loss: 1-h, the share that is lost in the bad state.
        good_loss: 1-k, the share that is lost in the good state.
    """

    to_bad: float
    to_good: float
    bad_loss: float = 1.0
    good_loss: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Netem:
    """The options of netem.

    Attributes:
        delay: The mean delay, ns.
        jitter: The half width of the uniform distribution, or the standard deviation of
            another one, ns.
        correlation: The correlation of the delay's random numbers, 0 to 1.
        distribution: One of DISTRIBUTIONS.
        loss: The loss of packets.
        duplicate: The packets that are sent twice.
        reorder: The packets that are sent at once.
        gap: At least this number of packets less one is delayed before one is sent at
            once.
        limit: The most packets under way; one that exceeds them is lost.
    """

    delay: int = 0
    jitter: int = 0
    correlation: float = 0.0
    distribution: str = "uniform"
    loss: Chance | GilbertElliott = field(default_factory=Chance)
    duplicate: Chance = field(default_factory=Chance)
    reorder: Chance = field(default_factory=Chance)
    gap: int = 1
    limit: int = 1000

    def Line(self) -> str:
        """Returns the options as `tc qdisc add dev DEV root netem` takes them."""
        parts = []
        if self.delay or self.jitter:
            parts += ["delay", _Time(self.delay)]
        if self.jitter:
            parts += [_Time(self.jitter), *_Correlation(self.correlation)]
            if self.distribution != "uniform":
                parts += ["distribution", self.distribution]
        if isinstance(self.loss, GilbertElliott):
            model = self.loss
            numbers = model.to_bad, model.to_good, model.bad_loss, model.good_loss
            parts += ["loss", "gemodel", *map(_Percent, numbers)]
        chances = {"duplicate": self.duplicate, "reorder": self.reorder}
        if isinstance(self.loss, Chance):
            chances = {"loss": self.loss, **chances}
        for name, chance in chances.items():
            if chance.share:
                correlation = _Correlation(chance.correlation)
                parts += [name, _Percent(chance.share), *correlation]
        if self.reorder.share and self.gap > 1:
            parts += ["gap", str(self.gap)]
        if self.limit != 1000:
            parts += ["limit", str(self.limit)]
        return " ".join(parts)


def _Time(nanoseconds: int) -> str:
    for unit, factor in _UNITS.items():
        if nanoseconds >= factor:
            return f"{nanoseconds / factor:.9g}{unit}"
    return "0ms"


def _Percent(share: float) -> str:
    return f"{100 * share:.9g}%"


def _Correlation(correlation: float) -> list[str]:
    return [_Percent(correlation)] if correlation else []


class _Words:
    """The words of a line, which are taken one after another."""

    def __init__(self, path: str, line: str):
        self._path = path
        self._line = line
        self._words = line.split()

    def __bool__(self) -> bool:
        return bool(self._words)

    def Refuse(self, allowed: str) -> NoReturn:
        Refuse(self._path, self._line, allowed)

    def Next(self) -> str:
        """Returns the next word, empty at the end."""
        return self._words[0] if self._words else ""

    def Take(self) -> str:
        return self._words.pop(0)

    def TakeIf(self, *words: str) -> bool:
        """Takes the next word if it is one of these; returns whether it is."""
        found = self.Next() in words
        if found:
            self.Take()
        return found

    def Time(self, what: str) -> int:
        """Takes a time; returns it in ns."""
        found = _TIME.fullmatch(self.Next())
        if not found:
            self.Refuse(f"such that {what} is a time with a unit, as 100ms or 5us")
        self.Take()
        unit = _SPELLINGS.get(found[2], found[2])
        return round(float(found[1]) * _UNITS[unit])

    def HasTime(self) -> bool:
        return _TIME.fullmatch(self.Next()) is not None

    def Share(self, what: str) -> float:
        """Takes a percentage; returns the share."""
        found = _PERCENT.fullmatch(self.Next())
        share = float(found[1]) / 100 if found else -1.0
        if not 0 <= share <= 1:
            self.Refuse(f"such that {what} is 0% to 100%")
        self.Take()
        return share

    def HasShare(self) -> bool:
        return _PERCENT.fullmatch(self.Next()) is not None

    def Chance(self, what: str) -> Chance:
        """Takes a percentage and its correlation, if it has one."""
        share = self.Share(what)
        correlation = 0.0
        if self.HasShare():
            correlation = self.Share(f"the correlation of {what}")
        return Chance(share=share, correlation=correlation)

    def Count(self, what: str) -> int:
        if not self.Next().isdecimal() or int(self.Next()) < 1:
            self.Refuse(f"such that {what} is a whole number >= 1")
        return int(self.Take())


def ParseNetem(path: str, line: str) -> Netem:
    """Returns the options of netem that a line has.

    Args:
        path: The field that has the line, for messages.
        line: The line.

    Raises:
        ScenarioError: If a word is not allowed, or is an option that a channel does not
            have.
    """
    words = _Words(path, line)
    _SkipCommand(words)
    found: dict[str, object] = {}
    while words:
        name = words.Take()
        if name in _NOT_READ:
            what = _NOT_READ[name]
            words.Refuse(f"without {name}, because a channel does not model {what}")
        if name not in _READERS:
            known = ("delay", "loss", "duplicate", "reorder", "distribution", "limit")
            words.Refuse(f"options of netem; {name!r} must be {Choices(name, known)}")
        _READERS[name](words, found)
    netem = Netem(**found)  # type: ignore[arg-type]
    if netem.jitter > _MOST_JITTER:
        words.Refuse("such that jitter is at most 2.147 s")
    if "distribution" in found and not netem.jitter:
        words.Refuse("such that a distribution has a jitter")
    if netem.reorder.share and not netem.delay:
        words.Refuse("such that what is reordered has a delay")
    if "gap" in found and not netem.reorder.share:
        words.Refuse("such that a gap has a percentage to reorder")
    return netem


def _SkipCommand(words: _Words) -> None:
    """Skips what precedes the options in a command, or in what tc prints."""
    if words.Next() in ("sudo", "tc", "qdisc"):
        while words and words.Next() != "netem":
            words.Take()
    words.TakeIf("netem")
    if words.Next().endswith(":"):
        words.Take()
    while words.TakeIf(*_PLACES):
        if words.Next() and words.Next() not in (*_READERS, *_NOT_READ, *_PLACES):
            words.Take()


def _ReadDelay(words: _Words, found: dict[str, object]) -> None:
    found["delay"] = words.Time("delay")
    if words.HasTime():
        found["jitter"] = words.Time("jitter")
        if words.HasShare():
            found["correlation"] = words.Share("the correlation of the delay")


def _ReadDistribution(words: _Words, found: dict[str, object]) -> None:
    name = words.Next()
    if name not in DISTRIBUTIONS:
        words.Refuse(f"such that distribution is {Choices(name, DISTRIBUTIONS)}")
    found["distribution"] = words.Take()


def _ReadLoss(words: _Words, found: dict[str, object]) -> None:
    if words.Next() in _NOT_READ:
        return  # The next turn refuses it.
    if not words.TakeIf("gemodel"):
        words.TakeIf("random")
        found["loss"] = words.Chance("loss")
        return
    words.TakeIf("p")
    to_bad = words.Share("p of gemodel")
    # tc's defaults: independent losses, of every packet in the bad state.
    numbers = {"r": 1 - to_bad, "1-h": 1.0, "1-k": 0.0}
    for name in numbers:
        words.TakeIf(name)
        if words.HasShare():
            numbers[name] = words.Share(f"{name} of gemodel")
    found["loss"] = GilbertElliott(
        to_bad=to_bad,
        to_good=numbers["r"],
        bad_loss=numbers["1-h"],
        good_loss=numbers["1-k"],
    )


def _ReadChance(name: str, words: _Words, found: dict[str, object]) -> None:
    found[name] = words.Chance(name)


def _ReadCount(name: str, words: _Words, found: dict[str, object]) -> None:
    found[name] = words.Count(name)


_READERS: dict[str, Callable[[_Words, dict[str, object]], None]] = {
    "delay": _ReadDelay,
    "latency": _ReadDelay,
    "distribution": _ReadDistribution,
    "loss": _ReadLoss,
    "drop": _ReadLoss,
    "duplicate": partial(_ReadChance, "duplicate"),
    "reorder": partial(_ReadChance, "reorder"),
    "gap": partial(_ReadCount, "gap"),
    "limit": partial(_ReadCount, "limit"),
}
