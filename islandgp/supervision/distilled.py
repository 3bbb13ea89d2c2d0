"""A small policy that `islandgp distill` has read off another supervisor's decisions.

It is two decision trees over the population's state, one for the target (Table 7) and one
for the mutation rate, kept as plain JSON. Phase and pattern are named by the expert's rules.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, Discriminator, FiniteFloat, Tag, ValidationError

from islandgp.errors import SupervisionError
from islandgp.plain import read_json
from islandgp.scoring.classes import Classes
from islandgp.scoring.state import Crisis, PopulationState
from islandgp.supervision.base import Guidance, RunContext
from islandgp.supervision.expert import Expert, ExpertSettings
from islandgp.supervision.state_json import field_meanings, state_json

NAME: Final = "policy.json"
LARGEST: Final = 5_000_000  # bytes of a policy's file


class Answer(BaseModel, frozen=True, extra="forbid"):
    """A leaf: what the policy says, and the number of the teacher's decisions behind it."""

    answer: str | FiniteFloat
    cases: int


class Question(BaseModel, frozen=True, extra="forbid"):
    """A field of the state is compared with a number."""

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
    """What `islandgp distill` writes."""

    format: Literal[1]
    teacher: str  # the supervisor whose decisions these were
    target: Rule
    rate: Rule
    report: dict[str, float]  # how well it agrees with its teacher; `study.distill` says what


Question.model_rebuild()


def _keys(value: Any) -> Any:
    return value if isinstance(value, Mapping) else getattr(type(value), "model_fields", ())


class DistilledSettings(ExpertSettings, frozen=True, extra="forbid"):
    """The expert's, for phases and for the choice among a target's trees, and the policy."""

    folder: str | None  # with a policy.json

    def policy(self) -> Policy:
        """The policy. Raises SupervisionError where there is none."""
        if not self.folder:
            raise SupervisionError(
                "Expected a policy, found none; make one with islandgp distill RUNS... -o FOLDER,"
                " and name it with supervisor.policy.folder=FOLDER."
            )
        return read_policy(Path(self.folder))


def read_policy(folder: Path) -> Policy:
    """The policy in a folder. Raises SupervisionError where there is none, or another file."""
    path = folder / NAME if folder.is_dir() else folder
    try:
        if path.stat().st_size > LARGEST:
            raise SupervisionError(
                f"Expected a policy of at most {LARGEST:,} bytes in {path}, found more."
            )
        return Policy.model_validate(read_json(path.read_bytes()))
    except OSError as error:
        raise SupervisionError(
            f"Expected a policy in {path}, found none ({error.strerror}); islandgp distill makes"
            " one."
        ) from None
    except (ValidationError, ValueError) as error:
        line = str(error).splitlines()[0]
        raise SupervisionError(f"Expected a policy in {path}, found another file: {line}") from None


def features(state: PopulationState, crisis: Crisis) -> dict[str, float]:
    """The numbers of the state by field (`field_meanings`), and how far each behaviour is ahead.

    `ahead.NAME` is the number of individuals that show a behaviour, above that of the rarest.
    """
    found = dict(_numbers(state_json(state, crisis)))
    rarest = min(state.now.doing.values())
    return found | {f"ahead.{name}": float(n - rarest) for name, n in state.now.doing.items()}


def _numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, Mapping):
        for key, below in value.items():
            yield from _numbers(below, f"{path}.{key}" if path else str(key))
    elif isinstance(value, int | float):
        yield path, float(value)


def decide(rule: Rule, known: Mapping[str, float]) -> str | float:
    """What a decision tree says of a state."""
    while isinstance(rule, Question):
        rule = rule.yes if known[rule.feature] <= rule.at_most else rule.no
    return rule.answer


def rules(rule: Rule, indent: str = "") -> Iterator[str]:
    """A decision tree as indented lines."""
    if isinstance(rule, Answer):
        said = rule.answer if isinstance(rule.answer, str) else f"{rule.answer:.3f}"
        yield f"{indent}{said} ({rule.cases} cases)"
        return
    for word, below in (("<=", rule.yes), (">", rule.no)):
        yield f"{indent}{rule.feature} {word} {rule.at_most:g}"
        yield from rules(below, indent + "  ")


class Distilled:
    """Plays a policy: its rate and its target; the tree is one of the library's for the target."""

    name = "distilled"
    Settings = DistilledSettings

    @classmethod
    def ready(cls, settings: DistilledSettings, context: RunContext) -> None:
        """Raises SupervisionError where there is no policy, or one for other classes."""
        _check(settings.policy(), context)

    @classmethod
    def make(cls, settings: DistilledSettings, context: RunContext) -> Distilled:
        """See `Supervisor`. Raises SupervisionError as `ready` does."""
        policy = settings.policy()
        _check(policy, context)
        return cls(policy, Expert.make(settings, context), context.crisis)

    def __init__(self, policy: Policy, expert: Expert, crisis: Crisis) -> None:
        self.policy, self.expert, self.crisis = policy, expert, crisis

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        known = features(state, self.crisis)
        target, rate = str(decide(self.policy.target, known)), decide(self.policy.rate, known)
        name = self.expert.pick(target, state, rng)
        return replace(
            self.expert.advise(state, rng),
            mutation_rate=min(1.0, max(0.0, float(rate))),
            tree=self.expert.library.trees[name],
            source=self.name,
            target=target,
            reasoning=f"as {self.policy.teacher} decided in states like this one",
            rationale=f"{target}: tree {name}",
        )


def _check(policy: Policy, context: RunContext) -> None:
    """Raises SupervisionError where a policy asks or says what the run does not have."""
    known = _fields(context)
    for rule in (policy.target, policy.rate):
        for one in _walk(rule):
            if isinstance(one, Question) and one.feature not in known:
                raise SupervisionError(
                    f"Expected a policy for this experiment's states, found one that asks for"
                    f" {one.feature!r}; distill one from runs with the same domain and classes."
                )
    said = {str(one.answer) for one in _walk(policy.target) if isinstance(one, Answer)}
    if wrong := sorted(said - set(context.classes.targets)):
        raise SupervisionError(
            f"Expected targets of this experiment ({', '.join(context.classes.targets)}), found"
            f" {wrong[0]!r} in the policy; distill one from runs with the same classes."
        )
    if any(isinstance(a.answer, str) for a in _walk(policy.rate) if isinstance(a, Answer)):
        raise SupervisionError("Expected rates that are numbers in the policy, found a text.")


def _fields(context: RunContext) -> set[str]:
    """The names in `features`: the history, and what is no number, are not among them."""
    classes: Classes = context.classes
    numbers = (
        name
        for name in field_meanings(context.schema, classes)
        if not name.startswith(("history[]", "behaviours."))
    )
    return {*numbers, *(f"ahead.{name}" for name in classes.behaviours)}


def _walk(rule: Rule) -> Iterator[Answer | Question]:
    yield rule
    if isinstance(rule, Question):
        yield from _walk(rule.yes)
        yield from _walk(rule.no)
