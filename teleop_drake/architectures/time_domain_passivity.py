"""Direct force under passivity control in the time domain."""

from dataclasses import dataclass

import numpy as np

from teleop_drake.architectures.base import Architecture, ArchitectureConfig
from teleop_drake.architectures.facts import Facts
from teleop_drake.architectures.passivity_master import PassivityMaster
from teleop_drake.architectures.passivity_slave import PassivitySlave
from teleop_drake.validation import CheckNumber, Refuse


@dataclass(frozen=True, kw_only=True)
class TimeDomainPassivity:
    """Every number; see TimeDomainPassivityConfig for what they are."""

    horizon: float
    maximum_damping: float
    maximum_mobility: float
    initial_energy: float


@dataclass(kw_only=True, eq=False)
class TimeDomainPassivityConfig(ArchitectureConfig):
    """Direct force under passivity control; see architectures.passivity_slave."""

    kind = "time_domain_passivity"

    # Time for which the energy must last at the present power, s, > 0. It plays the
    # part of the sample period of the customary controllers, 1 ms; the shorter, the
    # more exactly passive and the slower to simulate. Assumed.
    horizon: float = 0.01
    # Largest damping at the tool, N s/m, > 0. Null: m / horizon, with the smallest
    # apparent mass m at the start pose: the tool stops within a horizon at the fastest.
    maximum_damping: float | None = None
    # Largest mobility at the hand, m/(N s), > 0. Null: 1 / (h horizon), with h = s H(s)
    # for s to infinity: the haptic force falls within a horizon at the fastest.
    maximum_mobility: float | None = None
    # E_0, energy that the tool may take on each axis before the operator has given any,
    # J, > 0. Null: what brings it to the commanded speed v_d and keeps it there for a
    # round trip T, m |v_d|^2 / 2 + d |v_d|^2 T, with the largest apparent mass m at
    # the start pose and the damping d of rail and first layer.
    initial_energy: float | None = None

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field for itself.

        Args:
            path: The config's place in a scenario, for messages.
            num_axes: Number n of task axes.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        CheckNumber(f"{path}.horizon", self.horizon, "s", above=0)
        for key, unit in (
            ("maximum_damping", "N s/m"),
            ("maximum_mobility", "m/(N s)"),
            ("initial_energy", "J"),
        ):
            value = getattr(self, key)
            if value is not None:
                CheckNumber(f"{path}.{key}", value, unit, above=0)

    def Resolve(self, facts: Facts, path: str) -> TimeDomainPassivity:
        """Returns the parameters with every default derived.

        Args:
            facts: What the defaults derive from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        damping, mobility = self.maximum_damping, self.maximum_mobility
        energy = self.initial_energy
        if damping is None:
            masses = np.linalg.eigvalsh(facts.Inertia(f"{path}.maximum_damping"))
            damping = float(masses[0]) / self.horizon
        if mobility is None:
            h = facts.DeviceGain()
            if not h > 0:
                Refuse(
                    f"{path}.maximum_mobility",
                    None,
                    "a number, because none derives from haptic_device with "
                    f"s H(s) -> {h:g}",
                )
            mobility = 1 / (h * self.horizon)
        if energy is None:
            field = f"{path}.initial_energy"
            mass = np.linalg.eigvalsh(facts.Inertia(field))[-1]
            drag = np.linalg.eigvalsh(facts.StartDamping(field))[-1]
            speed_squared = facts.velocity @ facts.velocity
            energy = (mass / 2 + drag * facts.round_trip) * speed_squared
        return TimeDomainPassivity(
            horizon=self.horizon,
            maximum_damping=damping,
            maximum_mobility=mobility,
            initial_energy=float(energy),
        )

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides.

        Args:
            facts: What the defaults derive from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        numbers, n = self.Resolve(facts, path), facts.num_axes
        facts.CheckStrictlyProper(self.kind)
        return Architecture(
            master_side=PassivityMaster(
                num_axes=n,
                horizon=numbers.horizon,
                maximum_mobility=numbers.maximum_mobility,
                energy_scale=numbers.initial_energy,
            ),
            slave_side=PassivitySlave(
                num_axes=n,
                horizon=numbers.horizon,
                maximum_damping=numbers.maximum_damping,
                initial_energy=numbers.initial_energy,
            ),
            initial_forward_packet=[0.0] * (2 * n),
            initial_return_packet=[*facts.start.tolist(), *[0.0] * (2 * n)],
        )
