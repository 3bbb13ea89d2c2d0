"""The checks of a language model's answers before one is used (section 2.4.6).

A decision passes JSON, fields and range; a tree JSON, fields, grammar, names and limits; an edit
must make a new tree. A failed check ends in a rejection whose text helps the model to repair its
answer.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeAlias, TypeVar

from pydantic import ValidationError

from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node, check_limits
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import DomainError, LimitError, TreeError, UnknownNameError
from islandgp.gp.edits import EDITS, Edit, edited
from islandgp.supervision.base import Guidance
from islandgp.supervision.llm.answers import (
    DecisionAnswer,
    EditAnswer,
    EditsAnswer,
    Rejection,
    RejectionStage,
    cleaned,
    faults,
    proposal_model,
    read_answer,
)
from islandgp.supervision.llm.message import Reply
from islandgp.supervision.llm.settings import RateSettings

T = TypeVar("T")

LONGEST: Final = 1000  # most characters of an explanation in the record
MOST_EDITS: Final = 20  # most edits of an answer; further ones are ignored
_FENCED: Final = re.compile(r"^\s*```\w*\n(.*?)\n?\s*```\s*$", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Accepted(Generic[T]):
    """An accepted value, and the change that was made to it ("" for none)."""

    value: T
    change: str = ""


Check: TypeAlias = Callable[[Reply], Accepted[T] | Rejection]


@dataclass(frozen=True, slots=True)
class Proposal:
    """The checked answer to a prompt for a tree."""

    tree: Node  # inside the limits
    target: str  # one of the state's targets
    rationale: str
    others: tuple[Node, ...] = ()  # further candidates, inside the limits
    edits: tuple[Edit, ...] = ()


@dataclass(frozen=True, slots=True)
class EditProposal:
    """The checked answer to the prompt for edits."""

    edits: tuple[Edit, ...]


def check_decision(rates: RateSettings) -> Check[Guidance]:
    """The check of decisions on the mutation rate."""

    def check(reply: Reply) -> Accepted[Guidance] | Rejection:
        answer = read_answer(reply, DecisionAnswer)
        if isinstance(answer, Rejection):
            return answer
        advised = answer.mutation_rate
        rate, change = advised, ""
        if not rates.least <= advised <= rates.most:
            if rates.outside == "repair":
                return Rejection(
                    RejectionStage.RANGE,
                    f"mutation_rate: expected a number from {rates.least} to {rates.most},"
                    f" found {advised}",
                )
            rate = min(rates.most, max(rates.least, advised))
            change = f"clamped from {advised}"
        decision = Guidance(
            rate,
            None,
            "llm",
            phase=answer.phase,
            pattern=answer.pattern,
            intervention=answer.intervention,
            risk=answer.risk[:LONGEST],
            reasoning=answer.reasoning[:LONGEST],
        )
        return Accepted(decision, change)

    return check


def check_proposal(
    limits: Limits,
    vocabulary: Vocabulary,
    targets: tuple[str, ...],
    candidates: int = 1,
    known: frozenset[str] | None = None,
) -> Check[Proposal]:
    """The check of trees. It accepts an answer if at least one of its candidates is valid.

    With `known`, the canonical texts of trees that are no news, these are rejected, and trees that
    `islandgp check` warns of.
    """
    model: Any = proposal_model(targets, candidates)

    def check(reply: Reply) -> Accepted[Proposal] | Rejection:
        proposal = read_answer(reply, model)
        if isinstance(proposal, Rejection):
            return proposal
        texts = proposal.trees[:candidates] if candidates > 1 else [proposal.tree]
        checked = [_check_tree(without_fences(text), limits, vocabulary, known) for text in texts]
        trees = [tree for tree in checked if isinstance(tree, Node)]
        if not trees:
            return next(wrong for wrong in checked if isinstance(wrong, Rejection))
        change = f"{len(trees)} of {len(texts)} trees" if len(trees) < len(texts) else ""
        rationale = proposal.rationale[:LONGEST]
        return Accepted(Proposal(trees[0], proposal.target, rationale, tuple(trees[1:])), change)

    return check


def without_fences(text: str) -> str:
    """A tree's text without a Markdown fence around it."""
    match = _FENCED.search(text)
    return match[1] if match else text


