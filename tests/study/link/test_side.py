"""Tests of teleop_drake.study.link.side and .prediction, in simulated time."""

import numpy as np
import pytest
from grids import Slow
from link_networks import KEY, Fates, Network
from numpy.testing import assert_allclose

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.task_recording import LoadRecording
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.link.prediction import Compare, Predict, SaveRun
from teleop_drake.study.link.side import Side


def Scenario(kind="direct_force", name="one_dof", duration=1.0):
    return LoadScenario(name, {"controller.kind": kind, "duration": duration})


def Made(*options, fates=None, duration=1.0, **both):
    """Returns two sides and their network, which loses packets unless given fates."""
    network = Network(*(fates or map(Fates, (1, 2))))
    return network, network.MakeSides(Scenario(duration=duration), *options, **both)


def CheckPrediction(sides):
    """Checks that predictions from the packets in use agree with the recordings."""
    for side in sides:
        apart = Compare(side.Recording(), Predict(side))
        assert len(apart) == 2
        assert max(apart.values()) < 1e-6, apart


def CheckTraces(sides, folder):
    """Checks that the loop with the recorded traces agrees too, if nothing fades."""
    for side in sides:
        SaveRun(side, folder)
        scenario = LoadScenario(folder / f"{side.side}_predicted.yaml")
        predicted = simulate(scenario)
        recording = side.Recording()
        for name in [x for x in recording if "_packet_" in x]:
            expected = predicted.Interpolate(name, recording.time - 1e-9)
            span = np.maximum(np.ptp(expected, axis=0), 1e-9)
            # At time 0 the prediction has already received packets with delay 0.
            apart = np.abs(recording[name] - expected)[1:] / span
            assert apart.max() < 1e-3, name


RUNS = [
    ("direct_force", "one_dof", (1, 2)),
    ("adaptive_backstepping", "two_dof_combined", (3, 4)),
    ("wave_variables", "one_dof", (5, 6)),
    ("time_domain_passivity", "one_dof", (7, 8)),
    ("four_channel", "two_dof_collision", (9, 10)),
    ("smith_predictor", "one_dof", (11, 12)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "name", "seeds"), Slow(RUNS, but=(0,)))
def test_the_run_is_what_its_trace_predicts(kind, name, seeds, tmp_path, unrendered):
    """They agree within the accuracy of the solvers, although the clocks differ."""
    network = Network(*map(Fates, seeds), offsets=(10**15, 5))
    sides = network.MakeSides(Scenario(kind, name, duration=0.8))
    network.Run(sides)
    for side in sides:
        assert side.reason == ""
        report = side.Report()
        assert report["refused_packets"]["old"] > 80  # Late and doubled packets.
        assert report["unknown_periods"] == 0
        assert report["early_packets"] == {"forward": 0, "return": 0}
    CheckPrediction(sides)
    CheckTraces(sides, tmp_path)


@pytest.mark.slow
def test_the_delays_are_those_of_the_network():
    """They are exact in whole periods, except for the error of the robot's clock."""
    fates = Fates(0, delay=0.0203, std=0, loss=0), Fates(0, delay=0.0303, std=0, loss=0)
    network, sides = Made(fates=fates, duration=0.4)
    network.Run(sides, phase=0.0)
    for side in sides:
        forward, back = (side.measured.Delays()[way] for way in ("forward", "return"))
        assert np.isfinite(forward[:300]).all()
        # Half of 50.6 ms each, because only the round trip can be measured.
        assert forward[:300] == pytest.approx(0.026, abs=0.0011)
        assert forward[100] + back[100] == pytest.approx(0.0506, abs=0.0021)
        assert np.ptp(forward[:300]) == 0
        report = side.Report()  # Packets are read once a period.
        assert report["shortest_round_trip_s"] == pytest.approx(0.0516, abs=0.0011)
        assert report["round_trip_s"]["median"] == pytest.approx(0.0516, abs=0.0021)
        assert report["period_s"]["mean"] == pytest.approx(0.001)
        assert report["period_s"]["deviation"] < 1e-5


@pytest.mark.slow
def test_a_clock_that_drifts_makes_packets_early(tmp_path, unrendered):
    """The operator's clock jumps ahead of the robot's by more than the delay."""
    fates = Fates(0, delay=0.005, std=0, loss=0), Fates(2)
    network, sides = Made(fates=fates, duration=0.2)
    network.Run(sides, until=0.15)
    network.Skip(sides, 0, 0.02)
    network.Run(sides)
    assert sides[1].Report()["early_packets"]["forward"] > 10
    assert np.nanmin(sides[1].measured.Delays()["forward"]) < 0
    CheckPrediction(sides[1:])
    SaveRun(sides[1], tmp_path)
    trace = np.genfromtxt(tmp_path / "robot_forward.csv", delimiter=",")[1:, 1]
    assert np.nanmin(trace) == 0


