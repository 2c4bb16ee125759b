"""Diagrams in which one connection can be made late, for runs beside its margin."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from wired import Wired

from teleop_drake.loops import TransportDelay, simulate

# A run decides if the deviations at its end and in its middle differ by this factor. It
# becomes twice as long until it does.
_CLEAR = 1.5
_MOST_DOUBLINGS = 12


def Late(late, systems, connections, outputs=None, inputs=None, path=""):
    """Returns a Diagram as Wired() does, with TransportDelays in some connections.

    Args:
        late: The delay in s and the value before it, keyed as DelayMargins() is.
        path: The path of the Diagram that is built, with a slash at its end.
    """
    systems = dict(systems)
    wires = {}

    def Behind(target):
        """Returns what is connected instead of an input, which may be a delay."""
        name, _, port_name = target.partition(".")
        system = systems[name]
        port = system.GetInputPort(port_name) if port_name else system.get_input_port()
        wire = f"{path}{name}.{port.get_name()}"
        if wire not in late:
            return target
        time, value = late[wire]
        systems["late"] = TransportDelay(time, port.size(), initial_value=value)
        wires[target] = "late"
        return "late"

    for target, source in connections.items():
        wires[Behind(target)] = source
    fed = {name: " ".join(map(Behind, x.split())) for name, x in (inputs or {}).items()}
    return Wired(systems, wires, outputs, fed)


@dataclass(frozen=True)
class Case:
    """A Diagram whose connections can be late.

    Attributes:
        make: Makes the Diagram from its late connections, with the output "y".
        num_finite: The number of connections with a finite margin.
        state: The continuous state at the equilibrium.
    """

    make: Callable
    num_finite: int
    state: tuple

    def At(self, diagram):
        """Returns the Context of the equilibrium."""
        context = diagram.CreateDefaultContext()
        context.SetContinuousState(self.state)
        return context

    def Grows(self, wire, delay):
        """Returns whether a small deviation grows if a connection is late."""
        diagram = self.make({})
        context = self.At(diagram)
        port = PortOf(diagram, wire)
        value = port.Eval(port.get_system().GetMyContextFromRoot(context))
        rest = diagram.GetOutputPort("y").Eval(context)
        late = self.make({wire: (delay, value)})
        start = self.At(late)
        push = 1e-6 * (1 + np.arange(len(self.state)) % 3)
        start.SetContinuousState(np.array(self.state) + push)
        duration = 20 * delay
        for _ in range(_MOST_DOUBLINGS):
            run = simulate(late, context=start, duration=duration)
            size = np.abs(run["y"] - rest).max(axis=1)
            share = run.time / duration
            middle = size[(share > 0.4) & (share < 0.6)].max()
            end = size[share > 0.8].max()
            if not 1 / _CLEAR < end / middle < _CLEAR:
                return bool(end > middle)
            duration *= 2
        raise AssertionError(f"{wire} late by {delay}: neither grows nor decays")


def PortOf(diagram, wire):
    """Returns the input port of a name as `robot/plant.force`."""
    *path, last = wire.split("/")
    for name in path:
        diagram = diagram.GetSubsystemByName(name)
    name, port = last.split(".")
    return diagram.GetSubsystemByName(name).GetInputPort(port)
