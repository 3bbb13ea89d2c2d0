"""Leaf functions: the implementations of a tree's actions.

A leaf is a function of the action's arguments, passed by name. It is called once per tick while its
node runs, and returns True (success), False (failure) or RUNNING. It can also be a generator
function: each `yield` is a tick in which it is RUNNING, and it returns True or False at its end. If
it is aborted, the generator is closed, so its `finally` clauses run. In place of True it may return
a mapping: the values of keys that the action sets.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, MutableSequence
from functools import partial
from inspect import iscoroutine, isgenerator, isgeneratorfunction
from math import isfinite
from numbers import Real
from types import SimpleNamespace
from typing import Any, Final, TypeAlias

from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.node import RUNNING, SUCCESS, ActionArgs, Node
from islandgp.bt.core.parameters import bound, referenced
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.errors import DomainError
from islandgp.plugin import defined_in, short_repr
from islandgp.time_limit import Overdue

Leaf: TypeAlias = Callable[..., int] | Callable[..., Generator[None, None, bool]]


def arguments_of(args: ActionArgs, vocabulary: Vocabulary) -> dict[str, Any]:
    """The keyword arguments of a leaf's function; of an undeclared action, those in the tree."""
    if args.name not in vocabulary.actions:
        return dict(args.values)
    return bound(args, vocabulary.action(args.name).arguments)


class LeafRunner:
    """Ticks one leaf of a tree: the function of its action, with its own generator."""

    def __init__(
        self,
        args: ActionArgs,
        leaf: Leaf,
        vocabulary: Vocabulary,
        board: MutableSequence[float],
        places: Mapping[str, int],
        log: Any = None,
    ) -> None:
        """Binds the arguments.

        Args:
            args: of the leaf; `"{place}"` as a value is the present value of the key `place`.
            leaf: the function of its action.
            vocabulary: declares its arguments and the keys that it sets.
            board: a value per key; keys that the leaf returns are written to it.
            places: the index of each key on the board.
            log: its attribute `action` is the name of the action while its code runs, else "".
        """
        self._log = SimpleNamespace() if log is None else log
        self.running = False  # also while its function is called and after it raised
        self._name, self._leaf, self._vocabulary = args.name, leaf, vocabulary
        self._board, self._places = board, places
        self._asks = vocabulary.action(args.name).condition
        self._generates = isgeneratorfunction(leaf) or isgeneratorfunction(type(leaf).__call__)
        self._generator: Any = None
        arguments = arguments_of(args, vocabulary)
        references = {name: referenced(value) for name, value in arguments.items()}
        keys = {name: key for name, key in references.items() if key in places}

        def call() -> Any:
            return leaf(**arguments, **{name: self._value(key) for name, key in keys.items()})

        arguments = {name: value for name, value in arguments.items() if name not in keys}
        self._call = call if keys else partial(leaf, **arguments) if arguments else leaf

    def __call__(self, fresh: bool) -> int:
        """The status of the leaf; `fresh` is True at its start.

        Raises:
            DomainError: the result is no status, or has a key that the action cannot set.
        """
        self.running = True
        self._log.action = self._name
        try:
            result = self._next(fresh) if self._generates else self._call()
        except Overdue as late:
            late.action = late.action or self._name
            raise
        self._log.action = ""
        if result is True:  # fast path
            self.running = False
            return SUCCESS
        if not isinstance(result, int) and isinstance(result, Mapping):
            self._write(result)
            result = True
        status = status_of(result, self._name, self._leaf, condition=self._asks)
        self.running = status == RUNNING
        return status

    def stop(self) -> None:
        """Closes the generator and calls the function's own `stop`, if the leaf runs."""
        if not self.running:
            return
        self.running = False
        self._log.action = self._name
        generator, self._generator = self._generator, None
        if generator is not None:
            generator.close()
        if callable(stop := getattr(self._leaf, "stop", None)):
            stop()
        self._log.action = ""

    def _next(self, fresh: bool) -> Any:
        """Advance to the next `yield`; return RUNNING, or the generator's result at its end."""
        if fresh or self._generator is None:
            self._generator = self._call()
        try:
            value = next(self._generator)
        except StopIteration as end:
            self._generator = None
            return end.value
        if value is not None and value != RUNNING:
            raise DomainError(
                f"Expected `yield` without a value, found {short_repr(value)}; write"
                f" `return {short_repr(value)}` to end the action{defined_in(self._leaf)}."
            )
        return RUNNING

    def _value(self, key: str) -> object:
        """The present value of a key, as an argument."""
        number = self._board[self._places[key]]
        return self._vocabulary.value(key, number) if key in self._vocabulary.keys else number

    def _write(self, result: Mapping[Any, Any]) -> None:
        """Writes the keys that the function returns."""
        sets = self._vocabulary.action(self._name).sets
        for key, value in result.items():
            if key not in sets:
                raise DomainError(
                    f"Expected results of {self._name} among its `sets`"
                    f" ({', '.join(sets) or 'none'}), found {key!r}."
                )
            subject = f"the result {key} of {self._name}"
            number = number_of(value, self._vocabulary.keys[key], subject)
            if key in self._places:
                self._board[self._places[key]] = number


