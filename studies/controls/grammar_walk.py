"""The control "random grammar walks": valid trees without any judgement.

Each tree is a random walk over the grammar that also constrains a language model's answers. A
model beats it only by what it knows, not by the grammar.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, Field

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import size
from islandgp.bt.export.grammar import tree_grammar
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, RunContext
from islandgp_judge.grammar_walk import random_text


class GrammarWalkSettings(BaseModel, frozen=True, extra="forbid"):
    """The constant rate, and the size of the trees."""

    rate: float = Field(ge=0, le=1)  # of mutation, in every generation
    depth: int = Field(default=4, ge=1, le=20)  # levels
    children: int = Field(default=4, ge=1, le=20)  # of a composite
    nodes: int = Field(default=22, ge=1)  # larger trees are drawn again


class GrammarWalk:
    """Advises a constant rate, and a random text of the domain's grammar as the tree."""

    name = "grammar_walk"
    Settings = GrammarWalkSettings

    @classmethod
    def make(cls, settings: GrammarWalkSettings, context: RunContext) -> GrammarWalk:
        """See `Supervisor`."""
        return cls(settings, context)

    def __init__(self, settings: GrammarWalkSettings, context: RunContext) -> None:
        self.settings, self.vocabulary = settings, context.schema.vocabulary
        self.grammar = tree_grammar(self.vocabulary, settings.depth, children=settings.children)

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        while True:
            tree = parse(random_text(self.grammar, rng), self.vocabulary)
            if 1 < size(tree) <= self.settings.nodes:
                break
        target = state.targets[rng.integers(len(state.targets))]
        return Guidance(
            self.settings.rate, tree, self.name, target=target, rationale="a random walk"
        )
