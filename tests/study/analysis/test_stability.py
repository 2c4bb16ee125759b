"""Tests of analysis.stability: closed forms, collocation, and runs of the diagram."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_allclose

from teleop_drake.loops.numerics.characteristic_roots import characteristic_roots
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.analysis.operating_point import (
    POSITION,
    OperatingPointAt,
    OperatingPoints,
    PointOfRest,
)
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.analysis.stability_chart import ChartStability
from teleop_drake.study.numerics.delay_margin import is_delay_robust

# The tests share analyses, and therefore run in one process.
pytestmark = pytest.mark.xdist_group("stability")

TASKS = ("one_dof", "two_dof_combined")
KINDS = ("direct_force", "adaptive_backstepping")
OTHERS = (
    "wave_variables",
    "time_domain_passivity",
    "proportional_damping",
    "four_channel",
    "smith_predictor",
)

# A single, unbounded layer, so that a run stays at its operating point.
EVERYWHERE = {
    "tissue": [
        {
            "name": "tissue",
            "start": -math.inf,
            "stiffness": 0.01,
            "damping": 0.5,
            "reference": 0.0,
        }
    ],
    "free": [],
    "bone": [{"name": "bone", "start": -math.inf, "stiffness": 150.0}],
}


ANALYSES = {}


def Analyze(name, kind="direct_force", **overrides):
    """Returns the analysis of a scenario, which is made once for all tests."""
    overrides = {"controller.kind": kind, **overrides}
    key = repr((name, overrides))
    if key not in ANALYSES:
        ANALYSES[key] = AnalyzeStability(LoadScenario(name, overrides))
    return ANALYSES[key]


@pytest.mark.parametrize(
    ("layer", "k", "d"), [("tissue", 0.01, 0.5), ("free", 0, 0), ("bone", 150, 0)]
)
def test_direct_force_on_one_axis_by_hand(layer, k, d):
    """L = (25 s + 50)/((s + 25) (m s^2 + (c + d) s + k)), with a cancelled integrator.

    The crossings follow from a polynomial in w^2.
    """
    analysis = Analyze("one_dof")
    point = analysis[layer]
    m = 0.5
    c = 0.1
    w = np.geomspace(0.05, 100, 40)
    s = 1j * w
    expected = (25 * s + 50) / ((s + 25) * (m * s**2 + (c + d) * s + k))
    assert_allclose(point.loop.frequency_response(w)[:, 0, 0], expected, rtol=1e-9)
    # |25 j w + 50|^2 = |j w + 25|^2 |k - m w^2 + j (c + d) w|^2 is a polynomial in w^2.
    spring = np.polyadd(np.polymul([-m, k], [-m, k]), [(c + d) ** 2, 0])
    squares = np.roots(np.polysub(np.polymul([1, 625], spring), [625, 2500]))
    w = np.sort(np.sqrt(squares[(squares.real > 0) & (abs(squares.imag) < 1e-9)].real))
    assert_allclose([x.frequency for x in point.crossings], w, rtol=1e-9)
    s = 1j * w
    phase = np.angle((25 * s + 50) / ((s + 25) * (m * s**2 + (c + d) * s + k)))
    assert_allclose(
        [x.delay for x in point.crossings], (phase + math.pi) / w, rtol=1e-9
    )
    assert point.num_neutral == 1 and len(point.hidden_modes) == 0


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", TASKS)
def test_collocation_agrees_at_every_border(name, kind):
    """The rightmost root is on the axis at the ends of each interval of stability.

    It has the frequency of a crossing there. Inside of an interval it is left of the
    axis, between intervals right of it. On the bone there are several intervals.
    """
    for point in Analyze(name, kind).points:
        assert is_delay_robust(point.loop)
        for begin, end in point.stable_delays:
            for T in (begin, end):
                if not 0 < T < point.max_delay:
                    continue
                root = point.RightmostRoot(T)
                assert abs(root.real) < 1e-7
                assert min(abs(root.imag - x.frequency) for x in point.crossings) < 1e-6
            assert point.RightmostRoot((begin + end) / 2).real < 0
        margin = point.margin.delay if point.margin else point.max_delay
        assert point.stable_delays[0] == (0.0, min(margin, point.max_delay))
        if point.margin:
            assert point.RightmostRoot(1.02 * margin).real > 0
        for (_, end), (begin, _) in pairwise(point.stable_delays):
            assert point.RightmostRoot((begin + end) / 2).real > 0
    if (name, kind) == ("one_dof", "direct_force"):
        assert [x.direction for x in point.crossings] == [-1, 1]
        assert len(point.stable_delays) > 3


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", OTHERS)
@pytest.mark.parametrize("name", Slow(["one_dof", "two_dof_combined"]))
def test_collocation_and_counting_agree_for_all_architectures(name, kind, subtests):
    for point in Analyze(name, kind).points:
        for T in (0.05, 0.2, 0.45):
            with subtests.test(T=T):
                root = point.RightmostRoot(T)
                # The result is None if the two methods do not agree.
                assert root is not None
                assert (root.real < 0) == point.IsStableWith(T)


@pytest.mark.parametrize("name", Slow(["two_dof_combined", "one_dof"]))
def test_only_integrators_are_hidden(name):
    """The roots of the full model are those of L and the integrators."""
    for point in Analyze(name, "adaptive_backstepping").points:
        system = point.model.system
        T = 0.3
        delays = np.empty(len(system.D))
        delays[point.model.signals.forward] = 0.1
        delays[point.model.signals.back] = T - 0.1
        loop = replace(system, delays=tuple(delays))
        roots = characteristic_roots(loop, count=12)
        n = len(point.model.point.position)
        is_integrator = np.abs(roots) < 1e-4
        assert is_integrator.sum() == n == point.num_neutral
        rest = roots[~is_integrator][:6]
        reduced = point.Roots(T, count=12)
        for root in rest:
            assert np.min(np.abs(reduced - root)) < 1e-5 * max(1, abs(root))


def Growth(recording, begin):
    """Returns growth rate and frequency of an oscillation, from its extremes."""
    t = np.linspace(begin, recording.time[-1], 8000)
    v = recording.Interpolate("tool_velocity", t)[:, 0]
    slope = np.diff(v)
    i = np.flatnonzero(slope[:-1] * slope[1:] < 0) + 1
    swings = np.abs(np.diff(v[i]))
    times = (t[i][1:] + t[i][:-1]) / 2
    return np.polyfit(times, np.log(swings), 1)[0], np.pi / np.mean(np.diff(t[i]))


RUNS = [
    ("one_dof", "direct_force", "tissue", 40.0, 1e-3),
    ("one_dof", "direct_force", "free", 40.0, 1e-3),
    ("one_dof", "direct_force", "bone", 9.0, 1e-3),
    # In the runs of these the estimates continue to adapt.
    ("one_dof", "adaptive_backstepping", "tissue", 40.0, 2e-2),
    ("one_dof", "adaptive_backstepping", "free", 40.0, 2e-2),
    ("two_dof_collision", "direct_force", "tissue", 20.0, 1e-2),
    ("two_dof_collision", "direct_force", "free", 20.0, 1e-2),
]


@pytest.mark.parametrize(
    ("name", "kind", "layer", "duration", "tolerance", "share"),
    # The fast tests are the slider below its margin in free space, and the arm above.
    Slow([(*run, share) for run in RUNS for share in (0.95, 1.05)], but=[2, 13]),
)
def test_runs_on_either_side_of_the_margin(
    name, kind, layer, duration, tolerance, share
):
    """A run decays below the margin and grows above it, at the rightmost root's rate.

    The delays of the channels are not equal.
    """
    overrides = {
        "controller.kind": kind,
        "environment.layers": EVERYWHERE[layer],
        "divergence_speed_ratio": 1000.0,
        "simulator.accuracy": 1e-10,
    }
    if name != "one_dof":
        # The arm moves so slowly that its pose hardly changes, and begins with a
        # relaxed spring.
        overrides |= {"surgeon.velocity": [1e-4, 0.0], "surgeon.contact_force": None}
        if layer == "tissue":
            overrides |= {"environment.layers.tissue.reference": 0.85}
    scenario = LoadScenario(name, overrides)
    x = scenario.robot.start[0]
    point = OperatingPointAt(scenario, x + (0.01 if name == "one_dof" else 1e-4))
    stability = AnalyzeStability(scenario, points=[point]).points[0]
    delay = share * stability.margin.delay
    recording = simulate(
        LoadScenario(
            name,
            overrides
            | {
                "duration": duration,
                "forward_channel.delay": 0.3 * delay,
                "return_channel.delay": 0.7 * delay,
                "simulator.max_step_size": min(0.02, 0.15 * delay),
            },
        ),
        engine="auto",
    )
    assert recording.termination == "completed"
    assert np.ptp(recording["environment_layer"]) == 0
    rate, frequency = Growth(recording, 0.4 * duration)
    root = stability.RightmostRoot(delay)
    assert math.copysign(1, rate) == math.copysign(1, share - 1)
    assert rate == pytest.approx(root.real, rel=tolerance)
    assert frequency == pytest.approx(root.imag, rel=1e-3)


# Almost the same spring on both sides of a contact surface at 10 um.
SPRING = [
    {"name": "free", "start": -math.inf, "stiffness": 149.99, "reference": 0.0},
    {"name": "bone", "start": 1e-5, "stiffness": 150.0, "reference": 0.0},
]


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("kind", "delay", "grows"),
    [
        ("direct_force", 0.02, False),
        ("four_channel", 0.2, True),
    ],
)
def test_runs_follow_the_loop_of_the_held_force(kind, delay, grows):
    """Runs with contact do not follow the loop of the commanded velocity."""
    overrides = {
        "controller.kind": kind,
        "robot.mass": 0.2 if kind == "direct_force" else 0.5,
        "environment.layers": SPRING,
        "surgeon.contact_force": [0.3],
        "forward_channel.delay": delay,
        "return_channel.delay": delay,
        "duration": 12.0 if kind == "direct_force" else 30.0,
        "divergence_speed_ratio": 1000.0,
        "simulator.accuracy": 1e-11,
    }
    scenario = LoadScenario("one_dof", overrides)
    bone = AnalyzeStability(scenario)["bone"]
    assert bone.operator == "commands a velocity"
    assert bone.force_mode.operator == "holds a force"
    assert bone.force_mode.model.point.position[0] == pytest.approx(0.002, rel=1e-9)
    before, root = (x.RightmostRoot(2 * delay) for x in (bone, bone.force_mode))
    recording = simulate(scenario, engine="auto")
    rate, frequency = Growth(recording, 0.4 * scenario.duration)
    assert (rate > 0) == grows == (not bone.force_mode.is_stable)
    assert rate == pytest.approx(root.real, rel=2e-3)
    assert rate != pytest.approx(before.real, rel=0.5)
    assert frequency == pytest.approx(root.imag, rel=2e-4)


def Rest(name):
    """Returns a scenario and the point of rest under the force that is held."""
    scenario = LoadScenario(name)
    point = OperatingPoints(scenario)[-1]
    environment = scenario.environment.MakeEnvironment(scenario.robot.start)
    return scenario, PointOfRest(point, environment, scenario.surgeon.contact_force)


def test_a_tool_that_slides_has_no_place_of_rest():
    assert Rest("wall_sliding")[1] is None


def test_what_gives_way_across_the_normal_moves_the_point_of_rest():
    """K (p - p_rest) = F on three axes: an oblique bone, and soft tissue across."""
    scenario, point = Rest("needle_insertion")
    normal = np.array([0.6, 0.48, -0.64])
    across = np.eye(3) - np.outer(normal, normal)
    force = np.array(scenario.surgeon.contact_force)
    depth = 0.3 + normal @ force / 150.0
    assert normal @ point.position == pytest.approx(depth, rel=1e-9)
    way = across @ (point.position - np.array(scenario.robot.start))
    assert_allclose(5.0 * way, across @ force, atol=1e-9)


def test_force_that_is_held_leaves_the_slider_alone():
    """The roots are those of the slider on the spring, m s^2 + c s + k = 0."""
    held = Analyze("one_dof")["bone"].force_mode
    expected = np.roots([0.5, 0.1, 150.0])[0]
    assert held.RightmostRoot(0.2) == pytest.approx(expected, rel=1e-9)
    assert held.model.point.position[0] == pytest.approx(0.015 + 0.005 / 150, rel=1e-9)
    assert held.stable_delays == [(0.0, 2.0)] and held.margin is None


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        ({"surgeon.contact_force": None}, ""),
        ({"surgeon.contact_force": [-0.1]}, "the tool does not rest under it"),
        (
            {"surgeon.kind": "own_kinds:FadingConfig"},
            "own_kinds:FadingConfig does not tell it",
        ),
    ],
)
def test_no_loop_of_a_held_force(overrides, reason):
    analysis = Analyze("one_dof", **overrides)
    bone = analysis.ToRecord()["operating_points"][2]
    assert bone["operator"] == "commands a velocity" and bone["force_mode"] is None
    note = "The loop in bone once the operator holds a force there is not known: "
    note += f"{reason}."
    assert [x for x in analysis.notes if "holds a force" in x] == [note] * bool(reason)


def PredictorDeterminant(s, T, model_mass, k, d):
    """Returns the characteristic function of the slider with a Smith predictor.

    With tool P = 1/(m s + c + d + k/s), model Q = 1/(m' s + ...) and device H it is
    1 + H [P z + Q (1 - z)], z = e^(-s T).
    """
    H = (25 * s + 50) / (s**2 + 25 * s)
    P = 1 / (0.5 * s + 0.1 + d + k / s)
    Q = 1 / (model_mass * s + 0.1 + 0.5 + 0.01 / s)
    z = np.exp(-s * T)
    return 1 + H * (P * z + Q * (1 - z))


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("layer", "k", "d", "T"),
    [("tissue", 0.01, 0.5, 0.05), ("free", 0, 0, 1.3), ("bone", 150, 0, 0.3)],
)
def test_roots_of_a_predictor_by_hand(layer, k, d, T):
    """All computed roots are zeros of the characteristic function."""
    point = Analyze(
        "one_dof",
        "smith_predictor",
        **{
            "controller.smith_predictor.mass": 0.7,
            "forward_channel.delay": T / 2,
            "return_channel.delay": T / 2,
        },
    )[layer]
    roots = point.Roots(T, count=6)
    assert len(roots) >= 4
    for s in roots:
        # The step of Newton's method from a simple root is small.
        h = 1e-6 * max(abs(s), 1e-3)
        low, middle, high = (
            PredictorDeterminant(s + x, T, 0.7, k, d) for x in (-h, 0, h)
        )
        step = middle / ((high - low) / (2 * h))
        assert abs(step) < 1e-5 * max(abs(s), 0.1)


@pytest.mark.slow
def test_exact_predictor_has_the_roots_without_delay():
    """The roots are the same at every delay, and none crosses the axis."""
    tissue = Analyze("one_dof", "smith_predictor")["tissue"]
    assert tissue.margin is None
    assert [x for x in tissue.crossings if x.frequency > 0] == []
    assert tissue.stable_delays == [(0.0, tissue.max_delay)]
    direct = Analyze("one_dof")["tissue"].Roots(0.0)
    assert sum(direct.real > -5) == 2
    for T in (0.2, 2.0):
        found = tissue.Roots(T)
        for s in direct[direct.real > -5]:
            assert np.min(np.abs(found - s)) < 1e-6


IN_FREE_SPACE = {
    # The predictor's model is that of the tissue, which is wrong here.
    "smith_predictor": {"damping": 0.6},
    # These gains do not derive from the delay.
    "proportional_damping": {"stiffness": 10.0},
    "four_channel": {"variant": "position_position", "bandwidth": 5.0},
    # Packets are held: half a period counts as a part of each channel's delay.
    "direct_force": {},
}
PERIOD = 0.02


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("kind", "share"),
    Slow([(kind, x) for kind in IN_FREE_SPACE for x in (0.9, 1.1)], but=[1, 2, 6]),
)
def test_runs_in_free_space_on_either_side_of_the_margin(kind, share):
    values = {f"controller.{kind}.{k}": x for k, x in IN_FREE_SPACE[kind].items()}
    overrides = values | {
        "controller.kind": kind,
        "environment.layers": [],
        "divergence_speed_ratio": 1000.0,
        "duration": 40.0,
    }
    scenario = LoadScenario("one_dof", overrides)
    point = OperatingPointAt(scenario, 0.01)
    (stability,) = AnalyzeStability(scenario, points=[point]).points
    delay = share * stability.margin.delay
    channels = {
        "forward_channel.delay": 0.3 * delay,
        "return_channel.delay": 0.7 * delay,
    }
    if kind == "direct_force":
        held = {"kind": "sampled", "sample_period": PERIOD}
        held["delay"] = (delay - PERIOD) / 2
        channels = {"forward_channel": held, "return_channel": held}
    scenario = LoadScenario("one_dof", overrides | channels)
    (own,) = AnalyzeStability(scenario, points=[point]).points
    assert own.delay == pytest.approx(delay)
    rate, frequency = Growth(simulate(scenario, engine="auto"), 20.0)
    pair = next(s for s in own.Roots(delay) if s.imag > 0)
    assert (rate > 0) == (share > 1) == (not own.is_stable)
    assert rate == pytest.approx(pair.real, rel=5e-2)
    assert frequency == pytest.approx(pair.imag, rel=1e-2)


@pytest.mark.parametrize(
    "kind",
    ("proportional_damping", "four_channel"),
)
def test_gains_that_derive_from_the_delay_are_held(kind):
    (note,) = Analyze("one_dof", kind).notes
    assert note.startswith("Gains that derive from the delay keep the values")
    assert "for 0.2 s" in note


def test_bare_wave_line_is_not_robust():
    """Without a damper the wave is completely reflected at both ends."""
    analysis = Analyze(
        "one_dof",
        "wave_variables",
        **{"controller.wave_variables.master_damping": 0.0},
    )
    (note,) = analysis.notes
    assert note.startswith("The loop is of neutral type, and a signal that goes round")
    for point in analysis.points:
        assert not is_delay_robust(point.loop)
        assert point.stable_delays == [] and point.margin is None


def test_idle_passivity_is_said():
    analysis = Analyze("one_dof", "time_domain_passivity")
    direct = Analyze("one_dof")
    for point, other in zip(analysis.points, direct.points, strict=True):
        assert point.margin.delay == pytest.approx(other.margin.delay, rel=1e-7)
        assert point.ToRecord()["idle_passivity"] is True
        assert other.ToRecord()["idle_passivity"] is False
    assert len(analysis.ToRecord()["notes"]) == 1 and direct.notes == []


def test_device_whose_loop_is_too_fast_for_collocation():
    """Stability then follows from counting crossings, and no false root is returned."""
    free = Analyze(
        "one_dof",
        **{
            "haptic_device.numerator": [3000.0],
            "haptic_device.denominator": [1.0],
            "robot.mass": 0.01,
        },
    )["free"]
    assert free.delay * free.margin.frequency > 10_000
    assert not free.is_stable
    root = free.RightmostRoot(free.delay)
    assert root is None or root.real > 0
    assert free.RightmostRoot(0.9 * free.margin.delay).real < 0


def test_record_is_plain_json():
    record = Analyze("two_dof_combined", "adaptive_backstepping").ToRecord()
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["scenario"] == "two_dof_combined"
    assert all(x["frozen_weights"] is True for x in record["operating_points"])
    bone = Analyze("one_dof", "adaptive_backstepping").ToRecord()["operating_points"][2]
    assert bone["delay_margin"] is None and bone["phase_margin"] is None
    assert bone["gain_crossovers"] == []
    assert bone["stable_delays"] == [[0.0, 2.0]]


def test_unstable_without_delay():
    """A device that reverses the sign of the error is positive feedback."""
    analysis = Analyze("one_dof", **{"haptic_device.numerator": [-25.0, -50.0]})
    point = analysis["free"]
    assert point.margin is None and not point.is_stable
    assert point.stable_delays == []
    assert point.ToRecord()["delay_margin"] is None
    ((low, high),) = point.stable_gains
    assert low < 0 and high == 0


def test_device_with_feedthrough_keeps_a_margin():
    """H = 25: L = 25/(m s + c), |L| = 1 at w = sqrt(625 - c^2)/m."""
    analysis = Analyze(
        "one_dof",
        **{"haptic_device.numerator": [25.0], "haptic_device.denominator": [1.0]},
    )
    free = analysis["free"]
    w = math.sqrt(625 - 0.01) / 0.5
    assert free.margin.delay == pytest.approx(
        (math.pi - math.atan2(0.5 * w, 0.1)) / w, rel=1e-9
    )


@pytest.mark.slow
def test_chart_of_a_scenario_key():
    chart = ChartStability(
        "one_dof",
        "environment.layers.bone.stiffness",
        [50.0, 150.0, 300.0],
        overrides=["controller.kind=direct_force"],
    )
    names = ["tissue", "free", "bone"]
    assert chart.PointNames() == [*names, "bone, force held"]
    assert chart.PointNames(with_force_mode=False) == names
    assert chart.StableDelays("bone, force held") == [[(0.0, 2.0)]] * 3
    one = Analyze("one_dof")["bone"].stable_delays
    assert_allclose(chart.StableDelays("bone")[1], one)
    firsts = [intervals[0][1] for intervals in chart.StableDelays("bone")]
    assert firsts[0] > firsts[1] > firsts[2]
    frees = {intervals[0][1] for intervals in chart.StableDelays("free")}
    assert max(frees) == pytest.approx(min(frees))
    assert json.dumps(chart.ToRecord(), allow_nan=False)


def test_chart_along_the_path():
    chart = ChartStability(
        "two_dof_combined",
        POSITION,
        # Free space begins at 1.0 and bone at 1.1.
        [0.9, 1.0, 1.1],
        overrides={"controller.kind": "direct_force"},
    )
    assert chart.PointNames() == ["tissue", "free", "bone", "bone, force held"]
    assert [x is None for x in chart.StableDelays("free")] == [True, False, True]


def test_refuses():
    """Further refusals are tested with the command."""
    with pytest.raises(ValueError, match=r"robot\.mass = \[\]: must be a list"):
        ChartStability("one_dof", "robot.mass", [])
    with pytest.raises(ValueError, match="max_delay = "):
        AnalyzeStability(LoadScenario("one_dof"), max_delay=math.inf)
    with pytest.raises(KeyError):
        Analyze("one_dof")["brain"]
