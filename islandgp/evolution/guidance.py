"""Checks a supervisor's guidance, records it, and makes the search's advice from it.

The record has the reason if the tree or an edit is rejected. An edited tree is compared with the
original tree in the same worlds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, within
from islandgp.domain import Outcome, total
from islandgp.evaluation.base import Evaluator, Job
from islandgp.gp.archive import Elite
from islandgp.gp.edits import Edit, EditRecord, EditTrial, as_record, edited
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, EditedTree, Evaluated, Origin
from islandgp.gp.record import GuidanceRecord, IndividualRecord
from islandgp.gp.variation import mutate
from islandgp.scoring.state import PopulationState
from islandgp.search.base import Search
from islandgp.seeding import Stream, Streams
from islandgp.supervision.base import Guidance

MOST_EDITS: Final = 100  # edits of a guidance that are checked; further ones are left out

Nameable = Mapping[str, str]
"""Texts, by id, of the trees that an edit may refer to."""


def nameable(
    generations: Iterable[Sequence[IndividualRecord]], archive: Sequence[Elite]
) -> dict[str, str]:
    """The trees that edits may refer to: those of the archive and of these generations."""
    return {
        **{e.id: e.tree for e in archive},
        **{i.id: i.tree for individuals in generations for i in individuals},
    }


def decide(
    plan: Plan,
    search: Search,
    state: PopulationState,
    answer: Guidance | None,
    rate: float,
    *,
    names: Nameable | None = None,
    streams: Streams | None = None,
) -> tuple[GuidanceRecord, Advice]:
    """Makes the record of a supervisor's answer and the advice for the search.

    Args:
        plan: of the run.
        search: its `uses` are the parts of the guidance that it can use.
        state: of the population.
        answer: None if none is due yet (`supervisor.lag`).
        rate: the mutation rate in force, in [0, 1].
        names: the trees that edits may name; default: none.
        streams: of the run; for `supervisor.mutate_advice` alone.
    """
    guidance = answer or Guidance(None, None, "none", reasoning="no answer is due yet")
    wanted = guidance.mutation_rate if plan.switches.adapt_mutation else None
    # If the rate is not adapted, an emergency rate ends with its crisis.
    default_rate = rate if plan.switches.adapt_mutation else plan.gp.mutation_rate
    refused = []
    if wanted is not None and "rate" not in search.uses:
        wanted = None
        refused.append("the search has no mutation rate")
    tree = guidance.tree
    if tree is not None:
        why = _why_refused(tree, plan, search)
        refused += [why] if why else []
        tree = None if why else tree
    applied = plan.gp.crisis.rate(default_rate if wanted is None else wanted, state.crisis)
    edits, trees = decide_edits(plan, search, guidance.edits[:MOST_EDITS], names or {})
    if plan.switches.mutate_advice and streams is not None:
        generation = state.now.generation + 1
        trees = _mutated(plan, trees, streams, generation, applied)
    record = GuidanceRecord(
        asked_at=None if answer is None else state.now.generation - plan.switches.lag,
        source=guidance.source,
        phase=guidance.phase,
        pattern=guidance.pattern,
        target=guidance.target,
        intervention=guidance.intervention,
        wanted_rate=guidance.mutation_rate,
        crisis=state.crisis,
        applied_rate=applied,
        tree=None if guidance.tree is None else to_text(guidance.tree),
        injected=tree is not None,
        refused="; ".join(refused),
        risk=guidance.risk,
        reasoning=guidance.reasoning,
        rationale=guidance.rationale,
        notes=guidance.notes,
        edits=edits,
    )
    return record, Advice(applied, tree, trees)


def _why_refused(tree: Node, plan: Plan, search: Search) -> str:
    """The reason why a supervisor's tree is not injected, or ""."""
    if not plan.switches.inject:
        return "injection is switched off"
    if "tree" not in search.uses:
        return "the search takes no trees"
    return "" if within(tree, plan.gp.limits) else "the tree breaks the limits"


