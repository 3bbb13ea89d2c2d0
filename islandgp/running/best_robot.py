"""Selects a run's best robot in validation worlds."""

from __future__ import annotations

from islandgp.bt.core.language import parse, to_text
from islandgp.config.settings import Settings
from islandgp.evaluation.base import Evaluator
from islandgp.evolution.validation import (
    Best,
    Validation,
    candidates,
    candidates_by_evidence,
    entrants,
    validate,
    validation_seeds,
)
from islandgp.gp.evidence import SHRINKAGE
from islandgp.intervals import import_early
from islandgp.records.folder import RunFolder
from islandgp.supervision.library import library_folder, read_tree


def best_robot(settings: Settings, target: RunFolder, evaluator: Evaluator) -> Best:
    """The run's best robot, by successive halving in validation worlds (held-out seeds).

    With gp.validation=0, or if the budget leaves no episode, it is the best individual of the last
    stage. The number of candidates depends on the number of episodes.
    """
    records, constraints = target.records(), settings.constraints
    if settings.search.ranking == "evidence":
        shrinkage = settings.search.policy.get("shrinkage", SHRINKAGE)
        contenders = candidates_by_evidence(records, constraints=constraints, shrinkage=shrinkage)
    else:
        contenders = candidates(records, settings.classes, constraints=constraints)
    episodes = validation_episodes(settings, target)
    verdict: Validation | None = None
    if episodes < 1:
        winner = max(contenders, key=lambda c: c.merit)
    else:
        import_early()
        used_worlds: set[int] = set()
        stage = 0
        for record in target.records():
            used_worlds.update(record["worlds"])
            stage = record["snapshot"]["stage"]
        winner, verdict = validate(
            entrants(contenders, episodes),
            validation_seeds(settings.seed, frozenset(used_worlds), episodes),
            evaluator,
            stage,
            settings.classes,
            episodes=episodes,
            reference_tree=_reference_tree(settings),
            constraints=constraints,
        )[0]
    born = next(target.records(winner.generation))
    champion = next(i for i in born["individuals"] if i["id"] == winner.id)
    return Best(winner.generation, champion, verdict)


def validation_episodes(settings: Settings, target: RunFolder) -> int:
    """Number of validation episodes; with a budget, all that remain."""
    if settings.gp.validation == 0:
        return 0
    if settings.budget.episodes is None:
        return max(1, round(settings.gp.validation * settings.gp.episodes_in_all))
    spent = sum(int(cost["episodes"]) for cost in target.costs())
    return settings.budget.episodes - spent


def _reference_tree(settings: Settings) -> tuple[str, str] | None:
    """Name and canonical text of the tree with which the best robot is compared, or None."""
    library, domain = settings.library, settings.make_domain()
    if library.folder is None or not library.reference_trees:
        return None
    name = library.reference_trees[0]
    text = read_tree(library_folder(library.folder, domain), name)
    return name, to_text(parse(text, domain.schema.vocabulary, name=name))
