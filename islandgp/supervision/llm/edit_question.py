"""The question for edits: the trees that a language model is shown, and the check of its answer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError
from islandgp.gp.archive import Elite
from islandgp.gp.edits import (
    EDITS,
    Edit,
    EditRecord,
    EditTrial,
    edited,
    nodes_with_paths,
    written,
)
from islandgp.gp.record import IndividualRecord
from islandgp.scoring.constraints import merit, violation
from islandgp.supervision.base import RunContext, Seen
from islandgp.supervision.llm.informed import cut, trace_of
from islandgp.supervision.llm.message import Reply, clean
from islandgp.supervision.llm.validation import (
    LONGEST,
    TEXT,
    Accepted,
    Check,
    FieldType,
    Rejection,
    RejectionStage,
    Shape,
    fields_of,
    without_fences,
)
from islandgp.text import in_points, title

PAST: Final = 8  # earlier edits that are shown, at most
NEIGHBOURS: Final = 3  # individuals beside the parents that are shown, at most
LINES: Final = 60  # nodes of a listed tree, at most
MOST: Final = 20  # edits of an answer that are looked at

EDIT_VALUES: Final = ("parents", "neighbours", "past_edits")
"""Values of `prompts/edits.md` that a generation changes."""

_TEXT: Final = {"type": "string"}
_FIELDS: Final[Mapping[str, tuple[type | tuple[type, ...], Mapping[str, Any]]]] = {
    # a field of an edit: the type of its value, and its JSON schema
    "kind": (str, {"type": "string", "enum": list(EDITS)}),
    "of": (str, _TEXT),
    "at": (str, _TEXT),
    "branch": (str, _TEXT),
    "number": ((int, float), {"type": "number"}),
    "term": (int, {"type": "integer"}),
    "donor": (str, _TEXT),
    "donor_at": (str, _TEXT),
    "reason": (str, _TEXT),
}
_NEEDED: Final = ("kind", "of", "at", "reason")
_FORM: Final = (
    '{"kind": KIND, "of": ID, "at": PATH, "branch": TREE, "number": NUMBER, "term": NUMBER,'
    ' "donor": ID, "donor_at": PATH, "reason": TEXT}'
)

EDIT_LIST: Final = FieldType(
    "[EDIT, EDIT, ...]",
    "a list of edits, one at least",
    {
        "type": "array",
        "items": {
            "type": "object",
            "properties": {name: dict(schema) for name, (_, schema) in _FIELDS.items()},
            "required": list(_NEEDED),
            "additionalProperties": False,
        },
    },
    lambda value: (
        isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)
    ),
)
EDITS_SHAPE: Final[Shape] = {"edits": EDIT_LIST, "reasoning": TEXT}
"""The answer to the prompt `edits`."""


@dataclass(frozen=True, slots=True)
class EditProposal:
    """The answer to the prompt for edits."""

    edits: tuple[Edit, ...]


@dataclass(frozen=True, slots=True)
class PastEdit:
    """An edit of an earlier answer, and its comparison with the tree before it."""

    generation: int  # in which its tree was evaluated, or would have been
    edit: EditRecord
    trial: EditTrial | None  # None: refused, or not evaluated


@dataclass(frozen=True, slots=True)
class EditHistory:
    """What the question for edits needs of a run so far."""

    now: Seen | None = None  # the last generation
    past: tuple[PastEdit, ...] = ()  # oldest first

    def followed_by(self, seen: Seen) -> EditHistory:
        """With one generation more."""
        trials, found = list(seen.trials), []
        for edit in () if seen.guidance is None else seen.guidance.edits:
            trial = trials.pop(0) if trials and not edit.refused else None
            found.append(PastEdit(seen.snapshot.generation, edit, trial))
        return EditHistory(seen, (*self.past, *found)[-PAST:])


def fixed_edit_values(context: RunContext) -> dict[str, str]:
    """Values of `prompts/edits.md` that no generation changes."""
    kinds = (f"- {n} (needs {k.needs}): {k.meaning}" for n, k in EDITS.items())
    return {
        "edit_kinds": "\n".join(kinds),
        "edit_form": _FORM,
        "most_edits": str(context.edits),
        "tree_depth": str(context.limits.max_depth),
        "tree_nodes": str(context.limits.max_nodes),
    }


def parents_of(seen: Seen, context: RunContext, most: int) -> list[IndividualRecord]:
    """The individuals to improve: the fittest, then those of other classes, each tree once."""

    def worth(i: IndividualRecord) -> tuple[float, float]:
        return merit(i.fitness, violation(i.counters, context.constraints))

    order = sorted(seen.individuals, key=worth, reverse=True)
    classes: dict[str, IndividualRecord] = {}
    for i in order:
        classes.setdefault(i.specialist, i)
    first = [*classes.values(), *order]
    return list({i.tree: i for i in reversed(first)}.values())[::-1][:most]


def edit_values(context: RunContext, run: EditHistory, most: int) -> tuple[dict[str, str], int]:
    """The values of EDIT_VALUES, and the episodes that were run for them.

    Args:
        context: of the run.
        run: so far.
        most: parents that are shown, at most.
    """
    seen = run.now
    if seen is None:
        return dict.fromkeys(EDIT_VALUES, ""), 0
    parents = parents_of(seen, context, most)
    others = parents_of(seen, context, most + NEIGHBOURS)[len(parents) :]
    elites = [_elite(e) for e in seen.archive if e.tree not in _texts(parents)]
    near = [f"{_head(i)}\n```\n{cut(i.tree)}\n```" for i in others]
    return {
        "parents": "\n\n".join(_parent(i, context, seen) for i in parents),
        "neighbours": "\n\n".join((elites or near)[:NEIGHBOURS]),
        "past_edits": "\n".join(map(_past, run.past)),
    }, len(parents)


def _texts(individuals: Sequence[IndividualRecord]) -> set[str]:
    return {i.tree for i in individuals}


def _elite(e: Elite) -> str:
    points = f"{in_points(e.mean)} points in stage {e.stage + 1}"
    return f"Individual {e.id}, of the archive: {points}.\n```\n{cut(e.tree)}\n```"


def _head(i: IndividualRecord) -> str:
    tiers = "".join(f", {title(tier)} Robot" for tier in i.tiers)
    counts = ", ".join(f"{name} {in_points(value)}" for name, value in i.counters.items() if value)
    return (
        f"Individual {i.id}: {in_points(i.fitness)} points, class {i.specialist}{tiers}"
        f" ({counts or 'nothing counted'})."
    )


def _parent(i: IndividualRecord, context: RunContext, seen: Seen) -> str:
    tree = parse(i.tree, context.schema.vocabulary)
    return "\n".join((_head(i), *listing(tree), trace_of("It", i, context, seen)))


def listing(tree: Node) -> list[str]:
    """The nodes of a tree, a line each, with the path of each: `0/2 action Charge`."""
    lines = []
    for path, node in list(nodes_with_paths(tree))[:LINES]:
        own = to_text(node._replace(children=())) if not node.children else _opening(node)
        lines.append(f'  at "{written(path)}": {own.strip()}')
    return lines


def _opening(node: Node) -> str:
    """A node's first line, without its children."""
    return to_text(node).split("{", 1)[0].strip()


