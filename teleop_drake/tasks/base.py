"""Task: what is asked of the operator and the robot, and what counts."""

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

from pydrake.systems.framework import Diagram

from teleop_drake.channels import ChannelConfig
from teleop_drake.recording import Event, Recording
from teleop_drake.scenario import AnyScenario
from teleop_drake.tasks.panels import AxisPanels, SignalRow

_S = TypeVar("_S", bound=AnyScenario)


@dataclass(frozen=True, kw_only=True)
class SpeedLimit:
    """What speed of the tool ends a run.

    Attributes:
        speed: In m/s.
        name: How to call it.
    """

    speed: float
    name: str

    def Reason(self, speed: float) -> str:
        """Returns why a run ended.

        Args:
            speed: Of the tool, in m/s.
        """
        return f"the tool's speed, {speed:.4g} m/s, exceeds {self.name}"


class Task(ABC, Generic[_S]):
    """What a scenario of class S is run for. It has no state.

    A task of one's own derives from this class, or from one of the package's tasks and
    changes what is different. A scenario names it as `task: my_module:MyTask`, or it is
    given to simulate(), RunMetrics(), RunSummary() and PlotRun().

    Attributes:
        controllers: Kinds that are compared unless others are asked for; none if there
            is only one.
        systems: Names of the systems that MakeDiagram puts side by side, as far as the
            task needs them; one is `robot`.
        units: Scalar metrics by their dotted names, and their units. A name that ends
            in `.*` has a value for each task axis.
        page_metrics: The name in page/metrics.js of what computes the metrics of this
            very class in a page; empty: nothing there does, and the page says so.
    """

    controllers: ClassVar[tuple[str, ...]] = ()
    systems: ClassVar[tuple[str, ...]] = ("robot",)
    units: ClassVar[Mapping[str, str]]
    page_metrics: ClassVar[str] = ""

    def Check(self, scenario: _S) -> None:
        """Checks a scenario, and what derives from several of its fields.

        Raises:
            ScenarioError: If it is not valid.
            ValueError: If what derives from it is not allowed.
        """
        scenario.Validate()

    def Channels(self, scenario: _S) -> dict[str, ChannelConfig]:
        """Returns the channels of a scenario by the names of their fields."""
        names = [field.name for field in dataclasses.fields(scenario)]
        values = {name: getattr(scenario, name) for name in names}
        return {name: x for name, x in values.items() if isinstance(x, ChannelConfig)}

    @abstractmethod
    def MakeDiagram(self, scenario: _S) -> Diagram:
        """Makes what is simulated.

        Every vector output of its systems is recorded by its name. Among them are
        tool_position, tool_velocity, environment_force and control_force (n each).

        Returns:
            The Diagram. Its default context is the start.

        Raises:
            ScenarioError: If the scenario is not valid.
        """

    @abstractmethod
    def MakeSpeedLimit(self, scenario: _S) -> SpeedLimit:
        """Returns what speed of the tool ends a run as diverged."""

    @abstractmethod
    def FindEvents(self, recording: Recording) -> list[Event]:
        """Returns what happened in a run, in the order of its time.

        Args:
            recording: A run, its events not found yet.
        """

    @abstractmethod
    def Metrics(self, recording: Recording) -> dict[str, Any]:
        """Returns the metrics of a run.

        Args:
            recording: A run, all of its numbers finite.

        Returns:
            Finite numbers, lists of them with one entry per task axis, bool, None, and
            dicts of these. The scalar ones are those of `units`.
        """

    @abstractmethod
    def Particulars(self, recording: Recording) -> dict[str, Any]:
        """Returns what RunSummary says of a run of this task beside the metrics.

        Args:
            recording: A run, all of its numbers finite.

        Returns:
            Finite numbers, bool, str and None by name.
        """

    @abstractmethod
    def Panels(self, recordings: Sequence[Recording]) -> list[SignalRow] | AxisPanels:
        """Returns what a figure of runs shows, from top to bottom.

        Args:
            recordings: Runs of robots with as many axes, at least one.

        Returns:
            Rows of signals, with a panel against time and one against the position; or
            rows with a panel for each task axis, for a figure of one run.
        """