def decide_edits(
    plan: Plan, search: Search, edits: Sequence[Edit], names: Nameable
) -> tuple[tuple[EditRecord, ...], tuple[EditedTree, ...]]:
    """The records of a supervisor's edits, and the trees of those that are accepted.

    Edits are processed in order until all slots are taken.
    """
    records: list[EditRecord] = []
    trees: list[EditedTree] = []
    for edit in edits:
        tree, why = None, ""
        if not plan.switches.edits:
            why = "edits are switched off (supervisor.edits=0)"
        elif "edits" not in search.uses:
            why = "the search takes no edits"
        elif len(trees) == plan.switches.edits:
            why = f"all {plan.switches.edits} slots (supervisor.edits) are taken"
        else:
            wanted = {name: parse(names[name]) for name in (edit.of, edit.donor) if name in names}
            try:
                tree = edited(edit, wanted, plan.vocabulary, plan.gp.limits)
            except ValueError as error:
                why = str(error)
            else:
                if tree in [other.tree for other in trees]:
                    tree, why = None, "an edit before it makes the same tree"
        if tree is not None:
            parents = tuple(dict.fromkeys(name for name in (edit.of, edit.donor) if name))
            trees.append(EditedTree(tree, parents, f"edit:{edit.kind}"))
        records.append(as_record(edit, why))
    return tuple(records), tuple(trees)


def _mutated(
    plan: Plan, trees: Sequence[EditedTree], streams: Streams, generation: int, rate: float
) -> tuple[EditedTree, ...]:
    """The trees after mutation, each with probability `rate`."""
    mutants = []
    for slot, e in enumerate(trees):
        rng = streams(Stream.EDIT, generation=generation, slot=slot)
        tree, operator = mutate(rng, e.tree, rate=rate, space=plan.space, how=plan.gp.mutation)
        changes = f"{e.operator}+{operator}" if operator else e.operator
        mutants.append(EditedTree(tree, e.parents, changes))
    return tuple(mutants)


def compare_with_parents(
    plan: Plan,
    population: Sequence[Evaluated],
    texts: Sequence[str],
    worlds: Sequence[int],
    parents: Nameable,
    evaluator: Evaluator,
    *,
    stage: int,
) -> tuple[tuple[EditTrial, ...], int]:
    """Compares each edited tree with the original tree in the same worlds.

    A tree that is evaluated in these worlds anyway is not evaluated again.

    Args:
        plan: of the run.
        population: the generation, evaluated.
        texts: the canonical texts of its trees.
        worlds: of the generation.
        parents: texts of the original trees by id.
        evaluator: runs the episodes.
        stage: of the curriculum.

    Returns:
        The comparisons, and the number of additional episodes.
    """
    n, common = plan.gp.episodes, plan.gp.shared_seed
    known = {
        (text, 0 if common else slot): e.fitness
        for slot, (text, e) in enumerate(zip(texts, population, strict=True))
    }
    pairs = [
        (e, parents[e.individual.parents[0]], 0 if common else slot)
        for slot, e in enumerate(population)
        if e.individual.origin == Origin.EDITED and e.individual.parents[0] in parents
    ]
    missing = [
        key for key in dict.fromkeys((text, at) for _, text, at in pairs) if key not in known
    ]
    jobs = [Job(text, stage, worlds[at * n + k]) for text, at in missing for k in range(n)]
    outcomes = evaluator.evaluate(jobs) if jobs else []
    for k, key in enumerate(missing):
        known[key] = _mean(outcomes[k * n : (k + 1) * n])
    trials = tuple(
        EditTrial(e.individual.id, e.individual.parents[0], e.fitness, known[text, at])
        for e, text, at in pairs
    )
    return trials, len(jobs)


def _mean(outcomes: Sequence[Outcome]) -> float:
    return float(total(o.fitness for o in outcomes) / len(outcomes))
