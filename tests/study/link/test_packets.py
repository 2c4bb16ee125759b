"""Tests of teleop_drake.study.link.packets."""

import re
import stat
import struct

import numpy as np
import pytest
from documentation import ROOT
from grids import Slow

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.study.link import packets
from teleop_drake.study.link.packets import (
    NewKey,
    OpenSocket,
    ReadKey,
    Reason,
    Session,
)

KEY = bytes(range(32))


def Sessions(agreement=7):
    """Returns the sessions of an operator and a robot, which have not connected yet.

    The operator sends signals of 2 numbers, the robot signals of 3.
    """
    return Session(KEY, 0, 7, 3, "robot"), Session(KEY, 1, agreement, 2, None)


def Seal(session, now, tick=-1):
    values = np.arange(2.0 if session.address == "robot" else 3.0)
    used = np.arange(tick - 31, tick + 1).clip(-1)
    return session.Seal(now, values, start=100, tick=tick, used=used, ended=False)


def Introduced(operator, robot):
    """Returns the sessions after the connection; the robot's clock is 1000 ns ahead."""
    assert robot.Open(Seal(operator, 0), "operator", 1010).reason == Reason.HELLO
    assert operator.Open(Seal(robot, 1030), "robot", 40).reason is None
    assert robot.Open(Seal(operator, 50), "operator", 1060).reason is None
    assert operator.offset == -robot.offset == 1000
    return operator, robot


def test_the_layout_is_the_documented_one():
    text = (ROOT / "teleop_drake/docs/network.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| (\d+) \| (\w+) \| (.*) \|$", text, re.MULTILINE)
    operator, robot = Introduced(*Sessions())
    data = Seal(operator, 70, tick=4)
    ends = [int(begin) + int(size) for begin, size, _, _ in rows]
    assert [int(begin) for begin, *_ in rows] == [0, *ends[:-1]]
    assert ends[-1] + 8 * 2 + 16 == len(data)
    formats = {"bytes": "3s", "u8": "B", "u16": "H", "u64": "Q", "i64": "q"}
    fields = [
        struct.unpack_from("<" + formats.get(kind, "32i"), data, int(begin))
        for begin, _, kind, _ in rows
    ]
    assert fields[0] == (b"TDL",)
    assert [x[0] for x in fields[1:5]] == [1, 0, 0, 2]
    assert [x[0] for x in fields[7:14]] == [3, 70, 1030, 30, 7, 100, 4]
    assert fields[14] == (*[-1] * 27, 0, 1, 2, 3, 4)
    packet = robot.Open(data, "operator", 80).packet
    assert packet["values"].tolist() == [0, 1]
    assert packet["tick"] == 4


@pytest.mark.slow
@pytest.mark.parametrize("num", Slow([10_000, 100_000]))
def test_packets_that_are_not_meant_change_nothing(num):
    """Forged, truncated, replayed and old packets are rejected."""
    operator, robot = Introduced(*Sessions())
    random = np.random.default_rng(1)
    seen = [Seal(operator, 100 + k, tick=k) for k in range(100)]
    for k, data in enumerate(seen):
        assert robot.Open(data, "operator", 200 + k).packet["tick"] == k
    other = Introduced(*Sessions())[0]  # The same key, another session.
    seen += [Seal(other, 100 + k, tick=k) for k in range(100)]
    seen += [Seal(robot, 100)]  # The robot's own packet, sent back.
    before = vars(robot) | {"refused": None}
    for k in range(num):
        data = bytearray(seen[k % len(seen)])
        if k % 4 == 0:
            data[random.integers(len(data))] ^= 1 << int(random.integers(8))
        elif k % 4 == 1:
            del data[random.integers(len(data)) :]
        elif k % 4 == 2:
            data = random.bytes(int(random.integers(400)))
        assert robot.Open(bytes(data), "anybody", 1000).packet is None
    assert vars(robot) | {"refused": None} == before
    assert set(robot.refused) >= {"hash", "foreign", "old", "session", "own"}
    opened = robot.Open(Seal(operator, 300, tick=100), "operator", 400)
    assert opened.packet["tick"] == 100


def test_a_replay_to_a_process_that_was_started_anew():
    operator, robot = Introduced(*Sessions())
    seen = [Seal(operator, k, tick=k) for k in range(100)]
    operator, robot = Sessions()
    for data in seen:
        assert robot.Open(data, "anybody", 1).reason == Reason.HELLO
    assert robot.exchanges == 0
    assert robot.address is None
    # The packets of the new process are accepted nevertheless.
    Introduced(operator, robot)
    assert robot.address == "operator"


def test_what_does_not_count():
    operator, robot = Introduced(*Sessions())
    values = np.array([np.nan, 1.0])
    used = np.zeros(32, int)
    data = operator.Seal(70, values, start=100, tick=0, used=used, ended=False)
    assert robot.Open(data, "operator", 80).reason == Reason.VALUES
    operator, robot = Sessions(agreement=8)
    assert robot.Open(Seal(operator, 10), "operator", 20).reason == Reason.SCENARIO
    assert robot.refused == {"scenario": 1}


def test_the_version_is_looked_at_after_the_hash(monkeypatch):
    """Without the key, a sender cannot make a side report another version."""
    operator, robot = Sessions()
    forged = bytearray(Seal(operator, 10))
    forged[3] += 1
    assert robot.Open(bytes(forged), "anybody", 20).reason == Reason.HASH
    monkeypatch.setattr(packets, "_VERSION", packets._VERSION + 1)
    newer = Seal(operator, 30)
    monkeypatch.undo()
    assert robot.Open(newer, "operator", 40).reason == Reason.VERSION


def test_keys(tmp_path, subtests):
    file = tmp_path / "key"
    NewKey(str(file))
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert len(ReadKey(str(file))) == 32
    with pytest.raises(FileExistsError):
        NewKey(str(file))
    NewKey(str(tmp_path / "other"))
    assert ReadKey(str(file)) != ReadKey(str(tmp_path / "other"))
    file.chmod(0o640)
    with pytest.raises(ScenarioError, match=r"for its owner alone \(its mode is 640;"):
        ReadKey(str(file))
    file.chmod(0o600)
    for text in ("", "0" * 63, "x" * 64):
        with subtests.test(text=text):
            file.write_text(text)
            with pytest.raises(
                ScenarioError, match=r"key = .*: must be a file that `teleop"
            ):
                ReadKey(str(file))


@pytest.mark.parametrize("address", ["here", "localhost:", "127.0.0.1:99999", ":x"])
def test_addresses(address):
    with pytest.raises(ScenarioError, match=r"listen = '.*': must be HOST:PORT"):
        OpenSocket(address, listens=True)
