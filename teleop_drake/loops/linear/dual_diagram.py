"""A diagram of the blocks that Drake converts to AutoDiffXd."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import (
    Context,
    DiagramBuilder_,
    InputPort,
    LeafSystem_,
    OutputPort,
    PortDataType,
    System,
)

from teleop_drake.loops.engine.flatten import Block
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.wiring import InputPorts
from teleop_drake.loops.kernel.block import DualBlock


class Twin(NamedTuple):
    """A system of a diagram or its counterpart in the converted diagram.

    Attributes:
        system: The system, of any scalar type.
        context: Its Context.
    """

    system: Any
    context: Any

    def PortOf(self, port: InputPort | OutputPort) -> Any:
        """Returns the port that corresponds to a port of the original system."""
        index = int(port.get_index())
        if isinstance(port, OutputPort):
            return self.system.get_output_port(index)
        return self.system.get_input_port(index)


class NotConverted(Exception):
    """Raised where the value of a block is needed that does not convert."""


class DualDiagram:
    """The blocks of a diagram that convert to AutoDiffXd, connected without levels.

    The output of a block that does not convert raises NotConverted when it is
    evaluated.

    Args:
        blocks: All blocks of the diagram.
        needed: The blocks to convert.
        contexts: The Context of each system in the diagram.

    Attributes:
        twins: The converted form of each needed block that converts.
        mismatched: Blocks whose converted output does not fit to its receiver, as a
            constant value of floats, or that have such a value as a fixed input.
    """

    def __init__(
        self,
        blocks: Sequence[Block],
        needed: Sequence[Block],
        contexts: Mapping[System, Context],
    ):
        self.twins: dict[System, Twin] = {}
        self.mismatched: set[System] = set()
        self._contexts = contexts
        duals = {x.system: x.system.ToAutoDiffXdMaybe() for x in needed}
        duals = {system: dual for system, dual in duals.items() if dual is not None}
        if not duals:
            return
        builder = DiagramBuilder_[AutoDiffXd]()
        for i, dual in enumerate(duals.values()):
            builder.AddNamedSystem(str(i), dual)
        converted = [block for block in needed if block.system in duals]
        for block in converted:
            for name, source in block.inputs.items():
                origin = blocks[source.block].system
                output = None
                if origin in duals:
                    output = duals[origin].GetOutputPort(source.port)
                if not _Connect(builder, output, duals[block.system], name):
                    self.mismatched.add(origin)
            # A fixed value that is not a vector may have to be of another type.
            for port in self._OpenInputs(block):
                if port.get_data_type() != PortDataType.kVectorValued:
                    _Connect(builder, None, duals[block.system], port.get_name())
                    self.mismatched.add(block.system)
        diagram = builder.Build()
        self._root = diagram.CreateDefaultContext()
        own = ContextsIn(diagram, self._root)
        for block in converted:
            dual = duals[block.system]
            twin = Twin(dual, own[dual])
            self.twins[block.system] = twin
            for port in self._OpenInputs(block):
                if port.get_data_type() == PortDataType.kVectorValued:
                    value = port.Eval(contexts[block.system])
                    twin.PortOf(port).FixValue(twin.context, value)

    def SetFrom(self, root: Context) -> None:
        """Sets time, states and parameters to those of the original diagram.

        Args:
            root: The Context of the original diagram.
        """
        self._root.SetTime(root.get_time())
        self._root.SetAccuracy(root.get_accuracy())
        for system, twin in self.twins.items():
            twin.context.SetStateAndParametersFrom(self._contexts[system])

    def _OpenInputs(self, block: Block) -> list[InputPort]:
        """Returns the inputs of a block that are not connected and have a value."""
        context = self._contexts[block.system]
        known = {*block.inputs, *block.idle}
        return [
            port
            for port in InputPorts(block.system)
            if port.get_name() not in known and port.HasValue(context)
        ]


class _Absent(LeafSystem_[AutoDiffXd]):
    """A block in the place of one that does not convert; it has no value.

    Args:
        receiver: The converted block that receives its output.
        port: The input port that receives it.
    """

    def __init__(self, receiver: Any, port: Any):
        LeafSystem_[AutoDiffXd].__init__(self)

        def Calc(context: Any, output: Any) -> None:
            raise NotConverted

        if port.get_data_type() == PortDataType.kVectorValued:
            self.DeclareVectorOutputPort("output", port.size(), Calc)
        else:
            model = receiver.AllocateInputAbstract(port)
            self.DeclareAbstractOutputPort("output", model.Clone, Calc)


def _Connect(builder: Any, output: Any, receiver: Any, name: str) -> bool:
    """Connects an input of a converted block; returns whether the output fits.

    Args:
        builder: The builder of the converted diagram.
        output: The output; None if its block does not convert.
        receiver: The converted block.
        name: The name of its input port.
    """
    port = receiver.GetInputPort(name)
    fits = True
    if output is not None:
        try:
            builder.Connect(output, port)
            return True
        except RuntimeError:
            fits = False
    absent = builder.AddSystem(_Absent(receiver, port))
    builder.Connect(absent.get_output_port(), port)
    return fits


def Converts(system: System, context: Context) -> bool:
    """Returns whether a block converts to AutoDiffXd and can be evaluated at a point.

    The rates and outputs of a block of this package are evaluated, unless it has
    abstract states. Their functions may not accept AutoDiffXd.
    """
    dual = system.ToAutoDiffXdMaybe()
    if not isinstance(dual, DualBlock) or context.num_abstract_states():
        return dual is not None
    own = dual.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    dual.FixInputPortsFrom(system, context, own)
    try:
        dual.EvalTimeDerivatives(own)
        for i in range(dual.num_output_ports()):
            dual.get_output_port(i).Eval(own)
    except TypeError:
        return False
    return True
