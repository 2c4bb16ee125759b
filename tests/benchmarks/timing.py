"""Fair timing: contenders take turns, and the ratio of their medians counts."""

import gc
import resource
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
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
    """What repeated calls of one contender took, in s, and what the last returned."""

    cpu_times: list[float] = field(default_factory=list)
    wall_times: list[float] = field(default_factory=list)
    value: Any = None

    @property
    def cpu(self) -> float:
        return statistics.median(self.cpu_times)

    @property
    def wall(self) -> float:
        return statistics.median(self.wall_times)


def _CpuTime() -> float:
    """Returns the CPU time in s of this process and its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def Alternate(
    contenders: Mapping[str, Callable[[], Any]], repeats: int
) -> dict[str, Measurement]:
    """Calls the contenders in turn (A B A B ...), each of them `repeats` times.

    CPU time is that of processes as well which a contender starts and ends.
    """
    measurements = {name: Measurement() for name in contenders}
    for _ in range(repeats):
        for name, call in contenders.items():
            gc.collect()
            measurement = measurements[name]
            wall, cpu = time.perf_counter(), _CpuTime()
            measurement.value = call()
            measurement.cpu_times.append(_CpuTime() - cpu)
            measurement.wall_times.append(time.perf_counter() - wall)
    return measurements
