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
from teleop_drake.moved import FindMoved

if TYPE_CHECKING:
    from teleop_drake.blocks import *  # noqa: F403
    from teleop_drake.loops.draw.block_diagram import WriteDiagram
    from teleop_drake.loops.engine.parameters import NamedParameters
    from teleop_drake.loops.linear.delay_map import DelayMargins
    from teleop_drake.loops.linear.ports import DelayMargin, LinearizePorts
    from teleop_drake.loops.run.recording import Recording
    from teleop_drake.loops.run.simulator import MakeSimulator
    from teleop_drake.model.run.compile import Compile
    from teleop_drake.model.run.simulate import MakeDiagram, simulate
    from teleop_drake.model.scenario import (
        LoadScenario,
        Scenario,
        ScenarioError,
        ScenarioNames,
        ScenarioToYaml,
        TrackingScenario,
    )
    from teleop_drake.model.task_recording import LoadRecording, TaskRecording
    from teleop_drake.model.tasks.metrics import RunMetrics, RunSummary
    from teleop_drake.model.teleoperator import MakeTeleoperator
    from teleop_drake.study.analysis.energy import TwoPortEnergyBalance
    from teleop_drake.study.analysis.latency import EstimateLatency
    from teleop_drake.study.analysis.stability import AnalyzeStability
    from teleop_drake.study.analysis.stability_chart import ChartStability
    from teleop_drake.study.figures.analysis import (
        PlotBode,
        PlotNyquist,
        PlotStabilityChart,
        PlotStableDelays,
    )
    from teleop_drake.study.figures.latency import PlotLatency
    from teleop_drake.study.figures.notebook import ShowDiagram, ShowTable
    from teleop_drake.study.figures.runs import PlotComparison, PlotRun, SaveFigure
    from teleop_drake.study.figures.scene import MakeReplay
    from teleop_drake.study.figures.style import Figure
    from teleop_drake.study.figures.sweeps import PlotSweep
    from teleop_drake.study.figures.trace_report import PlotTraceReport
    from teleop_drake.study.link.remote import OperateRemotely, ServeRobot
    from teleop_drake.study.page.page import Explore, MakePage, WritePage
    from teleop_drake.study.sweep import RunSweep, Sweep
    from teleop_drake.study.sweep.study import LoadStudy
    from teleop_drake.study.sweep.trace_report import ReportTrace
    from teleop_drake.study.sweep.tuning import Tune

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
    "loops.linear.delay_map": ["DelayMargins"],
    "study.analysis.energy": ["TwoPortEnergyBalance"],
    "study.analysis.latency": ["EstimateLatency"],
    "study.analysis.stability_chart": ["ChartStability"],
    "study.figures.analysis": [
        "PlotBode",
        "PlotNyquist",
        "PlotStabilityChart",
        "PlotStableDelays",
    ],
    "study.figures.latency": ["PlotLatency"],
    "study.figures.notebook": ["RecordingHtml", "ShowDiagram", "ShowTable"],
    "study.figures.style": ["Figure"],
    "study.figures.sweeps": ["PlotSweep"],
    "study.figures.trace_report": ["PlotTraceReport"],
    "study.sweep.study": ["LoadStudy"],
    "study.link.remote": ["OperateRemotely", "ServeRobot"],
    "loops.linear.ports": ["DelayMargin", "LinearizePorts"],
    "study.analysis.stability": ["AnalyzeStability"],
    "loops.draw.block_diagram": ["WriteDiagram"],
    "study.figures.runs": ["PlotComparison", "PlotRun", "SaveFigure"],
    "study.figures.scene": ["MakeReplay"],
    "study.page.page": ["Explore", "MakePage", "WritePage"],
    "loops.engine.parameters": ["NamedParameters"],
    "loops.run.recording": ["Recording"],
    "model.scenario": [
        *("LoadScenario", "Scenario", "ScenarioError", "ScenarioNames"),
        *("ScenarioToYaml", "TrackingScenario"),
    ],
    "loops.run.simulator": ["MakeSimulator"],
    "model.run.simulate": ["MakeDiagram", "simulate"],
    "model.run.compile": ["Compile"],
    "study.sweep": ["RunSweep", "Sweep"],
    "study.sweep.trace_report": ["ReportTrace"],
    "study.sweep.tuning": ["Tune"],
    "model.task_recording": ["LoadRecording", "TaskRecording"],
    "model.tasks.metrics": ["RunMetrics", "RunSummary"],
    "model.teleoperator": ["MakeTeleoperator"],
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


FindMoved()


def __dir__() -> list[str]:
    """Returns the names of the package, including those not imported yet."""
    hidden = {"Any", "FindMoved", "TYPE_CHECKING", "import_module"}
    return sorted({*globals(), *__all__} - hidden)
