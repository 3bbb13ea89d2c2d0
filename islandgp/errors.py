"""The exceptions for errors of users.

IslandError            root; one message: expected, found, remedy; exit code 2 of commands
|-- TreeError          a text is not a tree of the language (line, column, caret)
|   |-- UnknownNameError  an action, a key or a subtree does not exist
|   |-- LimitError     a tree is deeper or larger than its limits
|   |-- SharedResourceError  two actions use one resource in the same tick
|   `-- OtherDomainError  a tree is for another domain; a DomainError as well
|-- ConfigError        the configuration is wrong (one line per error)
|-- DomainError        a domain's declaration is wrong
|   `-- TimeLimitError an episode takes longer than it may (names the action)
|-- PartError          a class of the user, named in the configuration, failed (with traceback)
|-- EvaluationError    an episode could not be run (names the tree and the world seed)
|-- SupervisionError   a supervisor cannot work
|-- RunError           a run's folder, checkpoint or record cannot be used
|   |-- BusyError      another process is using it
|   `-- UntrustedError it has a link, or names code or a server that only it names
|-- TrackingError      a tracking store cannot be used
`-- StudyError         runs cannot be compared
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final


class IslandError(Exception):
    """The root; its text is shown to the user without a traceback."""


class TreeError(IslandError):
    """A text is not a tree of the language.

    `line` and `column` count from 1; `guess` is what was probably meant, or "". `str()` gives the
    whole message with the offending line and a caret below it.
    """

    guess = ""

    def __init__(self, message: str, *, line: int = 1, column: int = 1, source: str = "") -> None:
        super().__init__(message)
        self.line = line
        self.column = column
        self.source = source


class UnknownNameError(TreeError):
    """A text names an action, a blackboard key or a subtree that does not exist."""


class LimitError(TreeError):
    """A tree is deeper or has more nodes than its limits allow."""


class SharedResourceError(TreeError):
    """Two actions of a tree can run in the same tick, but use the same resource."""


class ConfigError(IslandError):
    """The configuration is wrong; the message has one line per error."""


class DomainError(IslandError):
    """A domain's declaration is wrong, or breaks its contract."""


class TimeLimitError(DomainError):
    """An episode exceeded its time limit; `running` is the running code, with its place."""

    def __init__(self, work: str, seconds: float) -> None:
        super().__init__(
            f"Expected an episode to end within {seconds:g} s, found {work}; {RAISE_LIMIT}."
        )
        self.running = work


RAISE_LIMIT: Final = (
    "let it return, or raise the limit (--timeout of a command, evaluator.policy.episode_timeout of"
    " a run)"
)
"""The remedy for a TimeLimitError."""


class OtherDomainError(TreeError, DomainError):
    """A tree's text names another domain than the configured one, or an unknown domain."""


class PartError(IslandError):
    """A class of the user raised an exception, which is its cause and is shown as well."""


class EvaluationError(IslandError):
    """An episode could not be run; the message names the tree and the world seed."""


class SupervisionError(IslandError):
    """A supervisor cannot work, so the run must not start."""


class RunError(IslandError):
    """A run's folder, checkpoint or record cannot be used."""


class BusyError(RunError):
    """Another process is using a run's folder."""


class UntrustedError(RunError):
    """A folder has a link or a pipe, or names code or a server that only it names."""


class TrackingError(IslandError):
    """A tracking store cannot be used."""


class StudyError(IslandError):
    """Runs cannot be selected or compared."""


def brief(error: Exception) -> str:
    """The first line of the message that is not empty, or the type; at most 200 characters.

    Of pydantic's errors, which begin with their number, it is what follows.
    """
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if lines and " validation error" in lines[0]:
        lines = [" ".join(lines[1:])]
    return (lines[0] if lines else type(error).__name__)[:200]


def in_the_way(folder: Path) -> str:
    """The message if files in a folder shadow Python's or installed modules, else ""."""
    from importlib.metadata import packages_distributions

    reserved = {*sys.stdlib_module_names, *packages_distributions()}
    files = sorted(f.name for f in folder.glob("*.py") if f.stem in reserved)
    if not files:
        return ""
    named = ", ".join(files)
    return (
        f"Expected Python's own and installed modules, found {named} in {folder}, which hides one"
        " of them; rename it."
    )
