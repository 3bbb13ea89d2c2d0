"""Asking a supervisor: its answer is checked here before anything is made of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import lru_cache
from typing import Any, Final

import numpy as np

from islandgp.bt.language import parse, to_text
from islandgp.bt.node import Node
from islandgp.bt.vocabulary import Vocabulary
from islandgp.errors import SupervisionError, TreeError
from islandgp.plugin import blaming, path_of
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, Pattern, Phase, Supervisor


def ask(
    supervisor: Supervisor,
    state: PopulationState,
    rng: np.random.Generator,
    vocabulary: Vocabulary | None = None,
) -> Guidance:
    """What the supervisor advises; its tree must be in the words of the vocabulary, if given.

    Raises:
        SupervisionError: it is no guidance that a population could be given.
        PartError: a supervisor of the user's own failed.
    """
    with blaming(path_of(type(supervisor))):
        found = supervisor.advise(state, rng)
    if not isinstance(found, Guidance):
        raise _wrong(supervisor, "a Guidance", found)
    for field in fields(Guidance):
        wanted, fits = WANTED[field.name]
        if not fits(value := getattr(found, field.name)):
            raise _wrong(supervisor, f"a Guidance whose {field.name} is {wanted}", value)
    if found.target is not None and found.target not in state.targets:
        wanted = f"a Guidance whose target is None or one of {', '.join(state.targets)}"
        raise _wrong(supervisor, wanted, found.target)
    if found.tree is not None and vocabulary is not None and not _in_words(found.tree, vocabulary):
        wanted = f"a Guidance whose tree is of the domain {vocabulary.domain}"
        raise _wrong(supervisor, wanted, to_text(found.tree))
    return found


def _wrong(supervisor: Supervisor, wanted: str, found: object) -> SupervisionError:
    shown = repr(found)
    return SupervisionError(
        f"Expected from the supervisor {path_of(type(supervisor))} {wanted},"
        f" found {shown if len(shown) <= 60 else shown[:60] + '...'}; mend its advise."
    )


def _is_rate(value: Any) -> bool:
    return value is None or (
        isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value <= 1
    )


def _is_tree(value: Any) -> bool:
    """Whether the language has it: a node of a made-up kind could not be ticked or written down."""
    if not isinstance(value, Node):
        return value is None
    try:
        return _in_language(value)
    except (TreeError, LookupError, TypeError, ValueError, AttributeError):
        return False


@lru_cache(maxsize=64)  # supervisors give the same trees again
def _in_language(tree: Node) -> bool:
    return parse(to_text(tree)) == tree


def _in_words(tree: Node, vocabulary: Vocabulary) -> bool:
    try:
        parse(to_text(tree), vocabulary)
    except TreeError:
        return False
    return True


def _is_text(value: Any) -> bool:
    """Whether it can be written down; half a surrogate pair cannot."""
    return isinstance(value, str) and value.encode("utf-8", "ignore").decode("utf-8") == value


def _are_notes(value: Any) -> bool:
    return isinstance(value, dict) and all(
        _is_text(text) for pair in value.items() for text in pair
    )


WANTED: Final[Mapping[str, tuple[str, Callable[[Any], bool]]]] = {
    # a field of Guidance: what it must be, and whether a value is that
    "mutation_rate": ("a number in [0, 1] or None", _is_rate),
    "tree": ("a tree of the language (bt.language.parse makes one of a text) or None", _is_tree),
    "source": ("a text that is not empty", lambda value: _is_text(value) and value != ""),
    "phase": ("a Phase or None", lambda value: value is None or value in list(Phase)),
    "pattern": ("a Pattern or None", lambda value: value is None or value in list(Pattern)),
    "target": ("a text or None", lambda value: value is None or _is_text(value)),
    "intervention": ("True or False", lambda value: isinstance(value, bool)),
    "risk": ("a text", _is_text),
    "reasoning": ("a text", _is_text),
    "rationale": ("a text", _is_text),
    "notes": ("a dict of texts", _are_notes),
}
