"""Evolves robot Behaviour Trees with genetic programming under a supervisor.

compose     composes an experiment: iterate over its generations, evaluate trees
run         composes an experiment, runs it with records, returns its results
load        loads recorded runs as pandas frames
parse       parses the text of a tree
to_text     prints a tree as its canonical text
load_tree   loads a tree from a file as a `Tree`; `Tree.bind` binds your functions to it
RobotTree   a bound tree, ready to be ticked; a tick returns a `NodeStatus`
Streams     the random streams of a run, for searches of your own
Advice      the checked guidance of a supervisor, passed to a search
GenerationRecord  the record of one generation, as a callback of `run` gets it
IslandError root of the package's exceptions; TreeError: a text is not a tree

Each name is imported when it is first used, because some of the modules take seconds to import.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # not from typing: its import takes time before signals are handled
if TYPE_CHECKING:
    from typing import Any

    from islandgp.binding import NodeStatus as NodeStatus
    from islandgp.binding import RobotTree as RobotTree
    from islandgp.binding import Tree as Tree
    from islandgp.binding import load_tree as load_tree
    from islandgp.bt.core.language import parse as parse
    from islandgp.bt.core.language import to_text as to_text
    from islandgp.errors import IslandError as IslandError
    from islandgp.errors import TreeError as TreeError
    from islandgp.experiment import Experiment as Experiment
    from islandgp.experiment import compose as compose
    from islandgp.experiment import run as run
    from islandgp.gp.population import Advice as Advice
    from islandgp.gp.record import GenerationRecord as GenerationRecord
    from islandgp.results import Results as Results
    from islandgp.results import load as load
    from islandgp.seeding import Streams as Streams

    __version__: str

_NAMES = {
    "binding": "NodeStatus RobotTree Tree load_tree",
    "bt.core.language": "parse to_text",
    "errors": "IslandError TreeError",
    "experiment": "Experiment compose run",
    "gp.population": "Advice",
    "gp.record": "GenerationRecord",
    "results": "Results load",
    "seeding": "Streams",
}
"""The public names of each module."""

_HOMES = {name: f"islandgp.{module}" for module, names in _NAMES.items() for name in names.split()}

__all__ = [*_HOMES, "__version__"]


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first used."""
    if name == "__version__":
        from importlib.metadata import version

        return version("islandgp")
    if name not in _HOMES:
        raise AttributeError(f"module 'islandgp' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
