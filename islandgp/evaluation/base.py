"""The evaluator interface: runs jobs (one episode each) and returns outcomes in the same order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Final, Protocol, Self

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain import Domain, Observer, Outcome
from islandgp.errors import RAISE_LIMIT, EvaluationError, RunError, TimeLimitError, brief
from islandgp.evaluation.perturbation import Perturbation, PerturbedWorlds, staged
from islandgp.gate import must_be_known_code
from islandgp.plain import DECODE_ERRORS
from islandgp.plugin import imported, raised_in
from islandgp.scoring.curriculum import Curriculum
from islandgp.time_limit import time_limit


@dataclass(frozen=True, slots=True)
class Job:
    """One episode to be run. Equal jobs have equal outcomes."""

    tree: str  # canonical text
    stage: int  # index into Table 2
    seed: int  # of the world
    node: Node | None = field(default=None, compare=False, repr=False)  # `tree`, if parsed


class EpisodeObserver(Observer, Protocol):
    """An observer with a result, for a search that learns from more than outcomes."""

    def result(self) -> tuple[Any, ...]:
        """What it has found out, after the episode; values that can be pickled."""
        ...


@dataclass(frozen=True, slots=True)
class Problem:
    """The domain and curriculum of a run's episodes. Shared by all jobs; sent to workers once."""

    domain: Domain
    curriculum: Curriculum
    stages: tuple[Domain, ...] = ()  # by stage, if stages change the world; () otherwise
    perturbed: PerturbedWorlds | None = None  # perturbed worlds to run in; None: as configured
    observer: Callable[[Node, Vocabulary], EpisodeObserver] | None = None
    """Makes the observer of a tree's episode, whose result is `Outcome.observed`."""

    @classmethod
    def of(
        cls,
        factory: Any,
        world: Any,
        rewards: Any,
        curriculum: Curriculum,
        perturbation: Perturbation | None = None,
        *,
        perturbed: bool = False,
    ) -> Self:
        """Makes the problem from configuration.

        Args:
            factory: a class that implements Domain.
            world: settings of its world.
            rewards: settings of its rewards.
            curriculum: its stages may change settings of the world.
            perturbation: of worlds; None: there is none.
            perturbed: True: episodes run in perturbed worlds, if there are any; False: as in
                training.

        Returns:
            The problem.

        Raises:
            ConfigError: the domain does not accept these settings.
            pydantic.ValidationError: a stage sets the world to invalid values.
        """
        stages: tuple[Domain, ...] = ()
        worlds = tuple(staged(world, stage.world) for stage in curriculum.stages)
        if any(stage.world for stage in curriculum.stages):
            stages = tuple(factory.make(each, rewards) for each in worlds)
        changed = None
        if perturbation is not None and (perturbed or perturbation.training):
            changed = PerturbedWorlds(perturbation, factory, worlds, rewards)
        return cls(factory.make(world, rewards), curriculum, stages, changed)

    @classmethod
    def recorded(cls, config: Mapping[str, Any], *, perturbed: bool = False) -> Self:
        """Makes the problem of a recorded run from its configuration.

        Args:
            config: the run's configuration as plain values.
            perturbed: as in `of`.

        Returns:
            The problem.

        Raises:
            RunError: the configuration is damaged.
            UntrustedError: it names code that the user's configuration does not name.
        """
        groups = ("domain", "world", "rewards", "curriculum", "perturb")
        must_be_known_code({key: config.get(key) for key in groups})
        try:
            factory = imported(config["domain"]["factory"])
            world = factory.World.model_validate(config["world"])
            rewards = factory.Rewards.model_validate(config["rewards"])
            perturb, curriculum = config.get("perturb"), Curriculum(**config["curriculum"])
            perturbation = None if perturb is None else Perturbation.model_validate(perturb)
            return cls.of(factory, world, rewards, curriculum, perturbation, perturbed=perturbed)
        except DECODE_ERRORS as error:
            raise RunError(
                f"Expected the configuration of a run, found a damaged one ({brief(error)});"
                " install what it names, or run its command again under another name."
            ) from error

    def at(self, stage: int) -> Domain:
        """The domain of a stage's index."""
        return self.stages[stage] if self.stages else self.domain

    def in_world(self, stage: int, seed: int) -> Domain:
        """The domain in which an episode runs, perturbed if the problem is.

        Raises:
            ConfigError, pydantic.ValidationError: the domain does not accept a perturbed world.
        """
        return self.at(stage) if self.perturbed is None else self.perturbed.domain(stage, seed)

    def run(self, stage: int) -> Callable[[Node, int, Observer | None], Outcome]:
        """A function that runs the episode of a tree in the world of a seed, in this process."""
        weights = self.curriculum.multipliers(stage)
        return lambda tree, seed, observer: self.in_world(stage, seed).run_episode(
            tree, seed, weights, observer
        )


