"""Claims that are data hold by the same rules here and in the executable thesis."""

import json
import math
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

import teleop_drake
from teleop_drake.thesis.claims.relation import (
    NEVER,
    SETTLING,
    Compare,
    Relation,
)
from teleop_drake.thesis.report import CLAIMS
from teleop_drake.thesis.runs import Both

JUDGE = Path(teleop_drake.__file__).parent / "loops" / "page" / "js" / "judge.js"
SPEED = 0.1


def made(**metrics):
    """Returns a run with metrics, of an operator who commands SPEED."""
    surgeon = SimpleNamespace(velocity=[SPEED, 0.0])
    recording = SimpleNamespace(teleoperation=SimpleNamespace(surgeon=surgeon))
    return type("Run", (dict,), {"recording": recording})(metrics)


# A relation, the metric of direct force and of the adaptive controller, and whether it
# holds.
CASES = [
    (Relation("force", factor=0.5), 2.0, 0.99, True),
    (Relation("force", factor=0.5), 2.0, 1.0, False),
    (Relation("force", factor=0.5), [2.0, 2.0], [0.9, 1.1], False),
    (Relation("force", relation=">"), -3.0, -1.0, True),
    (Relation("force", factor=0.0), -3.0, 1.0, False),
    (Relation("force", relation="=", tolerance=0.01), 1.0, 1.009, True),
    (Relation("force", relation="=", tolerance=0.01), 1.0, 1.011, False),
    (Relation("force", factor=0.01, of="speed"), 9.0, 0.0009, True),
    (Relation("force", run="direct", relation=">", of="speed"), 0.09, 9.0, False),
    (Relation(SETTLING, factor=NEVER), None, 2.0, True),
    (Relation(SETTLING, factor=NEVER), 3e3, 2.0, False),
    (Relation(SETTLING, factor=0.5), None, None, False),
]


@pytest.mark.parametrize(("relation", "direct", "adaptive", "holds"), CASES)
def test_a_relation_holds_on_every_axis(relation, direct, adaptive, holds):
    both = Both(*(made(**{relation.metric: x}) for x in (direct, adaptive)))
    assert relation.Holds(both) is holds


def test_no_relation_holds_for_a_run_that_lacks_the_metric():
    both = Both(made(force=None), made(force=1.0))
    assert not any(Relation("force", relation=x).Holds(both) for x in "<>=")


def test_the_numbers_are_told_for_each_metric():
    both = Both(made(f=2.0, g=3.0), made(f=1.0, g=math.inf))
    relations = [Relation("f", "N"), Relation("f", "N", of_metric="a.g_h")]
    both = Both(*({**run, "a.g_h": run["g"]} for run in both))
    text = "f: direct 2, adaptive 1 N; g h: direct 3, adaptive not in the run N"
    assert Compare(relations, both) == text


def flat(metric, value):
    """Returns a metric as the page has it: one for each axis, none if there is none."""
    if isinstance(value, list):
        return {f"{metric}.{axis}": x for axis, x in zip("xy", value, strict=True)}
    return {} if value is None else {metric: value}


@pytest.mark.skipif(not shutil.which("node"), reason="no node")
def test_the_page_has_the_same_rules():
    cases = [
        [x._asdict(), flat(x.metric, direct), flat(x.metric, adaptive)]
        for x, direct, adaptive, _ in CASES
    ]
    script = f"""
import {{ Evidence }} from {json.dumps(str(JUDGE))};
const holds = {json.dumps(cases)}.map(([relation, ...metrics]) => {{
  const runs = metrics.map((x) => ({{ metrics: x, z: {{ command: [{SPEED}] }} }}));
  return new Evidence(runs, "one_dof").holds(relation);
}});
console.log(JSON.stringify(holds));
"""
    command = ["node", "--input-type=module", "-e", script]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert json.loads(run.stdout) == [holds for *_, holds in CASES]


def test_a_claim_has_relations_or_a_measure_of_its_own():
    for claim in CLAIMS:
        assert bool(claim.relations) != bool(claim.measure), claim.key
        is_shown = bool(claim.relations) and claim.printed is not None
        assert bool(claim.shown) == is_shown, claim.key
