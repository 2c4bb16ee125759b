"""Packets in tables: small files of our own making, in every form that people have."""

import json

import pytest
from numpy.testing import assert_allclose

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.tables import ReadPackets

LOST = float("nan")
NS = 1_700_000_000_000_000_000


def read(tmp_path, text, **given):
    path = tmp_path / "trace.csv"
    path.write_text(text, encoding="utf-8")
    return ReadPackets("trace", {"file": str(path), **given} if given else str(path))


def check(packets, times, delays):
    assert packets.times.tolist() == pytest.approx(times, abs=1e-9)
    assert_allclose(packets.delays, delays, rtol=0, atol=1e-9)


# The delays are 20 ms, lost, 30 ms; the packets are 0.1 s apart.
TIMES = [0, 0.1, 0.2]
DELAYS = [0.02, LOST, 0.03]
DIALECTS = {
    "CSV": "time_s,delay_s\n0,0.02\n0.1,lost\n0.2,0.03\n",
    "a byte-order mark": "\ufefftime_s,delay_ms\n0,20\n0.1,nan\n0.2,30\n",
    "comments and empty lines": "# at\n\ntime_s,delay_ms\n7,20\n% x\n7.1,\n7.2,30\n",
    "semicolons and decimal commas": "time_s;rtt_ms\n0,0;40,0\n0,1;NA\n0,2;60,0\n",
    "tabs": "time_ms\tdelay_us\n0\t20000\n100\ttimeout\n200\t30000\n",
    "bars": "time_ms|delay_us\n0|20000\n100|null\n200|30000\n",
    "blanks, decimal commas": "time_s delay_ms\n0,0 20,0\n0,1 inf\n0,2 30,0\n",
    "a header in a comment": "# time_s delay_ms\n0 20\n0.1 nan\n0.2 30\n",
    "quotes": '"Time [s]","RTT [ms]"\n"0","40,0"\n"0,1","NA"\n"0,2","60,0"\n',
    "units in parentheses": "Time (ms),Round trip (us)\n0,40000\n100,*\n200,60000\n",
    "units in camel case": "sendTimeMs,rttUs\n0,40000\n100,-1\n200,60000\n",
    "a line of units": "time;rtt\n[s];[ms]\n0;40\n0.1;-\n0.2;60\n",
    "stamps in s": f"stamp,rtt_ms\n{NS / 1e9:.1f},40\n{NS / 1e9 + 0.1:.1f},-1\n"
    f"{NS / 1e9 + 0.2:.1f},60\n",
    "stamps in ms": f"ts,rtt_ms\n{NS // 10**6},40\n{NS // 10**6 + 100},None\n"
    f"{NS // 10**6 + 200},60\n",
    "stamps in ns": f"ts,rtt_ms\n{NS},40\n{NS + 10**8},?\n{NS + 2 * 10**8},60\n",
    "stamps of ROS": "stamp.sec,stamp.nanosec,delay_ms\n7,900000000,20\n"
    "8,0,lost\n8,100000000,30\n",
    "ISO 8601 with a zone": "time,rtt_ms,by\n2030-05-27T23:59:59.9-04:00,40,x\n"
    "2030-05-28T00:00:00-04:00,Lost,x\n2030-05-28T00:00:00.1-04:00,60,x\n",
    "dates of UTC": "date,rtt_ms\n2030-05-27 10:59:59.9 UTC,40\n"
    "2030-05-27 11:00:00 UTC,no reply\n2030-05-27 11:00:00.1 UTC,60\n",
    "a date and a time of day": "date,time,rtt_ms\n2030-05-27,23:59:59.9,40\n"
    "2030-05-28,00:00:00.0,timed out\n2030-05-28,00:00:00.1,60\n",
    "a time of day, over midnight": "time,rtt_ms\n23:59:59.9,40\n00:00:00,\n"
    "00:00:00.1,60\n",
    "a time of day before and after noon": "time,rtt_ms\n11:59:59.9 AM,40\n"
    "12:00:00 PM,\n12:00:00.1 PM,60\n",
    "sent and received": f"sent_ns,received_ns\n{NS},{NS + 20_000_000}\n"
    f"{NS + 10**8},\n{NS + 2 * 10**8},{NS + 230_000_000}\n",
    "sent and received as dates": "tx,rx\n"
    "2030-05-27T10:00:00Z,2030-05-27T10:00:00.020Z\n"
    "2030-05-27T10:00:00.1Z,NA\n2030-05-27T10:00:00.2Z,2030-05-27T10:00:00.230Z\n",
    "received, with -1": f"sent_ns,received_ns\n{NS},{NS + 20_000_000}\n"
    f"{NS + 10**8},-1\n{NS + 2 * 10**8},{NS + 230_000_000}\n",
    "sent and received around midnight": "sent,received\n"
    "23:59:59.9,23:59:59.92\n00:00:00,NA\n00:00:00.1,00:00:00.13\n",
    "zones of hours": "time,rtt_ms\n2030-05-27 10:59:59.9+02,40\n"
    "2030-05-27 11:00:00+02,lost\n2030-05-27 11:00:00.1+02,60\n",
    "Excel's separator and word": "sep=;\ntime_s;rtt_ms\n0,0;40\n0,1;#N/A\n0,2;60\n",
    "blanks in names": "Time [s]  RTT [ms]\n0  40\n0.1  nan\n0.2  60\n",
    "capital letters": "TIME_S,RTT_MS\n0,40\n0.1,NA\n0.2,60\n",
    "a column of answers": "time_ms,rtt_ms,ok\n0,40,1\n100,0,0\n200,60,1\n",
    "received or not": "time_ms,rtt_ms,received\n0,40,yes\n100,0,no\n200,60,yes\n",
    "a status": "time_ms,rtt_ms,status\n0,40,ok\n100,9999,timeout\n200,60,ok\n",
    "a status of something else": "time_ms,rtt_ms,status\n0,40,LTE\n100,NA,-\n"
    "200,60,LTE\n",
    "numbers with a gap": "seq,time_ms,rtt_ms\n65535,0,40\n1,200,60\n",
    "a column of losses": "time_ms,rtt_ms,lost\n0,40,false\n100,0,true\n200,60,false\n",
    "JSON": json.dumps(
        [
            {"t_ms": 0, "owd_ms": 20},
            {"t_ms": 100, "owd_ms": None},
            {"t_ms": 200, "owd_ms": 30},
        ]
    ),
    "lines of JSON": '{"t_ms": 0, "net": {"rtt_ms": 40}}\n'
    '{"t_ms": 100, "net": {"rtt_ms": null}}\n{"t_ms": 200, "net": {"rtt_ms": 60}}\n',
    "irtt": json.dumps(
        {
            "round_trips": [
                {
                    "seqno": i,
                    "lost": "true_down" if rtt is None else "false",
                    "timestamps": {"client": {"send": {"wall": NS + i * 10**8}}},
                    "delay": {} if rtt is None else {"rtt": rtt * 10**6},
                }
                for i, rtt in enumerate([40, None, 60])
            ]
        }
    ),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_dialect(dialect, tmp_path):
    check(read(tmp_path, DIALECTS[dialect]), TIMES, DELAYS)


@pytest.mark.parametrize(
    "word",
    ["NA", "n/a", "timeout", "null", "None", "inf", "-1", "NaN", "", "lost", "*"],
)
def test_words_for_lost(word, tmp_path):
    check(read(tmp_path, f"time_s,delay_ms\n0,20\n0.1,{word}\n0.2,30\n"), TIMES, DELAYS)


def test_rows_by_arrival_are_put_in_order(tmp_path):
    """Packet 2 overtakes packet 1: it is above it in the log of the receiver."""
    text = "time_ms,delay_ms\n0,10\n20,15\n10,40\n30,30\n"
    check(read(tmp_path, text), [0, 0.01, 0.02, 0.03], [0.01, 0.04, 0.015, 0.03])


def test_packets_of_one_instant_stay_apart(tmp_path):
    text = "time_s,delay_ms\n0.00,41.2\n0.00,41.3\n0.01,40.8\n"
    check(read(tmp_path, text), [0, 0, 0.01], [0.0412, 0.0413, 0.0408])


def Pair(name, is_nominated, i, rtt):
    """A record of WebRTC, of the pair of addresses in use or of another one."""
    return {
        "id": name,
        "nominated": is_nominated,
        "timestamp": 1.7e12 + 1e3 * i,
        "currentRoundTripTime": rtt,
    }


def Iperf(*round_trips, **fields):
    """Intervals of iperf3 with round trips in us."""
    return [
        {"streams": [{"start": i, "end": i + 1, "rtt": rtt, **fields}]}
        for i, rtt in enumerate(round_trips)
    ]


REPORTS = [
    {"intervals": Iperf(40_000, 60_000)},
    [{"event": "interval", "data": x} for x in Iperf(40_000, 60_000)],
    {"intervals": Iperf(9, 9, omitted=True) + Iperf(40_000, 60_000, omitted=False)},
    [[Pair("a", True, i, 0.04 + 0.02 * i), Pair("b", False, i, 9)] for i in range(2)],
    [
        [
            {"type": "codec", "timestamp": 1e12 + 1e3 * i},
            {
                "type": "candidate-pair",
                "timestamp": 1.7e12 + 1e3 * i,
                "currentRoundTripTime": 0.04 + 0.02 * i,
            },
        ]
        for i in range(2)
    ],
]


@pytest.mark.parametrize(
    "report",
    REPORTS,
    ids=["iperf3", "--json-stream", "iperf3 -O", "two pairs", "WebRTC"],
)
def test_the_json_of_a_tool(report, tmp_path):
    check(read(tmp_path, json.dumps(report)), [0, 1], [0.02, 0.03])


def test_a_user_names_columns_and_units(tmp_path):
    text = "stamp,host,RTT\n0,a,40\n100,a,x\n200,a,60\n".replace("x", "NA")
    columns = {"time": "Stamp", "rtt": 3}
    units = {"time": "ms", "rtt": "ms"}
    packets = read(tmp_path, text, columns=columns, units=units)
    check(packets, TIMES, DELAYS)
    assert packets.Summary() == (
        "3 packets in 0.2 s, 1 lost, median 25 ms, 20 to 30 ms (half of rtt), clock: "
        "seconds"
    )
    # Of two delays the one that is named, else the one way.
    text = "time_s,delay_ms,rtt_ms\n0,20,50\n1,20,50\n"
    assert read(tmp_path, text).delays.tolist() == [0.02, 0.02]
    assert read(tmp_path, text, columns={"rtt": "rtt_ms"}).delays[0] == 0.025


HEAD = "time_s,delay_ms\n"
UNCLEAR = [
    # What is not told is asked for, with the line that tells it.
    (
        "time,delay_ms\n0,1\n1,1\n",
        "columns 'time', 'delay_ms': 'time' must have a unit; write {file: ..., units: "
        "{time: s}}, with s, ms, us or ns",
    ),
    (
        "time_s,rtt\n0,1\n1,1\n",
        "'time_s', 'rtt': 'rtt' must have a unit; write {file: ..., units: {rtt: ms}}",
    ),
    (
        "time_s,rtt [furlong]\n0,1\n1,1\n",
        "'rtt [furlong]' must have a unit of time, not 'furlong'; write {file: ..., un",
    ),
    ("time_s,delay_m\n0,1\n1,1\n", "'delay_m' must have a unit of time, not 'm'; wr"),
    ("time [min],rtt_ms\n0,1\n1,1\n", "'time [min]' must have a unit of time, not "),
    ("time_s,rtt (1/min)\n0,1\n1,1\n", "must have a unit of time, not '1/min'; wri"),
    ("time_s,rtt_std_ms\n0,1\n1,1\n", "must have a delay (delay, rtt or received); "),
    ("time_s,max_delay_ms\n0,1\n1,1\n", "must have a delay (delay, rtt or received"),
    (
        "sent,received\n1700000000000,1700000000000000\n1700000000009,1\n",
        "columns 'sent', 'received': times up to 1.7e+15: must have a unit, in the",
    ),
    # Clocks that are none since 1970: of a computer's start, and of Windows.
    ("t,rtt_ms\n2000000000000,1\n2000100000000,1\n", "times up to 2.0001e+12: must "),
    ("t,rtt_ms\n133444736000000000,1\n133444736001000000,1\n", "must have a unit, in"),
    ("time;rtt_ms\n[s];[us]\n0;1\n1;1\n", "must have one unit, not ms and us"),
    ('time_s,rtt_us\n"0","1,234"\n"1","2,345"\n', "'1,234': must be clear, and may "),
    ('time_s,rtt_ms\n0,"4\n1,5\n', "line 2, '\"4': must be a finite number"),
    (
        "time_s,latency_ms\n0,1\n1,1\n",
        "'latency_ms' may be one way or there and back; write {file: ..., columns: "
        "{time: 'time_s', rtt: 'latency_ms'}}, or with delay for rtt",
    ),
    (
        "0,0.1\n1,0.1\n",
        "columns '1', '2' (no header): must have the time when a packet was sent; "
        "write {file: ..., columns: {time: '1', rtt: '2'}, units: {time: s, rtt: ms}}",
    ),
    ("a,b\n0,1\n1,1\n", "columns 'a', 'b': must have the time when a packet was sent"),
    (
        "stamp,elapsed_s,rtt_ms\n0,0,1\n1,1,1\n",
        "columns 'stamp', 'elapsed_s': must be one for time; write {file: ..., "
        "columns: {time: 'stamp'",
    ),
    ("sent_ms,received_us\n0,1\n1,1\n", "must have one unit, not 'ms' and 'us'"),
    # What cannot be true is refused.
    (f"{HEAD}0,1\n1,-3\n", "line 3: must be a delay >= 0, not -0.003 s; the clocks of"),
    ("time_s,rtt_ms\n0,1\n1,-3\n", "line 3: must be a delay >= 0, not -0.0015 s"),
    (
        f"{HEAD}0,1\n3600,1\n5,1\n",
        "line 4: must not be earlier than the line before, a",
    ),
    (f"{HEAD}0,1e400\n1,1\n", "column 'delay_ms': line 2, '1e400': must be a finite"),
    (
        f"{HEAD}O.0,1\n1,1\n",
        "column 'time_s': line 2, 'O.0': must be a finite number, ",
    ),
    (
        f"{HEAD}nan,1\n1,1\n",
        "column 'time_s': line 2, 'nan': must be a finite number, ",
    ),
    (f"{HEAD}0,1\n2\n", "line 3, '2': must have 2 cells, time_s, delay_ms, and has 1"),
    (f"{HEAD}0,1\n1,2,3\n", "line 3, '1,2,3': must have 2 cells"),
    (f"{HEAD}0,1\n", "must have two packets, and has 1"),
    (f"{HEAD}0,1\n0,1\n", "must have packets that were sent at different times"),
    (HEAD, "must have rows, and has only a header"),
    ("", "must have rows, and has none"),
    ("time_s,time_s\n0,1\n1,1\n", "column 'time_s': must be named once, not 2 times"),
    (f"time_s,delay_ms\n{NS // 10**6},1\n1,1\n", "must be shorter than 300 years"),
    (
        f"time_s,delay_ms\n{NS // 10**6},1\n{NS // 10**6 + 9},1\n",
        "must be shorter than 300 years; in ms they would be times since 1970",
    ),
    (
        "time,rtt_ms\n27.05.2030 10:59,1\n27.05.2030 11:00,1\n",
        "'27.05.2030 10:59': must",
    ),
    (
        "time,rtt_ms\n2030-05-27T10:59:00Z,1\n2030-05-27T10:59:01,1\n",
        "'2030-05-27T10:59:01': must be ISO 8601 with a zone, as in the first row",
    ),
    (
        "time,rtt_ms\n2030-05-27T10:59:00Z,1\n2030-13-27T10:59:01Z,1\n",
        "'2030-13-27T10:",
    ),
    ("time,rtt_ms\n10:59:00,1\n10:61:00,1\n", "'10:61:00': must be a time of day"),
    ("time_s,rtt_ms,lost\n0,1,maybe\n1,1,no\n", "'maybe': must be true or false"),
    ("seq,time_s,rtt_ms\n1.5,0,1\n2,1,1\n", "packet numbers: must be whole numbers"),
    (
        "seq,time_s,rtt_ms\n" + "".join(f"{10 * i},{i},1\n" for i in range(8)),
        "packet numbers: must count by 1, not by 10 or more",
    ),
    (
        "seq,time_s,rtt_ms\n" + "".join(f"{i % 4},{i},1\n" for i in range(8)),
        "packet numbers: must count on, and begin anew; split the file there",
    ),
    ("seq,time_s,rtt_ms\n1,0,1\n900,1,1\n", "packet numbers: must have fewer gaps"),
    ('{"round_trips": []}', "must have delays of packets: irtt client"),
    ('{"intervals": [{"streams": [{}]}]}', "iperf3 has round trips only of TCP"),
    (json.dumps({"intervals": Iperf(0, 0)}), "rtt: must be >= 0, and not always 0"),
    (
        json.dumps([[Pair(name, True, i, 0.1) for name in "ab"] for i in range(2)]),
        "candidate pairs a, b: must have one at a time that is nominated",
    ),
    ("{}", "must be a list of records, or named lists of one length"),
    ("[1, 2]", "must be a list of records, or named lists of one length"),
]


@pytest.mark.parametrize(("text", "message"), UNCLEAR)
def test_what_is_unclear_is_asked_for(text, message, tmp_path):
    with pytest.raises(ScenarioError) as error:
        read(tmp_path, text)
    assert str(error.value).startswith("trace = ")
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"colums": {}}, "trace.colums = {}: must be left out: one of file, columns"),
        ({"columns": ["a"]}, "trace.columns = ['a']: must be a mapping of time, rtt"),
        ({"columns": {"tim": 1}}, "trace.columns.tim = 1: must be one of time, rtt, "),
        (
            {"columns": {"rtt": 3}},
            "column 3: must be one of time_s, delay_ms, or a num",
        ),
        (
            {"columns": {"rtt": "x"}},
            "column 'x': must be one of time_s, delay_ms, or a",
        ),
        ({"interval": 0.2}, "trace.interval = 0.2: must be left out where a table is"),
        ({"units": {"rtt": "min"}}, "trace.units.rtt = 'min': must be one of s, sec"),
    ],
)
def test_what_a_user_names_is_checked(given, message, tmp_path):
    with pytest.raises(ScenarioError) as error:
        read(tmp_path, f"{HEAD}0,1\n1,1\n", **given)
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("given", [None, 3, {"columns": {}}, {"file": 3}])
def test_a_file_is_a_path_or_a_mapping(given):
    with pytest.raises(ScenarioError, match=r"must be a file, or a mapping \{file"):
        ReadPackets("trace", given)
