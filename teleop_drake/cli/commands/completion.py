"""The command `teleop-drake completion`: what the tab key of a shell offers."""

import argparse
from pathlib import Path

# What a shell calls at the tab key. `words` has the words up to the cursor.
_BASH = """\
_teleop_drake() {
    local IFS=$'\\n'
    COMPREPLY=($(teleop-drake completion words "${COMP_WORDS[@]:1:COMP_CWORD}"))
}
complete -o default -F _teleop_drake teleop-drake
"""
_SCRIPTS = {
    "bash": _BASH,
    "zsh": f"autoload -U +X bashcompinit && bashcompinit\n{_BASH}",
    "fish": "complete -c teleop-drake -a "
    "'(teleop-drake completion words (commandline -opc)[2..-1] (commandline -ct))'\n",
}

# Options whose values are those of another command's table, by the name of the table.
_CONTROLLERS = ("--controller", "--controllers")


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.epilog = (
        'For bash: add `eval "$(teleop-drake completion bash)"` to ~/.bashrc; zsh '
        "likewise; for fish: `teleop-drake completion fish > "
        "~/.config/fish/completions/teleop-drake.fish`."
    )
    parser.add_argument(
        "shell",
        choices=(*_SCRIPTS, "words"),
        help="print the script for this shell; words: what may stand for the last word",
    )
    parser.add_argument(
        "words", nargs=argparse.REMAINDER, help="the words up to the cursor"
    )


def Execute(args: argparse.Namespace) -> int:
    """Prints the script of a shell, or the words that fit."""
    if args.shell in _SCRIPTS:
        print(_SCRIPTS[args.shell], end="")
    else:
        print("\n".join(Complete(args.words)))
    return 0


def Complete(words: list[str]) -> list[str]:
    """Returns what may stand for the last of some words.

    Args:
        words: Those after `teleop-drake`; the last one is incomplete or empty.

    Returns:
        The completed words, none where the shell's own names of files are better.
    """
    from teleop_drake.cli.main import MakeParser

    *before, last = words or [""]
    parser = MakeParser()
    commands = next(
        action.choices
        for action in parser._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    if not before:
        known = [*commands, "--help", "--version"]
    elif before[0] not in commands:
        known = []
    else:
        command = commands[before[0]]
        command.AddOptionsOfCommand()
        known = _Known(command, before[1:], last)
    return sorted(word for word in known if word.startswith(last))


def _Known(command: argparse.ArgumentParser, before: list[str], last: str) -> list[str]:
    """Returns the words that a command knows at a place."""
    options = {name: x for x in command._actions for name in x.option_strings}
    previous = before[-1] if before else ""
    if previous in options and options[previous].nargs != 0:
        if previous in _CONTROLLERS:
            return _ControllerNames()
        return [str(choice) for choice in options[previous].choices or ()]
    if last.startswith("-"):
        return list(options)
    positional = next((x for x in command._actions if not x.option_strings), None)
    if positional is None or any(not word.startswith("-") for word in before):
        return []
    if positional.dest == "scenario":
        return _ScenarioNames()
    return [str(choice) for choice in positional.choices or ()]


def _ScenarioNames() -> list[str]:
    """Returns the built-in scenarios, without the second that Drake's import takes."""
    folder = Path(__file__).parents[2] / "scenarios"
    return [path.stem for path in folder.glob("*.yaml")]


def _ControllerNames() -> list[str]:
    """Returns the kinds of controllers."""
    from teleop_drake.architectures import ARCHITECTURES

    return [*ARCHITECTURES, "all"]
