"""Calls of a search by the evolution loop, with checks of what it returns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from islandgp.bt.core.node import Node, actions_in, keys_in, size_and_depth
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import RunError
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual
from islandgp.gp.record import RunState
from islandgp.plain import from_json, to_json
from islandgp.plugin import path_of, plugin_errors
from islandgp.search.base import Search, SearchState
from islandgp.seeding import Streams


def asked_of(
    search: Search, state: SearchState, streams: Streams, plan: Plan
) -> Iterator[Individual]:
    """Yields the individuals of a generation, each as soon as the search has made it.

    Raises:
        PartError: an individual cannot be evaluated, or there are too many or none.
    """
    slot = -1
    with plugin_errors(path_of(type(search))):
        for slot, individual in enumerate(search.ask(state, streams)):
            if slot == plan.gp.population:
                raise ValueError(f"{_expected(plan)} more")
            _must_be_individual(individual, f"{state.generation}.{slot}", plan)
            yield individual
        if slot < 0:
            raise ValueError(f"{_expected(plan)} none")


def _expected(plan: Plan) -> str:
    return f"expected ask to return 1 to gp.population={plan.gp.population} individuals, found"


def _must_be_individual(value: object, name: str, plan: Plan) -> None:
    """Raises TypeError or ValueError unless it is an individual within the run's limits."""
    if not isinstance(value, Individual):
        raise TypeError(f"expected ask to return individuals, found {type(value).__name__}")
    tree = value.tree
    if not isinstance(tree, Node):
        raise TypeError(f"expected a tree (Node) in {name}, found {type(tree).__name__}")
    if value.id != name:
        raise ValueError(f"expected the id {name!r}, GENERATION.SLOT, found {value.id!r}")
    nodes, levels = size_and_depth(tree)
    if nodes > plan.gp.max_nodes or levels > plan.gp.max_depth:
        raise ValueError(
            f"expected at most gp.max_nodes={plan.gp.max_nodes} nodes and"
            f" gp.max_depth={plan.gp.max_depth} levels in {name},"
            f" found {nodes} and {levels}"
        )
    words, actions, keys = plan.vocabulary, actions_in(tree), {*keys_in(tree)}
    for used, declared in ((actions, words.actions), (keys, words.keys)):
        if strange := sorted(used - declared.keys()):
            raise ValueError(
                f"expected actions and keys of the domain in {name}, found {strange[0]!r}"
            )


def updated_memory(
    search: Search, state: SearchState, population: Sequence[Evaluated], advice: Advice, plan: Plan
) -> Any:
    """The memory that `tell` returns. Raises PartError unless it returns the next state."""
    path = path_of(type(search))
    with plugin_errors(path):
        new = search.tell(state, population, advice)
        if not isinstance(new, SearchState) or new.generation != state.generation + 1:
            raise ValueError(
                f"expected tell to return SearchState({state.generation + 1}, ...), found {new!r}"
            )
        if not (path.startswith("islandgp.") or new.memory is None):
            restored = from_json(search.Memory, to_json(new.memory), plan.vocabulary)
            if state.generation == 0 and restored != new.memory:
                raise ValueError("expected a Memory that is the same after a checkpoint")
    return new.memory


def restored(state: RunState, search: Search, vocabulary: Vocabulary) -> RunState:
    """A checkpoint's state, with its trees in the vocabulary and its search's memory as `Memory`.

    Raises:
        RunError: the memory is of another search.
    """
    state = replace(state, advice=from_json(Advice, to_json(state.advice), vocabulary))
    if state.memory is None or isinstance(state.memory, search.Memory):
        return state
    try:
        return replace(state, memory=from_json(search.Memory, state.memory, vocabulary))
    except ValueError as error:
        raise RunError(
            f"Expected a checkpoint of the search {type(search).__name__}, found other contents"
            f" ({error}); use resume=never for a new folder beside this one."
        ) from error


def findings(search: Search, state: RunState | None, vocabulary: Vocabulary) -> list[str]:
    """Sentences on what a search has found out, e.g. about actions; [] if it learns nothing."""
    found: Callable[[Any], list[str]] | None = getattr(search, "findings", None)
    if found is None or state is None or state.memory is None:
        return []
    return found(restored(state, search, vocabulary).memory)
