"""The offline expert: Tables 6, 7 and 8 as rules, without a language model.

The tree is drawn from the run's random stream; all else follows from the state. Like the paper's
prompt, the rules consider quality first: the existence of Complete and Excellent Robots is a better
sign of progress than raw fitness, which single-task specialists inflate.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, Field

from islandgp.bt.core.node import Limits, Node, within
from islandgp.errors import ConfigError
from islandgp.scoring.classes import EXPLORATION, INTEGRATION, RARE, Classes
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, Pattern, Phase, PhaseRates, RunContext
from islandgp.supervision.library import Library
from islandgp.text import title


class Size(BaseModel, frozen=True, extra="forbid"):
    """Upper limits of a tree's size."""

    depth: int = Field(ge=1)  # most levels
    nodes: int = Field(ge=1)  # most nodes

    def admits(self, tree: Node) -> bool:
        """True if `tree` is within the limits."""
        return within(tree, Limits(self.depth, self.nodes))


class ExpertSettings(BaseModel, frozen=True, extra="forbid"):
    """The ranges of Table 8 and the thresholds of the conditions in Tables 6 to 8."""

    rates: PhaseRates  # Table 8: lowest and highest rate by phase
    multiple: int = Field(ge=1)  # quality individuals that Table 8 calls "multiple"
    plateau: int = Field(ge=1)  # generations without improvement that are "stagnating"
    strong: float = Field(gt=0)  # relative rise of the best over the window that is "strong"
    rare: float = Field(ge=0, le=1)  # share of the population below which a behaviour is rare
    collapse: float = Field(ge=0, le=1)  # diversity, Eq. (3), below which it has collapsed
    compact: Size
    """Limits of injected trees until a robot reaches the first milestone (section 2.4.6)."""

    @property
    def reads(self) -> dict[str, tuple[str, ...]]:
        """See `Supervisor`. All parts depend on the settings that a subclass adds."""
        added = type(self).model_fields.keys() - ExpertSettings.model_fields.keys()
        rate = ("rates", "multiple", "plateau", "strong", "collapse", *added)
        tree = ("rare", "collapse", "compact", *added)
        return {
            "rate": (*policy_keys(rate), "gp.state"),
            "tree": (*policy_keys(tree), "gp.crisis", "library"),
        }


def policy_keys(names: Iterable[str]) -> tuple[str, ...]:
    """The keys of a supervisor's own settings."""
    return tuple(f"supervisor.policy.{name}" for name in names)


def exploitation_level(state: PopulationState, settings: ExpertSettings) -> float:
    """Position in the phase's rate range, in [0, 1]; 0: its high end. Rises with working robots."""
    return min(1.0, max(state.now.working, state.quality_count / (2 * settings.multiple)))


def classify_phase(state: PopulationState, settings: ExpertSettings) -> Phase:
    """The phase of the state, Table 8."""
    is_stuck = state.stagnant_generations >= settings.plateau
    if not state.quality_count:
        if state.ever_quality:
            collapsed = state.now.diversity < settings.collapse
            return Phase.CRISIS_INTERVENTION if collapsed else Phase.AGGRESSIVE_EXPLORATION
        return Phase.EARLY_EXPLORATION
    if state.now.diversity < settings.collapse:
        return Phase.AGGRESSIVE_EXPLORATION
    if state.quality_count >= settings.multiple:
        if rising(state, settings):
            return Phase.EXPLOITATION
        return Phase.BALANCED_OPTIMIZATION if is_stuck else Phase.REFINEMENT
    if is_stuck or (state.diversity_trend < 0 and state.diversity_warning):
        return Phase.BALANCED_EXPLORATION
    return Phase.REFINEMENT


def rising(state: PopulationState, settings: ExpertSettings) -> bool:
    """True if the best fitness rose by more than `strong` over the window."""
    return state.best_rise > settings.strong


def classify_pattern(state: PopulationState, settings: ExpertSettings) -> Pattern:
    """The evolutionary pattern of the state, Table 6."""
    if state.crisis == "stagnation":
        return Pattern.STAGNATION
    if state.now.diversity < settings.collapse:
        return Pattern.PREMATURE_CONVERGENCE
    if not state.ever_quality:
        return Pattern.EXPLORATION_PHASE
    return Pattern.RAPID_IMPROVEMENT if rising(state, settings) else Pattern.HEALTHY_PROGRESS


