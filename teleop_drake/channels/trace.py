"""Measured delays, read from a file."""

import math
import re
from pathlib import Path

from teleop_drake.validation import ScenarioError, Show

# Anything else is a row, which may have a typing error.
_HEADER = re.compile(r"""\s*["']?[^\W\d_][^,]*(,\s*["']?[^\W\d_][^,]*)+""")


def ReadTrace(path: str, file: str) -> tuple[list[float], list[float]]:
    """Reads measured delays from a CSV file of time,delay.

    Its first line may be a header, all of whose columns begin with a letter.

    Args:
        path: The field that names the file, for messages.
        file: The file.

    Returns:
        Times and delays in s, at least two of each.

    Raises:
        ScenarioError: If the file cannot be read or a line is not allowed.
    """
    origin = f"{path} = {Show(file)}"
    try:
        # With a byte-order mark or without.
        lines = Path(file).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as e:
        reason = getattr(e, "strerror", None) or "not UTF-8 text"
        raise ScenarioError(f"{origin}: must be readable ({reason})") from None
    times: list[float] = []
    delays: list[float] = []
    may_be_header = True
    for i, line in enumerate(lines):
        if not line.strip() or line.startswith("#"):
            continue
        is_header = may_be_header and _HEADER.fullmatch(line)
        may_be_header = False
        try:
            time, delay = map(float, line.split(","))
        except ValueError:
            if is_header:
                continue
            raise ScenarioError(
                f"{origin}: line {i + 1}, {Show(line)}: must be time,delay in s"
            ) from None
        wrong = ""
        if not (math.isfinite(time) and math.isfinite(delay)):
            wrong = "finite numbers"
        elif times and time <= times[-1]:
            wrong = f"later than the line before, {times[-1]:g} s"
        elif delay < 0:
            wrong = "a delay >= 0 (s)"
        if wrong:
            raise ScenarioError(
                f"{origin}: line {i + 1}, {Show(line)}: must be {wrong}"
            )
        times.append(time)
        delays.append(delay)
    if len(times) < 2:
        raise ScenarioError(
            f"{origin}: must have at least two lines of time,delay, not {len(times)}"
        )
    return times, delays
