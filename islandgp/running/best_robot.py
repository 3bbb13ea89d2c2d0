"""Selects a run's best robot in validation worlds."""

from __future__ import annotations

from islandgp.bt.core.language import parse, to_text
from islandgp.config.settings import Settings
from islandgp.evaluation.base import Evaluator
from islandgp.evolution.candidates import (
    Candidates,
    CandidatesByEvidence,
    CandidatesByFitness,
)
from islandgp.evolution.validation import (
    Best,
    Validation,
    entrants,
    validate,
    validation_seeds,
)
from islandgp.gp.evidence import SHRINKAGE
from islandgp.records.folder import RunFolder
from islandgp.running.totals import RunTotals
from islandgp.supervision.library import library_folder, read_tree


def candidates_of(settings: Settings) -> Candidates:
    """Collects the candidates for a run's best robot, by evidence or by the paper's fitness."""
    if settings.search.ranking == "evidence":
        shrinkage = settings.search.policy.get("shrinkage", SHRINKAGE)
        return CandidatesByEvidence(constraints=settings.constraints, shrinkage=shrinkage)
    return CandidatesByFitness(settings.classes, constraints=settings.constraints)


def best_robot(
    settings: Settings, target: RunFolder, totals: RunTotals, evaluator: Evaluator
) -> Best:
    """The run's best robot, by successive halving in validation worlds (held-out seeds).

    With gp.validation=0, or if the budget leaves no episode, it is the best individual of the last
    stage. The number of candidates depends on the number of episodes.
    """
    assert totals.candidates is not None
    contenders = totals.candidates.best()
    episodes = validation_episodes(settings, totals)
    verdict: Validation | None = None
    if episodes < 1:
        winner = max(contenders, key=lambda c: c.merit)
    else:
        winner, verdict = validate(
            entrants(contenders, episodes),
            validation_seeds(settings.seed, frozenset(totals.worlds), episodes),
            evaluator,
            totals.stage,
            settings.classes,
            episodes=episodes,
            reference_tree=_reference_tree(settings),
            constraints=settings.constraints,
        )[0]
    born = next(target.records(winner.generation))
    champion = next(i for i in born["individuals"] if i["id"] == winner.id)
    return Best(winner.generation, champion, verdict)


def validation_episodes(settings: Settings, totals: RunTotals) -> int:
    """Number of validation episodes; with a budget, all that remain."""
    if settings.gp.validation == 0:
        return 0
    if settings.budget.episodes is None:
        return max(1, round(settings.gp.validation * settings.gp.episodes_in_all))
    return settings.budget.episodes - totals.episodes


def _reference_tree(settings: Settings) -> tuple[str, str] | None:
    """Name and canonical text of the tree with which the best robot is compared, or None."""
    library, domain = settings.library, settings.make_domain()
    if library.folder is None or not library.reference_trees:
        return None
    name = library.reference_trees[0]
    text = read_tree(library_folder(library.folder, domain), name)
    return name, to_text(parse(text, domain.schema.vocabulary, name=name))
