"""The names of teleop_drake besides those of teleop_drake.blocks."""

from teleop_drake.blocks import *
from teleop_drake.loops.draw.block_diagram import WriteDiagram as WriteDiagram
from teleop_drake.loops.engine.parameters import NamedParameters as NamedParameters
from teleop_drake.loops.linear.delay_map import DelayMargins as DelayMargins
from teleop_drake.loops.linear.ports import DelayMargin as DelayMargin
from teleop_drake.loops.linear.ports import LinearizePorts as LinearizePorts
from teleop_drake.loops.run.recording import Recording as Recording
from teleop_drake.loops.run.simulator import MakeSimulator as MakeSimulator
from teleop_drake.model.run.compile import Compile as Compile
from teleop_drake.model.run.simulate import MakeDiagram as MakeDiagram
from teleop_drake.model.run.simulate import simulate as simulate
from teleop_drake.model.scenario import LoadScenario as LoadScenario
from teleop_drake.model.scenario import Scenario as Scenario
from teleop_drake.model.scenario import ScenarioError as ScenarioError
from teleop_drake.model.scenario import ScenarioNames as ScenarioNames
from teleop_drake.model.scenario import ScenarioToYaml as ScenarioToYaml
from teleop_drake.model.scenario import TrackingScenario as TrackingScenario
from teleop_drake.model.task_recording import LoadRecording as LoadRecording
from teleop_drake.model.task_recording import TaskRecording as TaskRecording
from teleop_drake.model.tasks.metrics import RunMetrics as RunMetrics
from teleop_drake.model.tasks.metrics import RunSummary as RunSummary
from teleop_drake.model.teleoperator import MakeTeleoperator as MakeTeleoperator
from teleop_drake.study.analysis.energy import (
    TwoPortEnergyBalance as TwoPortEnergyBalance,
)
from teleop_drake.study.analysis.latency import EstimateLatency as EstimateLatency
from teleop_drake.study.analysis.stability import AnalyzeStability as AnalyzeStability
from teleop_drake.study.analysis.stability_chart import ChartStability as ChartStability
from teleop_drake.study.figures.analysis import PlotBode as PlotBode
from teleop_drake.study.figures.analysis import PlotNyquist as PlotNyquist
from teleop_drake.study.figures.analysis import PlotStabilityChart as PlotStabilityChart
from teleop_drake.study.figures.analysis import PlotStableDelays as PlotStableDelays
from teleop_drake.study.figures.latency import PlotLatency as PlotLatency
from teleop_drake.study.figures.notebook import RecordingHtml as RecordingHtml
from teleop_drake.study.figures.notebook import ShowDiagram as ShowDiagram
from teleop_drake.study.figures.notebook import ShowTable as ShowTable
from teleop_drake.study.figures.runs import PlotComparison as PlotComparison
from teleop_drake.study.figures.runs import PlotRun as PlotRun
from teleop_drake.study.figures.runs import SaveFigure as SaveFigure
from teleop_drake.study.figures.scene import MakeReplay as MakeReplay
from teleop_drake.study.figures.style import Figure as Figure
from teleop_drake.study.figures.sweeps import PlotSweep as PlotSweep
from teleop_drake.study.figures.trace_report import PlotTraceReport as PlotTraceReport
from teleop_drake.study.link.remote import OperateRemotely as OperateRemotely
from teleop_drake.study.link.remote import ServeRobot as ServeRobot
from teleop_drake.study.page.page import Explore as Explore
from teleop_drake.study.page.page import MakePage as MakePage
from teleop_drake.study.page.page import WritePage as WritePage
from teleop_drake.study.sweep import RunSweep as RunSweep
from teleop_drake.study.sweep import Sweep as Sweep
from teleop_drake.study.sweep.study import LoadStudy as LoadStudy
from teleop_drake.study.sweep.trace_report import ReportTrace as ReportTrace
from teleop_drake.study.sweep.tuning import Tune as Tune

__version__: str