def Cut(kind, begin, end, duration, name="one_dof"):
    """Returns the sides and their network after a run with a cut forward direction."""
    fates = Fates(0, delay=0.01, std=0, loss=0)
    network = Network(lambda k: [] if begin <= k < end else fates(k), fates)
    scenario = Scenario(kind, name, duration)
    sides = network.MakeSides(scenario, limit=0.1, fade=0.05, period=0.002)
    network.Run(sides)
    return sides, network


@pytest.mark.parametrize("kind", Slow([x[0] for x in RUNS], but=(0,)))
def test_the_robot_holds_its_place(kind):
    """It stays within 0.1 mm; with direct force and no hold it moves by 0.6 mm."""
    sides, _ = Cut(kind, 500, 850, 1.8)
    run = sides[1].Recording()
    ((begin, end),) = sides[1].Report()["outages_s"]
    held = run["tool_position"][(run.time > begin) & (run.time < end)]
    assert np.ptp(held) < 1e-4
    assert np.ptp(held[-100:]) < 5e-6
    force = run["applied_force"][run.time > 0.5]
    assert np.abs(np.diff(force, axis=0)).max() < 0.1 * np.ptp(force)


def test_what_is_too_old_fades_and_comes_back():
    """The forward direction is cut for 0.4 s: forces fall smoothly on both sides."""
    sides, network = Cut("wave_variables", 200, 400, 1.1)
    recording = sides[1].Recording()
    time = recording.time
    (wave, position) = recording["forward_packet_received"].T
    ((begin, end),) = sides[1].Report()["outages_s"]
    assert begin == pytest.approx(0.38 + 0.1, abs=0.03)
    assert end == pytest.approx(0.8, abs=0.03)
    silent = (time > begin + 0.06) & (time < end)
    assert np.all(wave[silent] == 0)
    assert np.ptp(position[silent]) == 0
    assert position[silent][0] == position[time < begin][-1] > 0
    assert abs(wave[time < begin][-1]) > 0.2 * np.abs(wave).max()
    # No change exceeds the share of one period in the fade, plus half for the signal.
    jump = np.abs(np.diff(wave))[time[1:] > 0.1].max()
    assert jump < 1.5 * np.abs(wave).max() * 0.002 / 0.05
    for side, lines in zip(sides, network.lines, strict=True):
        assert side.reason == ""
        assert len(side.Report()["outages_s"]) == 1
        assert lines[-2].endswith("forces fall to zero")
        assert lines[-1].endswith("forces come back")
    CheckPrediction(sides)


def test_who_is_left_alone_ends_safe():
    options = {"limit": 0.1, "fade": 0.05, "patience": 1, "period": 0.002}
    network, sides = Made(duration=3.0, **options)
    network.Run(sides, until=0.3)
    network.Run(sides, until=9.0, stopped=[0])
    assert sides[1].reason == "nothing was heard for 1 s"
    recording = sides[1].Recording()
    assert recording.termination == "interrupted"
    assert np.all(recording["forward_packet_received"][-250:] == 0)
    # The recording is complete.
    assert_allclose(np.diff(recording.time), 0.002)
    # The other side resumes after the end, when it receives nothing either.
    network.Run(sides)
    assert sides[0].reason in ("", "the other side has ended")


@pytest.mark.slow  # The next test covers this in the short run.
@pytest.mark.parametrize("stopped", [0, 1])
def test_one_that_slept_is_predicted_all_the_same(stopped, tmp_path, unrendered):
    """A side that is stopped for 0.2 s sends nothing, and keeps the packet in use."""
    network, sides = Made(duration=0.6, limit=1.0)
    network.Run(sides, until=0.2)
    network.Run(sides, until=0.4, stopped=[stopped])
    network.Run(sides)
    report = sides[stopped].Report()
    assert report["missed_periods"] == pytest.approx(200, abs=5)
    assert report["lateness_s"]["most"] == pytest.approx(0.2, abs=0.005)
    assert sides[1 - stopped].Report()["missed_periods"] == 0
    CheckPrediction(sides)
    CheckTraces(sides, tmp_path)


