"""The reader on files that nobody has foreseen: no traceback, no silent guess.

What comes out is either a ScenarioError of one line, or the numbers of the file.
"""

import math
import string

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.tables import ReadPackets
from teleop_drake.model.tables.motion import ReadMotion

ALPHABET = string.printable + "\ufeffµüж\x00\x1c\u2028"
WORDS = (
    "time_s t rtt_ms delay v seq lost sent received stamp.sec stamp.nanosec NaN -1 inf "
    "1e999 2030-05-27T10:59:00Z 10:59:00 27.05.2030 1700000000123456789 -0.0 1,5 0x10 "
    '1_000 icmp_seq=70000 time=1 [1700000000.5] null " # % { [] ١٢'
)
PHRASES = [
    "",
    "x [mm]",
    "64 bytes from 1.1.1.1: icmp_seq=1 ttl=1 time=1.0 ms",
    "PING h (1.1.1.1) 56(84) bytes of data.",
    "2 packets transmitted, 1 received, 50% packet loss, time 9ms",
    "Reply from 1.1.1.1: bytes=32 time<1ms TTL=57",
    '{"round_trips": [{}]}',
    '[{"t_s": 1}]',
]
CELLS = st.one_of(
    st.sampled_from([*WORDS.split(), *PHRASES]),
    st.floats().map(repr),
    st.integers().map(str),
)
SEPARATORS = st.sampled_from([",", ";", "\t", " ", "|", ", "])
LINES = st.lists(st.lists(CELLS, max_size=4), max_size=8)
TABLES = st.builds(
    lambda lines, separator: "\n".join(separator.join(line) for line in lines),
    LINES,
    SEPARATORS,
)


PING = """\
PING h (192.0.2.1) 56(84) bytes of data.
[1700000000.010] 64 bytes from 192.0.2.1: icmp_seq=1 ttl=57 time=10.0 ms
[1700000000.230] 64 bytes from 192.0.2.1: icmp_seq=2 ttl=57 time=30.0 ms

--- h ping statistics ---
2 packets transmitted, 2 received, 0% packet loss, time 200ms
rtt min/avg/max/mdev = 10.0/20.0/30.0/0.5 ms
"""
WINDOWS = """
Pinging a.example [192.0.2.1] with 32 bytes of data:
Reply from 192.0.2.1: bytes=32 time=10ms TTL=57
Request timed out.
Reply from 192.0.2.1: bytes=32 time<1ms TTL=57

Ping statistics for 192.0.2.1:
    Packets: Sent = 3, Received = 2, Lost = 1 (33% loss),
"""
VALID = [
    PING,
    WINDOWS,
    "time_s,rtt_ms\n0,40\n0.1,NA\n0.2,60\n",
    "seq;sent [ms];received [ms]\n1;0,5;20,5\n3;200;\n4;300;330\n",
    "time,v_mm_s\n2030-05-27T10:59:00Z,1\n2030-05-27T10:59:00.5Z,2\n",
    "date,time,x_mm\n2030-05-27,23:59:59.9,1\n2030-05-28,00:00:00.1,2\n",
    "stamp.sec,stamp.nanosec,v\n1700000000,0,1\n1700000000,500000000,2\n",
    '[{"t_ms": 0, "v": [1]}, {"t_ms": 5, "v": [2]}]',
]


@st.composite
def Damaged(draw):
    """A valid file in which a few pieces are replaced, or a line is moved."""
    text = draw(st.sampled_from(VALID))
    for _ in range(draw(st.integers(1, 3))):
        begin = draw(st.integers(0, len(text)))
        end = begin + draw(st.integers(0, 4))
        text = text[:begin] + draw(CELLS | st.text(ALPHABET, max_size=3)) + text[end:]
    lines = text.split("\n")
    i = draw(st.integers(0, len(lines) - 1))
    lines.insert(draw(st.integers(0, len(lines) - 1)), lines.pop(i))
    return "\n".join(lines) if draw(st.booleans()) else text


def IsOneLine(call):
    """Calls a reader; returns what it reads, or None after an error of one line."""
    try:
        return call()
    except ScenarioError as error:
        assert str(error).count("\n") == 0 and str(error).startswith("f = ")
        return None


