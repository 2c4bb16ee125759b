"""Loading of scenarios from names, files and overrides."""

import math
import os
from pathlib import Path
from typing import Any

from pydrake.systems.framework import System

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.solver import MAX_STEPS
from teleop_drake.loops.framework.validation import (
    CheckKind,
    Choices,
    Refuse,
    ScenarioError,
)
from teleop_drake.model.kinds import KIND_KEYS, IsOwn, WithFile
from teleop_drake.model.scenario.overrides import (
    CHANNELS,
    DELAYS,
    Overrides,
    ParseOverrides,
    SetFields,
    SetPath,
)
from teleop_drake.model.scenario.scenario import (
    AnyScenario,
    Scenario,
    ScenarioFiles,
    ScenarioLike,
    TrackingScenario,
)
from teleop_drake.model.scenario.tree import FromTree, ToTree
from teleop_drake.model.scenario.yaml_text import ParseFile, ParseYaml

_SCENARIO_DIR = Path(__file__).parent.parent / "scenarios"


def ScenarioNames() -> list[str]:
    """Returns the names of the built-in scenarios in alphabetical order."""
    return sorted(path.stem for path in _SCENARIO_DIR.glob("*.yaml"))


def LoadScenario(
    name_or_path: str | os.PathLike[str], overrides: Overrides = ()
) -> AnyScenario:
    """Loads a scenario, applies overrides and validates the result.

    Args:
        name_or_path: A built-in name (see `ScenarioNames`) or a YAML file. Fields that
            the file leaves out have the default of their dataclass, if there is one.
        overrides: Either a mapping such as {"delay": 0.05} or strings "PATH=VALUE"
            with a YAML value. A path is dotted; an element of a list is addressed by
            its number or its `name` ("environment.layers.bone.stiffness",
            "surgeon.velocity.0"). ALIASES contains short paths; `delay` sets the delay
            of both channels. A later override replaces an earlier one.

    Returns:
        A TrackingScenario if the file has a key `trajectory`, otherwise a Scenario.

    Raises:
        ScenarioError: If the file cannot be read, or its contents or an override are
            not allowed.
    """
    return LoadOverridden(name_or_path, overrides)[0]


def LoadOverridden(
    scenario: ScenarioLike | Record, overrides: Overrides
) -> tuple[AnyScenario, list[str]]:
    """Returns a scenario with overrides, and the paths of the replaced fields.

    Args:
        scenario: A valid scenario, its name or file, or a tree of ReadTree().
        overrides: The overrides as in LoadScenario().

    Returns:
        The scenario, and the dotted paths of the replaced fields, two for `delay`. They
        contain the numbers of a list's elements, never their names, so that each field
        has a unique path.
    """
    given = scenario
    if isinstance(given, str | os.PathLike):
        given = _CompleteTree(_FindScenario(given))
    if not isinstance(given, dict):
        CheckScenarioLike(given)
    tree = ToTree(given)
    replaced = SetFields(tree, overrides)
    changed = FromTree(tree, _SchemaOf(tree))
    # Most sweeps change only the channels of a valid scenario. Checking only these
    # saves time.
    only_channels = all(path.startswith(CHANNELS) for path in replaced)
    if isinstance(given, Scenario) and only_channels:
        assert isinstance(changed, Scenario)
        changed._CheckChannels()
    else:
        changed._Check()
    return changed, replaced


def ReadTree(name_or_path: str | os.PathLike[str]) -> Record:
    """Returns the complete tree of a scenario, in which paths of files are absolute."""
    return _CompleteTree(_FindScenario(name_or_path).absolute())


def ReadScenario(
    name_or_path: str | os.PathLike[str], overrides: Overrides = ()
) -> tuple[Record, dict[str, str]]:
    """Returns the contents of a scenario file with overrides, without running code.

    Values are not checked, and defaults are not added: both could import the module of
    a user's own kind.

    Args:
        name_or_path: A built-in name or a YAML file.
        overrides: The overrides as in LoadScenario().

    Returns:
        The tree, and the names of the user's own kinds and task in it by their fields.

    Raises:
        ScenarioError: If the file or an override cannot be read.
    """
    tree = _ParseScenario(_FindScenario(name_or_path))
    for dotted, value in ParseOverrides(overrides):
        SetPath(tree, dotted, value)
    own = {
        f"{name}.{key}": section[key]
        for name, section in tree.items()
        if isinstance(section, dict)
        for key in KIND_KEYS
        if IsOwn(section.get(key))
    }
    if tree.get("task") is not None:
        own["task"] = tree["task"]
    return tree, own


def AsScenario(scenario: ScenarioLike) -> AnyScenario:
    """Returns the scenario, which is loaded if a name or a file is given."""
    CheckScenarioLike(scenario)
    if isinstance(scenario, (str, os.PathLike)):
        return LoadScenario(scenario)
    return scenario


