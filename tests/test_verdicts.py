"""Numbers of documentation pages that no other test recomputes.

Each is taken from a run or an analysis, and compared with the page's text.
"""

import re

import appendix_a as arm
import independent_solver as oracle
import numpy as np
import pytest
import standard_dh
from documentation import ROOT
from grids import Slow
from pydrake.multibody.tree import JacobianWrtVariable
from scipy.optimize import brentq

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.analysis.stability import AnalyzeStability

TASKS = ("one_dof", "two_dof_collision", "two_dof_combined")


def page(name):
    return (ROOT / f"teleop_drake/docs/{name}.md").read_text(encoding="utf-8")


def notebook(name):
    return (ROOT / f"notebooks/{name}.ipynb").read_text(encoding="utf-8")


def rest_time(task, **overrides):
    """The rest time of the adaptive controller, None: never."""
    overrides = {f"controller.{name}": value for name, value in overrides.items()}
    overrides["controller.kind"] = "adaptive_backstepping"
    return RunMetrics(simulate(LoadScenario(task, overrides)))["collision"]["rest_time"]


RATES = {
    "thesis's rates": {},
    "`controller.beta3=100`": {"beta3": 100.0},
    "`controller.adaptation_rate=1`": {"adaptation_rate": 1.0},
    "`controller.adaptation_rate=10`": {"adaptation_rate": 10.0},
}


@pytest.mark.mostly_slow
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("name", Slow(list(RATES), but=[0, 1]))
def test_rest_at_higher_rates_of_adaptation(name, task):
    cells = re.search(rf"^\| {re.escape(name)} \|(.*)\|$", page("learning"), re.M)
    text = cells[1].split("|")[TASKS.index(task)].strip()
    found = rest_time(task, **RATES[name])
    if text == "-":
        assert found is None
    else:
        assert found == pytest.approx(float(text), abs=6e-3)


@pytest.mark.slow
@pytest.mark.parametrize("task", ["one_dof", "two_dof_combined"])
def test_the_independent_solver_rests_sooner_with_a_fast_third_network(task):
    """It has the page's time, too; 2e-4 s lie between its samples."""
    duration = LoadScenario(task).duration
    model = oracle.thesis_task(task, True, third_rate=100.0)
    cells = re.search(r"^\| `controller.beta3=100` \|(.*)\|$", page("learning"), re.M)
    text = cells[1].split("|")[TASKS.index(task)]
    found = oracle.solve(model, duration, rtol=1e-8).rest_time()
    assert found == pytest.approx(float(text), abs=6e-3)


def metric_of(task, metric, **overrides):
    """A metric of the collision without adaptation, at the study's accuracy."""
    overrides = {f"controller.{name}": value for name, value in overrides.items()}
    overrides["controller.kind"] = "adaptive_backstepping"
    overrides["simulator.accuracy"] = 1e-9
    return RunMetrics(simulate(LoadScenario(task, overrides)))["collision"][metric]


@pytest.mark.mostly_slow
@pytest.mark.parametrize("task", TASKS)
def test_what_adaptation_changes(task):
    """At most 0.5 % of the table's numbers, and 6.1 % of the settling of case II."""

    def change(metric):
        without = metric_of(task, metric, adaptation_rate=0.0)
        return without / metric_of(task, metric) - 1

    assert max(abs(change("rest_time")), abs(change("peak_force"))) < 5e-3
    if task == "two_dof_collision":
        assert change("settling_time") == pytest.approx(-0.061, abs=1e-3)


@pytest.mark.mostly_slow
@pytest.mark.parametrize("task", ["one_dof", "two_dof_combined"])
def test_the_highest_rate_gains_little(task):
    assert 0.9 < rest_time(task, beta3=1000.0) / rest_time(task) < 1.0


def test_learning_costs_delay():
    ends = [
        simulate(LoadScenario("two_dof_learning", {"delay": 0.3, **more})).termination
        for more in ({}, {"controller.adaptation_rate": 0.0})
    ]
    assert ends == ["diverged", "completed"]


@pytest.mark.slow
def test_the_margin_that_a_human_leaves():
    text = " ".join(page("operators").split())
    (share,) = re.findall(r"takes (\d+) % of the adaptive", text)
    numbers = re.search(r": ([\d.]+) s instead of ([\d.]+) s", text)
    human, planned = (float(x) for x in numbers.groups())
    margins = []
    for kind in ("human", "constant_velocity"):
        overrides = {"controller.kind": "adaptive_backstepping", "surgeon.kind": kind}
        scenario = LoadScenario("two_dof_collision", overrides)
        margins.append(AnalyzeStability(scenario)["free"].margin.delay)
    assert margins == pytest.approx([human, planned], rel=2e-3)
    assert 1 - margins[0] / margins[1] == pytest.approx(float(share) / 100, abs=6e-3)


