"""The replay of a run's best robot: its first episode."""

from __future__ import annotations

from itertools import islice

from islandgp.bt.core.language import parse
from islandgp.errors import RunError
from islandgp.evaluation.base import Problem
from islandgp.records.folder import RunFolder
from islandgp.viewer.page import page
from islandgp.viewer.recording import record


def first_episode(folder: RunFolder, name: str) -> tuple[int, int]:
    """World seed and stage index of the first episode of the individual with this id.

    Raises RunError without a record.
    """
    config = folder.configuration()
    generation, slot = (int(part) for part in name.split("."))
    for recorded in islice(folder.records(generation), 1):
        place = 0 if config["gp"]["shared_seed"] else slot * config["gp"]["episodes"]
        return recorded["worlds"][place], recorded["snapshot"]["stage"]
    raise RunError(f"Expected generation {generation} in {folder.path}, found none.")


def champion_replay(folder: RunFolder, problem: Problem) -> str:
    """The replay page of a finished run's best robot, in the problem of the run."""
    champion = folder.summary()["champion"]
    seed, stage = first_episode(folder, champion["record"]["id"])
    tree = parse(champion["tree"], problem.domain.schema.vocabulary)
    episode = record(tree, problem, seed=seed, stage=stage)
    generation = champion["generation"]
    return page(episode, title=f"{folder.path.name}: the best robot, of generation {generation}")