@given(st.one_of(Damaged(), TABLES, st.text(ALPHABET), st.binary()))
@example("time_s,rtt_ms\n0,1\n1,1_000\n")
@example("PING a\n64 bytes from 1.1.1.1: icmp_seq=99999999999999999999 time=1 ms\n")
@example("time_s,rtt_ms\n" + "9" * 400 + ",1\n1,1\n")
@example("seq,time_s,rtt_ms\n1e300,0,1\n2,1,1\n")
@example("time,rtt_ms\n2030-05-27T10:59:00Z,1\n9999-05-27T10:59:00Z,1\n")
@example(PING.replace("10.0/20.0/30.0", "10/1,234.5/30"))
@example("t;v\n[s];[m/s]\n")
@example('[{"10:59:00s": "4"}, {"time_s": "1", "rtt_ms": "x"}]')
@example(f'[{{"timestamp": {10**400}, "currentRoundTripTime": 1}}]')
@example(f'[{{"timestamp": {10**37}, "currentRoundTripTime": 1}}]')
@example("[[[]]]")
@example("[" * 100_000)
def test_there_is_no_traceback(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("f", numbered=True) / "a.txt"
    path.write_bytes(
        data if isinstance(data, bytes) else data.encode("utf-8", "replace")
    )
    packets = IsOneLine(lambda: ReadPackets("f", str(path)))
    if packets is not None:
        assert packets.times[0] == 0 and (np.diff(packets.times) >= 0).all()
        assert np.isfinite(packets.times).all() and not (packets.delays < 0).any()
        assert not np.isinf(packets.delays).any()
        assert packets.Summary().count("\n") == 0
    motion = IsOneLine(lambda: ReadMotion("f", str(path), 1))
    if motion is not None:
        assert (np.diff(motion.times) > 0).all() and motion.times[0] >= 0
        assert np.isfinite(motion.velocities).all()


ROWS = st.lists(
    st.tuples(st.integers(0, 10**6), st.one_of(st.none(), st.integers(1, 10**6))),
    min_size=2,
    max_size=20,
).filter(lambda rows: len({time for time, _ in rows}) > 1)
FORMS = st.fixed_dictionaries(
    {
        "separator": st.sampled_from([",", ";", "\t", " "]),
        "decimal": st.sampled_from([".", ","]),
        "lost": st.sampled_from(["NA", "timeout", "inf", "-1", "null"]),
        "is_quoted": st.booleans(),
        "time": st.sampled_from([("time_s", 1e-6), ("T [ms]", 1e-3), ("t_us", 1.0)]),
        "delay": st.sampled_from(
            [("rtt_ms", 2e-3), ("RTT (us)", 2.0), ("owd_s", 1e-6), ("delayMs", 1e-3)]
        ),
        "start": st.sampled_from([0, 1_700_000_000_000_000]),
    }
)


@given(ROWS, FORMS)
def test_each_form_of_a_table_has_the_same_numbers(tmp_path_factory, rows, form):
    """Times and delays in us, written in some unit, come back as they are."""
    if form["separator"] == "," and not form["is_quoted"]:
        form["decimal"] = "."
    head, unit = form["time"]
    name, delay_unit = form["delay"]

    def Cell(text):
        text = text.replace(".", form["decimal"])
        return f'"{text}"' if form["is_quoted"] else text

    rows = sorted(rows, key=lambda row: row[0])
    lines = [form["separator"].join(f'"{x}"' for x in (head, name))]
    for time, delay in rows:
        # Python's integers, because floats of stamps have no digits left.
        digits = round(-math.log10(unit))
        whole, rest = divmod(time + form["start"], 10**digits)
        stamp = f"{whole}.{rest:0{digits}d}" if digits else str(whole)
        late = form["lost"] if delay is None else f"{delay * delay_unit:.9f}"
        lines.append(form["separator"].join([Cell(stamp), Cell(late)]))
    path = tmp_path_factory.mktemp("f") / "a.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    if all(delay is None for _, delay in rows):
        return
    packets = ReadPackets("f", str(path))
    times = np.array([time for time, _ in rows]) * 1e-6
    assert_allclose(packets.times, times - times[0], rtol=0, atol=2e-10)
    delays = [np.nan if delay is None else delay * 1e-6 for _, delay in rows]
    assert_allclose(packets.delays, delays, rtol=0, atol=1e-9)
