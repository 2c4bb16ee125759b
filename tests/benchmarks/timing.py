"""Fair timing on a machine that does other things as well.

Contenders take turns (A B A B ...) in one invocation, so that whatever slows the
machine slows all of them, and a comparison is the ratio of their medians. CPU time
counts, that of processes which a contender starts and ends included: wall time would
count what else the machine is doing.
"""

import gc
import resource
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


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
    """Calls the contenders in turn, each of them `repeats` times."""
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
