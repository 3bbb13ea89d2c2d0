"""The offline expert: Tables 6, 7 and 8 as a policy. Deterministic, free, no language model.

Like the paper's prompt it goes by quality first: whether Complete and Excellent
Robots exist says more than raw fitness, which single-task specialists inflate.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from pydantic import BaseModel, Field, model_validator

from islandgp.bt.node import Node, depth, size
from islandgp.errors import ConfigError
from islandgp.scoring.classify import Tier
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, Pattern, Phase, Setup, Target


class Size(BaseModel, frozen=True, extra="forbid"):
    """The largest that a tree may be."""

    depth: int = Field(ge=1)
    nodes: int = Field(ge=1)

    def holds(self, tree: Node) -> bool:
        """Whether `tree` is no larger."""
        return depth(tree) <= self.depth and size(tree) <= self.nodes


class ExpertSettings(BaseModel, frozen=True, extra="forbid"):
    """Table 8's ranges and what the conditions of Tables 6-8 mean in numbers."""

    rates: dict[Phase, tuple[float, float]]  # Table 8
    several: int = Field(ge=1)  # quality individuals that are "multiple"
    plateau: int = Field(ge=1)  # generations without a better best that are "stagnating"
    strong: float = Field(gt=0)  # rise of the best over the window, as a share, that is "strong"
    rare: float = Field(ge=0, le=1)  # share of the population below which a behaviour is missing
    collapse: float = Field(ge=0, le=1)  # Eq. (3) below which diversity has collapsed
    compact: Size  # section 2.4.6: trees until a Complete Robot has existed
    trees: dict[Target, tuple[str, ...]]  # Table 7: example trees by target; one of them is drawn

    @model_validator(mode="after")
    def _complete(self) -> ExpertSettings:
        if missing := [p.value for p in Phase if p not in self.rates]:
            raise ValueError(
                f"rates: expected a range for each phase, missing {', '.join(missing)}"
            )
        if missing := [t.value for t in Target if not self.trees.get(t)]:
            raise ValueError(
                f"trees: expected a tree for each target, missing {', '.join(missing)}"
            )
        for phase, (low, high) in self.rates.items():
            if not 0 <= low <= high <= 1:
                raise ValueError(f"rates.{phase}: expected 0 <= low <= high <= 1")
        return self


def quality(state: PopulationState) -> int:
    """Complete Robots now alive; Excellent ones are among them."""
    return state.now.tiers[Tier.COMPLETE]


def calm(state: PopulationState, how: ExpertSettings) -> float:
    """How low in its range the rate may be, in [0, 1]: the more there is to lose, the lower."""
    return min(1.0, max(state.now.working, quality(state) / (2 * how.several)))


def classify_phase(state: PopulationState, how: ExpertSettings) -> Phase:
    """Table 8: the phase that the state is in."""
    good, stuck = quality(state), state.stagnant_generations >= how.plateau
    if not good:
        if state.ever_complete:
            collapsed = state.now.diversity < how.collapse
            return Phase.CRISIS_INTERVENTION if collapsed else Phase.AGGRESSIVE_EXPLORATION
        return Phase.EARLY_EXPLORATION
    if state.now.diversity < how.collapse:
        return Phase.AGGRESSIVE_EXPLORATION
    if good >= how.several:
        if rising(state, how):
            return Phase.EXPLOITATION
        return Phase.BALANCED_OPTIMIZATION if stuck else Phase.REFINEMENT
    if stuck or (state.diversity_trend < 0 and state.diversity_warning):
        return Phase.BALANCED_EXPLORATION
    return Phase.REFINEMENT


def rising(state: PopulationState, how: ExpertSettings) -> bool:
    """Whether the best fitness rose strongly over the window."""
    return state.best_rise > how.strong


def classify_pattern(state: PopulationState, how: ExpertSettings) -> Pattern:
    """Table 6: the label of the evolutionary pattern."""
    if state.crisis == "stagnation":
        return Pattern.STAGNATION
    if state.now.diversity < how.collapse:
        return Pattern.PREMATURE_CONVERGENCE
    if not state.ever_complete:
        return Pattern.EXPLORATION_PHASE
    return Pattern.RAPID_IMPROVEMENT if rising(state, how) else Pattern.HEALTHY_PROGRESS


def choose_target(state: PopulationState, how: ExpertSettings) -> Target:
    """Table 7: what the next tree is for.

    What nobody does comes first, then a crisis, then what few do. Until a Complete
    Robot has existed the rarest behaviour always is too rare: putting behaviours
    together is left to evolution.
    """
    order = ("charging", "clearing", "humanoid", "pickup")  # hardest to find first
    rarest = min(order, key=lambda name: state.now.doing[name])
    if not state.now.doing[rarest]:
        return Target(rarest)
    if state.crisis:
        return Target.EXPLORATION
    if not state.ever_complete or state.now.doing[rarest] < how.rare * state.population:
        return Target(rarest)
    return Target.RARE if state.now.diversity < how.collapse else Target.INTEGRATION


EARLY: Final = (
    Target.PICKUP,
    Target.HUMANOID,
    Target.CHARGING,
    Target.CLEARING,
    Target.EXPLORATION,
)
"""Targets that there are before the first Complete Robot."""


class Expert:
    """The policy over a library of example trees."""

    name = "expert"
    Settings = ExpertSettings

    @classmethod
    def make(cls, settings: ExpertSettings, setup: Setup) -> Expert:
        """See `Supervisor`."""
        names = {name for trees in settings.trees.values() for name in trees}
        expert = cls(settings, {name: setup.example(name) for name in sorted(names)})
        for target in EARLY:
            if not expert.trees(target, compact=True):
                raise ConfigError(
                    f"supervisor.policy.trees.{target}: expected a tree within"
                    f" supervisor.policy.compact, found only larger ones; add one, or allow more."
                )
        return expert

    def __init__(self, settings: ExpertSettings, library: Mapping[str, Node]) -> None:
        """`library` holds the trees that `settings.trees` names."""
        self.settings = settings
        self.library = library

    def trees(self, target: Target, *, compact: bool) -> list[str]:
        """The trees for a target; with `compact` only those that are."""
        names = self.settings.trees[target]
        return [n for n in names if not compact or self.settings.compact.holds(self.library[n])]

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """A rate inside the phase's range, and a tree for what the population lacks most."""
        how = self.settings
        phase, pattern = classify_phase(state, how), classify_pattern(state, how)
        target = choose_target(state, how)
        low, high = how.rates[phase]
        trees = self.trees(target, compact=not state.ever_complete)
        name = trees[rng.integers(len(trees))]
        return Guidance(
            mutation_rate=high - (high - low) * calm(state, how),
            tree=self.library[name],
            source=self.name,
            phase=phase,
            pattern=pattern,
            target=target,
            intervention=phase in (Phase.CRISIS_INTERVENTION, Phase.AGGRESSIVE_EXPLORATION),
            risk="disruption of Complete Robots" if quality(state) else "premature convergence",
            reasoning=f"{quality(state)} Complete Robots, {state.stagnant_generations} generations"
            f" without a better best, diversity {state.now.diversity:.2f}",
            rationale=f"{target}: tree {name}",
        )
