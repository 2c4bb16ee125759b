"""Tests of --channel: both channels from a file or by a name."""

import json

import pytest
import yaml

from teleop_drake.cli import main
from teleop_drake.cli.commands.sweep import PlanOf
from teleop_drake.cli.main import MakeParser

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")


def Channels(capsys, *options):
    """Returns the channels that `show` prints."""
    assert main(["show", "one_dof", "--duration", "1", *options]) == 0
    shown = yaml.safe_load(capsys.readouterr().out)
    return shown["forward_channel"], shown["return_channel"]


def test_a_kind_has_its_own_delay_unless_another_is_given(capsys):
    for channel in Channels(capsys, "--channel", "lte"):
        assert (channel["kind"], channel["delay"]) == ("lte", 0.0459)
    forward, back = Channels(
        capsys, "--channel", "wifi", "--delay", "0.2", "--set", "return_channel.seed=3"
    )
    assert (forward["delay"], forward["seed"]) == (0.2, 0)
    assert (back["delay"], back["seed"]) == (0.2, 3)


def test_a_file_has_the_fields_of_both(tmp_path, capsys):
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "t.csv").write_text("time_s,delay_s\n0,0.1\n9,0.1\n")
    (folder / "c.yaml").write_text("{kind: variable, delay: 0.05, trace: t.csv}\n")
    for channel in Channels(capsys, "--channel", "there/c.yaml"):
        assert (channel["kind"], channel["delay"]) == ("variable", 0.05)
        assert channel["trace"] == "there/t.csv"


def test_a_measured_trace_is_run_over_packets(tmp_path, capsys):
    (tmp_path / "ping.txt").write_text(
        "".join(
            f"64 bytes from 192.0.2.1: icmp_seq={k} ttl=56 time={40 + 20 * k} ms\n"
            for k in (0, 1, 3)
        )
    )
    options = [
        "one_dof",
        "--channel",
        "ping.txt",
        "--duration",
        "4",
        "--json",
        "a.json",
    ]
    options += ["--controller", "direct_force", "--accuracy", "1e-4", "--quiet"]
    assert main(["run", *options]) == 0
    headline = capsys.readouterr().out.splitlines()[0]
    half = "0 s and ping.txt (half of its round trips)"
    assert f"delay {half} forward, {half} back" in headline
    record = json.loads((tmp_path / "a.json").read_text("utf-8"))
    channel = record["channels"]["forward_channel"]
    assert channel["sent"] == 400
    assert channel["lost"] == 100  # The third second.
    assert channel["delay_minimum"] == pytest.approx(0.02)


def test_a_sweep_has_them_as_well():
    args = MakeParser().parse_args(
        ["sweep", "one_dof", "--channel", "lte", "--seeds", "2"]
    )
    assert PlanOf(args).overrides == [
        ("forward_channel", {"kind": "lte"}),
        ("return_channel", {"kind": "lte"}),
    ]


@pytest.mark.parametrize("given", ["ltee", "none.yaml", "bad.yaml", "none.csv"])
def test_what_is_no_channel_is_refused(given, tmp_path, capsys):
    (tmp_path / "bad.yaml").write_text("kind: nowhere\n")
    assert main(["show", "one_dof", "--channel", given]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"teleop-drake: error: --channel = {given!r}: must be")
    assert error.count("\n") == 1
