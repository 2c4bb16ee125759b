"""How long simulate() takes in Drake's engine, against Drake's Simulator with logs.

The Simulator has the same settings, and a VectorLogSink for each signal that simulate()
records: it takes a sample at each step or, with a publish period, at its multiples. A
sink is C++, and stores nothing within a step. There, simulate() has rows of its own of
signals that move: three in each step, and more where one bends.

    python tests/benchmarks/run.py --only in_drake
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from benchmarks.measuring import Alternate, CallsInTurn, Options, Repeat, Table
from drake_systems import FinishArm
from pydrake.examples import PendulumPlant
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Gain,
    Integrator,
    LinearSystem,
    LogVectorOutput,
    Sine,
    ZeroOrderHold,
)

from teleop_drake.loops import Recording, simulate
from teleop_drake.loops.framework.signals import SignalsOf

CONFIG = SimulatorConfig()
PERIOD = 0.01


class Counter(LeafSystem):
    """x[k + 1] = 0.5 x[k] + u, every millisecond, in Python."""

    def __init__(self, *, has_callback: bool):
        LeafSystem.__init__(self)
        self.u = self.DeclareVectorInputPort("u", 1)
        state = self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.001, 0.0, self.Update)
        if has_callback:
            self.DeclareVectorOutputPort("x", 1, self.CalcOutput)
        else:
            self.DeclareStateOutputPort("x", state)

    def Update(self, context, state):
        x = context.get_discrete_state_vector()[0]
        state.set_value(0, [0.5 * x + self.u.Eval(context)[0]])

    def CalcOutput(self, context, output):
        output.SetFromVector(context.get_discrete_state_vector().value())


def Continuous(builder: DiagramBuilder) -> None:
    pendulum = builder.AddNamedSystem("pendulum", PendulumPlant())
    gain = builder.AddNamedSystem("gain", Gain(np.array([-1.0])))
    integral = builder.AddNamedSystem("integral", Integrator(2))
    builder.Connect(pendulum.get_output_port(), integral.get_input_port())
    force = builder.AddNamedSystem("force", Sine(1.0, 2.0, 0.0, 1))
    builder.Connect(force.get_output_port(0), gain.get_input_port())
    builder.Connect(gain.get_output_port(), pendulum.get_input_port())


def Discrete(builder: DiagramBuilder) -> None:
    """Two samples of a millisecond in a loop."""
    a, b = np.array([[1.0, 0.001], [-0.02, 0.99]]), np.array([[0.0], [0.001]])
    plant = builder.AddNamedSystem(
        "plant", LinearSystem(a, b, np.eye(2), np.zeros((2, 1)), 0.001)
    )
    force = builder.AddNamedSystem("gain", LinearSystem(D=[[-3.0, -1.0]]))
    builder.Connect(plant.get_output_port(), force.get_input_port())
    builder.Connect(force.get_output_port(), plant.get_input_port())


def Python(builder: DiagramBuilder, *, has_callback: bool) -> None:
    counter = builder.AddNamedSystem("counter", Counter(has_callback=has_callback))
    gain = builder.AddNamedSystem("gain", Gain(0.25, 1))
    builder.Connect(counter.get_output_port(), gain.get_input_port())
    source = gain
    if has_callback:  # In a loop it has to declare its prerequisites.
        source = builder.AddNamedSystem("source", ConstantVectorSource([1.0]))
    builder.Connect(source.get_output_port(), counter.get_input_port())


def Arm(
    builder: DiagramBuilder, *, has_scene: bool = False, time_step: float = 0.001
) -> MultibodyPlant:
    """Two joints."""
    plant = builder.AddNamedSystem("plant", MultibodyPlant(time_step))
    if has_scene:
        scene = builder.AddNamedSystem("scene", SceneGraph())
        plant.RegisterAsSourceForSceneGraph(scene)
    FinishArm(plant, 2)
    if has_scene:
        builder.Connect(
            plant.get_geometry_pose_output_port(),
            scene.get_source_pose_port(plant.get_source_id()),
        )
        builder.Connect(
            scene.get_query_output_port(), plant.get_geometry_query_input_port()
        )
    return plant


def DrivenArm(builder: DiagramBuilder) -> None:
    """Two joints with torques that are functions of time."""
    plant = Arm(builder)
    torque = builder.AddNamedSystem("torque", Sine(0.1, 2.0, 0.0, 2))
    target = plant.get_applied_generalized_force_input_port()
    builder.Connect(torque.get_output_port(0), target)


def Sampled(builder: DiagramBuilder) -> None:
    """An integrator with a regulator that samples it each millisecond."""
    plant = builder.AddNamedSystem("plant", Integrator([1.0]))
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(0.001, 1))
    gain = builder.AddNamedSystem("gain", Gain(-5.0, 1))
    builder.Connect(plant.get_output_port(), hold.get_input_port())
    builder.Connect(hold.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), plant.get_input_port())


# What adds each system, the signals (None: those that simulate() records), and seconds.
SYSTEMS: dict[str, tuple] = {
    "continuous": (Continuous, None, 20.0),
    "continuous, its state": (Continuous, ["pendulum.state"], 20.0),
    "continuous arm": (partial(Arm, time_step=0.0), None, 20.0),
    "sampled": (Sampled, None, 2.0),
    "discrete": (Discrete, None, 2.0),
    "in Python": (partial(Python, has_callback=False), None, 2.0),
    "in Python, with a callback": (partial(Python, has_callback=True), None, 2.0),
    "arm": (Arm, None, 2.0),
    "arm, its state": (Arm, ["plant.state"], 2.0),
    "arm, driven": (DrivenArm, None, 2.0),
    "arm in a scene": (partial(Arm, has_scene=True), None, 2.0),
    "arm in a scene, its state": (partial(Arm, has_scene=True), ["plant.state"], 2.0),
}


def Measure(options: Options) -> list[Table]:
    rows = []
    for name, (add, signals, longest) in SYSTEMS.items():
        duration = 0.05 if options.quick else longest
        row: dict = {"system": name}
        for period in (None, PERIOD):
            contenders = {
                "simulate": partial(
                    simulate,
                    _Built(add),
                    duration=duration,
                    simulator=CONFIG,
                    engine="drake",
                    signals=signals,
                    publish_period=period,
                ),
                "Simulator": partial(_Run, _Built(add, signals, period), duration),
                "alone": partial(_Run, _Built(add), duration),
            }
            counts = {name: CallsInTurn(call) for name, call in contenders.items()}
            measured = Alternate(
                {x: partial(Repeat, call, counts[x]) for x, call in contenders.items()},
                3 * options.repeats,
            )
            taken = {x: each.cpu / counts[x] for x, each in measured.items()}
            rows_of = "step" if period is None else f"{PERIOD:g} s"
            if period is None:
                row["rows in a step"] = _RowsInAStep(contenders["simulate"]())
            row[f"a row each {rows_of}"] = taken["simulate"] / taken["Simulator"]
            row[f"logs, ms, each {rows_of}"] = 1e3 * taken["Simulator"]
        row["without logs, ms"] = 1e3 * taken["alone"]
        rows.append(row)
    note = (
        "Ratios of CPU times, simulate() to a Simulator with logs, medians of "
        "alternating runs."
    )
    return [Table(title="Recording in Drake against logs", note=note, rows=rows)]


def _RowsInAStep(recording: Recording) -> float:
    return len(recording.time) / len(np.unique(recording.time[recording.steps[:, -1]]))


def _Built(
    add: Callable[[DiagramBuilder], None],
    logged: Sequence[str] | None = (),
    period: float | None = None,
) -> Diagram:
    """Returns a Diagram, with a log for each signal; None: for those of SignalsOf()."""
    builder = DiagramBuilder()
    add(builder)
    ports = {
        f"{x.get_name()}.{name}": port
        for x in builder.GetSystems()
        for name, port in SignalsOf(x).items()
    }
    for name in ports if logged is None else logged:
        if period is None:
            LogVectorOutput(ports[name], builder)
        else:
            LogVectorOutput(ports[name], builder, period)
    return builder.Build()


def _Run(diagram: Diagram, duration: float) -> Context:
    simulator = Simulator(diagram)
    ApplySimulatorConfig(CONFIG, simulator)
    simulator.AdvanceTo(duration)
    return simulator.get_context()