def _check_tree(
    text: str, limits: Limits, vocabulary: Vocabulary, known: frozenset[str] | None
) -> Node | Rejection:
    """Checks grammar, names and limits of a tree; with `known` also novelty and lint warnings."""
    try:
        tree = parse(text, vocabulary, name="tree")
        check_limits(tree, limits)
    except (UnknownNameError, DomainError) as error:
        return Rejection(RejectionStage.NAMES, str(error))
    except LimitError as error:
        return Rejection(RejectionStage.LIMITS, str(error))
    except TreeError as error:
        return Rejection(RejectionStage.GRAMMAR, str(error))
    if known is None:
        return tree
    if to_text(tree) in known:
        return Rejection(
            RejectionStage.COPY,
            "Expected a new tree, found a copy of a living one or of an example.",
        )
    if lint := warnings(text, vocabulary, name="tree"):
        return Rejection(RejectionStage.LINT, "\n".join(w.message for w in lint))
    return tree


def check_edits(
    living: Mapping[str, str], known: frozenset[str], vocabulary: Vocabulary, limits: Limits
) -> Check[EditProposal]:
    """The check of edits. It accepts an answer if at least one of its edits makes a new tree.

    Args:
        living: by id, the texts of the trees that an edit may name.
        known: canonical texts of trees that are no news.
        vocabulary: of the domain.
        limits: of trees.
    """

    def check(reply: Reply) -> Accepted[EditProposal] | Rejection:
        answer = read_answer(reply, EditsAnswer)
        if isinstance(answer, Rejection):
            return answer
        listed, taken, wrong = answer.edits[:MOST_EDITS], [], []
        for number, plain in enumerate(listed, 1):
            try:
                edit = _edit(plain)
                _check_new(edit, living, known, vocabulary, limits)
                taken.append(edit)
            except (ValueError, TreeError) as error:
                wrong.append(f"edit {number}: {error}")
        if not taken:
            return Rejection(RejectionStage.EDITS, "\n".join(wrong))
        change = f"{len(taken)} of {len(listed)} edits: {'; '.join(wrong)}" if wrong else ""
        return Accepted(EditProposal(tuple(taken)), change[:LONGEST])

    return check


def _edit(plain: Mapping[str, Any]) -> Edit:
    """Makes an edit from JSON values; those that its kind does not need are ignored.

    Raises:
        ValueError, TreeError: they are not those of an edit.
    """
    values = {k: cleaned(v) for k, v in plain.items() if v is not None and v != ""}
    try:
        answer = EditAnswer.model_validate(values)
    except ValidationError as error:
        raise ValueError("; ".join(faults(error, EditAnswer, values))) from None
    if answer.kind not in EDITS:
        raise ValueError(f"kind: expected one of {', '.join(EDITS)}, found {answer.kind!r:.60}")
    needs = EDITS[answer.kind].needs
    if needs not in answer.model_fields_set:
        raise ValueError(f"{needs}: expected a value in an edit {answer.kind}, found none")
    return Edit(
        answer.kind,
        of=answer.of[:LONGEST],
        at=answer.at[:LONGEST],
        branch=parse(without_fences(answer.branch), name="branch") if needs == "branch" else None,
        number=answer.number if needs == "number" else None,
        term=answer.term,
        donor=answer.donor[:LONGEST] if needs == "donor" else "",
        donor_at=answer.donor_at[:LONGEST],
        reason=answer.reason[:LONGEST],
    )


def _check_new(
    edit: Edit,
    living: Mapping[str, str],
    known: frozenset[str],
    vocabulary: Vocabulary,
    limits: Limits,
) -> None:
    """Raises ValueError unless an edit makes a new tree without a new lint warning."""
    named = {name: parse(living[name]) for name in (edit.of, edit.donor) if name in living}
    text = to_text(edited(edit, named, vocabulary, limits))
    if text in known:
        raise ValueError("expected a new tree, found a copy of a living tree or of an example")
    before = {w.message for w in warnings(to_text(named[edit.of]), vocabulary)}
    if new := [w.message for w in warnings(text, vocabulary) if w.message not in before]:
        raise ValueError(f"islandgp check warns of the edited tree: {new[0]}")
