"""The search interface: ask, evaluate, tell.

A search decides which trees are evaluated next. Searches are stateless: `ask` and `tell` are
functions of a `SearchState`, which is stored in checkpoints, and of named random streams. So
records depend neither on the number of workers nor on whether a run was resumed.

    state = search.start()
    while True:
        population = search.ask(state, streams)
        evaluated = ...                              # one Evaluated for each Individual
        state = search.tell(state, evaluated, Advice(rate=0))
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Protocol

from pydantic import BaseModel

from islandgp.bt.core.node import Node
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual
from islandgp.seeding import Streams


@dataclass(frozen=True, slots=True)
class SearchState:
    """State of a search between generations."""

    generation: int  # the next one to be evaluated, >= 0
    memory: Any = None  # an instance of the search's `Memory`; None before generation 0
    advice: Advice | None = None  # of the supervisor for this generation; None for generation 0


@dataclass(frozen=True, slots=True)
class SearchContext:
    """Arguments of a search's `make` that come from the run."""

    plan: Plan
    library: Callable[[], Mapping[str, Node]]
    """Loads the library: trees by name, {} for none. May raise ConfigError or TreeError."""


SEARCHES: Final = ("make", "start", "ask", "tell")
"""Methods that a configured search must have, besides the class `Settings`."""


USES: Final = frozenset({"rate", "tree", "edits"})
"""Parts of a supervisor's guidance that a search can use."""


class Search(Protocol):
    """Decides which trees are evaluated. `tests/contracts` checks every implementation.

    A search that can be configured has two more class attributes: `Settings`, a pydantic model,
    and `make(settings, context)`. `Settings` may have a method `faults(schema)`, which yields a
    line for each setting with a name that the domain does not declare, and a property `reads`: the
    keys of the groups `gp` and `library` that the search reads besides RUN_READS, as in
    `("gp.trees",)`. The plan and the library have nothing else. A third class attribute
    `Allocation` is a pydantic model of the keys of the group `allocation`: how the slots of a
    generation are filled. The plan has an instance. A search that learns from more than outcomes
    has an `observer`: it is called with the tree and the vocabulary of each episode and returns its
    `islandgp.evaluation.base.EpisodeObserver`, whose result is in `Outcome.observed`. A method
    `findings(memory)` returns sentences on what it has found out besides trees, for reports.
    """

    Memory: ClassVar[Any]
    """The type of `SearchState.memory`: a frozen dataclass of plain values and trees."""
    uses: ClassVar[frozenset[str]]
    """The parts of a supervisor's guidance that it uses: a subset of USES."""

    def start(self) -> SearchState:
        """Returns the state before generation 0."""
        ...

    def ask(self, state: SearchState, streams: Streams) -> Iterable[Individual]:
        """Generates the individuals of one generation.

        If it yields them one by one, each is evaluated while the search makes the next one.

        Args:
            state: as returned by `start` or the last `tell`.
            streams: the run's random streams.

        Returns:
            The individuals of generation `state.generation`: `gp.population` of them, or at
            least one if the search has fewer candidates left. Each tree is within the run's
            limits, and each id is "<generation>.<slot>".
        """
        ...

    def tell(
        self, state: SearchState, evaluated: Sequence[Evaluated], advice: Advice
    ) -> SearchState:
        """Updates the search with the outcomes of a generation.

        Args:
            state: the one that was passed to `ask`.
            evaluated: the individuals returned by `ask` with their outcomes, in the same order.
            advice: of the supervisor, for the next generation; the new state has it.

        Returns:
            The state of the next generation, `state.generation + 1`.
        """
        ...


class NoSettings(BaseModel, frozen=True, extra="forbid"):
    """Settings of a search that has none."""
