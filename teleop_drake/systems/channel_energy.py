"""Energy that goes into the channels and does not come out."""

from teleop_drake.kernel import FixedBlock, Kernel, Term
from teleop_drake.laws.passivity import difference, port_power
from teleop_drake.validation import CheckNumber


class ChannelEnergy(FixedBlock):
    """Balances the energy at both ends of the communication.

        power_in = F_m . v_m           d(energy_in)/dt  = power_in
        power_out = F_s . v_s          d(energy_out)/dt = power_out
        power = power_in - power_out   energy = energy_in - energy_out

    At the master a force F_m is sent while a velocity v_m is felt: F_m . v_m goes into
    the channels. At the slave a force F_s arrives while the tool moves with v_s:
    F_s . v_s comes out of them. Channels without delay have power 0. Channels are
    passive as long as the energy, counted from rest, is not negative: what they deliver
    by then was put in before. Energy below 0 they have made themselves.

    | port | name            | size | unit | in the thesis's loop          |
    |------|-----------------|------|------|-------------------------------|
    | in   | master_force    | n    | N    | F_h, sent                     |
    | in   | master_velocity | n    | m/s  | v(t - T_r), felt              |
    | in   | slave_force     | n    | N    | F_h(t - T_f), received        |
    | in   | slave_velocity  | n    | m/s  | v of the tool, sent           |
    | out  | energy          | 1    | J    | put in minus taken out so far |
    | out  | power           | 1    | W    | its rate                      |
    | out  | power_in        | 1    | W    | at the master                 |
    | out  | power_out       | 1    | W    | at the slave                  |
    | out  | energy_in       | 1    | J    | put in at the master so far   |
    | out  | energy_out      | 1    | J    | taken out at the slave so far |

    State (continuous, 2): [energy_in, energy_out] in J.

    Initial value: 0.

    Direct feedthrough: from the inputs at the master to power_in, from those at the
    slave to power_out, from all to power; none to the energies.

    It acts on nothing. Forces that jump without an event that ends the step cost
    accuracy, as in any integrated quantity.

    Source: R. J. Anderson and M. W. Spong, "Bilateral control of teleoperators with
    time delay", IEEE Trans. Autom. Control 34 (1989); observed over time by
    B. Hannaford and J.-H. Ryu, "Time-domain passivity control of haptic interfaces",
    IEEE Trans. Robot. Autom. 18 (2002).
    """

    def __init__(self, *, num_axes: int):
        CheckNumber("num_axes", num_axes, minimum=1)
        at_master = ("master_force", "master_velocity")
        at_slave = ("slave_force", "slave_velocity")
        outputs: dict[str, Term] = {
            "energy": (difference, "state"),
            "power": (difference, "rate"),
            "power_in": (port_power, *at_master),
            "power_out": (port_power, *at_slave),
            "energy_in": ("state", 0, 1),
            "energy_out": ("state", 1, 2),
        }
        FixedBlock.__init__(
            self,
            "channel_energy",
            Kernel(rate=["power_in", "power_out"], outputs=outputs),
            inputs=dict.fromkeys((*at_master, *at_slave), num_axes),
            outputs=dict.fromkeys(outputs, 1),
            state=[0.0, 0.0],
        )