@pytest.mark.parametrize("stopped", Slow([1, 0]))
def test_forces_fade_after_a_sleep_that_is_longer_than_the_fade(stopped):
    """They fade over executed periods, starting from the packet in use before."""
    network, sides = Made(duration=0.9, limit=0.1, fade=0.05)
    network.Run(sides, until=0.4)
    network.Run(sides, until=0.7, stopped=[stopped])
    network.Run(sides)
    CheckPrediction(sides)
    recording = sides[stopped].Recording()
    received = recording[f"{sides[stopped].heard}_packet_received"]
    (awake,) = np.flatnonzero(np.diff(recording.time) > 0.2) + 1
    before = received[awake]  # Recorded before the next packet is fed.
    assert np.all(np.abs(before) > 1e-5)
    # The position, which is first in packets from the robot, is held.
    shares = 1 - np.arange(11)[:, np.newaxis] / 50 * [stopped, 1]
    assert_allclose(received[awake : awake + 11], before * shares)


def test_one_that_was_started_anew_is_another_one():
    """The robot does not continue with an operator that has just started."""
    network, sides = Made(duration=3.0, patience=0.7)
    network.Run(sides, until=0.3)
    sides[0] = network.MakeSides(Scenario(duration=3.0), patience=0.7)[0]
    network.Run(sides)
    assert [side.reason for side in sides] == ["nothing was heard for 0.7 s"] * 2
    assert len(sides[1].Report()["outages_s"]) == 1
    assert not sides[0].measured.Delays()["forward"].size


def test_only_the_robot_waits_for_as_long_as_it_takes():
    network, sides = Made(fates=[lambda k: []] * 2, patience=1.0)
    network.Run(sides, until=5.0)
    assert [side.reason for side in sides] == ["nothing was heard for 1 s", None]
    with pytest.raises(ConnectionError, match="no connection: nothing was heard"):
        sides[0].Run()


def test_both_have_the_same_period():
    network, sides = Made(({"period": 0.001}, {"period": 0.002}))
    network.Run(sides, until=0.2)
    line = "not heard: the other side's version, scenario or options differ"
    assert network.lines[1] == [line]
    assert not sides[1].measured.Delays()["forward"].size


def test_a_driver_of_ones_own():
    """It gets received packets; if it fails, the other side ends safely."""
    given = []

    def Step(t, packet):
        given.append((t, packet))
        if t > 0.3:
            raise OSError("the cable is out")
        return [0.002, 0.001]

    network, sides = Made(({"step": Step}, {}), duration=2.0)
    network.Run(sides)
    assert sides[0].reason == "OSError: the cable is out"
    recording = sides[0].Recording()
    assert recording.termination == "diverged"
    assert np.all(recording["forward_packet_sent"] == [0.002, 0.001])
    assert [x.shape for _, x in given] == [(2,)] * 302
    assert sides[1].reason == "the other side has ended"
    assert sides[1].tick < 450  # The side does not wait for the limit.
    received = sides[1].Recording()["forward_packet_received"]
    assert received[200].tolist() == [0.002, 0.001]
    assert np.all(received[-1] <= [0.00003, 0.000015])
    assert "the other side has ended: forces fall" in network.lines[1][-1]
    for values in ([1.0], [np.nan, 0.0]):
        network, sides = Made(({"step": lambda t, packet, x=values: x}, {}))
        network.Run(sides, until=0.5)
        assert "must send 2 finite numbers" in sides[0].reason
    with pytest.raises(ScenarioError, match=r"period = 0\.0: must be"):
        network.MakeSides(Scenario(), period=0.0)


@pytest.mark.slow
def test_files_and_a_prediction_that_is_wrong(tmp_path):
    """The files can be loaded as those of any run, and differences are found."""
    network, sides = Made(duration=0.3)
    network.Run(sides)
    side = sides[0]
    picture = tmp_path / "prediction.svg"
    assert set(SaveRun(side, tmp_path)["prediction"].values()) == {0.0}
    assert (tmp_path / "operator_prediction.png").stat().st_size > 10_000
    recording = LoadRecording(tmp_path / "operator.npz")
    predicted = Predict(side)
    Compare(recording, predicted, picture)
    text = picture.read_text(encoding="utf-8")
    for label in ("F_h x", "p_WT x", "v_WT x", "[mN]", "[µm]", "[mm/s]"):
        assert f"<!-- {label} -->" in text
    assert 0.009 < recording["packet_age"][-1, 0] < 0.05
    scenario = LoadScenario(tmp_path / "operator_predicted.yaml")
    assert AnalyzeStability(scenario).ToRecord()["operating_points"]
    predicted.signals["forward_packet_sent"] *= 3
    apart = Compare(recording, predicted)
    assert apart["return_packet_received"] == 0
    assert apart["forward_packet_sent"] == pytest.approx(2 / 3)


class Wire:
    """A fake socket with lists of the datagrams to receive and of those sent."""

    def __init__(self):
        self.inbox = []
        self.sent = []

    def recvfrom(self, size):
        if not self.inbox:
            raise BlockingIOError
        return self.inbox.pop(0)

    def sendto(self, data, address):
        self.sent.append((data, address))

    def close(self):
        pass


