"""Frequency responses of linear blocks, from their own derivatives and outputs."""

import numpy as np


def TerminatedPort(matrix, load):
    """Returns what is seen at port 1 of p(j w) (K, 2, 2) with a load at port 2 (K).

    For a hybrid matrix the load is the environment's admittance v_s/F_s and the result
    the impedance F_m/v_m; for the inverse hybrid one it is the environment's impedance
    F_s/v_s, and the result the admittance v_m/F_m that the operator feels.
    """
    (p11, p12), (p21, p22) = np.moveaxis(matrix, 0, -1)
    return p11 - p12 * p21 / (p22 + load)


def Response(block, inputs, outputs, s):
    """Returns the transfer matrix between ports at s (rad/s), of what is 0 at 0."""
    context = block.CreateDefaultContext()
    num_states = block.num_continuous_states()
    for i in range(block.num_input_ports()):
        port = block.get_input_port(i)
        port.FixValue(context, np.zeros(port.size()))

    def Evaluate(x, u):
        if num_states:
            context.SetContinuousState(x)
        for name in inputs:
            port = block.GetInputPort(name)
            port.FixValue(context, u[: port.size()])
            u = u[port.size() :]
        rate = (
            block.EvalTimeDerivatives(context).CopyToVector()
            if num_states
            else np.zeros(0)
        )
        y = [block.GetOutputPort(name).Eval(context) for name in outputs]
        return np.concatenate([rate, *y])

    num_inputs = sum(block.GetInputPort(name).size() for name in inputs)
    columns = np.array(
        [
            Evaluate(e[:num_states], e[num_states:])
            for e in np.eye(num_states + num_inputs)
        ]
    ).T
    at_rest = Evaluate(np.zeros(num_states), np.zeros(num_inputs))
    assert np.abs(at_rest).max() == 0
    A = columns[:num_states, :num_states]
    B = columns[:num_states, num_states:]
    C = columns[num_states:, :num_states]
    D = columns[num_states:, num_states:]
    return C @ np.linalg.solve(s * np.eye(num_states) - A, B) + D


def FeltImpedance(master, slave, s, *, delays, robot, environment):
    """Returns F_h / v_felt of an architecture on one axis, all as phasors.

    `robot` and `environment` are the impedances of the tool and behind it in N s/m.
    """
    m_f = master.GetOutputPort("forward_packet").size()
    M = Response(
        master,
        ["haptic_force", "return_packet"],
        ["felt_velocity", "forward_packet"],
        s,
    )
    S = Response(
        slave,
        ["forward_packet", "tool_position", "tool_velocity", "environment_force"],
        ["control_force", "return_packet"],
        s,
    )
    # The tool: v = (F_c - F_e) / robot, F_e = environment v, p = v / s.
    tool = np.array([1 / s, 1.0, environment]) / (robot + environment)
    from_packet = S[:, :m_f]
    from_tool = S[:, m_f:] @ tool
    F_c = from_packet[0] / (1 - from_tool[0])
    returned = from_packet[1:] + np.outer(from_tool[1:], F_c)
    loop = np.exp(-s * sum(delays)) * returned
    # forward = M_f F_h + M_r loop forward.
    forward = np.linalg.solve(np.eye(m_f) - M[1:, 1:] @ loop, M[1:, 0])
    v = M[0, 0] + M[0, 1:] @ loop @ forward
    return 1 / v
