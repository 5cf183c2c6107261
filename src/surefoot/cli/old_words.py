"""Old words: options of the last version, which still work in this one.

Old values are translated where they are read: a suite by `chosen_scenarios`, a preset by the training command.
"""

from __future__ import annotations

from collections.abc import Sequence

OPTIONS = {("train", "--after"): "--warm-start"}
"""(command, old option) -> its new name."""


def renewed(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """The arguments of a command line in this version's words, and a line on each old word among them.

    Args:
        arguments: what follows the program's name; its first one is the command.
    """
    new, notes = list(arguments[:1]), []
    command = new[0] if new else ""
    for argument in arguments[1:]:
        option, equals, value = argument.partition("=")
        if (command, option) in OPTIONS:
            name = OPTIONS[command, option]
            notes.append(f"{option} is now called {name}")
            new.append(name + equals + value)
        else:
            new.append(argument)
    return new, notes
