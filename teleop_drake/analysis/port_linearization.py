"""The linear model of any diagram between two of its ports, with its exact delays.

Drake's own Linearize() asks the diagram for automatic differentiation. Blocks that are
written in Python, ours as well as a user's, have no such conversion, and a delay has no
finite state; Linearize() then ends the program. LinearizePorts() takes differences of
the diagram's own derivatives and outputs instead, and keeps delays as delays.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import (
    Context,
    Diagram,
    InputPort,
    InputPortIndex,
    OutputPort,
    System,
)

from teleop_drake.analysis.cut_diagram import Concatenate, FixedInput, InnerDelay
from teleop_drake.channels.transport import TransportDelay
from teleop_drake.compiler.flatten import Block, Flatten
from teleop_drake.contexts import ContextsIn
from teleop_drake.environments import SurfacesOf
from teleop_drake.numerics.differences import differentiate
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.operators.modes import ModalOperator
from teleop_drake.validation import Refuse

Array = NDArray[np.float64]

# How much the slopes on both sides of the operating point may differ, as a share of
# the largest one.
_BEND = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PortModel:
    """What small deviations at one port of a diagram do at another one.

    With the deviations u at the input, y at the output, x of the diagram's continuous
    states in their order, and d of what the delays T_i deliver,

        [y, what goes into the delays] = model(s) [u, d]
        d_i(t) = what goes into delay i, at t - T_i

    Attributes:
        model: From [u, d] to [y, what goes into the delays].
        delays: T_i in s, an entry for each signal.
        error: Estimated error of the matrices, relative to the largest entry.
        held: Systems with a mode or a layer, which is held.
    """

    model: StateSpace
    delays: tuple[float, ...]
    error: float
    held: tuple[str, ...]

    def __repr__(self) -> str:
        """Returns sizes and delays on one line, without matrices."""
        num_outputs, num_inputs = (
            size - len(self.delays) for size in self.model.D.shape
        )
        delays = ", ".join(f"{delay:g}" for delay in sorted(set(self.delays)))
        return (
            f"PortModel({num_inputs} -> {num_outputs}, {self.model.num_states} states, "
            f"delays [{delays}] s, error {self.error:.1g}, {len(self.held)} held)"
        )

    def Response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Returns the frequency response from u to y, (M, size of y, size of u).

        Args:
            frequencies: (M,) in rad/s, none of them an undamped mode.
        """
        model, num_delays = self.model, len(self.delays)
        num_outputs = len(model.C) - num_delays
        num_inputs = model.B.shape[1] - num_delays
        delays = np.array(self.delays)
        responses = []
        for w in np.atleast_1d(np.asarray(frequencies, dtype=float)):
            resolvent = np.linalg.solve(
                1j * w * np.eye(model.num_states) - model.A, model.B
            )
            G = model.C @ resolvent + model.D
            y_u, y_d = np.split(G[:num_outputs], [num_inputs], axis=1)
            z_u, z_d = np.split(G[num_outputs:], [num_inputs], axis=1)
            shift = np.diag(np.exp(-1j * w * delays))
            d = np.linalg.solve(np.eye(num_delays) - shift @ z_d, shift @ z_u)
            responses.append(y_u + y_d @ d)
        return np.array(responses)