def CheckScenarioLike(scenario: Any) -> None:
    """Refuses an argument that is neither a scenario nor the name or file of one.

    Raises:
        WrongKind: If it is not.
    """
    allowed = "a scenario, its name or file"
    if isinstance(scenario, System):
        allowed += (
            "; a Diagram is simulated by simulate(), with many numbers by Compile() "
            "and Sweep(), shown by MakePage(), analysed by LinearizePorts() and "
            "DelayMargin()"
        )
    CheckKind("scenario", scenario, AnyScenario | str | os.PathLike, allowed)


def AsTeleoperation(scenario: ScenarioLike, reason: str = "") -> Scenario:
    """Returns a teleoperation, which is loaded if a name or a file is given.

    Args:
        scenario: The scenario, or its name or file.
        reason: The reason why no other task is possible, for the message.

    Raises:
        ScenarioError: If the scenario is not a teleoperation.
    """
    scenario = AsScenario(scenario)
    if not isinstance(scenario, Scenario):
        allowed = f"a teleoperation; {reason}" if reason else "a teleoperation"
        Refuse("scenario", scenario.name, allowed)
    return scenario


def CheckSteps(scenario: AnyScenario) -> None:
    """Refuses a valid scenario whose simulation requires more than MAX_STEPS steps.

    It would take very long and fill the memory.

    Raises:
        ScenarioError: If the duration is too long for the longest possible step.
    """
    steps: dict[str, float] = {}
    if isinstance(scenario, Scenario):
        for path in CHANNELS:
            channel = getattr(scenario, path)
            delays = [channel.LongestStep(scenario.duration), *channel.FieldDelays()]
            steps[f"{path}.delay"] = min(delays)
            steps[f"{path}.sample_period"] = channel.PacketPeriod()
        steps["surgeon"] = scenario.surgeon.LongestStep()
        for name, config in scenario.sensor.sampled.items():
            steps[f"sensor.{name}.sample_period"] = config.sample_period or math.inf
    steps["simulator.max_step_size"] = scenario.simulator.max_step_size
    field, shortest = min(steps.items(), key=lambda item: item[1])
    num_steps = scenario.duration / shortest
    if num_steps > MAX_STEPS:
        raise ScenarioError(
            f"duration = {scenario.duration:g}: must be at most "
            f"{MAX_STEPS * shortest:g} s with {field} = {shortest:g} s, which makes "
            f"{num_steps:.2g} steps"
        )


def _ParseScenario(path: Path) -> dict[Any, Any]:
    """Returns the tree of a scenario file, with `delay` moved to both channels.

    Raises:
        ScenarioError: If the file is not a mapping in YAML, or gives two different
            delays for a channel.
    """
    tree = ParseFile(path)
    if "delay" not in tree or _SchemaOf(tree) is not Scenario:
        return tree
    delay = tree.pop("delay")
    for dotted in DELAYS:
        channel = tree.setdefault(dotted.partition(".")[0], {})
        if isinstance(channel, dict) and channel.setdefault("delay", delay) != delay:
            Refuse("delay", delay, f"left out, or the same as {dotted}")
    return tree


def _CompleteTree(path: Path) -> Record:
    """Returns the tree of a scenario file, completed by defaults."""
    tree = _ParseScenario(path)
    tree.setdefault("name", path.stem)
    scenario = FromTree(tree, _SchemaOf(tree))
    # The paths of files are relative to the folder of the scenario's file.
    for dotted, file in ScenarioFiles(scenario).items():
        section, key = dotted.split(".")
        config = getattr(scenario, section)
        given = WithFile(getattr(config, key), str(path.parent / file))
        setattr(config, key, given)
    complete: Record = ToTree(scenario)
    return complete


def ScenarioFromYaml(text: str) -> AnyScenario:
    """Returns the scenario from a text of ScenarioToYaml().

    If the scenario contains paths of files, only the types of its values are checked,
    so that a recording can be loaded without these files.

    Raises:
        ScenarioError: If the text is not YAML or a value is not allowed.
    """
    tree = ParseYaml(text, "scenario")
    scenario = FromTree(tree, _SchemaOf(tree))
    if not ScenarioFiles(scenario):
        scenario._Check()
    return scenario


def _FindScenario(name_or_path: str | os.PathLike[str]) -> Path:  # noqa: RET503
    """Returns the path of a scenario's file.

    Raises:
        ScenarioError: If there is no built-in scenario or file of that name.
    """
    text = os.fspath(name_or_path)
    built_in = _SCENARIO_DIR / f"{text}.yaml"
    path = Path(text)
    if text.isidentifier() and built_in.is_file():
        return built_in
    if path.suffix in (".yaml", ".yml") or len(path.parts) > 1 or os.path.isfile(text):
        return path
    allowed = Choices(text, ScenarioNames())
    Refuse("scenario", text, f"{allowed} or a YAML file")


def _SchemaOf(tree: Any) -> type[AnyScenario]:
    """Returns the class of the scenario that a tree describes."""
    is_tracking = isinstance(tree, dict) and "trajectory" in tree
    return TrackingScenario if is_tracking else Scenario
