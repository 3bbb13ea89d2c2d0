"""Asks supervisors, checks and records their guidance, and makes the search's advice from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Final

import numpy as np
from pydantic import FiniteFloat, Strict, TypeAdapter, ValidationError

from islandgp.bt.analysis.conflicts import conflict_in_words
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, within
from islandgp.bt.core.parameters import first_fault
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import SupervisionError, TreeError
from islandgp.gp.archive import Elite
from islandgp.gp.edits import Edit, EditRecord, as_record, edited
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Origin, Proposal
from islandgp.gp.record import GuidanceRecord, IndividualRecord
from islandgp.plugin import path_of, plugin_errors
from islandgp.scoring.state import PopulationState
from islandgp.search.base import Search
from islandgp.seeding import Stream, stream
from islandgp.supervision.base import GenerationView, Guidance, Supervisor, SupervisorLifecycle

MAX_EDITS: Final = 100  # edits of a guidance that are checked; further ones are left out
RECORDED: Final = (
    *("source", "phase", "pattern", "target", "intervention"),
    *("risk", "reasoning", "rationale", "notes"),
)
"""Fields of the guidance that its record has too."""

GUIDANCE: Final = TypeAdapter(Guidance)
COSTS: Final = TypeAdapter(dict[str, Annotated[FiniteFloat, Strict()]])
Nameable = Mapping[str, str]  # texts, by id, of the trees that an edit may refer to


def ask(
    supervisor: Supervisor,
    state: PopulationState,
    rng: np.random.Generator,
    vocabulary: Vocabulary | None = None,
) -> Guidance:
    """Calls a supervisor's `advise` and checks the guidance.

    Args:
        supervisor: the supervisor.
        state: of the population.
        rng: for the supervisor's draws; it is consumed.
        vocabulary: of the domain; the tree must be parsable with it. None: any names.

    Returns:
        The guidance, with its tree in the vocabulary, and NumPy's numbers as Python's.

    Raises:
        SupervisionError: the guidance is of the wrong type, or a field of it has a wrong value.
        PartError: a supervisor of the user failed.
    """
    path = path_of(type(supervisor))
    with plugin_errors(path):
        answer = supervisor.advise(state, rng)
    try:
        guidance = GUIDANCE.validate_python(answer)
    except ValidationError as error:
        raise _wrong(f"{path}.advise", "a Guidance", error) from None
    target, tree = guidance.target, guidance.tree
    if target is not None and target not in state.targets:
        expected = f"a Guidance whose target is None or one of {', '.join(state.targets)}"
        raise _wrong(f"{path}.advise", expected, repr(target))
    if tree is not None and vocabulary is not None:
        try:
            guidance = replace(guidance, tree=parse(to_text(tree), vocabulary))
        except TreeError:
            expected = f"a Guidance whose tree is of the domain {vocabulary.domain}"
            raise _wrong(f"{path}.advise", expected, repr(to_text(tree)[:60])) from None
    return guidance


def _wrong(method: str, expected: str, found: str | ValidationError) -> SupervisionError:
    """The error for a supervisor's result; of several wrong values it names the first."""
    if isinstance(found, ValidationError):
        at, reason, value = first_fault(found)
        text = repr(value)
        quoted = text if len(text) <= 60 else text[:60] + "..."
        found = f"{'.'.join(at)}={quoted}: {reason}" if at else quoted
    return SupervisionError(f"Expected {method} to return {expected}, found {found}; correct it.")


@dataclass
class SupervisorCalls:
    """Calls the methods of a supervisor that it has; its exceptions become errors that name it."""

    supervisor: Supervisor
    seed: int  # of the run, for the supervisor's random stream
    vocabulary: Vocabulary | None = None  # of the domain, as for `ask`

    def _call(self, method: str, *arguments: object) -> Any:
        """The result of a method that not every supervisor has; None without it."""
        with plugin_errors(path_of(type(self.supervisor))):
            return getattr(self.supervisor, method, lambda *_: None)(*arguments)

    def recall(self, view: GenerationView) -> None:
        """Passes a generation, as recorded, to the supervisor."""
        self._call("on_generation", view)

    def ask(self, state: PopulationState, view: GenerationView) -> Guidance:
        """The guidance for a generation's state; `view` is the generation as recorded."""
        self.recall(view)
        rng = stream(self.seed, Stream.SUPERVISION, generation=state.now.generation)
        return ask(self.supervisor, state, rng, self.vocabulary)

    def spent(self) -> dict[str, float]:
        """The costs of supervision so far, by name; empty for a supervisor without any.

        Raises:
            SupervisionError: they are not finite numbers by name.
        """
        if not isinstance(self.supervisor, SupervisorLifecycle):
            return {}
        try:
            return COSTS.validate_python(self._call("spent"))
        except ValidationError as error:
            method = f"{path_of(type(self.supervisor))}.spent"
            raise _wrong(method, "finite numbers by name", error) from None

    def close(self) -> None:
        """Closes the supervisor."""
        self._call("close")


