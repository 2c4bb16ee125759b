"""How stiff the tissue feels in the hand of the surgeon, for every architecture."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import System

from teleop_drake.analysis.linearization import LinearizeLoop, OperatingPoint
from teleop_drake.architectures import MakeArchitecture, ResolveController
from teleop_drake.laws.state_space import StateSpace
from teleop_drake.scenario import Scenario

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# At rest, or but for its model, the loop of these is that of direct force.
_LIKE_DIRECT_FORCE = ("time_domain_passivity", "smith_predictor")


def FeltAdmittance(
    scenario: Scenario, point: OperatingPoint, frequencies: ArrayLike
) -> ComplexArray:
    """Returns how far the hand gives way to the force that it applies (K, n, n), m/N.

        X_h(j w) = A(j w) F_h,   X_h = v_felt / (j w)

    The surgeon is cut off: F_h, on the master side's port haptic_force, is given, and
    v_felt is what its port felt_velocity answers, through both channels with their
    nominal delays, the robot and the layer that it is in. So it means the same for
    every architecture, whatever its packets hold. With direct force, the robot's
    impedance Z_r and the layer's Z_e it is e^(-j w T) / (j w (Z_r + Z_e)) with the
    round trip T.

    The estimates of an adaptive law are frozen, see analysis.linearization. A
    passivity controller is taken at rest, which it is as long as the energy suffices.

    Args:
        scenario: A valid one; its channels count with their `delay` only.
        point: Where the tool is.
        frequencies: w in rad/s (K), > 0.

    Raises:
        ValueError: If the loop has no linear model there, see LinearizeLoop.
    """
    w = np.asarray(frequencies, dtype=float).reshape(-1)
    n, kind = scenario.num_axes, scenario.controller.kind
    round_trip = scenario.forward_channel.delay + scenario.return_channel.delay
    delay = np.exp(-1j * w * round_trip)[:, None, None]
    loop = scenario
    if kind in _LIKE_DIRECT_FORCE:
        loop = replace(
            scenario, controller=replace(scenario.controller, kind="direct_force")
        )
    slave = LinearizeLoop(loop, point).slave.FrequencyResponse(w) * delay
    master_side = MakeArchitecture(loop).master_side
    if master_side is None:
        # The thesis's packets: [F_h; v_d] goes, and [p_WT; v_WT] is felt as it comes.
        velocity = slave[:, n:, :n]
    else:
        master = _LinearizeMasterSide(master_side).FrequencyResponse(w)
        # [v_felt; packet sent] of [F_h; packet received].
        by_force, by_packet = master[:, :, :n], master[:, :, n:]
        identity = np.eye(slave.shape[2])
        sent = np.linalg.solve(identity - by_packet[:, n:] @ slave, by_force[:, n:])
        velocity = by_force[:, :n] + by_packet[:, :n] @ slave @ sent
    s = 1j * w[:, None, None]
    if kind == "smith_predictor":
        velocity = velocity + _PredictedVelocity(scenario, s)
    return np.asarray(velocity / s)


def FeltStiffness(
    scenario: Scenario, point: OperatingPoint, frequencies: ArrayLike
) -> Array:
    """Returns the stiffness along x that the surgeon feels (K) in N/m.

        k(w) = Re 1 / A_xx(j w)

    with A of FeltAdmittance: the part of the force that is in phase with the motion of
    the hand, while no force is applied along the other axes. A hand that holds a spring
    k_e feels k_e. For slow motions, on a layer of stiffness k_e, the stiffness is

        direct force                    k_e, and so with every other law whose slave
                                        ends up with the force that the hand applies
                                        and whose hand goes where the tool goes
        wave variables                  k_e in series with 2 b / T: a line that is T
                                        long, there and back, is a spring itself
        proportional damping            k_e in series with K

    At higher frequencies the delay turns the phase; k(w) < 0 is felt as being pushed
    away from the layer while pushing into it no further.

    Args:
        scenario: A valid one.
        point: Where the tool is.
        frequencies: w in rad/s (K), > 0.

    Raises:
        ValueError: As FeltAdmittance does.
    """
    return np.asarray((1 / FeltAdmittance(scenario, point, frequencies)[:, 0, 0]).real)


def _PredictedVelocity(scenario: Scenario, s: ComplexArray) -> ComplexArray:
    """Returns v_model(t) - v_model(t - T) of a Smith predictor's model (K, n, n)."""
    model = ResolveController(scenario)
    impedance = model.mass * s + model.damping + model.stiffness / s
    return np.asarray((1 - np.exp(-s * model.delay)) * np.linalg.inv(impedance))


def _LinearizeMasterSide(block: System) -> StateSpace:
    """Returns a linear master side, from [F_h; packet] to [v_felt; packet sent]."""
    context = block.CreateDefaultContext()
    inputs = [block.GetInputPort(name) for name in ("haptic_force", "return_packet")]
    command = block.GetInputPort("velocity_command")
    command.FixValue(context, np.zeros(command.size()))
    split, size = inputs[0].size(), block.num_continuous_states()
    x0 = context.get_continuous_state_vector().CopyToVector()

    def Evaluate(x: Array, u: Array) -> Array:
        if size:
            context.SetContinuousState(x)
        inputs[0].FixValue(context, u[:split])
        inputs[1].FixValue(context, u[split:])
        rates = block.EvalTimeDerivatives(context).CopyToVector()
        outputs = [
            block.GetOutputPort(name).Eval(context)
            for name in ("felt_velocity", "forward_packet")
        ]
        return np.concatenate([rates, *outputs])

    # Of a linear block the differences are exact, whatever their steps.
    u0 = np.zeros(sum(port.size() for port in inputs))
    at_rest = Evaluate(x0, u0)
    matrix = np.array(
        [Evaluate(x0 + step, u0) - at_rest for step in np.eye(size)]
        + [Evaluate(x0, step) - at_rest for step in np.eye(len(u0))]
    ).T
    return StateSpace(
        A=matrix[:size, :size],
        B=matrix[:size, size:],
        C=matrix[size:, :size],
        D=matrix[size:, size:],
    )
