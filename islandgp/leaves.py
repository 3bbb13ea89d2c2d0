"""Leaf functions: the implementations of a tree's actions.

A leaf is a function of the action's arguments, passed by name. It is called once per tick while its
node runs, and returns True (success), False (failure) or RUNNING. It can also be a generator
function: each `yield` is a tick in which it is RUNNING, and it returns True or False at its end. If
it is aborted, the generator is closed, so its `finally` clauses run. In place of True it may return
a mapping: the values of keys that the action sets.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Mapping
from functools import partial
from inspect import iscoroutine, isgenerator, isgeneratorfunction
from math import isfinite
from numbers import Real
from typing import Any, Final, TypeAlias

from islandgp.bt.core.node import RUNNING
from islandgp.bt.core.parameters import referenced
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import DomainError
from islandgp.plugin import defined_in, short_repr

Leaf: TypeAlias = Callable[..., int] | Callable[..., Generator[None, None, bool]]


def steps(leaf: Leaf) -> Callable[[bool], Any]:
    """A leaf as a function of `fresh`, True at the start of its node; returns the leaf's result.

    Each call of `steps` returns a new function with its own generator.
    """
    if isgeneratorfunction(leaf) or isgeneratorfunction(type(leaf).__call__):
        return GeneratorSteps(leaf)
    return lambda _fresh: leaf()


def with_arguments(
    leaf: Leaf,
    arguments: Mapping[str, object],
    known: Collection[str],
    value_of: Callable[[str], object],
) -> Leaf:
    """A leaf that gets its arguments, each time that it is called.

    Args:
        leaf: the function of an action.
        arguments: as in the tree; `"{place}"` is the present value of the key `place`.
        known: the keys.
        value_of: the present value of a key.

    Returns:
        A function without arguments.
    """
    references = {name: referenced(value) for name, value in arguments.items()}
    keys = {name: key for name, key in references.items() if key in known}
    if not keys:
        return partial(leaf, **arguments) if arguments else leaf

    def current() -> dict[str, object]:
        return {**arguments, **{name: value_of(key) for name, key in keys.items()}}

    def generated() -> Generator[None, None, bool]:
        return (yield from leaf(**current()))  # type: ignore[misc, no-any-return] # a generator

    is_generator = isgeneratorfunction(leaf) or isgeneratorfunction(type(leaf).__call__)
    return generated if is_generator else lambda: leaf(**current())  # type: ignore[return-value]


class GeneratorSteps:
    """A leaf that is a generator function; it is restarted when its node starts."""

    __slots__ = ("_leaf", "_running")

    def __init__(self, leaf: Callable[[], Any]) -> None:
        self._leaf = leaf
        self._running: Generator[None, None, bool] | None = None

    def __call__(self, fresh: bool) -> Any:
        """Advance to the next `yield`; return RUNNING, or the generator's result at its end."""
        running = self._running
        if fresh or running is None:
            running = self._running = self._leaf()
        try:
            value = next(running)
        except StopIteration as end:
            self._running = None
            return end.value
        if value is not None and value != RUNNING:
            raise DomainError(
                f"Expected `yield` without a value, found {short_repr(value)}; write"
                f" `return {short_repr(value)}` to end the action{defined_in(self._leaf)}."
            )
        return RUNNING

    def stop(self) -> None:
        """Close a running generator. Raises RuntimeError if it yields again."""
        running, self._running = self._running, None
        if running is not None:
            running.close()


def results_of(
    result: object, name: str, vocabulary: Vocabulary
) -> tuple[dict[str, float], object]:
    """The values of keys in the result of an action, which succeeds if it returns a mapping.

    Args:
        result: of the action's function.
        name: of the action.
        vocabulary: declares the keys that the action sets.

    Returns:
        The values by key, and True; for another result no values, and the result.

    Raises:
        DomainError: the action does not declare one of the keys, or a key cannot have the value.
    """
    if not isinstance(result, Mapping):
        return {}, result
    sets = vocabulary.action(name).sets
    values: dict[str, float] = {}
    for key, value in result.items():
        if key not in sets:
            raise DomainError(
                f"Expected results of {name} among its `sets` ({', '.join(sets) or 'none'}), found"
                f" {key!r}."
            )
        declared = vocabulary.keys[key]
        number = declared.indexed(value)
        if not is_number(number) or (declared.words and number not in range(len(declared.words))):
            expected = declared.kind if declared.words else "a finite number, True or False"
            raise DomainError(
                f"Expected {expected} as the result {key} of {name}, found {short_repr(value)}."
            )
        values[key] = float(number)
    return values, True


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
