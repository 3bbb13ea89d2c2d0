"""What prompts say of a run's conditions: its episodes, worlds, curriculum and mutation.

All of it follows from the configuration, so it is the same in every generation.
"""

from __future__ import annotations

from collections.abc import Iterator

from islandgp.domain import Domain
from islandgp.supervision.base import RunContext


def run_facts(context: RunContext) -> dict[str, str]:
    """Values for prompts: `episode`, `judged`, `worlds`, `curriculum`, `mutated`, `joins`."""
    return {
        "episode": "\n".join(f"- {line}" for line in _episode(context)),
        "judged": _judged(context),
        "worlds": _worlds(context),
        "curriculum": " ".join(_curriculum(context)),
        "mutated": _MUTATED[context.gp.mutate_elites],
        "joins": _JOINS[context.gp.mutate_elites],
    }


_MUTATED = {
    # by gp.mutate_elites: what the mutation rate hits
    True: "Each individual is mutated with this chance, also the best\n"
    "ones and a tree that you write.",
    False: "Each child is mutated with this chance; the best individuals\n"
    "and a tree that you write are kept as they are.",
}
_JOINS = {
    # by gp.mutate_elites: what becomes of a tree that is injected
    True: "It joins the next generation as an equal: it is\n"
    "mutated, evaluated and selected like all others.",
    False: "It joins the next generation as it is: it is\n"
    "evaluated and selected like all others; mutation leaves it alone.",
}


def about(domain: Domain, seed: int | None = None) -> str:
    """A domain's sentences about its world, or that of a seed; "" where it has none to add."""
    method = getattr(domain, "about", None)
    general = "" if method is None else str(method())
    if seed is None or method is None:
        return general
    found = str(method(seed))
    return "" if found == general else found


def multiplied(context: RunContext) -> frozenset[str]:
    """The components that the curriculum has a factor for in some stage of the run."""
    stages = context.curriculum.stages
    return frozenset(name for k in _stages(context) for name in stages[k].multipliers)


def _stages(context: RunContext) -> dict[int, int]:
    """The first generation of each stage of the run, by the stage's index."""
    found: dict[int, int] = {}
    for generation in range(context.generations):
        found.setdefault(context.curriculum.stage(generation), generation)
    return found


def _episode(context: RunContext) -> Iterator[str]:
    stages = _stages(context)
    texts = {k: about(context.domain_in(g)) for k, g in stages.items()}
    if len(set(texts.values())) == 1:
        if text := next(iter(texts.values())):
            yield text
    else:
        for k, text in texts.items():
            yield f"Stage {k + 1}, from generation {stages[k]} on: {text}"
    if endings := context.schema.endings:
        named = "; ".join(f"{word}: {meaning}" for word, meaning in endings.items())
        yield f"Why an episode ended: {named}."
    yield _judged(context)
    yield from _curriculum(context)
    yield "In each tick of an episode the tree is ticked once."


def _judged(context: RunContext) -> str:
    n = context.gp.episodes
    if n == 1:
        return "Each individual is judged by one episode a generation."
    return f"Points, counts and tiers of an individual are means over {n} episodes a generation."


def _worlds(context: RunContext) -> str:
    how = context.gp
    several = how.episodes > 1
    whose = (
        f"the same {'worlds' if several else 'world'} for all individuals"
        if how.common_world
        else f"{'worlds' if several else 'a world'} of its own for each individual"
    )
    if how.new_worlds == "never":
        return f"The worlds never change ({whose}), so luck of the world explains no change."
    each = "Every generation" if how.new_worlds == "generation" else "Every epoch"
    return f"{each} has new worlds ({whose}), so the best fitness rises and falls by luck too."


def _curriculum(context: RunContext) -> Iterator[str]:
    stages = [context.curriculum.stages[k] for k in _stages(context)]
    if any(stage.multipliers for stage in stages):
        yield (
            "The curriculum multiplies components of the points; the report tells the factors of"
            " the next generation."
        )
    if len({tuple(sorted(stage.multipliers.items())) for stage in stages}) > 1:
        yield "The factors change with the stage: fitness in a new stage may jump for that alone."
    if any(stage.world for stage in stages) and len(stages) > 1:
        yield (
            "The curriculum changes the worlds with the stage: a fall of fitness in a new stage can"
            " come from that."
        )