def wanted_rate(state: PopulationState, settings: ExpertSettings) -> float:
    """The mutation rate, in [0, 1]: within the phase's range, lower with more working robots."""
    low, high = settings.rates[classify_phase(state, settings)]
    return high - (high - low) * exploitation_level(state, settings)


def choose_target(state: PopulationState, settings: ExpertSettings, hardest: Sequence[str]) -> str:
    """The target of the next tree (Table 7 of the paper).

    Missing behaviours come first, then a crisis, then rare behaviours. Until a robot reaches the
    first milestone, the target is a single behaviour, so that evolution combines them; in a crisis
    it is EXPLORATION. Of equally rare behaviours it is the first of `hardest`; those that are not
    listed follow in reverse order.
    """
    counts = state.now.behaviour_counts
    order = [*(name for name in hardest if name in counts), *reversed(counts)]
    rarest = min(order, key=lambda name: counts[name])
    if not counts[rarest]:
        return rarest
    if state.crisis:
        return EXPLORATION
    if not state.ever_quality or counts[rarest] < settings.rare * state.population:
        return rarest
    # No behaviour is rare by its share. After a collapse of diversity, Table 7's tree for a rare
    # one is injected all the same.
    return RARE if state.now.diversity < settings.collapse else INTEGRATION


class Expert:
    """Advises by the tables, with trees of a library."""

    name = "expert"
    Settings = ExpertSettings

    @classmethod
    def make(cls, settings: ExpertSettings, context: RunContext) -> Self:
        """See `Supervisor`.

        Raises:
            ConfigError: all trees of the library for a behaviour are larger than `compact`, or the
                library is not valid.
            TreeError: a tree of the library is not valid.
        """
        expert = cls(settings, context.library(), context.classes)
        for target in context.classes.behaviours:
            if target in expert.library.targets and not expert.fitting(target, compact=True):
                raise ConfigError(
                    f"library.trees.{target}: expected a tree within supervisor.policy.compact,"
                    " found only larger ones; add one, or allow more."
                )
        return expert

    def __init__(self, settings: ExpertSettings, library: Library, classes: Classes) -> None:
        self.settings, self.library, self.classes = settings, library, classes

    def fitting(self, target: str, *, compact: bool) -> list[str]:
        """Names of the library's trees for a target; with `compact` only those within its size."""
        names = self.library.targets.get(target, ())
        fits = self.settings.compact.admits
        return [n for n in names if not compact or fits(self.library.trees[n])]

    def tree_for(
        self, target: str, state: PopulationState, rng: np.random.Generator, remark: str = ""
    ) -> dict[str, Any]:
        """The tree drawn for a target, or None, and its rationale: fields of a `Guidance`.

        If the library has none, one for the rarest behaviour with a tree is drawn instead. There is
        no tree if the library is empty, as an automatic one may be.
        """
        wanted, compact = (target, *state.rarest_behaviours), not state.ever_quality
        candidates = (self.fitting(name, compact=compact) for name in wanted)
        names = next((names for names in candidates if names), [""])
        name = names[rng.integers(len(names))]
        choice = f"tree {name}" if name else "the library has no tree"
        return {"tree": self.library.trees.get(name), "rationale": f"{target}{remark}: {choice}"}

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`. A rate within the phase's range, and a tree for the chosen target."""
        settings = self.settings
        phase, pattern = classify_phase(state, settings), classify_pattern(state, settings)
        target = choose_target(state, settings, self.classes.hardest)
        tree_fields = self.tree_for(target, state, rng)
        goal = f"{title(next(iter(state.milestones_reached)))} {self.classes.agent}s"
        return Guidance(
            mutation_rate=wanted_rate(state, settings),
            source=self.name,
            phase=phase,
            pattern=pattern,
            target=target,
            intervention=phase in (Phase.CRISIS_INTERVENTION, Phase.AGGRESSIVE_EXPLORATION),
            risk=f"disruption of {goal}" if state.quality_count else "premature convergence",
            reasoning=f"{state.quality_count} {goal}, {state.stagnant_generations} generations"
            f" without a better best, diversity {state.now.diversity:.2f}",
            **tree_fields,
        )
