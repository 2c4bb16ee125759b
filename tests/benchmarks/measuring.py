"""Fair timing, by contenders that take turns, and tables of what it gives."""

import gc
import resource
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Options:
    """Whether to measure little, to see that all works, and whether JiTCDDE as well."""

    quick: bool = False
    peers: bool = False

    @property
    def repeats(self) -> int:
        """How often each contender runs."""
        return 1 if self.quick else 3

    def Duration(self, scenario) -> float:
        """Returns how much of a scenario to simulate, in s."""
        return 0.5 if self.quick else scenario.duration


@dataclass
class Measurement:
    """Medians of what calls of one contender took, in s; what the last returned."""

    cpu: float
    wall: float
    value: Any


# How long each contender is called again and again in its turn, s: some calls take less
# than a millisecond, and the first ones find the caches of the processor cold.
_TURN = 0.05


def CallsInTurn(call: Callable[[], Any]) -> int:
    """Returns how often a contender is called in a turn, after one call."""
    call()  # What is done once a process is no part of a run.
    begin = time.perf_counter()
    call()
    return 1 + int(_TURN / (time.perf_counter() - begin))


def Repeat(call: Callable[[], Any], count: int) -> None:
    """Calls a contender several times."""
    for _ in range(count):
        call()


def _Times() -> tuple[float, float]:
    """Returns CPU time, of this process and its children that have ended, and time."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = time.process_time() + children.ru_utime + children.ru_stime
    return cpu, time.perf_counter()


def Alternate(
    contenders: Mapping[str, Callable[[], Any]], repeats: int
) -> dict[str, Measurement]:
    """Calls the contenders in turn (A B A B ...), each of them `repeats` times.

    CPU time is that of processes as well which a contender starts and ends.
    """
    times: dict[str, list] = {name: [] for name in contenders}
    values = {}
    for _ in range(repeats):
        for name, call in contenders.items():
            gc.collect()
            before = _Times()
            values[name] = call()
            times[name].append([b - a for a, b in zip(before, _Times(), strict=True)])
    return {
        name: Measurement(
            *map(statistics.median, zip(*taken, strict=True)), values[name]
        )
        for name, taken in times.items()
    }


@dataclass(kw_only=True)
class Table:
    """Rows of cells by column; `note` says how to read them."""

    title: str
    note: str
    rows: list[dict[str, Any]]

    def Markdown(self) -> str:
        columns = list(dict.fromkeys(key for row in self.rows for key in row))
        cells = [columns, ["---"] * len(columns)]
        cells += [[_Text(row.get(key)) for key in columns] for row in self.rows]
        lines = ["| " + " | ".join(row) + " |" for row in cells]
        return "\n".join([f"## {self.title}", "", self.note, "", *lines, ""])


def OneDigit(ratio: float) -> str:
    """Returns a ratio with one significant digit, such as 0.7 or 30."""
    return f"{float(f'{ratio:.1g}'):g}"


def _Text(value: Any) -> str:
    """Returns a cell as text: three digits of a number, - for none."""
    if not isinstance(value, float):
        return "-" if value is None else str(value)
    if 1e3 <= abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.3g}" if 1e-2 <= abs(value) < 1e3 or not value else f"{value:.1e}"
