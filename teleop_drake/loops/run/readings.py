"""The values of output ports, copied from the memory of a Context.

OutputPort.Eval() makes an array at each call, which takes longer than most outputs of
Drake's. Drake keeps the value of an output at one place of the memory as long as its
Context exists. Here an output is evaluated there without an array, and the values of
all outputs are copied in one go.
"""

from collections.abc import Iterable

from pydrake.systems.framework import BasicVector, Context, OutputPort

from teleop_drake.loops.framework.arrays import Array


class Readings:
    """Reads some output ports in a Context.

    Attributes:
        readers: What evaluates the ports, and the Context of each.
        memory: The values of each port, eight bytes for each element. They are known
            from the first reading on, and are those of the last evaluation.

    Args:
        ports: The ports, of the systems in a Diagram or of one system.
        root_context: The Context of the Diagram.
    """

    def __init__(self, ports: Iterable[OutputPort], root_context: Context):
        self._evaluations = [
            (port.EvalBasicVector, port.get_system().GetMyContextFromRoot(root_context))
            for port in ports
        ]
        self.readers = self._evaluations
        self.memory: list[memoryview] = []

    def EvaluateOnly(self, indices: Iterable[int]) -> None:
        """Leaves out ports that are evaluated whenever some others are.

        Args:
            indices: The indices of the others among all ports.
        """
        self.readers = [self._evaluations[i] for i in indices]

    def Read(self) -> bytes:
        """Evaluates the ports; returns their values in a row."""
        if not self.memory:
            self.memory = [MemoryOf(f(own)) for f, own in self._evaluations]
        for evaluate, own in self.readers:
            evaluate(own)
        return b"".join(self.memory)


def MemoryOf(vector: BasicVector) -> memoryview:
    """Returns the memory of a vector in a Context, which shows all later values."""
    values: Array = vector.value()
    if values.size == 0:
        return memoryview(b"")
    return values.data.cast("B")
