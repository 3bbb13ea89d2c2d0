"""Lines 7 to 12 of Algorithm 1: what is done with a supervisor's answer."""

from __future__ import annotations

from islandgp.bt.language import to_text
from islandgp.bt.limits import within
from islandgp.bt.node import Node
from islandgp.evolution.plan import Plan
from islandgp.evolution.record import GuidanceRecord
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance


def decide(
    plan: Plan, state: PopulationState, answer: Guidance | None, rate: float
) -> tuple[GuidanceRecord, Node | None]:
    """The answer with what is done with it, and the tree that goes into the population, if any.

    `rate` is the mutation rate in force, and an `answer` of None is not due yet (`lag`).
    """
    given = answer or Guidance(None, None, "none", reasoning="no answer is due yet")
    wanted = given.mutation_rate if plan.switches.adapt_mutation else None
    # An emergency does not outlast its crisis where nobody adapts the rate.
    held = rate if plan.switches.adapt_mutation else plan.gp.mutation_rate
    refused = ""
    if given.tree is not None:
        if not plan.switches.inject:
            refused = "injection is switched off"
        elif not within(given.tree, plan.gp.limits):
            refused = "the tree breaks the limits"
    tree = None if refused else given.tree
    record = GuidanceRecord(
        asked_at=None if answer is None else state.now.generation - plan.switches.lag,
        source=given.source,
        phase=given.phase,
        pattern=given.pattern,
        target=given.target,
        intervention=given.intervention,
        wanted_rate=given.mutation_rate,
        crisis=state.crisis,
        applied_rate=plan.gp.crisis.rate(held if wanted is None else wanted, state.crisis),
        tree=None if given.tree is None else to_text(given.tree),
        injected=tree is not None,
        refused=refused,
        risk=given.risk,
        reasoning=given.reasoning,
        rationale=given.rationale,
        notes=given.notes,
    )
    return record, tree
