"""Tables 6, 7 and 8 as the expert reads them: a state for each row."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from islandgp.bt.core.node import depth, size
from islandgp.errors import ConfigError
from islandgp.running.parts import run_context
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Pattern, Phase, PhaseRates, RunContext
from islandgp.supervision.expert import (
    Expert,
    ExpertSettings,
    choose_target,
    classify_pattern,
    classify_phase,
)
from islandgp.supervision.library import Library
from tests.composed import composed, plain
from tests.samples import snapshot, state

TABLE_8 = {
    Phase.EARLY_EXPLORATION: (0.40, 0.50),
    Phase.EXPLOITATION: (0.10, 0.20),
    Phase.REFINEMENT: (0.15, 0.25),
    Phase.BALANCED_OPTIMIZATION: (0.18, 0.28),
    Phase.BALANCED_EXPLORATION: (0.30, 0.40),
    Phase.AGGRESSIVE_EXPLORATION: (0.35, 0.45),
    Phase.CRISIS_INTERVENTION: (0.45, 0.50),
}
WORKERS = {
    "humanoid": "MoveToHumanoid",
    "charging": "ExecuteCharge",
    "clearing": "DeliverToClearingPoint",
    "pickup": "PickupGarbage",
}


HARDEST = ("charging", "clearing", "humanoid", "pickup")


@cache
def settings_of_tables() -> ExpertSettings:
    """The configured trees and rates, with the thresholds that the states below are made for."""
    policy = plain("supervisor=expert")["supervisor"]["policy"]
    thresholds = {"multiple": 3, "plateau": 5, "strong": 0.2, "rare": 0.1, "collapse": 0.25}
    return ExpertSettings.model_validate({**policy, **thresholds})


def context(*overrides: str) -> RunContext:
    """What a run gives to it, with trees for each row of Table 7."""
    settings = composed("library=combined", *overrides)
    return run_context(settings)


@cache
def library() -> Library:
    """Trees for each row of Table 7."""
    return context().library()


@cache
def expert() -> Expert:
    """As a run makes it."""
    return Expert.make(settings_of_tables(), context())


def past(n: int, **changes: object) -> list[GenerationStats]:
    """`n` generations that are all alike: their best stagnates for n - 1."""
    return [snapshot(g, **changes) for g in range(n)]  # type: ignore[arg-type]


EARLY = past(3)
PHASES = [
    # nobody has ever been Complete
    (EARLY, Phase.EARLY_EXPLORATION),
    (past(3, diversity=0.0), Phase.EARLY_EXPLORATION),
    (past(12), Phase.EARLY_EXPLORATION),
    # Complete Robots have been, and are no more
    ([snapshot(0, complete=1), snapshot(1)], Phase.AGGRESSIVE_EXPLORATION),
    ([snapshot(0, complete=1), snapshot(1, diversity=0.2)], Phase.CRISIS_INTERVENTION),
    ([snapshot(0, complete=1), snapshot(1, diversity=0.25)], Phase.AGGRESSIVE_EXPLORATION),
    # some are there
    ([snapshot(0, complete=1, diversity=0.2)], Phase.AGGRESSIVE_EXPLORATION),
    ([snapshot(0, complete=9, diversity=0.2)], Phase.AGGRESSIVE_EXPLORATION),
    ([snapshot(0, complete=2)], Phase.REFINEMENT),
    (past(5, complete=2), Phase.REFINEMENT),  # 4 generations on the plateau
    (past(6, complete=2), Phase.BALANCED_EXPLORATION),  # 5
    (
        [snapshot(0, complete=2, diversity=0.5), snapshot(1, complete=2, diversity=0.28)],
        Phase.BALANCED_EXPLORATION,  # low diversity that falls
    ),
    (
        [snapshot(0, complete=2, diversity=0.26), snapshot(1, complete=2, diversity=0.28)],
        Phase.REFINEMENT,  # low diversity that rises
    ),
    (
        [snapshot(0, complete=2, diversity=0.7), snapshot(1, complete=2, diversity=0.5)],
        Phase.REFINEMENT,  # diversity that falls, and is not low
    ),
    # several are there
    ([snapshot(0, complete=3)], Phase.REFINEMENT),
    ([snapshot(0, complete=3), snapshot(1, complete=3, fitness_max=1201.0)], Phase.EXPLOITATION),
    ([snapshot(0, complete=3), snapshot(1, complete=3, fitness_max=1200.0)], Phase.REFINEMENT),
    (past(6, complete=3), Phase.BALANCED_OPTIMIZATION),
]


@pytest.mark.parametrize(("history", "phase"), PHASES)
def test_phase(history: list[GenerationStats], phase: Phase) -> None:
    """Table 8: each phase in the states it is for, and next to its borders."""
    assert classify_phase(state(history), settings_of_tables()) is phase


PATTERNS = [
    (EARLY, Pattern.EXPLORATION_PHASE),
    (past(8), Pattern.EXPLORATION_PHASE),
    (past(9), Pattern.STAGNATION),  # 8 generations without a better best: more than 1.5 epochs
    (past(3, diversity=0.24), Pattern.PREMATURE_CONVERGENCE),
    (past(3, diversity=0.25), Pattern.EXPLORATION_PHASE),
    (past(9, diversity=0.24), Pattern.STAGNATION),
    (past(9, diversity=0.0), Pattern.PREMATURE_CONVERGENCE),
    (past(3, complete=1), Pattern.HEALTHY_PROGRESS),
    ([snapshot(0, complete=1), snapshot(1, fitness_max=1300.0)], Pattern.RAPID_IMPROVEMENT),
    ([snapshot(0, complete=1), snapshot(1, fitness_max=1100.0)], Pattern.HEALTHY_PROGRESS),
]


@pytest.mark.parametrize(("history", "pattern"), PATTERNS)
def test_pattern(history: list[GenerationStats], pattern: Pattern) -> None:
    """Table 6: each label in the states it is for."""
    assert classify_pattern(state(history), settings_of_tables()) is pattern


# A Complete Robot exists already; 3 of 30 individuals are not too few, 2 are.
TARGETS = [
    (past(1, complete=1, behaviour_counts={"humanoid": 3}), "integration"),
    (past(1, complete=1, behaviour_counts={"humanoid": 2}), "humanoid"),
    (past(1, complete=1, behaviour_counts={"charging": 0}), "charging"),
    (past(1, complete=1, behaviour_counts={"clearing": 1}), "clearing"),
    (past(1, complete=1, behaviour_counts={"pickup": 2}), "pickup"),
    # the fewest first; of equals the one that is hardest to find
    (past(1, complete=1, behaviour_counts={"pickup": 0, "charging": 1}), "pickup"),
    (past(1, complete=1, behaviour_counts=dict.fromkeys(WORKERS, 0)), "charging"),
    (past(1, complete=1, behaviour_counts={"humanoid": 1, "clearing": 1}), "clearing"),
    # nothing is missing
    (past(1, complete=1), "integration"),
    (past(8, complete=1), "integration"),
    (past(1, complete=1, diversity=0.2), "rare"),
    # a crisis, of either kind, goes before what few do, and after what nobody does
    (past(9, complete=1), "exploration"),
    (past(9, complete=1, diversity=0.2), "exploration"),
    (past(9, complete=1, behaviour_counts={"clearing": 1}), "exploration"),
    (past(9, complete=1, behaviour_counts={"clearing": 0}), "clearing"),
    (past(1, complete=1, diversity=0.04), "exploration"),
    (past(9), "exploration"),
    (past(1, diversity=0.0, behaviour_counts=dict.fromkeys(WORKERS, 0)), "charging"),
    # before the first Complete Robot: always the rarest behaviour
    (past(1, behaviour_counts={"humanoid": 3}), "humanoid"),
    (past(8, behaviour_counts={"charging": 9}), "charging"),
    (past(1, diversity=0.2, behaviour_counts={"clearing": 4}), "clearing"),
]


@pytest.mark.parametrize(("history", "target"), TARGETS)
def test_target(history: list[GenerationStats], target: str) -> None:
    """Table 7: what the next tree is for."""
    assert choose_target(state(history), settings_of_tables(), HARDEST) == target


def test_a_new_stage_is_no_rise() -> None:
    """A best that is higher because the multipliers are is neither rapid improvement nor a rise."""
    view = state([snapshot(9, complete=3), snapshot(10, stage=1, complete=3, fitness_max=9000.0)])
    assert classify_pattern(view, settings_of_tables()) is Pattern.HEALTHY_PROGRESS
    assert classify_phase(view, settings_of_tables()) is Phase.REFINEMENT
    assert not view.best_rose
    assert (view.best_change, view.best_trend, view.best_rise) == (0, 0, 0)


def test_trees_are_compact_until_a_complete_robot_has_existed() -> None:
    """Section 2.4.6: depth 4 and about 10 nodes, for any missing behaviour; larger ones later."""
    for behaviour in WORKERS:
        for n in (1, 9):
            view = state(past(n, behaviour_counts={behaviour: 0}))
            for seed in range(20):
                guidance = expert().advise(view, np.random.default_rng(seed))
                assert guidance.tree is not None
                assert depth(guidance.tree) <= 4
                assert size(guidance.tree) <= 12
    later = state(past(1, complete=1, behaviour_counts={"clearing": 0}))
    assert library().trees["paper_fig9"] in [
        expert().advise(later, np.random.default_rng(seed)).tree for seed in range(20)
    ]


def test_a_library_without_a_compact_tree_is_refused() -> None:
    """A library without compact trees is an error before the run."""
    large = context("library.trees.clearing=[paper_fig9]")
    with pytest.raises(ConfigError, match=r"library\.trees\.clearing: expected a tree within"):
        Expert.make(settings_of_tables(), large)


def test_a_target_without_a_tree_has_one_for_the_rarest_behaviour() -> None:
    """Only behaviours need their own tree."""
    supervisor = Expert.make(settings_of_tables(), context("library.trees.exploration=[]"))
    view = state(past(9, behaviour_counts={"humanoid": 1}))
    guidance = supervisor.advise(view, np.random.default_rng(0))
    assert guidance.target == "exploration"
    assert guidance.tree == library().trees["humanoid_focused"]


def test_the_hardest_behaviours_are_the_domain_s() -> None:
    """Of equally rare behaviours the expert wants the hardest one; a domain may list none."""
    view = state(past(1, behaviour_counts={"charging": 0, "pickup": 0}))
    assert expert().advise(view, np.random.default_rng(0)).target == "charging"
    assert composed("supervisor=expert", "domain=cartpole").classes.hardest == ()


@st.composite
def states(draw: st.DrawFn) -> PopulationState:
    """Any short history."""
    counts = st.integers(0, 30)
    return state(
        [
            snapshot(
                g,
                fitness_max=draw(st.floats(-1e5, 1e5)),
                diversity=draw(st.floats(0, 0.75)),
                complete=draw(st.sampled_from([0, 0, 1, 2, 3, 10, 30])),
                behaviour_counts={name: draw(counts) for name in ("pickup", "humanoid")},
            )
            for g in range(draw(st.integers(1, 12)))
        ]
    )


@given(states(), st.integers(0, 2**32))
def test_advice_keeps_the_tables(view: PopulationState, seed: int) -> None:
    """For any state: a rate inside its phase's range, and a tree for the target."""
    guidance = expert().advise(view, np.random.default_rng(seed))
    assert guidance.phase is not None
    assert guidance.target is not None
    assert guidance.mutation_rate is not None
    low, high = TABLE_8[guidance.phase]
    assert low <= guidance.mutation_rate <= high
    assert guidance.tree in [library().trees[name] for name in library().targets[guidance.target]]
    assert guidance.phase is classify_phase(view, expert().settings)
    assert guidance.pattern is classify_pattern(view, expert().settings)
    assert guidance.source == "expert"


