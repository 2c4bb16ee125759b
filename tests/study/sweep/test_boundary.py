"""Tests of the boundaries of stability over the keys of a sweep, and of maps."""

import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.figures.sweep_maps import PlotMap, PlotStability
from teleop_drake.study.sweep import PlanSweep, TaskSweepResult
from teleop_drake.study.sweep.boundary import Boundary, FindBoundaries

# The tests share their boundaries.
pytestmark = pytest.mark.xdist_group("boundary")

MASSES = [0.2, 0.5]
KIND = {"controller": "direct_force"}


COMMANDING = ("surgeon.contact_force=null",)


@functools.cache
def Find(delay_key="delay", overrides=COMMANDING, largest=0.5):
    plan = PlanSweep(
        "one_dof",
        {"controller": ["direct_force"], "robot.mass": MASSES, delay_key: [0, largest]},
        overrides=overrides,
    )
    found = FindBoundaries(plan, delay_key, "robot.mass", MASSES, others=KIND)
    return {boundary.point: boundary.ends for boundary in found}


@pytest.mark.slow
def test_the_ends_are_the_margins_of_the_analysis():
    each_way = Find()
    assert list(each_way) == ["tissue", "free", "bone"]
    for i, mass in enumerate(MASSES):
        overrides = {
            "controller.kind": "direct_force",
            "robot.mass": mass,
            "surgeon.contact_force": None,
        }
        for point in AnalyzeStability(LoadScenario("one_dof", overrides)).points:
            end = each_way[point.model.point.name][i]
            assert 2 * end == pytest.approx(point.margin.delay, rel=1e-6)


@pytest.mark.slow
def test_another_delay_counts_as_well():
    forward = Find("forward_delay", (*COMMANDING, "return_channel.delay=0.1"))
    for name, ends in Find().items():
        expected = np.maximum(2 * ends - 0.1, 0)
        assert_allclose(forward[name], expected, atol=1e-6)


def test_what_lies_beyond_the_map_has_no_end():
    assert Find(largest=0.2)["tissue"].tolist()[1] == np.inf


def test_on_the_bone_it_is_the_loop_of_the_runs():
    """If the operator holds a force, the loop of direct force is open."""
    commanding = dict(Find())
    holding = dict(Find(overrides=()))
    assert np.all(commanding.pop("bone") < 0.05)
    assert holding.pop("bone, force held").tolist() == [np.inf, np.inf]
    assert list(holding) == list(commanding) == ["tissue", "free"]
    for name, ends in commanding.items():
        assert_array_equal(holding[name], ends)


@pytest.mark.slow
def test_loop_that_is_not_known_has_no_boundary():
    kind = "surgeon.kind=own_kinds:FadingConfig"
    plan = PlanSweep("one_dof", {"robot.mass": [0.5], "delay": [0.1]}, overrides=[kind])
    *_, bone = FindBoundaries(plan, "delay", "robot.mass", [0.5], others={})
    assert bone.point == "bone" and np.isnan(bone.ends).all()
    assert "FadingConfig does not tell it" in bone.note


def test_gains_that_follow_the_delay_have_no_boundary():
    others = {"controller": "four_channel"}
    axes = {"controller": ["four_channel"], "robot.mass": MASSES, "delay": [0.1, 0.2]}
    with pytest.raises(ValueError, match="gains derive from the delay"):
        FindBoundaries(
            PlanSweep("one_dof", axes), "delay", "robot.mass", MASSES, others=others
        )


def test_packets_are_no_exact_delay():
    packets = "{kind: sampled, sample_period: 0.01, delay: 0.1}"
    with pytest.raises(ValueError, match="packets are held"):
        Find("forward_delay", (f"return_channel={packets}",))


def Result(force):
    axes = {"controller": ["direct_force"], "robot.mass": MASSES, "delay": [0.1, 0.2]}
    records = []
    for mass in MASSES:
        for delay in axes["delay"]:
            value = force(mass, delay)
            collision = {"peak_force": value, "time": 1.0, "settling_time": 2.0}
            records.append(
                {
                    "run": len(records),
                    "varied": {**KIND, "robot.mass": mass, "delay": delay},
                    "status": "completed" if value < 4 else "diverged",
                    "reason": "",
                    "metrics": {"collision": collision},
                }
            )
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    return TaskSweepResult(scenario=scenario, axes=axes, records=records)


def test_maps_have_the_boundary_over_them():
    result = Result(lambda mass, delay: 10 * mass * (1 if delay == 0.1 else 0.8))
    ends = {
        "free": [0.12, np.inf],
        "tissue": [0.5, np.inf],
        "steel": [np.nan, 0.0],
        "bone": [np.nan, np.nan],
    }
    boundaries = [[Boundary(point=k, ends=np.array(x)) for k, x in ends.items()]]
    figure = PlotMap(result, "collision.peak_force", boundaries=boundaries)
    ax, bar = figure.axes
    shown, ended = (cells.get_array() for cells in ax.collections)
    assert_allclose(shown.filled(np.nan), [[2.0, 1.6], [np.nan, np.nan]])
    assert ended.mask.tolist() == [[True, True], [False, False]]
    assert ax.lines[1].get_xdata().tolist() == [0.12, np.inf]
    assert ax.lines[1].get_ydata().tolist() == MASSES
    assert bar.get_ylabel() == "collision peak force [N]"
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == [
        "diverges or fails",
        "end of stability, free",
    ]
    assert figure.get_supxlabel() == (
        "tissue: stable throughout; steel: not stable without delay; "
        "bone: stability not known"
    )
    # The axes end at the outermost values, whatever the boundary.
    assert ax.get_ylim() == (MASSES[0], MASSES[-1])
    assert ax.get_yticks().tolist() == MASSES
    assert ax.get_xlim() == PlotStability(result).axes[0].get_xlim()
    assert len(PlotStability(result, boundaries).axes[0].lines) == 8
