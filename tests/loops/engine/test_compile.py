"""Machine code of diagrams: the same numbers, compiled once a structure."""

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from kernel_checks import CheckKernel
from pydrake.systems.framework import LeafSystem
from pydrake.systems.primitives import Gain, Integrator
from wired import Wired

from teleop_drake.loops.engine.check import Compare
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.known_programs import ForgetPrograms
from teleop_drake.loops.jit.packing import Group, Parameters, Place
from teleop_drake.loops.kernel import Kernel


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    ForgetPrograms()
    return tmp_path / "teleop-drake" / "kernels"


def decay(rate):
    return Wired(
        {"state": Integrator([1.0, 2.0]), "gain": Gain(-rate, 2)},
        {"gain": "state", "state": "gain"},
    )


def check_machine_code(diagram):
    context = diagram.CreateDefaultContext()
    evaluator = Evaluator(diagram, context, as_machine_code=True)
    Compare(evaluator, diagram, context)
    return evaluator.function


def test_numbers_are_data_and_structure_is_code(cache):
    first = check_machine_code(decay(3.0))
    assert check_machine_code(decay(4.0)) is first
    ForgetPrograms()
    other = check_machine_code(decay(4.0))
    assert other is not first
    assert len(list(cache.rglob("evaluate_*.o"))) == 1


def test_code_is_used_again_where_it_would_be_the_same():
    def Compiled(diagram, like=None):
        context = diagram.CreateDefaultContext()
        return Evaluator(diagram, context, as_machine_code=True, like=like)

    first = Compiled(decay(3.0))
    assert Compiled(decay(4.0), like=first).function is first.function
    other = Integrator([1.0])
    diagram = Wired({"other": other}, {}, inputs={"u": "other"})
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, [0.0])
    anew = Evaluator(diagram, context, as_machine_code=True, like=first)
    assert anew.function is not first.function


RATES = {"rate": 4.0}


class Constant(LeafSystem):
    """y = u + what stands in a dict."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("u", 1)
        self.DeclareVectorOutputPort("y", 1, lambda context, output: None)

    def Kernel(self):
        return Kernel(outputs={"y": (raised, "u")})


def raised(u):
    return u + RATES["rate"]


def test_a_change_between_two_runs_is_seen(monkeypatch):
    for rate in (4.0, 6.0, 4.0):
        monkeypatch.setitem(RATES, "rate", rate)
        system = Constant()
        context = system.CreateDefaultContext()
        system.GetInputPort("u").FixValue(context, [1.0])
        y, _ = Evaluator(system, context, as_machine_code=True).Evaluate(context)
        assert y[0] == 1.0 + rate


def test_without_a_place_to_keep_it_the_code_still_runs(cache):
    cache.parent.mkdir()
    cache.write_text("in the way")
    check_machine_code(decay(3.0))


@pytest.mark.slow
def test_several_processes_may_compile_at_once(cache):
    here = Path(__file__).parent
    program = (
        f"import sys; sys.path[:0] = {[str(here), str(here.parents[1])]}\n"
        "import test_compile as t; t.check_machine_code(t.decay(3.0))"
    )
    runs = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(3)]
    assert [run.wait() for run in runs] == [0, 0, 0]
    # A gain of 1 would be another program: Drake leaves it out of its expressions.
    check_machine_code(decay(2.0))
    assert len(list(cache.rglob("evaluate_*.o"))) == 1


class Halving(LeafSystem):
    """y = u, halved until it is small: a loop that no graph has."""

    def __init__(self):
        LeafSystem.__init__(self)
        self._u = self.DeclareVectorInputPort("u", 1)
        self.DeclareVectorOutputPort("y", 1, self._Calc)

    def Kernel(self):
        return Kernel(outputs={"y": (halved, "u")})

    def _Calc(self, context, output):
        output.SetFromVector(halved(self._u.Eval(context)))


def halved(u):
    while abs(u[0]) > 1e-3:
        u = u / 2
    return u


def test_what_is_no_graph_of_operations_is_named():
    system = Halving()
    system.set_name("halving")
    context = system.CreateDefaultContext()
    system.GetInputPort("u").FixValue(context, [0.3])
    Compare(Evaluator(system, context), system, context)
    with pytest.raises(UnsupportedSystem, match=r"halved\(\), line \d+: there are too"):
        CheckKernel(Halving())
    with pytest.raises(
        UnsupportedSystem, match=r"'halving' cannot .* halved\(\), line"
    ):
        Evaluator(system, context, as_machine_code=True)


def test_a_plant_that_several_blocks_read_is_there_once():
    """The masses of one of them differ; the rest is computed once for both."""
    parameters = Parameters()
    first, second, third = (Place(i, (3,)) for i in (0, 3, 6))
    one = parameters.Add(Links(np.arange(3.0), np.arange(3.0)))
    assert one == Group(Links, (first, second))  # Equal fields are still two numbers.
    assert parameters.Add(Links(np.arange(3.0), np.arange(3.0))) == one
    other = parameters.Add(Links(np.arange(3.0), np.ones(3)))
    assert other == Group(Links, (first, third))


class Links(NamedTuple):
    frames: np.ndarray
    masses: np.ndarray