def LinearizePorts(
    diagram: Diagram,
    context: Context,
    input_port: InputPort,
    output_port: OutputPort,
    *,
    is_opened: bool = False,
    step: float = 1e-4,
) -> PortModel:
    """Linearises a diagram from one of its ports to another one, at any depth.

    A deviation is added to what the input port receives, as in a closed loop, or takes
    its place: then the loop is open there. Every continuous state is one of the model,
    the estimates of an adaptive law as well. What a TransportDelay holds is delayed
    exactly. The mode of an operator and the layer of an environment stay as they are.

    The operating point is a Context, at its time: nothing is trimmed. The diagram's own
    inputs have the values of that Context, or are 0. Deviations obey the model as long
    as the diagram does not move far from there.

    Args:
        diagram: Any, with at least one continuous state or delay.
        context: The operating point, of this diagram: from a Simulator, say; it is not
            changed.
        input_port: Where the deviation is: of a system in the diagram, or its own.
        output_port: Where it is seen: of a system in the diagram, or its own.
        is_opened: Whether the deviation takes the place of what the port receives.
        step: The longest difference of a state or an input, as a share of its size or
            of 1 if it is smaller; no surface of an environment may be as near.

    Returns:
        The model.

    Raises:
        ValueError: If a port is not in the diagram, a block holds samples (a channel of
            packets, a delay that varies), or a law bends at the operating point.
    """
    own = diagram.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    for i in range(diagram.num_input_ports()):
        port = diagram.get_input_port(i)
        is_known = port.HasValue(context)
        port.FixValue(own, port.Eval(context) if is_known else np.zeros(port.size()))
    cut = _Cut(diagram, own, input_port, output_port, is_opened=is_opened)
    model, error = cut.Differentiate(step)
    if cut.is_closed:
        model = _Close(model, input_port.size())
    return PortModel(
        model=model,
        delays=tuple(x.delay for x in cut.delays for _ in range(x.size)),
        error=error,
        held=cut.held,
    )


class _Cut:
    """A diagram whose input port and whose delays are set by hand.

    Attributes:
        delays: The delays.
        is_closed: Whether something in the diagram feeds the input port.
        held: Names of the systems whose discrete state is held.
    """

    def __init__(
        self,
        diagram: Diagram,
        context: Context,
        input_port: InputPort,
        output_port: OutputPort,
        *,
        is_opened: bool,
    ):
        blocks = Flatten(diagram)
        self._diagram, self._context = diagram, context
        self._contexts = ContextsIn(diagram, context)
        for port in (input_port, output_port):
            if port.get_system() not in self._contexts:
                Refuse("port", port.GetFullDescription(), "one in the diagram")
        self._output = output_port
        self.held = self._Held(blocks)
        self.delays = [
            InnerDelay(
                system=block.system,
                context=self._contexts[block.system],
                delay=block.system.delay,
            )
            for block in blocks
            if isinstance(block.system, TransportDelay) and block.system.delay > 0
        ]
        ports = _LeafPorts(input_port.get_system(), input_port.get_index())
        (first,) = (x for x in blocks if x.system is ports[0].get_system())
        source = first.inputs.get(ports[0].get_name())
        self._source: OutputPort | None = None
        if source is not None and not is_opened:
            self._source = blocks[source.block].system.GetOutputPort(source.port)
        self.is_closed = self._source is not None
        self._fixed = FixedInput(
            ports=ports, contexts=[self._contexts[x.get_system()] for x in ports]
        )
        # What they have now stays, whatever a difference does elsewhere.
        has_value = ports[0].HasValue(self._fixed.contexts[0])
        value = self._fixed.Get() if has_value else np.zeros(ports[0].size())
        for delay in self.delays:
            delay.Set(delay.Get())
        self._fixed.Set(value)

    def _Held(self, blocks: list[Block]) -> tuple[str, ...]:
        """Returns what has a discrete state that is held; refuses other such blocks."""
        held = []
        for block in blocks:
            context = self._contexts[block.system]
            groups = context.num_discrete_state_groups() + context.num_abstract_states()
            if groups == 0 or isinstance(block.system, TransportDelay):
                continue
            is_mode = isinstance(block.system, ModalOperator)
            if not is_mode and SurfacesOf(block.system) is None:
                Refuse(
                    "diagram",
                    block.path,
                    "without samples: a block whose state is not continuous has no "
                    "linear model, exact delays apart",
                )
            held.append(block.path)
        return tuple(held)

    def _Evaluate(self) -> Array:
        """Returns [dx/dt, y, what goes into the delays, what feeds the input]."""
        rates = self._diagram.EvalTimeDerivatives(self._context).CopyToVector()
        ports = [self._output, *([self._source] if self._source is not None else [])]
        values = [port.Eval(self._contexts[port.get_system()]) for port in ports]
        inner = [delay.GetInput() for delay in self.delays]
        return Concatenate([rates, values[0], *inner, *values[1:]])

    def Differentiate(self, step: float) -> tuple[StateSpace, float]:
        """Returns the model from [u, d] to the outputs of _Evaluate(), and its error.

        Args:
            step: See LinearizePorts().

        Raises:
            ValueError: If it bends.
        """
        inputs: list[FixedInput | InnerDelay] = [self._fixed, *self.delays]
        x0 = self._context.get_continuous_state_vector().CopyToVector()
        u0 = Concatenate([x.Get() for x in inputs])
        ends = np.cumsum([len(x.Get()) for x in inputs])[:-1]

        def OfState(x: Array) -> Array:
            self._context.SetContinuousState(x)
            return self._Evaluate()

        def OfInput(u: Array) -> Array:
            for port, value in zip(inputs, np.split(u, ends), strict=True):
                port.Set(value)
            return self._Evaluate()

        by_x, error_x, bend_x = differentiate(
            OfState, x0, step * np.maximum(1.0, np.abs(x0))
        )
        OfState(x0)
        by_u, error_u, bend_u = differentiate(
            OfInput, u0, step * np.maximum(1.0, np.abs(u0))
        )
        slopes = np.hstack([by_x, by_u])
        largest = max(float(np.abs(slopes).max(initial=0.0)), 1e-300)
        bends = np.hstack([bend_x, bend_u])
        if bends.max(initial=0.0) > _BEND * largest:
            Refuse(
                "context",
                f"at {self._context.get_time():g} s",
                "where every law has one slope; one bends here, as at a surface",
            )
        n = len(x0)
        model = StateSpace(A=by_x[:n], B=by_u[:n], C=by_x[n:], D=by_u[n:])
        error = np.hstack([error_x, error_u]).max(initial=0.0)
        return model, float(error) / largest


