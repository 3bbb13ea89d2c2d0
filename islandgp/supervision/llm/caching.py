"""System prompts that are long enough for a model's cache.

A server caches a system prompt from a number of tokens on that depends on the model. Where the
prompts of a run's questions are shorter, the questions share one system prompt with all of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from islandgp.supervision.llm.message import Request
from islandgp.supervision.llm.models import kind_of
from islandgp.supervision.llm.settings import LLMSettings

NEAR: Final = 1.2  # factor on the shortest cached length, as tokens are only estimated
_SHARED: Final = (
    "You are asked {} kinds of questions: {}. The first line of each message names its question."
    " Answer it by the instructions under its heading; those of other questions do not apply."
)


def heading(question: str) -> str:
    """The heading of a question in a shared system prompt, and the first line of its messages."""
    return f"# Question: {question}"


def shared_prompts(requests: Mapping[str, Request], settings: LLMSettings) -> dict[str, Request]:
    """Gives requests to the same model one system prompt, if one of theirs is too short to cache.

    Args:
        requests: of one generation, by the part of the guidance: "rate", "tree", "edits", ...
        settings: with `cache`; without it the requests are returned unchanged.
    """
    least = settings.prices.facts
    shared = dict(requests)
    for model in {request.model for request in requests.values()} if settings.cache else ():
        by_part = {part: r for part, r in requests.items() if r.model == model}
        systems = {kind_of(part): r.system for part, r in by_part.items()}
        shortest = least[model].caches_from if model in least else None
        if shortest is None or len(systems) == 1:
            continue
        if min(map(len, systems.values())) >= NEAR * shortest * least[model].characters:
            continue
        intro = _SHARED.format(len(systems), ", ".join(systems))
        sections = (f"{heading(name)}\n\n{text}" for name, text in systems.items())
        system = "\n\n".join((intro, *sections))
        for part, r in by_part.items():
            turns = (f"{heading(kind_of(part))}\n\n{r.turns[0]}", *r.turns[1:])
            shared[part] = replace(r, system=system, turns=turns)
    return shared


def too_short(prompts: Mapping[str, str], settings: LLMSettings) -> str:
    """A line on system prompts that are too short for the model's cache; "" if there are none.

    Args:
        prompts: the system prompts by name.
        settings: with the model, and `cache`; without it there is no line.
    """
    facts = settings.facts
    if not settings.cache or facts.caches_from is None:
        return ""
    tokens = {name: round(len(text) / facts.characters, -2) for name, text in prompts.items()}
    short = [f"{n} (about {t:,.0f})" for n, t in tokens.items() if t < NEAR * facts.caches_from]
    if not short:
        return ""
    return (
        f"cache=true: {settings.model_name} caches prompts of at least {facts.caches_from:,}"
        f" tokens; too short or nearly too short: {', '.join(short)}"
    )
