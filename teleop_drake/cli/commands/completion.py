"""The command `teleop-drake completion`: completion at the tab key of a shell."""

import argparse
import sys
from typing import Any

from teleop_drake.cli.commands.list import FilesIn, KindsOf


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.epilog = (
        'For bash: add `eval "$(teleop-drake completion bash)"` to ~/.bashrc; zsh '
        "likewise; for fish: `teleop-drake completion fish > "
        "~/.config/fish/completions/teleop-drake.fish`."
    )
    parser.add_argument(
        "shell", choices=("bash", "zsh", "fish"), help="print the script for this shell"
    )


def Execute(args: argparse.Namespace) -> int:
    """Prints the script by which a shell calls Complete() at the tab key."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(["teleop-drake"], shell=args.shell))
    return 0


def Complete(parser: Any) -> None:
    """Prints the completions at the cursor of a shell, and ends the process."""
    import argcomplete

    completers = {
        "scenario": lambda **_: FilesIn("model/scenarios"),
        "controller": lambda **_: KindsOf("architectures"),
        "controllers": lambda **_: [*KindsOf("architectures"), "all"],
    }
    for command in parser._subparsers._group_actions[0].choices.values():
        command.AddOptionsOfCommand()
        for action in command._actions:
            if action.dest in completers:
                action.completer = completers[action.dest]
    argcomplete.autocomplete(
        parser, always_complete_options=False, exit_method=sys.exit
    )
