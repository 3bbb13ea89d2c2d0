"""Episodes of the tree of a command, and of variants of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from islandgp.bt.core.node import Node
from islandgp.commands.files import TreeText, read_tree_text
from islandgp.commands.options import EpisodeOptions
from islandgp.commands.setting import settings_of
from islandgp.domain import Outcome
from islandgp.errors import ConfigError, EvaluationError

if TYPE_CHECKING:
    from rich.progress import Progress

    from islandgp.config.settings import Settings
    from islandgp.evaluation.base import Evaluator, Problem
    from islandgp.viewer.recording import Recording

CHUNK = 16  # worlds between two steps of the progress bar


@dataclass(frozen=True, slots=True)
class TreeTrials:
    """A tree of a file, and episodes in its domain."""

    source: TreeText
    tree: Node
    settings: Settings
    problem: Problem
    stage: int  # of the curriculum, from 0
    _evaluator: Evaluator
    _bar: Progress

    def outcomes(self, trees: Sequence[str | Node], worlds: Sequence[int]) -> list[list[Outcome]]:
        """The outcomes of each tree in each world."""
        from islandgp.evaluation.base import TREE_INTRODUCTION, evaluated

        by_tree: list[list[Outcome]] = [[] for _ in trees]
        for start in range(0, len(worlds), CHUNK):
            chunk = worlds[start : start + CHUNK]
            try:
                results = evaluated(self._evaluator, trees, self.stage, chunk)
            except EvaluationError as error:  # the tree is that of the file
                raise EvaluationError(str(error).partition(TREE_INTRODUCTION)[0]) from error
            for known, new in zip(by_tree, results, strict=True):
                known += new
            self._bar.advance(self._bar.task_ids[0], len(trees) * len(chunk))
        return by_tree


def _prepared(file: str, episode: EpisodeOptions) -> tuple[TreeText, Node, Settings, Problem, int]:
    """The text of a file, its marked tree, the settings of its domain, its problem and the stage.

    Raises:
        ConfigError, DomainError: the configuration is invalid, or the tree is for another domain.
        TreeError: the file is not a tree of the domain.
    """
    source = read_tree_text(file)
    settings = settings_of(source, episode.options)
    problem = settings.problem()
    stages = len(settings.curriculum.stages)
    if episode.stage is not None and episode.stage > stages:
        raise ConfigError(f"--stage: expected 1 to {stages}, found {episode.stage}")
    tree = source.tree(problem.domain.schema.vocabulary, marked=True)
    return source, tree, settings, problem, (episode.stage or stages) - 1


def recorded(file: str, seed: int, episode: EpisodeOptions) -> Recording:
    """The recording of an episode of the tree in a file, in the world of `seed`.

    Raises:
        IslandError: as `tree_trials` and `viewer.recording.record`.
    """
    from islandgp.viewer.recording import record

    _, tree, _, problem, stage = _prepared(file, episode)
    return record(tree, problem, seed=seed, stage=stage, limit=episode.timeout)


@contextmanager
def tree_trials(file: str, episode: EpisodeOptions, episodes: int) -> Iterator[TreeTrials]:
    """The tree in a file, ready for about so many episodes, with a progress bar on a terminal.

    If the configuration perturbs worlds, episodes run in perturbed ones.

    Raises:
        ConfigError, DomainError: the configuration is invalid, or the tree is for another domain.
        TreeError: the file is not a tree of the domain.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from islandgp.evaluation.serial import Serial
    from islandgp.running.parts import make_evaluator

    source, tree, settings, problem, stage = _prepared(file, episode)
    perturbed, evaluator = settings.perturb is not None, settings.evaluator
    made: Evaluator
    if episodes < 12:  # faster than starting processes
        made = Serial(settings.problem(perturbed=perturbed), episode_timeout=episode.timeout)
    else:
        policy = {**evaluator.policy, "episode_timeout": episode.timeout}
        changed = {"evaluator": evaluator.model_copy(update={"policy": policy})}
        made = make_evaluator(settings.model_copy(update=changed), perturbed=perturbed)
    console = Console(stderr=True)
    columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("episodes"))
    bar = Progress(*columns, console=console, disable=not console.is_terminal, transient=True)
    with closing(made), bar:
        bar.add_task("", total=episodes)
        yield TreeTrials(source, tree, settings, problem, stage, made, bar)
