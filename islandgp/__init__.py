"""Evolves robot Behaviour Trees with genetic programming under a supervisor.

compose     an experiment from configuration: iterate over its generations, evaluate trees
run         composes an experiment, runs it with its records, and gives its results
load        runs from their folders, as pandas frames
parse       a tree from its text
load_tree   a tree from its file, to be bound to functions of yours and ticked
Tree, RobotTree, NodeStatus  what it is, what `Tree.bind` makes of it, how a tick ends
Streams     a run's random streams, which a search draws from
Advice      what a supervisor's guidance comes to, which a search is told
to_text     the canonical text of a tree
IslandError what a user can do wrong, in one clear message; TreeError: a text is not a tree

Imported names are loaded when they are first used, as some take seconds.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # of typing, whose import takes time in which a signal may come
if TYPE_CHECKING:
    from typing import Any

    from islandgp.binding import NodeStatus, RobotTree, Tree, load_tree
    from islandgp.bt.core.language import parse, to_text
    from islandgp.errors import IslandError, TreeError
    from islandgp.experiment import Experiment, compose, run
    from islandgp.gp.population import Advice
    from islandgp.results import Results, load
    from islandgp.seeding import Streams

    __version__: str

__all__ = [
    "Advice",
    "Experiment",
    "IslandError",
    "NodeStatus",
    "Results",
    "RobotTree",
    "Streams",
    "Tree",
    "TreeError",
    "__version__",
    "compose",
    "load",
    "load_tree",
    "parse",
    "run",
    "to_text",
]

_HOMES = {
    "Advice": "islandgp.gp.population",
    "Experiment": "islandgp.experiment",
    "IslandError": "islandgp.errors",
    "NodeStatus": "islandgp.binding",
    "Results": "islandgp.results",
    "RobotTree": "islandgp.binding",
    "Streams": "islandgp.seeding",
    "Tree": "islandgp.binding",
    "TreeError": "islandgp.errors",
    "compose": "islandgp.experiment",
    "load": "islandgp.results",
    "load_tree": "islandgp.binding",
    "parse": "islandgp.bt.core.language",
    "run": "islandgp.experiment",
    "to_text": "islandgp.bt.core.language",
}


def _version() -> str:
    """The installed version; "0" in a checkout that was never installed."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("islandgp")
    except PackageNotFoundError:
        return "0"


def __getattr__(name: str) -> Any:
    """Loads a public name where it is first used."""
    if name == "__version__":
        return _version()
    if name not in _HOMES:
        raise AttributeError(f"module 'islandgp' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
