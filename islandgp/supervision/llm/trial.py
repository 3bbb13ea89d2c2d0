"""Candidates: several trees of one answer, of which the best for its target is injected.

Each is tried in one episode, all in the same world, in which no tree is trained, under the
factors of the generation that the tree will join.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from islandgp.bt.node import Node
from islandgp.domain import Outcome
from islandgp.scoring.classes import INTEGRATION, RARE, Classes
from islandgp.scoring.state import PopulationState
from islandgp.seeding import Stream, seed_of
from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.transcript import Played
from islandgp.supervision.llm.validation import Proposal


def try_out(
    proposal: Proposal, state: PopulationState, context: RunContext
) -> tuple[Proposal, Played, str]:
    """The candidate that does best for its target, its episodes, and a note for the record.

    Of equals it is the first, which would have been injected without a trial: its gain is the
    difference to that one.
    """
    trees: Sequence[Node] = (proposal.tree, *proposal.others)
    seed = seed_of(context.seed, Stream.TRIAL, generation=state.now.generation)
    domain = context.domain_in(state.now.generation + 1)
    outcomes = [domain.run_episode(tree, seed, state.multipliers) for tree in trees]
    worth = [_worth(o, proposal.target, state, context.classes) for o in outcomes]
    best = max(range(len(trees)), key=lambda i: worth[i])
    gain = outcomes[best].fitness - outcomes[0].fitness
    note = (
        f"number {best + 1} of {len(trees)} tried in world {seed}: {worth[best][0]:g} for"
        f" {proposal.target}, {worth[best][1]:,.0f} points; the first has {worth[0][0]:g} and"
        f" {worth[0][1]:,.0f}"
    )
    played = Played(state.now.generation, "trial", len(trees), gain)
    return replace(proposal, tree=trees[best], others=()), played, note


def _worth(
    o: Outcome, target: str, state: PopulationState, classes: Classes
) -> tuple[float, float]:
    """How much an outcome is worth for a target (Table 7), and its points between equals.

    For a behaviour it is the behaviour's counter, for `rare` that of the rarest, for
    `integration` how many behaviours it shows; for `exploration` points alone decide.
    """
    name = state.lacking[0] if target == RARE else target
    if name in classes.behaviours:
        return o.counters[classes.behaviours[name]], o.fitness
    return float(len(classes.shown(o.counters)) if target == INTEGRATION else 0), o.fitness