def nameable(individuals: Sequence[IndividualRecord], archive: Sequence[Elite]) -> dict[str, str]:
    """The trees that edits may refer to: those of the archive and of a generation."""
    return {**{e.id: e.tree for e in archive}, **{i.id: i.tree for i in individuals}}


def decide(
    plan: Plan,
    search: Search,
    state: PopulationState,
    guidance: Guidance,
    rate: float,
    names: Nameable,
) -> tuple[GuidanceRecord, Advice]:
    """Makes the record of a supervisor's answer and the advice for the search.

    The record has the reason if a part of the answer is refused. Edits are taken in order until
    all slots are.

    Args:
        plan: of the run.
        search: its `uses` are the parts of the guidance that it can use.
        state: of the population.
        guidance: the supervisor's answer.
        rate: the mutation rate in force, in [0, 1].
        names: the trees that edits may name.
    """
    switches, refused = plan.switches, []
    # If the rate is not adapted, an emergency rate ends with its crisis.
    proposed = rate if switches.adapt_mutation else plan.gp.mutation_rate
    if switches.adapt_mutation and guidance.mutation_rate is not None:
        if "rate" in search.uses:
            proposed = guidance.mutation_rate
        else:
            refused.append("the search has no mutation rate")
    tree = guidance.tree
    if tree is not None and (reason := _why_refused(tree, plan, search)):
        refused.append(reason)
        tree = None
    applied = plan.gp.crisis.rate(proposed, state.crisis)
    edits, trees = list[EditRecord](), list[Proposal]()
    for edit in guidance.edits[:MAX_EDITS]:
        why = ""
        try:
            trees.append(_edited_tree(plan, search, edit, names, trees))
        except ValueError as error:
            why = str(error)
        edits.append(as_record(edit, why))
    record = GuidanceRecord(
        asked_at=state.now.generation,
        wanted_rate=guidance.mutation_rate,
        crisis=state.crisis,
        applied_rate=applied,
        tree=None if guidance.tree is None else to_text(guidance.tree),
        injected=tree is not None,
        refused="; ".join(refused),
        edits=tuple(edits),
        **{name: getattr(guidance, name) for name in RECORDED},
    )
    return record, Advice(applied, tree, tuple(trees))


def _why_refused(tree: Node, plan: Plan, search: Search) -> str:
    """The reason why a supervisor's tree is not injected, or ""."""
    if not plan.switches.inject:
        return "injection is switched off"
    if "tree" not in search.uses:
        return "the search takes no trees"
    if not within(tree, plan.gp.limits):
        return "the tree breaks the limits"
    return conflict_in_words(tree, plan.vocabulary)


def _edited_tree(
    plan: Plan, search: Search, edit: Edit, names: Nameable, before: Sequence[Proposal]
) -> Proposal:
    """The tree of an edit, after those `before`. Raises ValueError with the reason to refuse it."""
    slots = plan.switches.edits
    if not slots:
        raise ValueError("edits are switched off (supervisor.edits=0)")
    if "edits" not in search.uses:
        raise ValueError("the search takes no edits")
    if len(before) == slots:
        raise ValueError(f"all {slots} slots (supervisor.edits) are taken")
    parents = tuple(dict.fromkeys(name for name in (edit.of, edit.donor) if name))
    named = {name: parse(names[name], plan.vocabulary) for name in parents if name in names}
    tree = edited(edit, named, plan.vocabulary, plan.gp.limits)
    if tree in [other.tree for other in before]:
        raise ValueError("an edit before it makes the same tree")
    return Proposal(tree, Origin.EDITED, parents, f"edit:{edit.kind}")
