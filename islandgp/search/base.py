"""The interface between the driver of a run and its search: ask, evaluate, tell.

A search decides which trees are evaluated next. It holds no state of its own: `ask` and `tell`
are functions of a `SearchState`, which a checkpoint stores, and of named random streams. So a
resumed run, or another number of workers, gives the same records.

    state = search.start()
    while True:
        population = search.ask(state, streams)
        evaluated = ...                              # one Evaluated for each Individual
        state = search.tell(state, evaluated, Advice(rate=0.4))
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Protocol

from pydantic import BaseModel

from islandgp.bt.core.node import Node
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual
from islandgp.seeding import Streams


@dataclass(frozen=True, slots=True)
class SearchState:
    """What the next generation of a search depends on, besides configuration and seed."""

    generation: int  # the next to be evaluated, from 0
    memory: Any = None  # a value of the search's `Memory`; None before the first generation
    advice: Advice | None = None  # of the supervisor for this generation; None: none was given


@dataclass(frozen=True, slots=True)
class SearchContext:
    """What a run gives to its search when it is made."""

    plan: Plan
    library: Callable[[], Mapping[str, Node]]
    """Trees by name whose branches may be used; {} for none. May raise ConfigError, TreeError."""


SEARCHES: Final = ("make", "start", "ask", "tell")
"""Methods of a class that configuration can choose as a search, besides `Settings`."""


USES: Final = frozenset({"rate", "tree", "edits"})
"""What a search can take of a supervisor's guidance."""


class Search(Protocol):
    """Decides which trees are evaluated. `tests/contracts` checks what each search guarantees.

    A search that configuration can choose has two class attributes more: `Settings`, a pydantic
    model, and `make(settings, context)`. `Settings` may have a method `faults(schema)`, which
    yields a line for each name in them that the domain does not declare.
    """

    Memory: ClassVar[Any]
    """The type of `SearchState.memory`: a frozen dataclass of plain values and trees."""
    uses: ClassVar[frozenset[str]]
    """What it takes of a supervisor's guidance: some of USES."""

    def start(self) -> SearchState:
        """The state before generation 0."""
        ...

    def ask(self, state: SearchState, streams: Streams) -> tuple[Individual, ...]:
        """The individuals of generation `state.generation`.

        There are `gp.population` of them, or fewer where the search has no more to try, but at
        least one. Each keeps the run's limits, and its id is "<generation>.<slot>".
        """
        ...

    def tell(
        self, state: SearchState, evaluated: Sequence[Evaluated], advice: Advice
    ) -> SearchState:
        """The state of the next generation.

        Args:
            state: that `ask` was called with.
            evaluated: the individuals that it returned, in their order, with their outcomes.
            advice: of the supervisor, for the next generation; it belongs into the state.
        """
        ...


class NoSettings(BaseModel, frozen=True, extra="forbid"):
    """For a search without settings."""