@pytest.mark.parametrize(
    ("complete", "working", "rate"),
    [
        (1, 0.0, 0.25 - 0.1 / 6),
        (2, 0.0, 0.25 - 0.1 / 3),
        (3, 0.0, 0.2),
        (6, 0.0, 0.15),
        (30, 0.0, 0.15),
        (1, 0.5, 0.2),
        (1, 1.0, 0.15),
        (6, 0.5, 0.15),
    ],
)
def test_the_rate_falls_with_working_and_complete_robots(
    complete: int, working: float, rate: float
) -> None:
    """In refinement, 0.15-0.25: down with Complete Robots, up to six, or with working ones."""
    view = state([snapshot(0, complete=complete, working=working)])
    guidance = expert().advise(view, np.random.default_rng(0))
    assert guidance.mutation_rate == pytest.approx(rate)


def test_ranges_of_rates_are_checked() -> None:
    """For the expert's and for those in the prompts of a language model."""
    ranges = {**dict.fromkeys(Phase, (0.1, 0.2)), Phase.REFINEMENT: (0.3, 0.2)}
    check = TypeAdapter(PhaseRates).validate_python
    with pytest.raises(ValueError, match="expected the lower number first"):
        check(ranges)
    del ranges[Phase.EXPLOITATION]
    ranges[Phase.REFINEMENT] = (0.2, 0.3)
    with pytest.raises(ValueError, match="expected a range for each phase, missing expl"):
        check(ranges)
