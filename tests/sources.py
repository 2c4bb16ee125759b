"""Signals that go into a channel by itself."""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiscreteStateIndex, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, Integrator
from wired import InSeries, Wired


class Step(LeafSystem):
    """Jumps from one vector to another at a time, by an unrestricted update."""

    def __init__(self, *, time, before, after):
        super().__init__()
        self.DeclareDiscreteState(np.array(before, dtype=float))
        self._after = np.array(after, dtype=float)
        self.DeclareStateOutputPort("y", DiscreteStateIndex(0))
        self.DeclarePeriodicUnrestrictedUpdateEvent(1e12, time, self._Jump)

    def _Jump(self, context, state):
        state.get_mutable_discrete_state(0).SetFromVector(self._after)


class Ramp:
    """A delay fed by the signal start + [1, 2] t."""

    def __init__(self, dut, start=(0.0, 0.0)):
        self.dut = dut
        parts = {
            "slope": ConstantVectorSource([1.0, 2.0]),
            "ramp": Integrator(list(start)),
            "dut": dut,
        }
        self.simulator = Simulator(Wired(parts, InSeries(*parts)))
        self.context = dut.GetMyContextFromRoot(self.simulator.get_context())

    def Eval(self):
        return self.dut.get_output_port().Eval(self.context).copy()

    def Output(self, time):
        """Returns the output at a time, after the events there."""
        self.simulator.AdvanceTo(time)
        self.simulator.AdvancePendingEvents()
        return self.Eval()