def _LeafPorts(system: System, index: InputPortIndex) -> list[InputPort]:
    """Returns the ports of blocks that an input port of a system is, or leads to."""
    if not isinstance(system, Diagram):
        return [system.get_input_port(int(index))]
    return [
        port
        for inner, i in system.GetInputPortLocators(InputPortIndex(int(index)))
        for port in _LeafPorts(inner, i)
    ]


def _Close(model: StateSpace, size: int) -> StateSpace:
    """Returns a model whose last outputs are added to its first inputs.

    Args:
        model: From [w, d] to [the others, what w is but for a deviation].
        size: Of w.

    Returns:
        From [u, d] to the others, where w = u + what it is without.

    Raises:
        ValueError: If it is an algebraic loop without a solution.
    """
    # w = F [x, u, d] with what feeds it: s = C_s x + D_sw w + D_sd d.
    C_s, D_s = model.C[-size:], model.D[-size:]
    loop = np.eye(size) - D_s[:, :size]
    if np.linalg.matrix_rank(loop) < size:
        Refuse("input_port", "in an algebraic loop", "where the loop has a solution")
    by_x = np.linalg.solve(loop, C_s)
    by_input = np.linalg.solve(loop, np.hstack([np.eye(size), D_s[:, size:]]))
    B_w, D_w = model.B[:, :size], model.D[:-size, :size]
    B_d = np.hstack([np.zeros_like(B_w), model.B[:, size:]])
    D_d = np.hstack([np.zeros_like(D_w), model.D[:-size, size:]])
    return StateSpace(
        A=model.A + B_w @ by_x,
        B=B_d + B_w @ by_input,
        C=model.C[:-size] + D_w @ by_x,
        D=D_d + D_w @ by_input,
    )