def test_direct_force_diverges_in_case_I_after_the_notebooks_end():
    scenario = LoadScenario("two_dof_puncture", {"controller.kind": "direct_force"})
    recording = simulate(scenario)
    assert recording.termination == "diverged"
    assert f"after {recording.time[-1]:.2f} s" in notebook("03_delay_two_dof")
    assert recording.time[-1] > 5.5


@pytest.mark.parametrize("kind", ["direct_force", "adaptive_backstepping"])
def test_when_the_tool_reaches_90_percent_of_the_command(kind):
    scenario = LoadScenario("two_dof_puncture", {"controller.kind": kind})
    recording = simulate(scenario, duration=1.0)
    v_x = recording["tool_velocity"][:, 0]
    first = recording.time[v_x >= 0.9 * scenario.surgeon.velocity[0]][0]
    (adaptive, direct) = re.search(
        r"after ([\d.]+) s against ([\d.]+) s", notebook("03_delay_two_dof")
    ).groups()
    expected = direct if kind == "direct_force" else adaptive
    assert first == pytest.approx(float(expected), abs=5e-3)


# Corke and Armstrong-Helouvry 1994, at the motors, N m: forward and backward.
COULOMB = np.array(
    [[0.395, 0.126, 0.132, 11.2e-3, 9.26e-3, 3.96e-3],
     [0.435, 0.071, 0.105, 16.9e-3, 14.5e-3, 10.5e-3]]
)  # fmt: skip


def friction_at_the_tip(scenario):
    """Coulomb and viscous friction at the tip along the needle, from their power, N."""
    plant = scenario.robot.LoadPlant()
    robot = scenario.robot
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, robot.JointPositions(robot.start))
    world = plant.world_frame()
    tool = plant.GetFrameByName("tool")
    J = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, tool, np.zeros(3), world, world
    )
    speed = np.linalg.norm(scenario.surgeon.velocity)
    v = np.linalg.solve(J, [0, 0, 0, speed, 0, 0])
    coulomb = np.where(v > 0, *COULOMB) * standard_dh.GEAR
    smooth_sign = v / np.hypot(v, robot.friction_speed)
    viscous = standard_dh.VISCOUS * standard_dh.GEAR**2 * v
    return coulomb * smooth_sign @ v / speed, viscous @ v / speed


def test_the_friction_of_the_puma_at_the_tip():
    """By the joints' power, the needle moving straight at the task's speed."""
    scenario = LoadScenario("puma560_insertion", {"robot.friction": 1.0})
    coulomb, viscous = friction_at_the_tip(scenario)
    text = notebook("09_arm_in_space")
    numbers = re.search(r"([\d.]+) N \(Coulomb\) and ([\d.]+) N \(viscous\)", text)
    expected = [float(x) for x in numbers.groups()]
    assert [coulomb, viscous] == pytest.approx(expected, abs=0.05)


def damped_margin(x, stiffness, damping):
    """The round trip at which the damped arm at rest oscillates, in s.

    (M s + b + k/s) v = -H(s) exp(-s T) v, with the tool's inertia of Appendix A and the
    stiffness along x: |e| = 1 for an eigenvalue e = -exp(j w T) of (M s + b + k/s)/H.
    """
    q = arm.joints((x, 0.0))
    J = arm.J(q)
    M = np.linalg.inv(J @ np.linalg.inv(arm.M(q)) @ J.T)
    k = np.diag([stiffness, 0.0])

    def eigenvalues(w):
        s = 1j * w
        H = (25 * s + 50) / (s * s + 25 * s)
        found = np.linalg.eigvals((s * M + damping * np.eye(2) + k / s) / H)
        return found[np.argsort(abs(found))]

    def excess(w, i):
        return np.log(abs(eigenvalues(w)[i]))

    frequencies = np.geomspace(0.01, 100, 2001)
    delays = []
    for i in range(2):
        values = [excess(w, i) for w in frequencies]
        for place in np.flatnonzero(np.diff(np.sign(values))):
            w = brentq(excess, *frequencies[place : place + 2], args=(i,))
            delays.append(np.angle(-1 / eigenvalues(w)[i]) % (2 * np.pi) / w)
    return min(delays)


def test_the_margins_of_the_damper():
    """Of case II with the damping by rule: from the closed loop's characteristic."""
    pattern = (
        r"([\d.]+) s in free space \(([\d.]+) s about an arm at rest\) and ([\d.]+)"
    )
    text = " ".join(page("architectures").split())
    free, at_rest, bone = map(float, re.search(pattern, text).groups())
    scenario = LoadScenario("two_dof_collision", {"controller.kind": "damped_force"})
    results = AnalyzeStability(scenario, max_delay=3.0)
    margins = [results[name].margin.delay for name in ("free", "bone")]
    assert margins == pytest.approx([free, bone], abs=6e-3)
    damping = ResolveController(scenario).damping[0, 0]
    assert damped_margin(0.925, 0.0, damping) == pytest.approx(at_rest, abs=6e-3)
    assert damped_margin(1.0041, 150.0, damping) == pytest.approx(bone, abs=6e-3)
