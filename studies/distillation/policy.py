"""Advises by a small policy that was fitted to another supervisor's decisions.

The policy is two decision trees over the population's state, one for the target (Table 7) and one
for the mutation rate, stored as JSON. Phase and pattern are classified by the expert's rules.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, Discriminator, FiniteFloat, Tag

from islandgp.errors import SupervisionError
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, RunContext
from islandgp.supervision.expert import Expert, ExpertSettings
from islandgp.supervision.state_json import state_json

NAME: Final = "policy.json"
MAX_BYTES: Final = 5_000_000  # most bytes of a policy's file
SMALL: Final = 1e-6  # points: relative changes of smaller values are 0


class Answer(BaseModel, frozen=True, extra="forbid"):
    """A leaf of a decision tree."""

    answer: str | FiniteFloat  # a target, or a mutation rate
    cases: int  # decisions of the teacher in this leaf


class Question(BaseModel, frozen=True, extra="forbid"):
    """An inner node of a decision tree: compares a field of the state with a number."""

    feature: str
    at_most: FiniteFloat
    yes: Rule
    no: Rule


Rule = Annotated[
    Annotated[Answer, Tag("answer")] | Annotated[Question, Tag("question")],
    Discriminator(lambda v: "answer" if "answer" in _keys(v) else "question"),
]
"""A decision tree."""


class Policy(BaseModel, frozen=True, extra="forbid"):
    """Content of the file policy.json, written by `python -m studies.distillation`."""

    format: Literal[1]
    teacher: str  # the supervisor whose decisions it was fitted to
    target: Rule
    rate: Rule
    report: dict[str, float]  # agreement with the teacher, as described in `fit.distil`


Question.model_rebuild()


def _keys(value: Any) -> Any:
    return value if isinstance(value, Mapping) else getattr(type(value), "model_fields", ())


class DistilledSettings(ExpertSettings, frozen=True, extra="forbid"):
    """The policy's folder; the expert's settings apply to phases and the choice of trees."""

    folder: str | None  # with a policy.json

    def policy(self) -> Policy:
        """Reads the policy. Raises SupervisionError if there is none."""
        if not self.folder:
            raise SupervisionError(
                "Expected a policy, found none; make one with python -m studies.distillation"
                " RUNS... -o FOLDER, and name it with supervisor.policy.folder=FOLDER."
            )
        return read_policy(Path(self.folder))


def read_policy(folder: Path) -> Policy:
    """Reads the policy in a folder. Raises SupervisionError if it is missing or not valid."""
    path = folder / NAME if folder.is_dir() else folder
    try:
        if path.stat().st_size > MAX_BYTES:
            raise SupervisionError(
                f"Expected a policy of at most {MAX_BYTES:,} bytes in {path}, found more."
            )
        return Policy.model_validate(json.loads(path.read_bytes()))
    except OSError as error:
        raise SupervisionError(
            f"Expected a policy in {path}, found none ({error.strerror}); python -m"
            " studies.distillation makes one."
        ) from None
    except (RecursionError, ValueError) as error:
        line = str(error).splitlines()[0]
        raise SupervisionError(f"Expected a policy in {path}, found another file: {line}") from None


def features(state: PopulationState) -> dict[str, float]:
    """The features of a state: the numbers among its fields (`state_json`), and three more.

    `ahead.NAME` is the number of individuals with a behaviour minus that of the rarest behaviour,
    `crisis` is 1 in a crisis, and `best_change_share` is `best_change` as a share of the best.
    """
    numbers = dict(_numbers(state_json(state)))
    counts = state.now.behaviour_counts
    rarest = min(counts.values())
    before = abs(state.now.fitness_max - state.best_change)
    share = round(state.best_change / before, 3) if before > SMALL else 0.0
    numbers |= {"crisis": float(bool(state.crisis)), "best_change_share": share}
    return numbers | {f"ahead.{name}": float(n - rarest) for name, n in counts.items()}


def _numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, Mapping):
        for key, below in value.items():
            yield from _numbers(below, f"{path}.{key}" if path else str(key))
    elif isinstance(value, int | float):
        yield path, float(value)


def decide(rule: Rule, values: Mapping[str, float]) -> str | float:
    """Evaluates a decision tree on the features of a state."""
    while isinstance(rule, Question):
        rule = rule.yes if values[rule.feature] <= rule.at_most else rule.no
    return rule.answer


def rules(rule: Rule, indent: str = "") -> Iterator[str]:
    """Prints a decision tree as indented lines."""
    if isinstance(rule, Answer):
        answer = rule.answer if isinstance(rule.answer, str) else f"{rule.answer:.3f}"
        yield f"{indent}{answer} ({rule.cases} cases)"
        return
    for sign, below in (("<=", rule.yes), (">", rule.no)):
        yield f"{indent}{rule.feature} {sign} {rule.at_most:g}"
        yield from rules(below, indent + "  ")


class Distilled:
    """Advises by a distilled policy: its rate, and a library tree for its target."""

    name = "distilled"
    Settings = DistilledSettings

    @classmethod
    def check(cls, settings: DistilledSettings, context: RunContext) -> None:
        """Raises SupervisionError if there is no policy, or one for other classes."""
        _check(settings.policy(), context)

    @classmethod
    def make(cls, settings: DistilledSettings, context: RunContext) -> Distilled:
        """See `Supervisor`. Raises SupervisionError as `check` does."""
        policy = settings.policy()
        _check(policy, context)
        return cls(policy, Expert.make(settings, context))

    def __init__(self, policy: Policy, expert: Expert) -> None:
        self.policy, self.expert = policy, expert

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        values = features(state)
        target, rate = str(decide(self.policy.target, values)), decide(self.policy.rate, values)
        tree_fields = self.expert.tree_for(target, state, rng)
        return replace(
            self.expert.advise(state, rng),
            mutation_rate=min(1.0, max(0.0, float(rate))),
            source=self.name,
            target=target,
            reasoning=f"as {self.policy.teacher} decided in states like this one",
            **tree_fields,
        )


def _check(policy: Policy, context: RunContext) -> None:
    """Raises SupervisionError if a policy has features or targets that the run does not have."""
    fields = _fields(context)
    for rule in (policy.target, policy.rate):
        for one in _walk(rule):
            if isinstance(one, Question) and one.feature not in fields:
                raise SupervisionError(
                    f"Expected a policy for this experiment's states, found one with the feature"
                    f" {one.feature!r}; distill one from runs with the same domain and classes."
                )
    targets = {str(one.answer) for one in _walk(policy.target) if isinstance(one, Answer)}
    if wrong := sorted(targets - set(context.classes.targets)):
        raise SupervisionError(
            f"Expected targets of this experiment ({', '.join(context.classes.targets)}), found"
            f" {wrong[0]!r} in the policy; distill one from runs with the same classes."
        )
    if any(isinstance(a.answer, str) for a in _walk(policy.rate) if isinstance(a, Answer)):
        raise SupervisionError("Expected rates that are numbers in the policy, found a text.")


def _fields(context: RunContext) -> set[str]:
    """The names of `features`; without the history and fields that are not numbers."""
    classes = context.classes
    names = {
        "specialists": classes.specialist_names,
        "behaviour_counts": classes.behaviours,
        "ahead": classes.behaviours,
        "tiers": classes.tiers,
        "milestones_reached": classes.milestones,
        "counters": context.schema.counters,
        "multipliers": context.schema.components,
    }
    return {*OF_ANY_RUN, *(f"{group}.{name}" for group, each in names.items() for name in each)}


OF_ANY_RUN: Final = (
    *("generation", "generations", "epoch", "stage", "working", "size", "population"),
    *("fitness_max", "fitness_mean", "fitness_sd", "best_change", "mean_change"),
    *("best_trend", "mean_trend", "diversity", "diversity_change", "diversity_trend"),
    *("stagnant_generations", "stagnant_epochs", "diversity_warning", "crisis"),
    *("mutation_rate", "crossover_rate", "best_change_share"),
)
"""Features that do not depend on the domain and the classes."""


def _walk(rule: Rule) -> Iterator[Answer | Question]:
    yield rule
    if isinstance(rule, Question):
        yield from _walk(rule.yes)
        yield from _walk(rule.no)
