"""Makes the trace of delays trace_satellite.csv: `python -m league.traces`.

It looks like a constellation of satellites in low orbit, as a user at home sees it. A
network controller assigns satellites anew every 15 s (N. Mohan et al., A multifaceted
look at Starlink performance, WWW 2024), and the round trip jumps to another level,
which is between the quartiles 40 and 60 ms (F. Michel et al., A first look at Starlink
performance, IMC 2022). Assumed are gamma jitter of 3 ms standard deviation each way, no
packets for 0.1 s at each jump, and the first jump after 2 s.
"""

from pathlib import Path

import numpy as np

FILE = Path(__file__).with_name("trace_satellite.csv")
PERIOD = 0.02
DURATION = 32.0
FIRST_JUMP = 2.0
SLOT = 15.0
LOST = 0.1


def MakeTrace() -> str:
    """Returns the text of the file."""
    rng = np.random.default_rng(2024)
    times = np.arange(0.0, DURATION, PERIOD)
    since_jump = (times - FIRST_JUMP) % SLOT
    slot = np.floor((times - FIRST_JUMP) / SLOT).astype(int) + 1
    level = rng.uniform(0.020, 0.030, slot.max() + 1)[slot]
    shape = 4.0
    jitter = rng.gamma(shape, 0.003 / np.sqrt(shape), times.size)
    delays = level - 0.003 * np.sqrt(shape) + jitter
    comment = "# Made by traces.py, which names the sources of its numbers.\n"
    lines = [
        f"{time:.2f},lost\n" if after < LOST else f"{time:.2f},{1e3 * delay:.2f}\n"
        for time, after, delay in zip(times, since_jump, delays, strict=True)
    ]
    return comment + "time_s,delay_ms\n" + "".join(lines)


if __name__ == "__main__":
    FILE.write_text(MakeTrace(), encoding="utf-8")