def compile_leaves(
    tree: Node,
    leaves: Mapping[str, Leaf],
    vocabulary: Vocabulary,
    board: MutableSequence[float],
    places: Mapping[str, int],
    log: Any = None,
    **options: Any,
) -> tuple[Callable[[], int], list[LeafRunner]]:
    """The tick of a tree with functions as its leaves, and the runners that it can leave running.

    Args:
        tree: with actions of `leaves`.
        leaves: the function of each action.
        vocabulary: as of `LeafRunner`, like `board`, `places` and `log`.
        options: of `compile_tree`.
    """
    runners: list[LeafRunner] = []

    def runner_of(args: ActionArgs) -> LeafRunner:
        runners.append(LeafRunner(args, leaves[args.name], vocabulary, board, places, log))
        return runners[-1]

    return compile_tree(tree, runner_of, board, places, **options), runners


def number_of(value: object, key: Key | None, subject: str, source: object = None) -> float:
    """The value of a key as a number.

    Args:
        value: a number, True, False, or one of the key's words.
        key: the declared one; None: any number fits.
        subject: what it is, for a message.
        source: the user's function that returned it, for a message.

    Raises:
        DomainError: the key cannot have this value.
    """
    words = () if key is None else key.words
    number: Any = value if key is None else key.indexed(value)
    if (is_number(number) or is_flag(number)) and (not words or number in range(len(words))):
        return float(number)
    expected = "a finite number, True or False" if key is None or not words else key.kind
    raise DomainError(
        f"Expected {expected} as {subject}, found {short_repr(value)}{defined_in(source)}."
    )


def status_of(result: object, name: str, leaf: object, *, condition: bool = False) -> int:
    """The status for the value returned by a leaf of an action or a condition.

    Raises:
        DomainError: the value is not a status, or a condition is RUNNING.
    """
    if isinstance(result, int) and 0 <= result <= RUNNING - condition:
        return int(result)
    if is_flag(result):
        return int(bool(result))
    ends, kind = ("True or False", "condition") if condition else _ANY_END
    raise DomainError(
        f"Expected {ends} from the {kind} {name}, found {short_repr(result)}{_hint(result)}"
        f"{defined_in(leaf)}."
    )


_ANY_END: Final = ("True, False or RUNNING", "action")


def is_number(value: object) -> bool:
    """True for a finite number in the range of a float; False for texts and arrays."""
    try:
        if isinstance(value, float | int):  # fast path
            return isfinite(value)
        return isinstance(value, Real) and isfinite(value)
    except OverflowError:
        return False


def is_flag(value: object) -> bool:
    """True for a NumPy bool, which is not a `numbers.Number`."""
    return type(value).__module__ == "numpy" and type(value).__name__ in ("bool", "bool_")


def _hint(result: object) -> str:
    if isgenerator(result):
        return "; write `return (yield from ...)` to run a generator of another method"
    if iscoroutine(result):
        result.close()
        return "; write `def` in place of `async def`"
    return "; return one in each branch" if result is None else ""
