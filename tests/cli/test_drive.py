"""The command `teleop-drake drive`."""

import base64
import json
import os
import signal
import socket
import subprocess
import sys
import time
from urllib.parse import urlsplit

import pytest

from teleop_drake.cli import main
from teleop_drake.cli.commands.drive import _MakeMeshcat
from teleop_drake.cli.server import Gate
from teleop_drake.recording import LoadRecording
from teleop_drake.scenario import LoadScenario

FAST = [
    *("--controller", "direct_force", "--set", "simulator.max_step_size=0.02"),
    *("--accuracy", "1e-7"),
]


@pytest.fixture(scope="module")
def taken_port():
    with socket.socket() as server:
        server.bind(("localhost", 0))
        server.listen()
        yield server.getsockname()[1]


def test_writes_what_was_driven(tmp_path, capsys):
    out = tmp_path / "out"
    options = ["--wait", "0", "--duration", "0.25", "--rate", "50", "--out", str(out)]
    assert main(["drive", "one_dof", *FAST, *options]) == 0
    printed = capsys.readouterr()
    assert "overshoot" in printed.out
    assert "Open http://localhost:" in printed.err
    assert sorted(x.name for x in out.iterdir()) == [
        f"drive_01.{suffix}" for suffix in ("csv", "npz", "yaml")
    ]
    # The scenario beside it repeats the run; the recording is one like any other.
    scenario = LoadScenario(out / "drive_01.yaml")
    assert scenario.surgeon.kind == "recorded"
    assert LoadRecording(out / "drive_01.npz").time[-1] == 0.25 == scenario.duration
    page = str(tmp_path / "page.html")
    assert main(["replay", str(out / "drive_01.npz"), "--out", page]) == 0
    capsys.readouterr()
    assert main(["run", str(out / "drive_01.yaml"), "--json", "-"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["metrics"]["start_velocity_overshoot"] == 0


def Request(gate, *, host=None, origin=None):
    """A WebSocket to a gate; its answer is not read."""
    place = urlsplit(gate.url)
    upgrade = socket.create_connection((place.hostname, place.port), timeout=20)
    headers = {
        "Host": host or place.netloc,
        "Origin": origin or f"http://{place.netloc}",
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": base64.b64encode(bytes(16)).decode(),
    }
    lines = ["GET / HTTP/1.1", *(f"{key}: {x}" for key, x in headers.items())]
    upgrade.sendall("\r\n".join([*lines, "", ""]).encode())
    return upgrade


@pytest.mark.slow  # Meshcat takes 12 s to end after a connection.
def test_only_its_own_page_reaches_meshcat():
    meshcat, place = _MakeMeshcat()
    gate = Gate(place, "localhost", None)
    for foreign in (
        {"origin": "http://example.org"},
        {"origin": "null"},
        {"host": "example.org:7000", "origin": "http://example.org:7000"},
    ):
        with Request(gate, **foreign) as socket_:
            assert socket_.recv(100).startswith(b"HTTP/1.1 403")
    assert meshcat.GetNumActiveConnections() == 0
    with Request(gate) as socket_:
        assert socket_.recv(100).startswith(b"HTTP/1.1 101")
        socket_.sendall(b"\x82\x80mask")  # An empty message.
        socket_.sendall(b"\x89\x80mask")  # A ping.
        received = b""
        while b"\x8a\x00" not in received:  # Its pong.
            received += socket_.recv(1 << 16)
        meshcat.AddButton("alive")
        assert meshcat.GetNumActiveConnections() == 1


def test_bad_input(taken_port, capsys):
    for options, message in (
        (["--port", str(taken_port)], f"--port = {taken_port}: must be a free port"),
        (["--port", "80"], "--port = '80': must be a whole number from 1024 to 65535"),
        (["--rate", "0"], "--rate = 0: must be > 0"),
        (["--wait", "-1"], "--wait = -1: must be >= 0 (s)"),
        (["--wait", "0.1"], "--wait = 0.1: must be a time in s in which a browser"),
        (["--wait", "0", "--gamepad"], "--wait = 0: must be a time in s in which a br"),
    ):
        assert main(["drive", "one_dof", *FAST, *options]) == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert message in lines[-1]
    assert main(["drive", "network_tracking_linear"]) == 2
    assert "there is no operator" in capsys.readouterr().err


def test_ctrl_c_ends_everything():
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "teleop_drake", "drive", "one_dof", *FAST]
    process = subprocess.Popen(
        [*command, "--port", str(port), "--wait", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("Open http://localhost:")
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    assert "overshoot" in out or "Nothing was driven" in out
    with socket.socket() as probe:  # Nobody serves there any more.
        assert probe.connect_ex(("localhost", port)) != 0