class Evaluator(Protocol):
    """Runs episodes. `tests/contracts` checks every implementation.

    An evaluator that can be configured has two more class attributes: `Settings`, a pydantic
    model, and `make(settings, problem)`.
    """

    def evaluate(self, jobs: Iterable[Job]) -> list[Outcome]:
        """Runs the episodes of jobs.

        Args:
            jobs: one per episode; equal jobs have equal outcomes. A list, except for an evaluator
                with an attribute `early` that is True: it starts each job before it takes the next
                one, which a search may be making.

        Returns:
            One outcome per job, in the same order.

        Raises:
            EvaluationError: an episode failed; the message names its tree and world seed.
        """
        ...

    def close(self) -> None:
        """Releases processes and other resources; the evaluator is not used afterwards."""
        ...


def evaluated(
    evaluator: Evaluator, trees: Sequence[str | Node], stage: int, worlds: Sequence[int]
) -> list[list[Outcome]]:
    """The outcomes of each tree (a node or canonical text) in each world, as nested lists."""
    forms = [(t, None) if isinstance(t, str) else (to_text(t), t) for t in trees]
    jobs = [Job(text, stage, world, node) for text, node in forms for world in worlds]
    outcomes, n = evaluator.evaluate(jobs), len(worlds)
    return [outcomes[i * n : (i + 1) * n] for i in range(len(trees))]


@lru_cache(maxsize=256)
def _tree(text: str, vocabulary: Vocabulary) -> Node:
    return parse(text, vocabulary)


def simulate(problem: Problem, job: Job, limit: float = 0) -> Outcome:
    """Runs one episode; the outcome is a function of the arguments alone.

    Args:
        problem: the domain and the curriculum.
        job: the tree, the stage and the world seed.
        limit: time limit of the episode in seconds, as in `time_limit`; 0: none.

    Returns:
        The outcome.

    Raises:
        EvaluationError: the episode failed in any way; the message names the tree and the world
            seed.
    """
    weights = problem.curriculum.multipliers(job.stage)
    try:
        tree = job.node or _tree(job.tree, problem.domain.schema.vocabulary)
        problem.domain.prepare()
        with time_limit(limit):
            domain = problem.in_world(job.stage, job.seed)
            observer = problem.observer and problem.observer(tree, domain.schema.vocabulary)
            outcome = in_floats(domain.run_episode(tree, job.seed, weights, observer))
    except TimeLimitError as late:
        raise EvaluationError(blame(job, f"{late.running}; {RAISE_LIMIT}")) from None
    except (Exception, SystemExit) as error:  # a simulator may call sys.exit
        fault = f"{type(error).__name__}: {str(error).rstrip('.')}{raised_in(error)}"
        raise EvaluationError(blame(job, fault)) from error
    return outcome if observer is None else replace(outcome, observed=observer.result())


def in_floats(outcome: Outcome) -> Outcome:
    """The outcome with Python's floats, as records cannot hold NumPy's numbers.

    Raises TypeError or ValueError for what is no outcome, or has a value that is no number.
    """
    if not isinstance(outcome, Outcome):
        raise TypeError(f"{outcome!r:.200}; return an Outcome from run_episode")
    values = (*outcome.components.values(), *outcome.counters.values(), outcome.seconds)
    if not all(type(value) is float for value in values):
        outcome = replace(
            outcome,
            components={name: float(value) for name, value in outcome.components.items()},
            counters={name: float(value) for name, value in outcome.counters.items()},
            seconds=float(outcome.seconds),
        )
    if not abs(outcome.fitness) < MAX_POINTS:
        raise ValueError(
            f"{outcome.fitness} points; lower the rewards, or correct the amounts in the domain"
        )
    return outcome


MAX_POINTS: Final = 1e100  # of an episode, so that their squares in statistics are finite


def blame(job: Job, fault: str) -> str:
    """The message of an error in a job, with its tree and world seed."""
    return (
        f"Expected an outcome from world seed {job.seed}, stage {job.stage + 1}, found {fault}."
        f"{TREE_INTRODUCTION}{job.tree}"
    )


TREE_INTRODUCTION: Final = " The run's records are kept. The tree:\n"
"""Text before the tree in this message."""
