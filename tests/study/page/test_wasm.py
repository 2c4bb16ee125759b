"""WebAssembly of a run against its native run."""

import dataclasses
import secrets
import time

import numpy as np
import pytest
from wasm_runs import DataOf
from wasm_scenarios import AssertSame

from teleop_drake.loops.jit import native
from teleop_drake.loops.page.inputs import Change
from teleop_drake.model.blocks.operators import OPERATOR_KINDS
from teleop_drake.model.scenario import ARCHITECTURES, LoadScenario, ScenarioNames
from teleop_drake.study.page.page import MakePage
from teleop_drake.study.page.scenario_model import ModelOf


@pytest.mark.slow
def test_it_ends_where_the_native_run_does():
    """At the range of a joint, and at a speed."""
    back = {"surgeon.velocity": [-0.1, 0.0, 0.0], "duration": 2.5}
    for name, more in (("puma560_insertion", back), ("one_dof", {"delay": 0.5})):
        scenario = LoadScenario(name, {"controller.kind": "direct_force", **more})
        assert AssertSame(scenario).termination == "diverged"


@pytest.mark.slow
def test_a_long_model_is_compiled_in_seconds_and_is_its_native_run(
    tmp_path, monkeypatch
):
    """Of 47 000 instructions, which took three minutes."""
    monkeypatch.setattr(native, "_Folder", lambda: tmp_path)
    scenario = LoadScenario("puma560_six_axes", {"duration": 0.5})
    model = ModelOf(scenario)
    begin = time.process_time()
    model.Module()
    assert time.process_time() - begin < 30
    AssertSame(scenario)


@pytest.mark.slow
def test_what_is_kept_on_the_disk_changes_no_byte(tmp_path, monkeypatch):
    model = ModelOf(LoadScenario("one_dof"))
    known = model.Module()
    monkeypatch.setattr(native, "_Folder", lambda: tmp_path)
    assert [model.Module(), model.Module()] == [known, known]
    assert len([*tmp_path.rglob("*.o")]) == 2


NETWORK = {
    "forward_channel": {
        **{"kind": "network", "delay": 0.1, "sample_period": 0.02},
        "jitter": {"kind": "normal", "std": 0.01},
    }
}
FIELDS = {"forward_channel": {"delay": 0.1, "fields": {"force": {"delay": 0.08}}}}
UNEVEN = {"sample_period": 0.02, "period_jitter": {"kind": "normal", "std": 0.004}}
NETEM = "delay 100ms 30ms loss gemodel 2% 30% duplicate 5% reorder 9%"
SEED = {"forward_channel.seed": (0.0, 5.0)}
VARY = {"environment.layers.bone.stiffness": (50.0, 400.0)}
VARY["surgeon.kind"] = ["constant_velocity", "sine"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more", "vary"),
    [
        ("one_dof", {}, VARY),
        pytest.param("one_dof", NETWORK, SEED, marks=pytest.mark.slow),
        pytest.param("two_dof_combined", {}, VARY, marks=pytest.mark.slow),
    ],
)
def test_random_values_of_every_input(request, name, more, vary):
    """What a page adds up is the run of the scenario with these values."""
    is_long = request.node.get_closest_marker("slow") is not None
    seed = secrets.randbits(32) if is_long else 0
    print(f"seed {seed}")
    generator = np.random.default_rng(seed)
    # In the short run test_page.py has the other one.
    kinds = None if is_long else ["direct_force"]
    page = MakePage(name, overrides=more, vary=vary, controllers=kinds)
    data = DataOf(page.html)
    for loop in data["controllers"] * (3 if is_long else 1):
        chosen = {"controller.kind": loop["kind"]}
        numbers = loop["numbers"]
        for one in data["inputs"]:
            key = one["name"]
            stops = one.get("stops")
            # Fields have no keys of the scenario; see test_fields.py.
            if key not in loop["changes"] or one["isField"]:
                continue
            value = float(generator.uniform(one["min"], one["max"]))
            value = float(generator.choice(stops)) if stops else value
            slopes, tables = loop["changes"][key].values()
            slopes = {k: (x.astype(int), rates) for k, (x, rates) in slopes.items()}
            change = Change(
                value=one["value"], values=stops or [], slopes=slopes, stops=tables
            )
            for k, x in loop["numbers"].items():
                numbers = {**numbers, k: change.Added(k, x, numbers[k], value)}
            field = key.replace("_delay", "_channel.delay")
            chosen[field] = int(value) if key.endswith("seed") else value
        scenario = LoadScenario(name, {**more, **loop["choice"], **chosen})
        model = dataclasses.replace(ModelOf(scenario), numbers=numbers)
        # Sums differ in their last digits, which many bounces magnify.
        AssertSame(scenario, model, 1e-7)


def Kinds():
    """The scenarios, one that explodes, and one with each kind."""
    # Of six axes the first contact: a module here calls Python for each exp().
    for name in sorted(ScenarioNames()):
        yield name, {"duration": 3.0} if name == "puma560_six_axes" else {}
    yield "network_tracking_coupled", {"disturbance.gain": -100.0}
    for kind in sorted(ARCHITECTURES):
        yield "one_dof", {"controller.kind": kind}
    against = {"controller.damped_force.against": "command"}
    yield "one_dof", {"controller.kind": "damped_force", **against}
    for kind, more in (
        ("variable", {"sinusoid": {"amplitude": 0.03, "frequency": 2.0}}),
        ("sampled", {"sample_period": 0.01}),
        ("network", {"sample_period": 0.01, "seed": 3}),
        ("network", {"sample_period": 0.01, "netem": NETEM}),
        ("network", UNEVEN),
        ("network", {"sample_period": 0.04, "periods": [0.02, 0.06], "seed": 3}),
    ):
        channel = {"kind": kind, "delay": 0.1, **more}
        yield "one_dof", {f"{way}_channel": channel for way in ("forward", "return")}
    # A packet on the way back has no force.
    yield "one_dof", FIELDS
    needed = {"minimum_jerk": {"surgeon.waypoints": [[0.3], [0.1]]}}
    needed["recorded"] = {"surgeon.file": "v.csv"}
    for kind in OPERATOR_KINDS.names:
        more = needed.get(kind, {})
        yield "one_dof", {"surgeon.kind": kind, "duration": 8.0, **more}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "more"), [*Kinds()], ids=str)
def test_every_kind(tmp_path, monkeypatch, name, more):
    monkeypatch.chdir(tmp_path)
    # So many rows that they are searched where they lie.
    times = np.linspace(0.0, 6.0, 61)
    hand = np.interp(times, [0, 0.4, 2, 2.1, 6], [0, 0.1, 0.1, -0.05, 0])
    rows = [f"{t:.3f},{v:.6f}" for t, v in zip(times, hand, strict=True)]
    (tmp_path / "v.csv").write_text("\n".join(["time,v_x", *rows]))
    AssertSame(LoadScenario(name, more))
