"""Tests of teleop_drake.study.link over sockets: loopback and network namespaces."""

import contextlib
import heapq
import itertools
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from link_networks import KEY, Fates

from teleop_drake.cli import main
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.task_recording import LoadRecording
from teleop_drake.study.link.packets import NewKey, OpenSocket
from teleop_drake.study.link.prediction import SaveRun
from teleop_drake.study.link.side import Side

OVERRIDES = {"controller.kind": "direct_force", "duration": 0.3}


def test_over_loopback(tmp_path, unrendered):
    """Both sides run in this process, where each delays the ticks of the other."""
    scenario = LoadScenario("one_dof", OVERRIDES)
    lines = []
    options = {"period": 0.002, "limit": 60, "say": lines.append}
    listening, _ = OpenSocket("127.0.0.1:0", listens=True)
    calling = OpenSocket(f"127.0.0.1:{listening.getsockname()[1]}", listens=False)
    sides = [
        Side(scenario, "operator", KEY, *calling, **options),
        robot := Side(scenario, "robot", KEY, listening, **options),
    ]
    for _ in range(300):  # At most 256 are read in a period.
        calling[0].sendto(b"x", listening.getsockname())
    robot.Tick()
    assert robot._session.refused["foreign"] == 256
    while running := [side for side in sides if side.reason is None]:
        due = min(running, key=lambda side: side.next_time)
        time.sleep(max(due.next_time - time.monotonic_ns(), 0) * 1e-9)
        due.Tick()
    for side in sides:
        assert side.reason == "", lines
        report = SaveRun(side, tmp_path)
        # If a busy machine misses many periods, the solver takes other steps.
        assert max(report["prediction"].values()) < 5e-6
        assert not report["outages_s"]  # The end of a complete run is no outage.


SERVE = ["serve", "one_dof", "--listen"]
OPERATE = ["operate", "one_dof", "--connect"]
BAD = [
    ([*SERVE, "x", "--key", "KEY"], "listen = 'x': must be HOST:PORT"),
    (
        [*SERVE, "0:1", "--key", "none"],
        "key = 'none': must be a file that `teleop-drake serve --new-key",
    ),
    ([*OPERATE[:2], "--key", "KEY"], "required: --connect"),
    ([*OPERATE, "0:9", "--key", "KEY", "--period", "0"], "period = 0.0: must be a fin"),
]