def _past(past: PastEdit) -> str:
    e, trial = past.edit, past.trial
    what = e.branch or (f"donor {e.donor} at {e.donor_at!r}" if e.donor else f"{e.number}")
    text = (
        f'- generation {past.generation}, {e.kind} at "{e.at}" of {e.of}: {" ".join(what.split())}'
    )
    if e.refused:
        return f"{text[:LONGEST]}; refused: {e.refused}"
    if trial is None:
        return f"{text[:LONGEST]}; not evaluated"
    before, after = trial.parent_fitness, trial.fitness
    gain = in_points(after - before, "+")
    return f"{text[:LONGEST]}; {in_points(before)} -> {in_points(after)} points ({gain})"


def check_edits(
    living: Mapping[str, str],
    known: frozenset[str],
    vocabulary: Vocabulary,
    limits: Limits,
) -> Check[EditProposal]:
    """The validation of edits: those count that make a new tree, one at least.

    Args:
        living: by id, the texts of the trees that an edit may name.
        known: canonical texts of trees that are no news.
        vocabulary: of the domain.
        limits: of trees.
    """

    def check(reply: Reply) -> Accepted[EditProposal] | Rejection:
        found = fields_of(reply, EDITS_SHAPE)
        if isinstance(found, Rejection):
            return found
        listed = found["edits"][:MOST]
        taken: list[Edit] = []
        wrong: list[str] = []
        for number, plain in enumerate(listed, 1):
            try:
                edit = _edit(plain)
                _must_be_new(edit, living, known, vocabulary, limits)
                taken.append(edit)
            except (ValueError, TreeError) as error:
                wrong.append(f"edit {number}: {error}")
        if not taken:
            return Rejection(RejectionStage.EDITS, "\n".join(wrong))
        change = f"{len(taken)} of {len(listed)} edits: {'; '.join(wrong)}" if wrong else ""
        return Accepted(EditProposal(tuple(taken)), change[:LONGEST])

    return check


