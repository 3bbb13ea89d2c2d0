"""Run a tree in your own program: bind your functions to its leaves and call `tick`.

    tree = islandgp.load_tree("patrol.bt")
    with tree.bind({"Dock": dock, "Patrol": patrol, "battery": read_battery}) as robot_tree:
        while robot_tree.tick() == islandgp.NodeStatus.RUNNING:
            time.sleep(0.1)

No configuration, run or simulator is needed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from enum import IntEnum
from inspect import iscoroutinefunction, signature
from pathlib import Path
from threading import Lock
from typing import Any, Final, Self

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.language import domain_of, domain_place, parse
from islandgp.bt.core.node import (
    AGAIN,
    FAILURE,
    RUNNING,
    SUCCESS,
    ActionArgs,
    Node,
    keys_in,
    size,
    walk,
    written_in,
)
from islandgp.bt.core.parameters import referenced
from islandgp.bt.core.source import Source, closest, plain
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Key, Vocabulary
from islandgp.errors import DomainError, OtherDomainError
from islandgp.installed import domain_class, domain_files
from islandgp.leaves import Leaf, arguments_of, compile_leaves, is_number, number_of
from islandgp.plugin import defined_in, short_repr
from islandgp.text_files import read_text_file


class NodeStatus(IntEnum):
    """Status of a node after a tick."""

    FAILURE = FAILURE
    SUCCESS = SUCCESS
    RUNNING = RUNNING
    ABORTED = ABORTED  # stopped while running; never the result of a whole tree


_STATUSES: Final = {**{int(status): status for status in NodeStatus}, AGAIN: NodeStatus.RUNNING}


@dataclass(frozen=True, slots=True)
class Tree:
    """A tree from a file, made by `load_tree`."""

    node: Node  # the root, with every `use` expanded
    vocabulary: Vocabulary  # an empty one if the file names no domain
    name: str  # of the file, for messages

    def actions(self) -> tuple[str, ...]:
        """The actions of the tree, in document order, each once."""
        return tuple(dict.fromkeys(args.name for args in self.leaves()))

    def leaves(self) -> list[ActionArgs]:
        """The action of each leaf with its arguments as they are written, in document order."""
        return [node.args for node in walk(self.node) if isinstance(node.args, ActionArgs)]

    def calls(self) -> list[tuple[str, Mapping[str, object]]]:
        """The action of each leaf and the arguments that its function gets, in document order."""
        return [(args.name, arguments_of(args, self.vocabulary)) for args in self.leaves()]

    def keys(self) -> tuple[str, ...]:
        """The blackboard keys that it reads or writes, in document order, each once."""
        values = (value for args in self.leaves() for _, value in args.values)
        references = (key for value in values if (key := referenced(value)) in self.vocabulary.keys)
        return tuple(dict.fromkeys((*keys_in(self.node), *references)))

    def inputs(self) -> tuple[str, ...]:
        """The keys that the program writes: those that neither trees nor actions write."""
        own = written_in(self.node)
        own |= {name for name, key in self.vocabulary.keys.items() if key.writable}
        return tuple(key for key in self.keys() if key not in own)

    def bind(
        self, leaves: object, keys: object = None, *, step_s: float | None = None, seed: int = 0
    ) -> RobotTree:
        """Binds a function to each action and a value to each blackboard key.

        Args:
            leaves: a function for each action, by name: a mapping, or an object with methods of
                these names. It is called with the action's arguments by name; see
                `islandgp.leaves` for functions and generator functions. When an action is
                aborted, its generator is closed, and its function's method `stop()` is called
                if it has one.
            keys: a value for each blackboard key that the tree does not write, by name: a number,
                True or False, one of the key's words or its index, or a function that returns one.
                A mapping or an object; read once per tick. None: the entries are in `leaves`.
            step_s: seconds between two ticks, > 0; required if the tree has a wait, a timeout or
                a cooldown.
            seed: of the orders that a random_selector draws, >= 0: equal seeds draw equal orders.
                After a stop they are drawn from the first one again.

        Returns:
            The tree, ready to be ticked.

        Raises:
            DomainError: an action, a key or `step_s` is missing, `step_s` is not above 0, or `seed`
                is no whole number of at least 0; an entry is not a function or takes other
                arguments; or a mapping has a name that is not in the vocabulary.
        """
        if not isinstance(seed, int) or seed < 0:
            raise DomainError(f"Expected a whole number >= 0 as seed, found {short_repr(seed)}.")
        if step_s is not None and not (is_number(step_s) and step_s > 0):
            raise DomainError(f"Expected seconds above 0 as step_s, found {short_repr(step_s)}.")
        sources = {"action": leaves, "key": leaves if keys is None else keys}
        if faults := dict.fromkeys(self._faults(sources)):
            lines = "".join(f"\n  {fault}" for fault in faults)
            raise DomainError(
                f"Expected a function for each action and a value for each key of {self.name},"
                f" found:{lines}"
            )
        functions: dict[str, Leaf] = {name: _entry(leaves, name) for name in self.actions()}
        return RobotTree(self, functions, sources["key"], step_s, seed)

    def _faults(self, sources: Mapping[str, object]) -> Iterator[str]:
        """A line for each action or key that is missing, cannot be called, or is unknown."""
        actions = [("action", *call) for call in self.calls()]
        for kind, name, arguments in [*actions, *(("key", key, {}) for key in self.inputs())]:
            entry = _entry(sources[kind], name)
            if entry is None:
                yield f"nothing for the {kind} {name}"
            elif (reason := _uncallable(entry, arguments)) and (
                callable(entry) or kind == "action"
            ):
                yield f"for the {kind} {name}, {reason}{defined_in(entry)}"
        known = {*self.vocabulary.actions, *self.vocabulary.keys}
        for source in sources.values() if known else ():
            for name in source if isinstance(source, Mapping) else ():
                if name not in known:
                    near = closest(str(name), known)
                    hint = f"; perhaps {near} is meant" if near else ""
                    domain = self.vocabulary.domain
                    yield f"{short_repr(name)}, which is not in the domain {domain}{hint}"


class RobotTree:
    """A bound tree, made by `Tree.bind`; it is stopped at the end of a `with` block."""

    def __init__(
        self, tree: Tree, leaves: Mapping[str, Leaf], keys: object, step_s: float | None, seed: int
    ) -> None:
        self.tree = tree
        self._step_s, self._seed = step_s, seed
        self.statuses: list[NodeStatus | None] = [None] * size(tree.node)
        """Status of each node in the last tick, in document order; None: it was not ticked."""
        self._leaves, self._keys = leaves, keys
        self._ticking = Lock()
        known, names = tree.vocabulary.keys, tree.keys()
        self._places = {name: place for place, name in enumerate(names)}
        self._inputs = [(self._places[name], name, known.get(name)) for name in tree.inputs()]
        self._board = [known[name].start if name in known else 0.0 for name in names]
        self._start()

    def tick(self) -> NodeStatus:
        """Reads the keys and ticks the tree once; returns SUCCESS, FAILURE or RUNNING.

        After SUCCESS or FAILURE the next tick starts the tree again. An exception of a leaf or
        a key stops all running actions and is then raised to the caller.

        Raises:
            DomainError: a leaf did not return a status, a key is not a number, or the tree is
                already in a tick.
        """
        self._enter("tick")
        try:
            for place, name, key in self._inputs:
                self._board[place] = _value(self._keys, name, key)
            self.statuses = [None] * len(self.statuses)
            return _STATUSES[self._tick()]
        except BaseException:
            self._stop()
            raise
        finally:
            self._ticking.release()

    @property
    def board(self) -> dict[str, float]:
        """The value of each key in the last tick; of a word its index."""
        return dict(zip(self._places, self._board, strict=True))

    def stop(self) -> None:
        """Stops all running actions; the next tick starts the tree again.

        Raises:
            DomainError: the tree is in a tick.
        """
        self._enter("stop")
        try:
            self._stop()
        finally:
            self._ticking.release()

    def _enter(self, name: str) -> None:
        """Raises DomainError if a leaf, a key or another thread calls `name` during a tick."""
        # Without a context manager, which would add a microsecond to each tick.
        if not self._ticking.acquire(blocking=False):
            raise DomainError(
                f"Expected {name}() between two ticks of {self.tree.name}, found a call during a"
                " tick, by a leaf, a key or another thread."
            )

    def _stop(self) -> None:
        try:
            with ExitStack() as stops:  # all are called, even if one raises
                for runner in reversed(self._runners):
                    stops.callback(runner.stop)
        finally:
            final = {NodeStatus.RUNNING: NodeStatus.ABORTED}
            self.statuses = [final.get(s, s) if s is not None else None for s in self.statuses]
            self._start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _start(self) -> None:
        """Compiles the tree, so that the next tick starts it."""
        self._tick, self._runners = compile_leaves(
            self.tree.node,
            self._leaves,
            self.tree.vocabulary,
            self._board,
            self._places,
            watch=self._watch,
            step_s=self._step_s,
            seed=self._seed,
        )

    def _watch(self, place: int, status: int) -> None:
        self.statuses[place] = _STATUSES[status]


def load_tree(
    file: str | os.PathLike[str], vocabulary: Vocabulary | str | os.PathLike[str] | None = None
) -> Tree:
    """Loads a tree from a file; bind your functions to it with `Tree.bind`.

    Args:
        file: path of a tree in the language; included files are in its folder or below.
        vocabulary: the permitted actions and keys: a `Vocabulary`, or the path of a file with the
            JSON of `islandgp domain NAME --json` or a TreeNodesModel. None: those of the installed
            domain that the file names (`domain NAME`), or any names if it names no domain.

    Returns:
        The parsed tree with its vocabulary.

    Raises:
        TreeError: the file is not a tree of this vocabulary.
        DomainError: the file names a domain that is not installed, or the vocabulary's file
            does not declare a vocabulary.
        IslandError: a file cannot be read.
    """
    path = Path(file)
    text = read_text_file(path)
    file_vocabulary = _vocabulary_of(text, path, vocabulary)
    node = parse(text, file_vocabulary, name=str(path), folder=path.parent)
    return Tree(node, file_vocabulary or EMPTY_VOCABULARY, str(path))


def _vocabulary_of(
    text: str, file: Path, vocabulary: Vocabulary | str | os.PathLike[str] | None
) -> Vocabulary | None:
    """The vocabulary of a tree's text. Raises as `load_tree`."""
    if isinstance(vocabulary, Vocabulary):
        return vocabulary
    if vocabulary is not None:
        from islandgp.bt.export.declared import declared

        declaration, tree = Path(vocabulary), str(file)
        content = read_text_file(declaration)
        return declared(content, text, name=str(declaration), tree_name=tree, folder=file.parent)
    if not (domain := domain_of(text)):
        return None
    if domain in domain_files():
        with suppress(AttributeError, ImportError):  # it depends on settings, or on an extra
            words: Vocabulary = domain_class(domain).schema.vocabulary
            return words
    raise Source(plain(text), str(file)).error(
        domain_place(text),
        f"nothing declares the words of the domain {domain!r}",
        "the argument vocabulary: a Vocabulary, or a file that `islandgp domain"
        f" {domain} --json` prints",
        kind=OtherDomainError,
    )


def _entry(source: object, name: str) -> Any:
    """The entry of a mapping or the attribute of an object; None if there is none."""
    return source.get(name) if isinstance(source, Mapping) else getattr(source, name, None)


def _uncallable(entry: object, arguments: Mapping[str, object]) -> str:
    """The reason why an entry cannot be called with these arguments; "" if it can."""
    if not callable(entry) or isinstance(entry, type):
        return f"{short_repr(entry)}, which is not a function"
    if iscoroutinefunction(entry):
        return "a coroutine; write `def` in place of `async def`"
    try:
        signature(entry).bind(**arguments)
    except TypeError as error:
        call = f"with {', '.join(arguments)}" if arguments else "without arguments"
        return f"a function that cannot be called {call}: {error}"
    except ValueError:  # it has no signature
        pass
    return ""


def _value(source: object, name: str, key: Key | None) -> float:
    """The present value of a key. Raises DomainError for a value that the key cannot have."""
    entry = _entry(source, name)
    value = entry() if callable(entry) else entry
    return number_of(value, key, f"the value of the key {name}", entry)
