"""Diagrams in which one connection can be made late, for runs beside its margin."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import DiagramBuilder, System

from teleop_drake.loops import TransportDelay, simulate

# A run decides if the deviations at its end and in its middle differ by this factor. It
# becomes twice as long until it does.
_CLEAR = 1.5
_MOST_DOUBLINGS = 12


@dataclass
class Wiring:
    """Builds a Diagram, with TransportDelays in some of its connections.

    Attributes:
        late: The delay in s and the value before it, keyed as DelayMargins() is.
        path: The path of the Diagram that is built, with a slash at its end.
    """

    late: dict
    path: str = ""
    builder: DiagramBuilder = field(default_factory=DiagramBuilder)

    def Add(self, name, system):
        return self.builder.AddNamedSystem(name, system)

    def Inner(self, name):
        """Returns the wiring of a Diagram inside of this one."""
        return Wiring(self.late, f"{self.path}{name}/")

    def Connect(self, source, target):
        """Connects two ports, or two systems at their only ports."""
        output = source.get_output_port() if isinstance(source, System) else source
        port = target.get_input_port() if isinstance(target, System) else target
        late = self._Late(port)
        if late is not None:
            self.builder.Connect(late.get_output_port(), port)
            port = late.get_input_port()
        self.builder.Connect(output, port)

    def Export(self, name, *ports):
        """Exports input ports as one input."""
        for i, port in enumerate(ports):
            late = self._Late(port)
            target = port
            if late is not None:
                self.builder.Connect(late.get_output_port(), port)
                target = late.get_input_port()
            if i == 0:
                self.builder.ExportInput(target, name)
            else:
                self.builder.ConnectInput(name, target)

    def Build(self, name="diagram"):
        diagram = self.builder.Build()
        diagram.set_name(name)
        return diagram

    def _Late(self, port):
        """Returns the delay before an input port; None if its signal is not late."""
        wire = f"{self.path}{port.get_system().get_name()}.{port.get_name()}"
        if wire not in self.late:
            return None
        time, value = self.late[wire]
        late = TransportDelay(time, port.size(), initial_value=value)
        return self.Add("late", late)


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