def _edit(plain: Mapping[str, Any]) -> Edit:
    """An edit from JSON values; those that its kind does not need are left out.

    Raises:
        ValueError, TreeError: they are not those of an edit.
    """
    given = {k: v for k, v in plain.items() if k in _FIELDS and v is not None and v != ""}
    for name, value in given.items():
        wanted = _FIELDS[name][0]
        if not isinstance(value, wanted) or isinstance(value, bool):
            raise ValueError(  # noqa: TRY004 -- of JSON, as all that may be wrong with it
                f"{name}: expected {_FIELDS[name][1]['type']}, found {value!r:.60}"
            )
    kind = given.get("kind", "")
    if kind not in EDITS:
        raise ValueError(f"kind: expected one of {', '.join(EDITS)}, found {kind!r:.60}")
    needs = EDITS[kind].needs
    if needs not in given:
        raise ValueError(f"{needs}: expected a value in an edit {kind}, found none")
    texts = {n: clean(str(given.get(n, "")))[:LONGEST] for n in ("of", "at", "donor_at", "reason")}
    number = float(given["number"]) if needs == "number" else None
    if number is not None and not abs(number) < 1e300:
        raise ValueError(f"number: expected a finite number, found {number}")
    return Edit(
        kind,
        **texts,
        branch=parse(without_fences(clean(given["branch"])), name="branch")
        if needs == "branch"
        else None,
        number=number,
        term=given.get("term", 0),
        donor=clean(given["donor"])[:LONGEST] if needs == "donor" else "",
    )


def _must_be_new(
    edit: Edit,
    living: Mapping[str, str],
    known: frozenset[str],
    vocabulary: Vocabulary,
    limits: Limits,
) -> None:
    """Raises ValueError unless an edit makes a tree that is news and has no new warning."""
    named = {name: parse(living[name]) for name in (edit.of, edit.donor) if name in living}
    tree = edited(edit, named, vocabulary, limits)
    text = to_text(tree)
    if text in known:
        raise ValueError("expected a new tree, found a copy of a living tree or of an example")
    before = {w.message for w in warnings(to_text(named[edit.of]), vocabulary)}
    if new := [w.message for w in warnings(text, vocabulary) if w.message not in before]:
        raise ValueError(f"islandgp check warns of the edited tree: {new[0]}")


def nameable(seen: Seen) -> dict[str, str]:
    """By id, the texts of the trees that an edit may name."""
    elites = {e.id: e.tree for e in seen.archive}
    return elites | {i.id: i.tree for i in seen.individuals}


def known_texts(living: Iterable[str], examples: Iterable[Node]) -> frozenset[str]:
    """Canonical texts of the living trees and of the examples."""
    return frozenset((*living, *map(to_text, examples)))
