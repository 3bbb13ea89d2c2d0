"""A run's best robot: chosen, shortened, tested in worlds that chose nothing, and explained."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from islandgp.bt.analysis.names import with_names
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, size
from islandgp.bt.core.printer import with_subtrees
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.config.settings import Settings
from islandgp.domain import Outcome
from islandgp.evaluation.base import Evaluator, Problem, evaluated
from islandgp.evolution.candidates import (
    Candidate,
    Candidates,
    CandidatesByEvidence,
    CandidatesByFitness,
)
from islandgp.evolution.prune import Keep, PruneResult, prune
from islandgp.evolution.validation import (
    Best,
    FrontTree,
    TreeComparison,
    Validation,
    entrants,
    fresh_worlds,
    judged,
    validate,
    validation_seeds,
)
from islandgp.gp.evidence import SHRINKAGE
from islandgp.intervals import interval
from islandgp.records.folder import RunFolder
from islandgp.running.report import RunTotals
from islandgp.scoring.explain import NodeUsage, explained, usage, with_losses
from islandgp.supervision.library import library_folder, read_tree

TEST_WORLDS = 50  # in which the best robot is tested, at most
TESTED = 3  # trees in these worlds: the robot, the reference tree, the best of generation 0
EXPLAIN_SHARE = 0.15  # of the episodes of pruning, for its explanation
EXPLAIN_WORLDS = 10  # in which a tree is explained, at most
FIRST_BEST = "best tree of generation 0"


def candidates_of(settings: Settings) -> Candidates:
    """Collects the candidates for a run's best robot, by evidence or by the paper's fitness."""
    if settings.search.ranking == "evidence":
        shrinkage = settings.search.policy.get("shrinkage", SHRINKAGE)
        return CandidatesByEvidence(constraints=settings.constraints, shrinkage=shrinkage)
    return CandidatesByFitness(settings.classes, constraints=settings.constraints)


@dataclass(frozen=True, slots=True)
class FinalEpisodes:
    """Numbers of episodes after the training of a run."""

    choice: int  # of the candidates
    pruning: int  # with the explanation
    test: int


def final_episodes(settings: Settings, totals: RunTotals) -> FinalEpisodes:
    """The episodes that follow the training; with a budget, all that remain.

    There are none with gp.validation=0. Shortening takes no more episodes than the training.
    """
    if settings.gp.validation == 0:
        return FinalEpisodes(0, 0, 0)
    budget, test = settings.budget.episodes, TESTED * TEST_WORLDS
    pruning = min(settings.prune.episodes, totals.episodes)
    if budget is None:
        choice = max(1, round(settings.gp.validation * settings.gp.episodes_in_all))
        return FinalEpisodes(choice, pruning, test)
    left = budget - totals.episodes
    pruning = min(pruning, int(settings.prune.budget_share * budget), left // 2)
    test = min(test, (left - pruning) // 3)
    return FinalEpisodes(left - pruning - test, pruning, test)


def best_robot(
    settings: Settings,
    target: RunFolder,
    totals: RunTotals,
    evaluator: Evaluator,
    founders: Sequence[Node] = (),
) -> Best:
    """The run's best robot.

    It is chosen by successive halving in validation worlds, or, with gp.validation=0, by its
    fitness in training. Then it is shortened, tested in fresh worlds, and explained. Its subtrees
    get the names that they have in the founders.
    """
    episodes = final_episodes(settings, totals)
    winner, choice_worlds = _chosen(settings, totals, evaluator, episodes.choice)
    problem = settings.problem()
    vocabulary, stage = problem.domain.schema.vocabulary, totals.stage
    used: list[int] = [*totals.worlds, *choice_worlds]
    new_worlds = fresh_worlds(settings.seed, frozenset(used))

    def worlds(n: int) -> list[int]:
        drawn = new_worlds(n)
        used.extend(drawn)
        return drawn

    def outcomes(trees: Sequence[Node], seeds: Sequence[int]) -> list[list[Outcome]]:
        return evaluated(evaluator, trees, stage, seeds)

    tree = parse(winner.tree, vocabulary)
    explaining = int(EXPLAIN_SHARE * episodes.pruning)
    pruned = prune(
        tree,
        vocabulary,
        outcomes,
        problem.run(stage),
        worlds,
        Keep(settings.prune.tolerance, settings.classes, settings.constraints),
        episodes=episodes.pruning - explaining,
        most_worlds=settings.prune.worlds,
    )
    chosen_in = tuple(used[len(totals.worlds) :])
    test_worlds = new_worlds(episodes.test // TESTED)
    usages = _usages(pruned.best, problem, outcomes, test_worlds, stage, explaining)
    named = with_names(pruned.best, vocabulary, founders)
    record = next(target.records(winner.generation))
    return Best(
        winner.generation,
        next(i for i in record["individuals"] if i["id"] == winner.id),
        to_text(pruned.best),
        with_subtrees(explained(named, usages) if usages else named),
        _tested(settings, totals, pruned.best, vocabulary, outcomes, test_worlds),
        _front(pruned),
        tuple(step.change for step in pruned.steps[1:]),
        chosen_in,
        tuple(usages),
    )


def _chosen(
    settings: Settings, totals: RunTotals, evaluator: Evaluator, episodes: int
) -> tuple[Candidate, Sequence[int]]:
    """The best candidate, and the worlds in which the candidates were compared."""
    contenders = totals.candidates.best()
    if episodes < 1:
        return max(contenders, key=lambda c: c.merit), ()
    winner, verdict = validate(
        entrants(contenders, episodes),
        validation_seeds(settings.seed, frozenset(totals.worlds), episodes),
        evaluator,
        totals.stage,
        settings.classes,
        episodes=episodes,
        constraints=settings.constraints,
    )[0]
    return winner, verdict.worlds


Evaluate = Callable[[Sequence[Node], Sequence[int]], list[list[Outcome]]]


def _tested(
    settings: Settings,
    totals: RunTotals,
    tree: Node,
    vocabulary: Vocabulary,
    evaluate: Evaluate,
    worlds: Sequence[int],
) -> Validation | None:
    """The results in fresh worlds, compared with the reference tree and that of generation 0."""
    if not worlds:
        return None
    others = {} if (reference := _reference_tree(settings)) is None else dict([reference])
    if totals.first_best:
        others[FIRST_BEST] = parse(totals.first_best, vocabulary)
    own, *theirs = evaluate([tree, *others.values()], worlds)
    by_name = dict(zip(others, theirs, strict=True))
    return judged(worlds, own, settings.classes, settings.constraints, by_name)


def _usages(
    tree: Node,
    problem: Problem,
    evaluate: Evaluate,
    worlds: Sequence[int],
    stage: int,
    episodes: int,
) -> list[NodeUsage]:
    """What each node of the tree does, and is worth; [] if episodes are few."""
    count = min(EXPLAIN_WORLDS, episodes // (size(tree) + 1), len(worlds))
    if count < 2:
        return []
    return with_losses(
        usage(problem.run(stage), tree, worlds[:count]), tree, evaluate, worlds[:count]
    )


def _front(pruned: PruneResult) -> tuple[FrontTree, ...]:
    """The front with the original as plain values; () if no shorter tree was tried."""
    if not pruned.front:
        return ()
    entries = [
        *(
            (c.tree, TreeComparison("the longest tree", *interval(c.differences)))
            for c in pruned.front
        ),
        (pruned.original, None),
    ]
    return tuple(
        FrontTree(size(tree), to_text(tree), difference, tree == pruned.best)
        for tree, difference in entries
    )


def _reference_tree(settings: Settings) -> tuple[str, Node] | None:
    """The name of the reference tree in reports, and the tree; None: there is none."""
    library, domain = settings.library, settings.make_domain()
    if library.folder is None or not library.reference_trees:
        return None
    name = library.reference_trees[0]
    text = read_tree(library_folder(library.folder, domain), name)
    return f"tree {name}", parse(text, domain.schema.vocabulary, name=name)