@pytest.mark.parametrize(("arguments", "message"), BAD)
def test_bad_input(arguments, message, tmp_path, capsys):
    key = str(tmp_path / "key")
    with pytest.raises(SystemExit, match="0"):
        main(["serve", "--new-key", key])
    capsys.readouterr()
    assert main([key if x == "KEY" else x for x in arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert main(["serve", "--new-key", key]) == 2
    assert "must be a new file that can be written (File ex" in capsys.readouterr().err


class Loop:
    """The commands `serve` and `operate`, each in its own process."""

    def __init__(self, folder, *more, prefixes=((), ())):
        NewKey(str(folder / "key"))
        self._folder = folder
        self._prefixes = prefixes
        self.processes = {}
        self._more = [*more, "--period", "0.002", "--key", folder / "key"]
        self._more += ["--set", "controller.kind=direct_force"]

    def Start(self, command, option, address):
        arguments = [command, "one_dof", option, address, *self._more]
        self.processes[command] = subprocess.Popen(
            [
                *self._prefixes[command == "serve"],
                *(sys.executable, "-m", "teleop_drake", *arguments),
                *("--out", self._folder / command),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        return self.processes[command]

    def Serve(self, address="127.0.0.1:0"):
        """Starts `serve`; returns the address at which it listens."""
        server = self.Start("serve", "--listen", address)
        return server.stderr.readline().split()[-1]

    def Report(self, command):
        """Waits for the end of a side, and returns its report."""
        _, errors = self.processes[command].communicate(timeout=60)
        assert "Traceback" not in errors, errors
        name = {"serve": "robot", "operate": "operator"}[command]
        recording = LoadRecording(self._folder / command / f"{name}.npz")
        report = json.loads((self._folder / command / f"{name}.json").read_text())
        assert recording.time[-1] == pytest.approx(report["duration_s"])
        return report


def IsPredicted(report):
    """Returns whether the prediction agrees.

    On a busy machine, a gap may be so long that some packets in use are not known.
    """
    limit = 0.02 if report["unknown_periods"] else 1e-4
    return max(report["prediction"].values()) < limit


def NumOutages(report):
    """Returns the number of outages; those within 0.2 s count as one.

    On a busy machine, a process that goes on may be late once more.
    """
    if not report["outages_s"]:
        return 0
    begins, ends = np.transpose(report["outages_s"])
    between = begins[1:] - ends[:-1]
    return 1 + int(np.sum(between > 0.2))


def Relay(server, operator, fates, process):
    """Relays datagrams with given fates until a process ends, and sends forged ones."""
    queue = []
    counts = [0, 0]
    targets = [server, None]
    other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    # A socket of its own, so that notices of a wrong key do not reach the relay.
    forger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    forged = np.random.default_rng(1)
    with operator, other, forger:
        sockets = operator, other
        for end in sockets:
            end.setblocking(False)
        while process.poll() is None:
            for k in range(20):
                data = b"TDL\x01" + forged.bytes(220)
                forger.sendto(data[: None if k % 2 else sum(counts) % 224], server)
            for i, end in enumerate(sockets):
                with contextlib.suppress(BlockingIOError):
                    data, source = end.recvfrom(2048)
                    targets[1] = source if i == 0 else targets[1]
                    for delay in fates[i](counts[i]):
                        at = time.monotonic() + delay
                        heapq.heappush(queue, (at, counts[i], i, data))
                    counts[i] += 1
            while queue and queue[0][0] <= time.monotonic():
                *_, i, data = heapq.heappop(queue)
                sockets[1 - i].sendto(data, targets[i])
            time.sleep(0.0005)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_through_a_relay_with_forged_packets(seed, tmp_path):
    loop = Loop(tmp_path, "--duration", "3")
    host, port = loop.Serve().split(":")
    operator = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    operator.bind(("127.0.0.1", 0))
    address = "{}:{}".format(*operator.getsockname())
    process = loop.Start("operate", "--connect", address)
    fates = map(Fates, (seed, 11))
    Relay((host, int(port)), operator, [*fates], process)
    for command in ("operate", "serve"):
        report = loop.Report(command)
        assert report["refused_packets"]["old"] > 10
        assert report["round_trip_s"]["median"] > 0.02
        assert IsPredicted(report)
        # On a busy machine, the relay may be late for a moment.
        assert sum(end - begin for begin, end in report["outages_s"]) < 0.3
        assert report["termination"] == "completed" or command == "serve"
    assert report["refused_packets"]["hash"] > 10_000


@pytest.mark.slow
def test_kills_at_random_times(tmp_path):
    print("seed", seed := random.randrange(2**32))
    draw = random.Random(seed)
    numbers = signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGSTOP
    for victim, number in itertools.product(("serve", "operate"), numbers):
        (folder := tmp_path / f"{victim}-{number.name}").mkdir()
        loop = Loop(folder, "--duration", "4")
        loop.Start("operate", "--connect", loop.Serve())
        process = loop.processes[victim]
        other = "operate" if victim == "serve" else "serve"
        assert "connected" in loop.processes["serve"].stderr.readline()
        time.sleep(draw.uniform(0, 2))
        process.send_signal(number)
        time.sleep(draw.uniform(0.6, 1))
        process.send_signal(signal.SIGCONT)
        left = loop.Report(other)
        if number == signal.SIGSTOP:
            assert NumOutages(left) == 1
            assert left["termination"] == "completed"
            assert loop.Report(victim)["missed_periods"] > 200
        elif number == signal.SIGKILL:
            assert left["outages_s"]
            process.communicate(timeout=60)
            assert process.returncode == -signal.SIGKILL
            name = {"serve": "robot", "operate": "operator"}[victim]
            log = np.genfromtxt(
                folder / victim / f"{name}_log.csv", delimiter=",", names=True
            )
            assert np.all(np.diff(log["time_s"]) > 0)
        else:
            assert left["reason"] == "the other side has ended"
            killed = loop.Report(victim)
            assert killed["reason"] == "interrupted by the user"
            assert killed["termination"] == "interrupted"


NAMES = "teleop-drake-a", "teleop-drake-b"


@pytest.fixture(params=["wire", "netem"])
def namespaces(request):
    """Two connected network namespaces; with netem, 20 ms of delay and 2 % of loss."""
    if os.geteuid() or not (shutil.which("ip") and shutil.which("tc")):
        pytest.skip("namespaces need root, ip and tc")
    commands = [f"ip netns add {name}" for name in NAMES]
    commands += [
        "ip link add tdl0 netns {} type veth peer tdl1 netns {}".format(*NAMES)
    ]
    for i, name in enumerate(NAMES):
        commands += [f"ip -n {name} address add 10.231.7.{i + 1}/24 dev tdl{i}"]
        commands += [f"ip -n {name} link set tdl{i} up"]
        netem = f"tc -n {name} qdisc add dev tdl{i} root netem delay 20ms 4ms loss 2%"
        commands += [netem] * (request.param == "netem")
    try:
        for command in commands:
            made = subprocess.run(
                command.split(), capture_output=True, check=False, text=True
            )
            if made.returncode:
                pytest.skip(f"`{command}` says: {made.stderr.strip()}")
        yield request.param, [("ip", "netns", "exec", name) for name in NAMES]
    finally:
        for name in NAMES:
            subprocess.run(
                ["ip", "netns", "delete", name], capture_output=True, check=False
            )


@pytest.mark.slow
@pytest.mark.xdist_group("namespaces")  # Both tests use the same names.
def test_through_the_network_of_the_kernel(namespaces, tmp_path):
    kind, prefixes = namespaces
    loop = Loop(tmp_path, "--duration", "2", prefixes=prefixes)
    loop.Serve("10.231.7.2:47800")
    loop.Start("operate", "--connect", "10.231.7.2:47800")
    for command in ("operate", "serve"):
        report = loop.Report(command)
        assert report["termination"] == "completed"
        assert (report["shortest_round_trip_s"] > 0.025) == (kind == "netem")
        assert IsPredicted(report)
