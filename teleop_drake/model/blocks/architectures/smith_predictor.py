"""Direct force with a model of the robot at the master: Smith's predictor."""

import math
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram
from pydrake.systems.primitives import (
    Adder,
    Demultiplexer,
    Gain,
    LinearSystem,
    Multiplexer,
)

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.framework.validation import (
    CheckNumber,
    Config,
    GainField,
    GainMatrix,
    Gains,
    Number,
    Refuse,
)
from teleop_drake.loops.framework.wiring import Wire
from teleop_drake.model.blocks.architectures.base import (
    Architecture,
    Facts,
    MakeLawArchitecture,
)
from teleop_drake.model.blocks.architectures.damped_force import DampedForce
from teleop_drake.model.blocks.architectures.direct_force import DirectForce
from teleop_drake.model.blocks.architectures.local_damper import LocalDamperConfig
from teleop_drake.model.kinds import NumberNames


class SmithPredictorMaster(Diagram):
    """Feeds back a model of the tool at once, and the model's error after the delay.

        v_felt = v_ret + v_model(t) - v_model(t - T)
        M dv_model/dt = F_h - B v_model - K y,   dy/dt = v_model

    for a slave that applies F_h(t - T_f) and returns its velocity, T = T_f + T_r. With
    a local damper D against the command the model's force is F_h + D v_d. If
    model and delay are exact, v_ret = v_model(t - T), and the operator feels only the
    model. F_h is then that of the loop without delay, and the tool moves as in that
    loop, T_f later. Effects that are not in the model, such as a puncture or the bone,
    are felt after the whole delay, as without a predictor.

    Source: O. J. M. Smith, "Closer control of loops with dead time", Chemical
    Engineering Progress 53 (1957).

    | port | name             | size | unit     | is                         |
    |------|------------------|------|----------|----------------------------|
    | in   | haptic_force     | n    | N        | F_h                        |
    | in   | velocity_command | n    | m/s      | v_d                        |
    | in   | return_packet    | 2n   | [m; m/s] | [p_WT; v_ret]              |
    | out  | felt_position    | n    | m        | p_WT as received           |
    | out  | felt_velocity    | n    | m/s      | v_felt                     |
    | out  | forward_packet   | 2n   | [N; m/s] | [F_h; v_d]                 |
    | out  | model_velocity   | n    | m/s      | v_model                    |

    State: [y (n), v_model (n)] and the history of a TransportDelay.

    Initial value: zero; y counts from the start of the tool, at which the model's
    spring is relaxed.

    Direct feedthrough: haptic_force and velocity_command to forward_packet,
    return_packet to felt_position and felt_velocity.

    The model is linear and has no layers. Its delay is constant.

    Args:
        config: The config without nulls, as returned by Resolve().
    """

    def __init__(self, config: "SmithPredictorConfig", *, num_axes: int):
        Diagram.__init__(self)
        n = num_axes
        M_inverse = np.linalg.inv(config.Gain("mass", n))
        B = config.Gain("damping", n)
        K = config.Gain("stiffness", n)
        delay: Any = config.delay
        CheckNumber("delay", delay, "s", minimum=0)
        nothing = np.zeros((n, n))
        one = np.eye(n)
        # The tool is driven by its local damper, too, if that follows the command.
        drive = nothing
        if config.follows_command:
            drive = config.Gain("local_damping", n)
        # The state is [y; v_model], the input [F_h; v_d] and the output v_model.
        model = LinearSystem(
            np.block([[nothing, one], [-M_inverse @ K, -M_inverse @ B]]),
            np.block([[nothing, nothing], [M_inverse, M_inverse @ drive]]),
            np.hstack([nothing, one]),
            np.hstack([nothing, nothing]),
        )
        systems = {
            "unpack": Demultiplexer([n, n]),
            "model": model,
            # One sample for each step of the solver; its steps determine the error.
            "model_delay": TransportDelay(
                delay=delay, size=n, max_sample_interval=math.inf
            ),
            "negation": Gain(-1.0, n),
            "felt": Adder(3, n),
            "pack": Multiplexer([n, n]),
        }
        # `felt` adds up v_felt = v_ret + v_model(t) - v_model(t - T).
        Wire(
            self,
            "smith_predictor_master",
            systems,
            inputs={
                "haptic_force": ["pack.u0"],
                "velocity_command": ["pack.u1"],
                "return_packet": ["unpack"],
            },
            connections={
                "model": "pack",
                "model_delay": "model",
                "negation": "model_delay",
                "felt.u0": "unpack.y1",
                "felt.u1": "model",
                "felt.u2": "negation",
            },
            outputs={
                "felt_position": "unpack.y0",
                "felt_velocity": "felt",
                "forward_packet": "pack",
                "model_velocity": "model",
            },
        )


@Config
class SmithPredictorConfig(LocalDamperConfig):
    """Direct force with a model at the master; see SmithPredictorMaster."""

    kind = "smith_predictor"
    forward_parts = ("F_h", "v_d")
    return_parts = ("p_WT", "v_ret")

    # M of the model, kg, > 0. Null: the apparent mass of the robot at its start.
    mass: Gains | None = GainField(None)
    # B, N s/m, >= 0. Null: the sum of the dampings of robot, local damper and
    # environment at the start.
    damping: Gains | None = GainField(None, may_be_zero=True)
    # K, N/m, >= 0. Null: the stiffness of the environment at the start.
    stiffness: Gains | None = GainField(None, may_be_zero=True)
    # T, s, >= 0. Null: T_f + T_r, the nominal round trip.
    delay: float | None = Number(None, "s", minimum=0)
    # Local damper at the tool, N s/m, >= 0; see DampedForce. Smith's own scheme has
    # none.
    local_damping: Gains = GainField(0.0, may_be_zero=True)

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        return {} if self.delay == 0 else {"delay": ("master.delay",)}

    def DeriveDefaults(self, facts: Facts) -> None:
        """Derives the fields that are null; see ArchitectureConfig.DeriveDefaults."""
        if self.mass is None:
            self.mass = facts.Told("inertia", "mass")
        if self.damping is None:
            self.damping = facts.StartDamping("damping") + self.local_damping
        if self.stiffness is None:
            self.stiffness = facts.Told("environment_stiffness", "stiffness")
        if self.delay is None:
            self.delay = facts.round_trip
        if np.any(GainMatrix(self.stiffness, facts.num_axes)[3:]):
            # About an axis, y is the integral of an angular velocity and no rotation.
            Refuse("stiffness", self.stiffness, "0 about axes: a model has no pose")

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides."""
        config = self.Resolve(facts, path)
        n = facts.num_axes
        local = config.local_damping
        law = (
            DampedForce(num_axes=n, damping=local, against=config.against)
            if np.any(local)
            else DirectForce(num_axes=n)
        )
        architecture = MakeLawArchitecture(law, facts.start.tolist())
        architecture.master_side = SmithPredictorMaster(config, num_axes=n)
        return architecture
