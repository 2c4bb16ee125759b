"""Laws as machine code give the numbers of the laws."""

import sys
import threading
import types

import numpy as np
import pytest
from block_checks import Gains
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation

from teleop_drake.loops.engine.plant_tree import ReadPlantTree
from teleop_drake.loops.jit import compiled
from teleop_drake.loops.jit.compiled import CompiledLaw
from teleop_drake.loops.kernel import Kernel, KernelBlock
from teleop_drake.model.blocks.robots import TwoLinkArmConfig
from teleop_drake.model.laws.backstepping import (
    adaptive_errors,
    adaptive_rate,
    unpack_state,
)
from teleop_drake.model.laws.gaussian_network import GaussianNetwork
from teleop_drake.model.laws.robust_backstepping import (
    RobustBounds,
    robust_errors,
    robust_rate,
)
from teleop_drake.model.laws.task_space import (
    Tool,
    joint_torques,
    tool_acceleration,
    tool_kinematics,
)


@pytest.fixture(autouse=True)
def compiles_at_the_first_call(monkeypatch):
    monkeypatch.setattr(compiled, "_COMPILED_CALL", 1)


def AssertSame(law, constants, samples):
    """Compares a law with its machine code, which has to exist, for many arguments."""
    fast = CompiledLaw(law, *constants)
    for arguments in samples:
        result = fast(*arguments)
        expected = law(*constants, *arguments)
        assert fast._run is not fast.law
        assert result.shape == expected.shape
        scale = max(np.max(np.abs(expected)), 1.0)
        assert_allclose(result, expected, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize(
    ("n", "is_at_limit"), [(1, True), (2, False), (2, True), (3, True)]
)
def test_backstepping(n, is_at_limit):
    rng = np.random.default_rng(n)
    I = np.eye(n)
    gains = Gains(n, Psi_min=2.0 if is_at_limit else 0.1)
    network = GaussianNetwork(lower=[0] * n, upper=[1] * n, count=[2] * n, width=1.2)
    samples = []
    for _ in range(20):
        x = rng.normal(size=n * (1 + n + 2 * network.num_functions))
        unpack_state(x, n).Psi[:] = 1.9 * I + 0.1 * rng.normal(size=(n, n))
        samples.append((x, *rng.normal(size=(5, n))))
    constants = gains.as_numbers(), network.as_numbers()
    AssertSame(adaptive_rate, constants, samples)
    AssertSame(adaptive_errors, constants, samples)
    if n == 3:  # The networks are the same ones.
        return
    bounds = RobustBounds(0.3, 0.1, 2.0, 0.2)
    AssertSame(robust_rate, (bounds, *constants), samples)
    AssertSame(robust_errors, (bounds, *constants), samples)


def test_task_space():
    rng = np.random.default_rng(0)
    plant = TwoLinkArmConfig().LoadPlant()
    for n in (1, 2, 3, 6):
        R = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        X = np.hstack([R, rng.normal(size=(3, 1))])
        tool = Tool(ReadPlantTree(plant, plant.CreateDefaultContext()).tree, 1, X, n)
        x = rng.normal(size=4)
        qddot = rng.normal(size=2)
        AssertSame(tool_kinematics, (tool, np.eye(3)), [(x,)])
        AssertSame(tool_acceleration, (tool,), [(x, qddot)])
        forces = rng.normal(size=(2, n))
        AssertSame(joint_torques, (), [(*forces, rng.normal(size=n * (2 + 4)))])


def halved(u):
    while abs(u[0]) > 1e-3:
        u = u / 2
    return u


def test_what_is_no_graph_of_operations_stays_as_it_is_and_says_so_once(caplog):
    for law in (CompiledLaw(halved), CompiledLaw(halved)):
        assert law(np.array([3.0])) == law(np.array([3.0])) == halved(np.array([3.0]))
        assert law._run is law.law
    (record,) = caplog.records
    assert record.message.startswith("not compiled: halved(), line ")


def test_a_law_is_compiled_after_some_calls(monkeypatch):
    monkeypatch.setattr(compiled, "_COMPILED_CALL", 3)
    law = CompiledLaw(lambda x: x + 1.0)
    are_compiled = []
    for k in range(4):
        assert law(np.array([float(k)])) == k + 1.0
        are_compiled.append(law._run is not None)
    assert are_compiled == [False, False, True, True]


def test_whole_numbers_as_arguments_are_numbers():
    law = CompiledLaw(lambda n, x, y: n * x + y, 2)
    for arguments in ((np.array([1, 2]), 3), (np.array([0.5, 0.25]), 0.125)):
        x, y = arguments
        assert_array_equal(law(*arguments), 2 * x + y)


LIMIT = 4.0
COUNT = np.int64(4)
LIMITS = [4.0]
TABLE = {"limit": np.array([4.0])}
settings = types.ModuleType("settings")
exec("LIMIT = 4.0\ndef limit(): return LIMIT", settings.__dict__)


class Config:
    limit = 4.0

    def __init__(self):
        self.inner = types.SimpleNamespace(limit=4.0)

    def Limit(self):
        return self.inner.limit


config = Config()


def helper(scale, *, limit=4.0):
    return scale * limit


def with_default(x, limit=4.0):
    return x + limit


def with_keyword(x):
    return x + helper(1.0)


def with_module(x, module=settings):
    return x + getattr(module, "LIMIT")  # noqa: B009


def with_import(x):
    import settings

    return x + settings.LIMIT


def around():
    limits = [4.0]
    limit = 4.0

    def in_list(x):
        return x + limits[0]

    def in_variable(x):
        return x + limit

    def Change(value):
        nonlocal limit
        limits[0] = limit = value

    return in_list, in_variable, Change


in_list, in_variable, change_around = around()
constant = np.array([4.0])


def setting(owner, name="limit"):
    return lambda value: setattr(owner, name, value)


def item(owner, key=0):
    return lambda value: owner.__setitem__(key, value)


def in_globals(value):
    globals().update(LIMIT=value, COUNT=np.int64(value))


in_module = setting(settings, "LIMIT")

OUTSIDE = {
    "global": (lambda x: x + LIMIT, in_globals),
    "comprehension": (lambda x: np.array([y + LIMIT for y in x]), in_globals),
    "numpy integer": (lambda x: x + COUNT, in_globals),
    "list": (lambda x: x + LIMITS[0], item(LIMITS)),
    "array in a dict": (lambda x: x + TABLE["limit"], item(TABLE["limit"])),
    "module": (lambda x: x + settings.LIMIT, in_module),
    "function of a module": (lambda x: x + settings.limit(), in_module),
    "module as an argument": (with_module, in_module),
    "import": (with_import, in_module),
    "class": (lambda x: x + Config.limit, setting(Config)),
    "class of an object": (lambda x: x + config.limit, setting(Config)),
    "object in a method": (lambda x: x + config.Limit(), setting(config.inner)),
    "list around": (in_list, change_around),
    "variable around": (in_variable, change_around),
    "default": (with_default, lambda v: setattr(with_default, "__defaults__", (v,))),
    "keyword's default": (with_keyword, item(helper.__kwdefaults__, "limit")),
    "helper": (
        with_keyword,
        lambda v: globals().update(helper=lambda scale: scale * v),
    ),
    "constant": (lambda c, x: x + c, item(constant), constant),
}


@pytest.mark.parametrize("name", OUTSIDE)
def test_what_is_outside_is_read_when_a_law_is_traced(name, monkeypatch):
    function, change, *constants = OUTSIDE[name]
    monkeypatch.setitem(sys.modules, "settings", settings)
    if name == "helper":
        monkeypatch.setitem(globals(), "helper", helper)
    x = np.array([1.0])
    for value in (6.0, 4.0):
        before = CompiledLaw(function, *constants)
        traced = before(x)
        change(value)
        assert before(x) == traced != 1.0 + value
        law = CompiledLaw(function, *constants)
        assert law(x) == function(*constants, x) == 1.0 + value
        assert law._run is not law.law


def test_what_changes_with_each_call_is_not_compiled():
    rng = np.random.default_rng(0)
    law = CompiledLaw(lambda x: x + rng.normal())
    assert law(np.array([1.0])) != law(np.array([1.0]))


class Growth(KernelBlock):
    """dx/dt = LIMIT."""

    is_compiled = True

    def __init__(self):
        KernelBlock.__init__(self)
        self.DeclareContinuousState(1)
        self.DeclareOutputs(x=1)

    def Kernel(self):
        return Kernel(outputs={"x": "state"}, rate=(growth, "state"))


def growth(x):
    return 0.0 * x + LIMIT


def test_a_block_that_is_made_anew_is_traced_anew(monkeypatch):
    for limit in (4.0, 6.0):
        monkeypatch.setitem(globals(), "LIMIT", limit)
        simulator = Simulator(Growth())
        simulator.AdvanceTo(1.0)
        state = simulator.get_context().get_continuous_state_vector()
        assert state.CopyToVector() == pytest.approx([limit])


def test_results_stay_when_it_is_called_again():
    law = CompiledLaw(lambda x: 2 * x)
    first = law(np.array([1.0]))
    law(np.array([5.0]))
    assert first == 2.0


def test_threads_do_not_share_what_they_work_with():
    law = CompiledLaw(lambda x: x + 1.0)
    wrong = []

    def Call(value):
        x = np.full(50, value)
        wrong.extend(i for i in range(3000) if (law(x) != value + 1.0).any())

    threads = [threading.Thread(target=Call, args=(float(k),)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_a_law_may_have_no_arguments():
    law = CompiledLaw(lambda: np.array([2.0, LIMIT]))
    assert_array_equal(law(), [2.0, LIMIT])
    assert law._run is not law.law
