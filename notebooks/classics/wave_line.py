"""A raw line and a line of waves. (Anderson and Spong; Niemeyer and Slotine.)

A channel that delays force and velocity by T each way has the scattering norm
|tan w T| + |sec w T|, which has no bound: it is not passive, and a wall behind it need
not come to rest. Waves u = (b v + F)/(2 b)^(1/2), w = (b v - F)/(2 b)^(1/2) are passive
whatever the delay. At the hand, with a damper D beside the line, a wave is reflected by

    u/w = (b - D)/(b + D)

for a hand that holds its force: with S = (2 b)^(1/2) from v = (F + S w)/(b + D) and
u = S v - w. With the round trip T the line feels like the mass b T/2 in front of a free
tool, and like the spring 2 b/T in front of a fixed one. With the load Z_L its impedance
is b (Z_L + b tanh(s T/2))/(b + Z_L tanh(s T/2)).

Sources: R. J. Anderson and M. W. Spong, "Bilateral control of teleoperators with time
delay", IEEE Trans. Automatic Control 34 (1989), for the norm; G. Niemeyer and J.-J. E.
Slotine, "Stable adaptive teleoperation", IEEE J. Oceanic Engineering 16 (1991), and
"Telemanipulation with time delays", Int. J. Robotics Research 23 (2004), for waves,
reflections and the felt mass. The reflection at a damper D is derived here.
"""

from typing import Any

import numpy as np
from scattering import delay_two_port, scattering_norm

from classics import InPageStyle
from teleop_drake import LoadScenario, Recording, WaveMaster, simulate
from teleop_drake.model.stations import MakeArchitecture
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.analysis.energy import TwoPortEnergyBalance
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.transparency import AnalyzeTransparency
from teleop_drake.study.figures.style import COLORS, GREY, LINES, Figure

IMPEDANCE = 0.92  # b in N s/m
ROUND_TRIP = 0.2  # s
# D at the hand, N s/m.
DAMPERS = (0.0, 0.3, 0.92, 2.0)
# A wall in front of the slider, for a hand that keeps commanding a velocity.
ON_WALL: dict[str, Any] = {
    "environment.layers": [
        {"name": "wall", "start": 0.002, "stiffness": 150.0, "reference": 0.002}
    ],
    "surgeon.contact_force": None,
    "delay": ROUND_TRIP / 2,
    "duration": 8.0,
}
LINES_TO_WALL: dict[str, dict[str, Any]] = {
    "raw line": {"controller.kind": "direct_force"},
    "waves": {"controller.kind": "wave_variables"},
    "raw line, damped tool": {
        "controller.kind": "damped_force",
        "controller.damped_force.against": "command",
    },
}


def OnWall(line: str) -> Recording:
    """Returns the run of a line that pushes the slider against a wall."""
    return simulate(LoadScenario("one_dof", ON_WALL | LINES_TO_WALL[line]))


def EnergyMade(recording: Recording) -> float:
    """Returns the energy in J that came out between hand and tool and never went in."""
    return float(TwoPortEnergyBalance(recording).violation[-1])


def WithDamper(damper: float) -> dict[str, Any]:
    """Returns overrides: a line of waves with a damper at the hand."""
    return {
        "controller.kind": "wave_variables",
        "controller.wave_variables.impedance": IMPEDANCE,
        "controller.wave_variables.master_damping": damper,
    }


def Reflecting(damper: float, duration: float = 8.0) -> Recording:
    """Returns the run of case III with a damper at the hand's end of the line."""
    overrides = WithDamper(damper) | {"duration": duration}
    return simulate(LoadScenario("two_dof_combined", overrides))


def RestTime(damper: float) -> float | None:
    """Returns how long case III takes from contact to rest in s; None: it does not."""
    return RunMetrics(Reflecting(damper))["collision"]["rest_time"]


def Reflection(damper: float) -> float:
    """Returns u/w at the hand, which holds its force."""
    scenario = LoadScenario("one_dof", WithDamper(damper))
    master = MakeArchitecture(scenario).master_side
    assert isinstance(master, WaveMaster)
    context = master.CreateDefaultContext()
    wave = 1.0
    master.GetInputPort("haptic_force").FixValue(context, [0.0])
    master.GetInputPort("velocity_command").FixValue(context, [0.0])
    master.GetInputPort("return_packet").FixValue(context, [wave, 0.0])
    return float(master.GetOutputPort("forward_packet").Eval(context)[0] / wave)


def FeltMass() -> float:
    """Returns the mass in kg that the line adds to a free tool for slow hands."""
    overrides = {"robot.damping": 0.0, "delay": ROUND_TRIP / 2}
    scenario = LoadScenario("one_dof", WithDamper(IMPEDANCE) | overrides)
    point = next(x for x in OperatingPoints(scenario) if x.name == "free")
    w = 0.01
    felt = AnalyzeTransparency(scenario, point, frequencies=[w]).transmitted[0, 0, 0]
    return float(felt.imag / w - scenario.robot.mass)


@InPageStyle
def Draw() -> Figure:
    """Draws the norm of a raw line, both lines on a wall, and the reflections."""
    figure = Figure(figsize=(7.0, 2.2))
    left, middle, right = figure.subplots(1, 3)
    w = np.linspace(0.01, 30, 2000)
    raw = delay_two_port(w, forward_delay=ROUND_TRIP / 2, return_delay=ROUND_TRIP / 2)
    left.plot(
        w, np.minimum(scattering_norm(raw), 12), color=COLORS[1], label="raw line"
    )
    left.plot(w, np.ones(len(w)), ls=LINES[1], color=COLORS[0], label="waves")
    left.set(ylim=(0, 10), xlabel="frequency [rad/s]", ylabel="scattering norm")
    left.legend()
    for i, name in enumerate(("waves", "raw line", "raw line, damped tool")):
        run = OnWall(name)
        force = 1e3 * run["environment_force"][:, 0]
        middle.plot(run.time, force, ls=LINES[i], color=COLORS[i], lw=1, label=name)
    middle.set(xlim=(1.5, 6), ylim=(0, 65), xlabel="time [s]")
    middle.set_ylabel("force on the wall [mN]")
    middle.legend()
    for i, damper in enumerate((0.0, 0.3, 0.92)):
        run = Reflecting(damper)
        contact = run.EventTimes("contact")[0]
        force = run["environment_force"][:, 0]
        right.plot(
            run.time - contact,
            force,
            ls=LINES[i],
            color=COLORS[(1, 2, 0)[i]],
            lw=1,
            label=f"D = {damper:g} N s/m",
        )
    right.axhline(0.2, color=GREY, lw=0.6)
    right.set(xlim=(0, 5), ylim=(0, 1.4), xlabel="time after contact [s]")
    right.set_ylabel("force on the bone [N]")
    right.legend()
    return figure