class Clock:
    """A clock whose time in ns a test sets."""

    def __init__(self):
        self.now = 1

    def __call__(self):
        return self.now


OPERATOR = ("10.0.0.1", 1)
ROBOT = ("10.0.0.2", 2)
VICTIM = ("10.0.0.3", 3)


class Pair:
    """The sides of an operator and a robot, between which a test delivers datagrams."""

    def __init__(self, *, robot_key=KEY, patience=5.0):
        self.clock = Clock()
        self.wires = Wire(), Wire()
        self.lines = [], []
        keys = KEY, robot_key
        self.operator, self.robot = (
            Side(
                Scenario(),
                name,
                keys[i],
                self.wires[i],
                ROBOT if name == "operator" else None,
                clock=self.clock,
                say=self.lines[i].append,
                patience=patience,
            )
            for i, name in enumerate(("operator", "robot"))
        )

    def Deliver(self):
        """Ticks both sides, and delivers their datagrams to each other."""
        caller, called = self.wires
        self.operator.Tick()
        called.inbox += [(data, OPERATOR) for data, _ in caller.sent]
        caller.sent.clear()
        self.robot.Tick()
        caller.inbox += [(data, ROBOT) for data, to in called.sent if to == OPERATOR]
        called.sent.clear()
        self.clock.now += 1_000_000


def test_a_hello_gets_one_answer():
    """A hello that is replayed with a forged address causes one packet to it."""
    pair = Pair()
    pair.operator.Tick()
    ((hello, _),) = pair.wires[0].sent
    for _ in range(3):
        pair.wires[1].inbox.append((hello, VICTIM))
        for _ in range(100):
            pair.robot.Tick()
            pair.clock.now += 1_000_000
    assert [address for _, address in pair.wires[1].sent] == [VICTIM] * 3
    # The true operator is connected nevertheless.
    pair.wires[1].sent.clear()
    for _ in range(15):
        pair.Deliver()
    assert "connected" in pair.lines[0][-1]
    assert "connected" in pair.lines[1][-1]


def test_a_wrong_key_is_reported_on_both_sides():
    pair = Pair(robot_key=bytes(32), patience=0.5)
    num_answers = 0
    while pair.operator.reason is None:
        pair.Deliver()
        num_answers += len(pair.wires[0].inbox)
    why = "10.0.0.2:2 reports that it has another key"
    line = "not heard: packets of 10.0.0.1:1 have another key"
    assert pair.lines == ([f"not heard: {why}"], [line])
    assert pair.operator.reason == f"nothing was heard for 0.5 s ({why})"
    # One notice in half a second.
    assert num_answers == 1
    assert pair.robot._session.refused["hash"] > 400


def test_a_caller_who_falls_silent_before_the_start_is_given_up():
    pair = Pair(patience=0.5)
    for _ in range(3):
        pair.Deliver()
    assert pair.robot._session.exchanges > 0
    for _ in range(600):
        if pair.robot.reason is None:
            pair.robot.Tick()
        pair.clock.now += 1_000_000
    assert pair.robot.reason == "nothing was heard for 0.5 s"


@pytest.mark.slow
def test_the_log_has_every_tick_while_the_side_runs(tmp_path):
    """It is complete even if the side does not end, as after a kill."""
    files = [tmp_path / f"{name}.csv" for name in ("operator", "robot")]
    options = [{"log_file": file} for file in files]
    network, sides = Made(options, duration=1.0)
    network.Run(sides, until=0.4)
    for side, file in zip(sides, files, strict=True):
        assert side.reason is None
        log = np.genfromtxt(file, delimiter=",", names=True)
        recording = side.Recording()
        assert_allclose(log["time_s"], recording.time, atol=1e-9)
        for name in ("packet_age", "round_trip", "period", "lateness"):
            measured = recording[name][:, 0]
            assert_allclose(log[f"{name}_s"], measured, rtol=1e-8)
        sent = recording[f"{side.spoken}_packet_sent"]
        for i in range(2):
            assert_allclose(log[f"sent_{i}"], sent[:, i], rtol=1e-8)
        ticks = [tick.tick for tick in side.measured.ticks]
        in_use = side.measured.used[side.heard][ticks]
        assert log["tick_of_packet_in_use"].tolist() == in_use.tolist()
    network.Run(sides)


class FullDisk:
    def write(self, line):
        raise OSError("no space left")

    def close(self):
        pass


def test_a_log_that_cannot_be_written_does_not_stop_the_loop():
    network, sides = Made(duration=0.3)
    sides[1]._log = FullDisk()
    network.Run(sides)
    assert [side.reason for side in sides] == ["", ""]
    assert "the log ends here: no space left" in network.lines[1]
