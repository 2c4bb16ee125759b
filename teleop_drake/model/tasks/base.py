"""Task: the diagram of a scenario, the events of its runs and their metrics."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

from pydrake.systems.framework import Diagram

from teleop_drake.loops.framework.arrays import Names, Record
from teleop_drake.loops.run.recording import Event
from teleop_drake.model.channels import ChannelConfig
from teleop_drake.model.scenario import AnyScenario
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks.panels import SignalRow
from teleop_drake.model.tasks.sentences import DurationInWords, Sentence

_S = TypeVar("_S", bound=AnyScenario)


@dataclass(frozen=True, kw_only=True)
class SpeedLimit:
    """The speed of the tool that ends a run.

    Attributes:
        speed: The limit in m/s.
        name: The description of the limit in messages.
    """

    speed: float
    name: str

    def Reason(self, speed: float) -> str:
        """Returns the message of a run that the limit has ended.

        Args:
            speed: The speed of the tool in m/s.
        """
        return f"the tool's speed, {speed:.4g} m/s, exceeds {self.name}"


def Divergence(recording: TaskRecording) -> Record:
    """Returns `diverged`, a bool, and `diverged_at` in s or None.

    A run has diverged if the tool's speed exceeded its limit or the solver failed.
    """
    has_diverged = recording.termination == "diverged"
    end = float(recording.time[-1]) if has_diverged else None
    return {"diverged": has_diverged, "diverged_at": end}


class Task(ABC, Generic[_S]):
    """The purpose of a scenario of class S. A task has no state.

    Your own task derives from this class, or from one of the package's tasks and
    overrides the methods that differ. A scenario names it as `task: my_module:MyTask`,
    or it is passed to simulate(), RunMetrics(), RunSummary() and PlotRun().

    Attributes:
        controllers: The kinds of controllers that a comparison uses by default; empty
            if there is only one.
        is_compared: Whether figures show several runs together, and also against the
            position.
        systems: Names of the systems of MakeDiagram() that the task requires; one of
            them is `robot`.
        units: The units of the scalar metrics, by their dotted names. A name that ends
            in `.*` has a value for each task axis.
        page_metrics: The name of the function in page/metrics.js that computes the
            metrics of exactly this class; empty if there is none, which a page states.
    """

    controllers: ClassVar[Names] = ()
    is_compared: ClassVar[bool] = True
    systems: ClassVar[Names] = ("robot",)
    units: ClassVar[Mapping[str, str]]
    page_metrics: ClassVar[str] = ""

    def Check(self, scenario: _S) -> None:
        """Checks a scenario, and the values that are derived from it.

        Raises:
            ScenarioError: If the scenario is not valid.
            ValueError: If a derived value is not allowed.
        """
        scenario.Validate()

    def Channels(self, scenario: _S) -> dict[str, ChannelConfig]:
        """Returns the channels of a scenario by the names of their fields."""
        fields = vars(scenario).items()
        return {name: x for name, x in fields if isinstance(x, ChannelConfig)}

    @abstractmethod
    def MakeDiagram(self, scenario: _S) -> Diagram:
        """Makes the Diagram that is simulated.

        Every vector output of its systems is recorded by its name. Among them are
        tool_position, tool_velocity, environment_force and control_force (n each).

        Returns:
            The Diagram. A run starts from its default Context.

        Raises:
            ScenarioError: If the scenario is not valid.
        """

    @abstractmethod
    def MakeSpeedLimit(self, scenario: _S) -> SpeedLimit:
        """Returns the speed of the tool at which a run ends as diverged."""

    @abstractmethod
    def FindEvents(self, recording: TaskRecording) -> list[Event]:
        """Returns the events of a run in the order of time.

        Args:
            recording: A run whose events are not found yet.
        """

    @abstractmethod
    def Metrics(self, recording: TaskRecording) -> Record:
        """Returns the metrics of a run.

        Args:
            recording: A run, all of its numbers finite.

        Returns:
            Finite numbers, lists of them with one entry per task axis, bool, None, and
            dicts of these. The scalar metrics are those of `units`.
        """

    def Outcome(self, recording: TaskRecording, metrics: Record) -> str:
        """Returns what a run did, in one sentence.

        Args:
            recording: A run, all of its numbers finite.
            metrics: Its Metrics().
        """
        return Sentence(recording, [DurationInWords(recording)])

    @abstractmethod
    def Particulars(self, recording: TaskRecording) -> Record:
        """Returns the entries that this task adds to RunSummary beside the metrics.

        Args:
            recording: A run, all of its numbers finite.

        Returns:
            Finite numbers, bool, str and None by name.
        """

    @abstractmethod
    def Panels(self, recordings: Sequence[TaskRecording]) -> list[SignalRow]:
        """Returns the panels of a figure of runs, from top to bottom.

        Args:
            recordings: One run or more, of robots with the same number of axes.

        Returns:
            Rows of signals, with a panel against time and, if runs of the task are
            compared, one against the position.
        """
