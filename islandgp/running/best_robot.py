"""A run's best robot: chosen, shortened, tested in worlds that chose nothing, and explained."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from islandgp.bt.analysis.names import with_names
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, size
from islandgp.bt.core.printer import with_subtrees
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.config.settings import Settings
from islandgp.domain import Outcome
from islandgp.evaluation.base import Evaluator, evaluated
from islandgp.evolution.candidates import Candidate, by_evidence, by_fitness
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
from islandgp.gp.record import IndividualRecord
from islandgp.plain import from_plain
from islandgp.records.folder import RunFolder
from islandgp.scoring.explain import NodeUsage, explained, usage, with_losses
from islandgp.statistics import mean_interval
from islandgp.supervision.library import library_folder, read_tree
from islandgp.viewer.history import RunRecords

TEST_WORLDS = 50  # in which the best robot is tested, at most
TESTED = 3  # trees in these worlds: the robot, the reference tree, the best of generation 0
EXPLAIN_SHARE = 0.15  # of the episodes of pruning, for its explanation
EXPLAIN_WORLDS = 10  # in which a tree is explained, at most
FIRST_BEST = "best tree of generation 0"


def candidates_of(settings: Settings, target: RunFolder) -> list[Candidate]:
    """The candidates for a run's best robot, by evidence or by the paper's fitness."""
    records, constraints = target.records(), settings.constraints
    if settings.search.ranking == "evidence":
        shrinkage = settings.search.policy.get("shrinkage", SHRINKAGE)
        return by_evidence(records, constraints=constraints, shrinkage=shrinkage)
    return by_fitness(records, settings.classes, constraints=constraints)


def final_episodes(settings: Settings, history: RunRecords) -> tuple[int, int, int]:
    """Numbers of episodes after the training: choice of a candidate, pruning with the explanation,
    test.

    With a budget these are all that remain. There are none with gp.validation=0. Shortening takes
    no more episodes than the training.
    """
    if settings.gp.validation == 0:
        return 0, 0, 0
    budget, test = settings.budget.episodes, TESTED * TEST_WORLDS
    pruning = min(settings.prune.episodes, history.episodes)
    if budget is None:
        return max(1, round(settings.gp.validation * settings.gp.episodes_in_all)), pruning, test
    left = budget - history.episodes
    pruning = min(pruning, int(settings.prune.budget_share * budget), left // 2)
    test = min(test, (left - pruning) // 3)
    return left - pruning - test, pruning, test


def best_robot(
    settings: Settings,
    target: RunFolder,
    history: RunRecords,
    evaluator: Evaluator,
    founders: Sequence[Node] = (),
) -> Best:
    """The run's best robot.

    It is chosen by successive halving in validation worlds, or, with gp.validation=0, by its
    fitness in training. Then it is shortened, tested in fresh worlds, and explained. Its subtrees
    get the names that they have in the founders.
    """
    choice, pruning, test = final_episodes(settings, history)
    winner, choice_worlds = _chosen(settings, target, history, evaluator, choice)
    problem, stage = settings.problem(), history.stage
    vocabulary = problem.domain.schema.vocabulary
    used: list[int] = [*history.worlds, *choice_worlds]
    new_worlds = fresh_worlds(settings.seed, frozenset(used))

    def worlds(n: int) -> list[int]:
        drawn = new_worlds(n)
        used.extend(drawn)
        return drawn

    def outcomes(trees: Sequence[Node], seeds: Sequence[int]) -> list[list[Outcome]]:
        return evaluated(evaluator, trees, stage, seeds)

    explaining = int(EXPLAIN_SHARE * pruning)
    pruned = prune(
        parse(winner.tree, vocabulary),
        vocabulary,
        outcomes,
        problem.run(stage),
        worlds,
        Keep(settings.prune.tolerance, settings.classes, settings.constraints),
        episodes=pruning - explaining,
        most_worlds=settings.prune.worlds,
    )
    chosen_in, best = tuple(used[len(history.worlds) :]), pruned.best
    test_worlds = new_worlds(test // TESTED)
    count = min(EXPLAIN_WORLDS, explaining // (size(best) + 1), len(test_worlds))
    usages: list[NodeUsage] = []
    if count > 1:
        counts = usage(problem.run(stage), best, test_worlds[:count])
        usages = with_losses(counts, best, outcomes, test_worlds[:count])
    named = with_names(best, vocabulary, founders)
    record = next(target.records(winner.generation))
    return Best(
        winner.generation,
        from_plain(
            IndividualRecord, next(i for i in record["individuals"] if i["id"] == winner.id)
        ),
        to_text(best),
        with_subtrees(explained(named, usages) if usages else named),
        _tested(settings, history, best, vocabulary, outcomes, test_worlds),
        _front(pruned),
        tuple(step.change for step in pruned.steps[1:]),
        chosen_in,
        tuple(usages),
    )


def _chosen(
    settings: Settings, target: RunFolder, history: RunRecords, evaluator: Evaluator, episodes: int
) -> tuple[Candidate, Sequence[int]]:
    """The best candidate, and the worlds in which the candidates were compared."""
    contenders = candidates_of(settings, target)
    if episodes < 1:
        return max(contenders, key=lambda c: c.merit), ()
    winner, verdict = validate(
        entrants(contenders, episodes),
        validation_seeds(settings.seed, frozenset(history.worlds), episodes),
        evaluator,
        history.stage,
        settings.classes,
        episodes=episodes,
        constraints=settings.constraints,
    )[0]
    return winner, verdict.worlds


def _tested(
    settings: Settings,
    history: RunRecords,
    tree: Node,
    vocabulary: Vocabulary,
    evaluate: Callable[[Sequence[Node], Sequence[int]], list[list[Outcome]]],
    worlds: Sequence[int],
) -> Validation | None:
    """The results in fresh worlds, compared with the reference tree and that of generation 0."""
    if not worlds:
        return None
    others: dict[str, Node] = {}
    library = settings.library
    if library.folder is not None and library.reference_trees:
        name = library.reference_trees[0]
        text = read_tree(library_folder(library.folder, settings.make_domain()), name)
        others[f"tree {name}"] = parse(text, vocabulary, name=name)
    if history.first_best:
        others[FIRST_BEST] = parse(history.first_best, vocabulary)
    own, *theirs = evaluate([tree, *others.values()], worlds)
    by_name = dict(zip(others, theirs, strict=True))
    return judged(worlds, own, settings.classes, settings.constraints, by_name)


def _front(pruned: PruneResult) -> tuple[FrontTree, ...]:
    """The front with the original as plain values; () if no shorter tree was tried."""
    entries: list[tuple[Node, TreeComparison | None]] = [
        (c.tree, TreeComparison("the longest tree", *mean_interval(c.differences)))
        for c in pruned.front
    ]
    return tuple(
        FrontTree(size(tree), to_text(tree), difference, tree == pruned.best)
        for tree, difference in [*entries, *[(pruned.original, None)] * bool(entries)]
    )
