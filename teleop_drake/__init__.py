"""Haptic teleoperation under communication delay as Drake systems diagrams.

The model of P. P. Sarda, "Control of a Teleoperating Robotic Arm Subject to Time
Delays", MS thesis, The University of Texas at Arlington, 2012.

The most used names are exported here, and so are all names of teleop_drake.blocks:
`from teleop_drake import TransportDelay, simulate`. Each is imported on first use, so
that importing the package itself is cheap.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from teleop_drake import blocks

if TYPE_CHECKING:
    from teleop_drake.analysis.delay_map import DelayMargins
    from teleop_drake.analysis.energy import TwoPortEnergyBalance
    from teleop_drake.analysis.latency import EstimateLatency
    from teleop_drake.analysis.ports import DelayMargin, LinearizePorts
    from teleop_drake.analysis.stability import AnalyzeStability
    from teleop_drake.analysis.stability_chart import ChartStability
    from teleop_drake.blocks import *  # noqa: F403
    from teleop_drake.figures.analysis import (
        PlotBode,
        PlotNyquist,
        PlotStabilityChart,
        PlotStableDelays,
    )
    from teleop_drake.figures.block_diagram import WriteDiagram
    from teleop_drake.figures.latency import PlotLatency
    from teleop_drake.figures.notebook import ShowDiagram, ShowTable
    from teleop_drake.figures.runs import PlotComparison, PlotRun, SaveFigure
    from teleop_drake.figures.scene import MakeReplay
    from teleop_drake.figures.style import Figure
    from teleop_drake.figures.sweeps import PlotSweep
    from teleop_drake.figures.trace_report import PlotTraceReport
    from teleop_drake.link.remote import OperateRemotely, ServeRobot
    from teleop_drake.page.page import Explore, MakePage, WritePage
    from teleop_drake.parameters import NamedParameters
    from teleop_drake.recording import Recording
    from teleop_drake.scenario import (
        LoadScenario,
        Scenario,
        ScenarioError,
        ScenarioNames,
        ScenarioToYaml,
        TrackingScenario,
    )
    from teleop_drake.simulation import MakeDiagram, MakeSimulator, simulate
    from teleop_drake.simulation.compile import Compile
    from teleop_drake.sweep import RunSweep, Sweep
    from teleop_drake.sweep.study import LoadStudy
    from teleop_drake.sweep.trace_report import ReportTrace
    from teleop_drake.sweep.tuning import Tune
    from teleop_drake.task_recording import LoadRecording, TaskRecording
    from teleop_drake.tasks.metrics import RunMetrics, RunSummary
    from teleop_drake.teleoperator import MakeTeleoperator

__version__ = "0.1.0"

__all__ = [
    "AnalyzeStability",
    "ChartStability",
    "Compile",
    "DelayMargin",
    "DelayMargins",
    "EstimateLatency",
    "Explore",
    "Figure",
    "LinearizePorts",
    "LoadRecording",
    "LoadScenario",
    "LoadStudy",
    "MakeDiagram",
    "MakePage",
    "MakeReplay",
    "MakeSimulator",
    "MakeTeleoperator",
    "NamedParameters",
    "OperateRemotely",
    "PlotBode",
    "PlotComparison",
    "PlotLatency",
    "PlotNyquist",
    "PlotRun",
    "PlotStabilityChart",
    "PlotStableDelays",
    "PlotSweep",
    "PlotTraceReport",
    "Recording",
    "ReportTrace",
    "RunMetrics",
    "RunSummary",
    "RunSweep",
    "SaveFigure",
    "Scenario",
    "ScenarioError",
    "ScenarioNames",
    "ScenarioToYaml",
    "ServeRobot",
    "ShowDiagram",
    "ShowTable",
    "Sweep",
    "TaskRecording",
    "TrackingScenario",
    "Tune",
    "TwoPortEnergyBalance",
    "WriteDiagram",
    "WritePage",
    "simulate",
    *blocks.__all__,
]

# The names that each module defines: those of __all__, and RecordingHtml.
# teleop_drake.blocks has a table for the blocks.
_PLACES = {
    "analysis.delay_map": ["DelayMargins"],
    "analysis.energy": ["TwoPortEnergyBalance"],
    "analysis.latency": ["EstimateLatency"],
    "analysis.stability_chart": ["ChartStability"],
    "figures.analysis": [
        "PlotBode",
        "PlotNyquist",
        "PlotStabilityChart",
        "PlotStableDelays",
    ],
    "figures.latency": ["PlotLatency"],
    "figures.notebook": ["RecordingHtml", "ShowDiagram", "ShowTable"],
    "figures.style": ["Figure"],
    "figures.sweeps": ["PlotSweep"],
    "figures.trace_report": ["PlotTraceReport"],
    "sweep.study": ["LoadStudy"],
    "link.remote": ["OperateRemotely", "ServeRobot"],
    "analysis.ports": ["DelayMargin", "LinearizePorts"],
    "analysis.stability": ["AnalyzeStability"],
    "figures.block_diagram": ["WriteDiagram"],
    "figures.runs": ["PlotComparison", "PlotRun", "SaveFigure"],
    "figures.scene": ["MakeReplay"],
    "page.page": ["Explore", "MakePage", "WritePage"],
    "parameters": ["NamedParameters"],
    "recording": ["Recording"],
    "scenario": [
        *("LoadScenario", "Scenario", "ScenarioError", "ScenarioNames"),
        *("ScenarioToYaml", "TrackingScenario"),
    ],
    "simulation": ["MakeDiagram", "MakeSimulator", "simulate"],
    "simulation.compile": ["Compile"],
    "sweep": ["RunSweep", "Sweep"],
    "sweep.trace_report": ["ReportTrace"],
    "sweep.tuning": ["Tune"],
    "task_recording": ["LoadRecording", "TaskRecording"],
    "tasks.metrics": ["RunMetrics", "RunSummary"],
    "teleoperator": ["MakeTeleoperator"],
}


def __getattr__(name: str) -> Any:
    """Imports a name of _PLACES or of the blocks on its first use."""
    if name in blocks.__all__:
        return getattr(blocks, name)
    for place, names in _PLACES.items():
        if name in names:
            value = getattr(import_module(f"{__name__}.{place}"), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Returns the names of the package, including those not imported yet."""
    hidden = {"Any", "TYPE_CHECKING", "import_module"}
    return sorted({*globals(), *__all__} - hidden)
