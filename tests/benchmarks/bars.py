"""How long anybody's Diagram takes, against bars that the package sets itself.

`simulate(diagram, engine="drake")` of a Diagram without blocks of this package is to
take at most 1.5 times as long as Drake's Simulator with the same settings. A run of a
kept program, Compile(diagram).Run(), is to take no longer than Drake's Simulator with
its defaults, and at equal settings a tenth.

The Simulator records nothing, the package records every vector output. So there is a
third contender: the Simulator with the shortest monitor that evaluates these outputs in
each step. Its time is what recording by way of pydrake costs at least.
"""

from functools import partial

from benchmarks.measuring import Alternate, CallsInTurn, Options, Repeat, Table
from benchmarks.published_systems import SYSTEMS
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig

from teleop_drake import Compile, simulate
from teleop_drake.loops.framework.signals import SignalsOf

# Smooth systems without events of the kinds that there are: of Drake's own classes,
# with a regulator, with a network, and MultibodyPlants.
NAMES = (
    "pendulum",
    "acrobot",
    "quadrotor with LQR",
    "pendulum with network",
    "cart-pole from SDF",
    "arm with PID",
    "triple pendulum",
)

MOST_OF_DRAKES_TIME = 1.5
LEAST_OF_DEFAULT = 1.0
LEAST_OF_EQUAL = 10.0

DEFAULTS = SimulatorConfig()
# The accuracy and the longest step of the defaults, by the scheme of compiled runs.
LIKE_DEFAULTS = SimulatorConfig(
    integration_scheme="runge_kutta5",
    accuracy=DEFAULTS.accuracy,
    max_step_size=DEFAULTS.max_step_size,
)
EQUAL = SimulatorConfig(
    integration_scheme="runge_kutta5", accuracy=1e-6, max_step_size=0.1
)


def Measure(options: Options) -> list[Table]:
    duration = 1.0 if options.quick else 100.0
    rows = []
    for system in SYSTEMS:
        if system.name not in NAMES:
            continue
        diagram, context = system.Make()
        program, equal_program = (
            Compile(diagram, context=context, duration=duration, simulator=config)
            for config in (LIKE_DEFAULTS, EQUAL)
        )
        program.Run()  # What is compiled once a process is no part of a run.
        in_drake = partial(_InDrake, diagram, context, duration)
        contenders = {
            "Simulator": partial(in_drake, DEFAULTS),
            "recording": partial(in_drake, DEFAULTS, records=True),
            "simulate": partial(
                simulate,
                diagram,
                context=context,
                duration=duration,
                simulator=DEFAULTS,
                engine="drake",
            ),
            "Run": program.Run,
            "Simulator, equal": partial(in_drake, EQUAL),
            "recording, equal": partial(in_drake, EQUAL, records=True),
            "Run, equal": equal_program.Run,
        }
        counts = {name: CallsInTurn(call) for name, call in contenders.items()}
        measured = Alternate(
            {
                name: partial(Repeat, call, counts[name])
                for name, call in contenders.items()
            },
            options.repeats,
        )
        cpu = {name: each.cpu / counts[name] for name, each in measured.items()}
        share = cpu["simulate"] / cpu["Simulator"]
        default = cpu["Simulator"] / cpu["Run"]
        equal = cpu["Simulator, equal"] / cpu["Run, equal"]
        rows.append(
            {
                "system": system.name,
                "simulate in Drake / Simulator": share,
                "Simulator that records / Simulator": cpu["recording"]
                / cpu["Simulator"],
                "Simulator / Run, defaults": default,
                "Simulator / Run, equal": equal,
                "Simulator that records / Run, equal": cpu["recording, equal"]
                / cpu["Run, equal"],
                "bars": _Bars(share, default, equal),
            }
        )
    note = (
        f"Ratios of CPU times of runs of {duration:g} s, medians of alternating runs. "
        f"Bars: simulate in Drake at most {MOST_OF_DRAKES_TIME:g}, defaults at least "
        f"{LEAST_OF_DEFAULT:g}, equal at least {LEAST_OF_EQUAL:g}."
    )
    return [Table(title="Anybody's Diagram against Drake", note=note, rows=rows)]


def _Bars(share: float, default: float, equal: float) -> str:
    """Returns which of the three bars are met."""
    met = (
        share <= MOST_OF_DRAKES_TIME,
        default >= LEAST_OF_DEFAULT,
        equal >= LEAST_OF_EQUAL,
    )
    return ", ".join("met" if is_met else "missed" for is_met in met)


def _InDrake(
    diagram, context, duration: float, config: SimulatorConfig, records: bool = False
) -> list:
    """Runs Drake's Simulator; returns the outputs at the ends of steps, if wanted."""
    simulator = Simulator(diagram, context.Clone())
    ApplySimulatorConfig(config, simulator)
    root = simulator.get_mutable_context()
    ports = [
        (port.Eval, port.get_system().GetMyContextFromRoot(root))
        for port in SignalsOf(diagram).values()
    ]
    samples: list = []

    def Record(_) -> None:
        values = [evaluate(own) for evaluate, own in ports]
        samples.append((root.get_time(), values))

    if records:
        simulator.set_monitor(Record)
    simulator.AdvanceTo(context.get_time() + duration)
    simulator.clear_monitor()  # It knows the Context, which keeps the Simulator alive.
    return samples
