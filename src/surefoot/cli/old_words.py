"""Old words: options and values of the last version, which go on working for one more."""

from __future__ import annotations

from collections.abc import Sequence

OPTIONS = {("train", "--after"): "--warm-start"}
"""(command, old option) -> its new name."""
VALUES = {("evaluate", "--suite", "pelvis"): "push"}
"""(command, option, old value) -> the new value."""


def renewed(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """The arguments of a command line in this version's words, and a line on each old word among them.

    Args:
        arguments: what follows the program's name; its first one is the command.
    """
    new, notes = list(arguments[:1]), []
    command = new[0] if new else ""
    for place, argument in enumerate(arguments[1:], 1):
        option, equals, value = argument.partition("=")
        before = arguments[place - 1]
        if (command, option) in OPTIONS:
            name = OPTIONS[command, option]
            notes.append(f"{option} is now called {name}")
            new.append(name + equals + value)
        elif (command, option, value) in VALUES:
            name = VALUES[command, option, value]
            notes.append(f"{option} {value} is now called {option} {name}")
            new.append(f"{option}={name}")
        elif (command, before, argument) in VALUES:
            name = VALUES[command, before, argument]
            notes.append(f"{before} {argument} is now called {before} {name}")
            new.append(name)
        else:
            new.append(argument)
    return new, notes
