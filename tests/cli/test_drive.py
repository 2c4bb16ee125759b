"""The command `teleop-drake drive`."""

import json
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from teleop_drake.cli import main
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


def test_bad_input(taken_port, capsys):
    for options, message in (
        (["--port", str(taken_port)], f"--port = {taken_port}: must be free"),
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
