"""Every block of the package has a kernel that computes what the block does."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from kernel_checks import CheckKernel
from pydrake.systems.framework import LeafSystem
from pydrake.systems.primitives import Sine, ZeroOrderHold
from wired import Wired

from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile, Sinusoid, VariableDelay
from teleop_drake.loops.engine.check import (
    CheckVisited,
    KernelDisagrees,
)
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.kernel import Kernel
from teleop_drake.model.blocks.architectures.four_channel import (
    FourChannelConfig,
    FourChannelMaster,
    FourChannelSlave,
    LocalController,
)
from teleop_drake.model.blocks.architectures.wave_variables import (
    WaveMaster,
    WaveSlave,
    WaveVariablesConfig,
)
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.blocks.environments.layered_force_field import (
    LayerConfig,
    LayeredForceField,
)
from teleop_drake.model.blocks.operators import ConstantVelocityOperator
from teleop_drake.model.blocks.operators.base import past_surface, with_stop
from teleop_drake.model.blocks.operators.planned import TrapezoidConfig
from teleop_drake.model.blocks.systems.disturbance_force import DisturbanceForce

I = np.eye(2)
LOCAL = LocalController(damping=I, stiffness=9 * I)
FOUR = FourChannelConfig(
    master_damping=1.0,
    slave_damping=1.0,
    C_m=LOCAL,
    C_s=LOCAL,
    **{"C1": 1.0, "C2": 1.0, "C3": 0.5, "C4": 0.5, "C5": 0.1, "C6": 0.1},
)
WAVES = WaveVariablesConfig(
    impedance=2.0,
    master_damping=1.0,
    forward_scaling=0.9,
    return_scaling=1.0,
)
MATCHED = replace(WAVES, master_damping=2.0, return_scaling=0.9)


@pytest.mark.parametrize(
    "block",
    [
        WaveMaster(WAVES, start=[0.1, 0]),
        WaveMaster(MATCHED, start=[0.1, 0]),
        WaveSlave(WAVES, num_axes=2),
        FourChannelMaster(FOUR, start=[1, 0]),
        FourChannelSlave(FOUR, start=[1, 0]),
        TransportDelay(delay=0, size=2),
        DisturbanceForce(kind="linear", gain=I),
        DisturbanceForce(kind="coupled", gain=I),
    ],
)
def test_a_variant_has_a_kernel(block):
    CheckKernel(block)


def layers():
    return [
        LayerConfig(name=name, start=start, stiffness=k, damping=d, reference=start)
        for name, start, k, d in (
            ("tissue", 0.2, 80.0, 3.0),
            ("free", 0.8, 0.0, 0.0),
            ("bone", 1.2, 800.0, 3.0),
        )
    ]


def bent_profile():
    return DelayProfile(
        delay=0.2,
        sinusoid=Sinusoid(amplitude=0.05, frequency=4.0),
        trace=([0.0, 0.5, 0.9, 3.0], [0.0, 0.1, 0.05, 0.2]),
    )


def network():
    return PacketNetwork(
        profile=DelayProfile(delay=0.1),
        sample_period=0.02,
        jitter=Jitter(kind="gamma", std=0.02),
        loss=Loss(kind="independent", probability=0.2),
        seed=1,
        stream="here",
    )


def operator():
    return ConstantVelocityOperator(
        velocity=[0.1, 0.0],
        contact_force=[1.0, 2.0],
        contact_surface=Surface("contact", np.array([0.5, 0.0]), np.array([1.0, 0.0])),
        stop_time=0.9,
    )


def stopped_when_it_stays():
    """Two transitions at one instant."""
    return TrapezoidConfig(
        velocity=[1.0, 2.0], contact_force=[1.0, 2.0], rise_time=0.5, stop_time=0.5
    ).MakeOperator(start=[0.0, 0.0])


# What changes its mode, or delays, and is therefore run.
BLOCKS = {
    "operator": operator,
    "trapezoid": stopped_when_it_stays,
    "layers": lambda: LayeredForceField(layers=layers(), num_axes=2),
    "transport": lambda: TransportDelay(delay=0.3, size=2, initial_value=[1, 2]),
    "sampled": lambda: SampledDelay(delay=0.3, size=2, sample_period=0.07),
    "variable": lambda: VariableDelay(profile=bent_profile(), size=1),
    "network": lambda: NetworkDelay(
        network=network(), receiver=Receiver(policy="extrapolate"), size=2
    ),
    "hold": lambda: ZeroOrderHold(0.1, 2),
}


@pytest.mark.mostly_slow
@pytest.mark.parametrize("block", BLOCKS)
def test_transitions_and_delays_are_checked(block):
    assert CheckKernel(BLOCKS[block](), num_states=3) == []


WRONG_PLACE = (past_surface, "mode", "felt_position", "normal", "normal")


def wrong(block, **changes):
    """Returns a block whose kernel is not its own in one respect."""
    system = BLOCKS[block]()
    kernel = system.Kernel()
    (name, first), *_ = kernel.transitions.items() or [("", None)]
    if first is not None:
        changed = {
            "transitions": {**kernel.transitions, name: replace(first, **changes)}
        }
    else:
        changed = {"delays": [replace(kernel.delays[0], **changes)]}
    system.Kernel = lambda: replace(kernel, **changed)
    return system


@pytest.mark.parametrize(
    ("block", "changes"),
    [
        ("operator", {"guard": WRONG_PLACE}),
        ("operator", {"mode": (with_stop, "mode")}),
        ("transport", {"initial_value": [1, 2.1]}),
        ("variable", {"time": lambda t: 0.2}),
        ("network", {"shown": lambda k: np.inf}),
    ],
)
def test_a_wrong_transition_or_delay_is_found(block, changes):
    with pytest.raises(KernelDisagrees, match="its kernel says"):
        CheckKernel(wrong(block, **changes), num_states=1)


class Limit(LeafSystem):
    """y = u, of which the kernel says it for u <= 0.5 only."""

    def __init__(self):
        LeafSystem.__init__(self)
        self._u = self.DeclareVectorInputPort("u", 1)
        self.DeclareVectorOutputPort("y", 1, self._Calc)

    def Kernel(self):
        return Kernel(outputs={"y": (np.minimum, "u", "limit")}, parameters=LIMIT)

    def _Calc(self, context, output):
        output.SetFromVector(self._u.Eval(context))


LIMIT = {"limit": np.array([0.5])}


@pytest.mark.parametrize("end, is_found", [(0.7, False), (1.5, True)])
def test_a_kernel_is_checked_where_the_run_has_been(end, is_found):
    diagram = Wired(
        {
            "source": Sine(1.0, 1.0, 0.0, True),
            "delay": TransportDelay(delay=0.3, size=1),
            "limit": Limit(),
        },
        {"delay": "source.y0", "limit": "delay"},
    )
    context = diagram.CreateDefaultContext()
    rest = {"end": end, "accuracy": 1e-6, "max_step": 0.1}
    run = CompiledRun(Evaluator(diagram, context), context, **rest)
    run.Advance(end)
    found = pytest.raises(KernelDisagrees, match="limit: its kernel says y")
    with found if is_found else contextlib.nullcontext():
        CheckVisited(run.evaluator, diagram, context, run.visited)


def test_what_did_not_happen_is_told():
    block = ConstantVelocityOperator(velocity=[0.1], stop_time=99.0)
    assert CheckKernel(block) == ["stops"]
