"""Drake's events of a block, made of its kernel's transitions."""

import math

import numpy as np
import pytest
from kernel_checks import CheckKernel
from pydrake.systems.analysis import Simulator

from teleop_drake.loops.kernel import Kernel, KernelBlock, Transition


def relax(state, mode):
    return mode[:1] - state


def above(mode, state):
    return mode[0] * (state - 0.5) - (1 - mode[0])


def switched(mode):
    return np.array([1 - mode[0], mode[1], mode[2]])


def second_for_first(mode):
    return np.array([mode[0], mode[2], mode[2]])


def first_for_second(mode):
    return np.array([mode[0], mode[1], mode[1]])


class Timer(KernelBlock):
    """Goes towards 1 until it is at 1/2; swaps two numbers every 0.3 s."""

    def __init__(self):
        KernelBlock.__init__(self)
        self.DeclareContinuousState(1)
        self.DeclareDiscreteState([1.0, 3.0, 4.0])
        self.DeclareOutputs(mode=3)

    def Kernel(self):
        swaps = {"period": 0.3, "offset": 0.1}
        return Kernel(
            outputs={"mode": "mode"},
            rate=(relax, "state", "mode"),
            transitions={
                "switches": Transition(
                    guard=(above, "mode", "state"), mode=(switched, "mode")
                ),
                "first": Transition(mode=(second_for_first, "mode"), **swaps),
                "second": Transition(mode=(first_for_second, "mode"), **swaps),
            },
        )


def test_events_are_those_of_the_transitions():
    simulator = Simulator(Timer())
    context = simulator.get_mutable_context()
    context.SetAccuracy(1e-9)
    simulator.get_mutable_integrator().set_maximum_step_size(0.05)
    simulator.AdvanceTo(2.2)
    # Eight swaps, of which each sees both numbers as they were.
    assert context.get_discrete_state_vector().value().tolist() == [0, 3, 4]
    x = 0.5 * math.exp(math.log(2) - 2.2)
    assert context.get_continuous_state_vector()[0] == pytest.approx(x, abs=1e-5)
    assert CheckKernel(Timer()) == []


def test_without_accuracy_a_guard_is_looked_at_after_each_step():
    simulator = Simulator(Timer())
    simulator.get_mutable_integrator().set_maximum_step_size(0.05)
    with pytest.warns(UserWarning, match="no event is located"):
        simulator.AdvanceTo(0.69)
    context = simulator.get_context()
    assert context.get_discrete_state_vector()[0] == 1
    simulator.AdvanceTo(0.76)
    assert context.get_discrete_state_vector()[0] == 0
