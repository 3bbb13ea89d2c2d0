"""Prompts: the templates of `prompts/`, and the values that are the same in all generations.

A file has a part `# system` and a part `# user` (section 2.4.6). `{{name}}` is replaced by a value;
a name without a value is an error with its place. Text between `{{#name}}` and `{{/name}}` is left
out if the value is empty. Each value follows from the configuration, so that no sentence of a
prompt is untrue of the run.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Final

from islandgp.bt.core.condition import FLAG_OPERATORS, OPERATORS
from islandgp.bt.core.kinds import KINDS, REPEATS
from islandgp.bt.core.parameters import described, signature
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain import Domain, Reward, RewardTable
from islandgp.errors import SupervisionError
from islandgp.gp.edits import EDITS
from islandgp.resources import resource
from islandgp.scoring.classes import Classes
from islandgp.supervision.base import RunContext
from islandgp.supervision.library import Library
from islandgp.supervision.state_json import words
from islandgp.text import title

_VARIABLE: Final = re.compile(r"\{\{\s*#?\s*([A-Za-z_][\w.]*)\s*\}\}")
_SECTION: Final = re.compile(r"\{\{#([A-Za-z_][\w.]*)\}\}(.*?)\{\{/\1\}\}", re.DOTALL)
_MARK: Final = re.compile(r"\{\{[#/][\w.]*\}\}")
_PART: Final = re.compile(r"^# (system|user)\s*$", re.MULTILINE)

PROMPT_SETS: Final = ("paper", "informed")
"""The prompts of the folder `prompts`, without or with what a model can learn of the run."""
SMALL_SET: Final = "small"
"""The prompts for small models, whose answers are decoded by a grammar."""
MAX_REWARDS: Final = 2000  # most characters of rewards that are not a table of events


@dataclass(frozen=True, slots=True)
class Prompt:
    """One file of `prompts/`."""

    name: str
    system: str  # template, may be empty
    user: str  # template

    @property
    def variables(self) -> set[str]:
        """The names that the templates use."""
        return set(_VARIABLE.findall(self.system + self.user))


def load_prompt(name: str, setting: str) -> Prompt:
    """Reads a file of a prompt set: of `paper`, `informed`, `small`, or of another folder.

    A file that the folder lacks is that of `paper`.

    Raises:
        SupervisionError: there is no such folder, or the file has no parts.
    """
    shipped = resource("prompts")
    folder = shipped if setting in PROMPT_SETS else Path(setting)
    folder = shipped / SMALL_SET if setting == SMALL_SET else folder
    path = folder / f"{name}.md"
    if folder.is_dir() and not path.exists():
        path = shipped / f"{name}.md"
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise SupervisionError(
            f"Expected UTF-8 text in {path}, found {error.reason}; save it as UTF-8."
        ) from None
    except OSError as error:
        raise SupervisionError(f"Expected a prompt in {path}, found none: {error}.") from None
    head, *rest = _PART.split(text)
    parts = dict(zip(rest[::2], rest[1::2], strict=True))
    if head.strip() or "user" not in parts:
        raise SupervisionError(
            f"Expected {path} to have a part `# user`, perhaps after a part `# system`,"
            f" found {', '.join(f'# {part}' for part in parts) or 'none of them'}."
        )
    return Prompt(name, parts.get("system", "").strip(), parts["user"].strip())


def render(prompt: Prompt, values: Mapping[str, str]) -> tuple[str, str]:
    """The system text and the user text with every variable filled in.

    Raises:
        SupervisionError: a variable has no value; the message names it.
    """
    return fill(prompt.system, prompt.name, values), fill(prompt.user, prompt.name, values)


def fill(template: str, name: str, values: Mapping[str, str]) -> str:
    """A template with every variable filled in; `name` is that of its file, for errors."""

    def value_of(match: re.Match[str]) -> str:
        if match[1] in values:
            return values[match[1]]
        line = template.count("\n", 0, template.find(match[0])) + 1
        near = get_close_matches(match[1], values, 1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(sorted(values))}"
        text = template.splitlines()[line - 1].strip()
        raise SupervisionError(
            f"prompts/{name}.md: expected a known variable, found {match[0]} in {text!r}; {hint}"
        )

    for match in _VARIABLE.finditer(template):
        value_of(match)
    filled = _SECTION.sub(lambda match: match[2] if values[match[1]] else "", template)
    if unpaired := _MARK.search(filled):
        raise SupervisionError(
            f"prompts/{name}.md: expected {{{{#name}}}} and {{{{/name}}}} in pairs, one pair in no"
            f" other, found {unpaired[0]} alone"
        )
    return _VARIABLE.sub(value_of, filled)


def _lines(meanings: Mapping[str, str]) -> str:
    return "\n".join(f"- {name}: {meaning}" for name, meaning in meanings.items())


SYNTAX: Final = {
    "parallel": "parallel success one|all failure one|all { NODE NODE ... }",
    "inverter": "inverter { NODE }",
    "repeater": "repeater N { NODE }",
    "when": "when CONDITION abort none|self|lower|both { NODE }",
    "action": "NAME",
}
"""How nodes of a kind are written; other composites are `KIND { NODE NODE ... }`."""


def language(vocabulary: Vocabulary) -> str:
    """The reference of the language: the paper's kinds of nodes, and the domain's vocabulary."""
    nodes = {
        f"`{SYNTAX.get(name, f'{name} {{ NODE NODE ... }}')}`": kind.meaning
        for name, kind in KINDS.items()
        if kind.paper
    }
    numbers = {n: k.meaning for n, k in vocabulary.keys.items() if not k.flag and not k.words}
    choices = {
        n: f"{k.meaning}: {' | '.join(k.words)}" for n, k in vocabulary.keys.items() if k.words
    }
    flags = {name: key.meaning for name, key in vocabulary.keys.items() if key.flag}
    has_resources = any(action.uses for action in vocabulary.actions.values())
    shared = "; two that use the same resource never run in the same tick" * has_resources
    actions = {
        signature(name, a.arguments): described(a.meaning, a.arguments, a.uses)
        for name, a in vocabulary.actions.items()
    }
    parts = [
        "A tree is one node. Blanks and line ends mean nothing; there are no commas.\n\n"
        f"{_lines(nodes)}",
        f"N is a whole number from {REPEATS[0]} to {REPEATS[1]}; `success`, `failure` (of how many"
        " children; all and one) and `abort` can be left out. A condition compares keys, joined by"
        f" `and`, `or`, `not` and brackets.\n\n{words()['ticks'].strip()}",
        f"Actions{shared}:\n{_lines(actions)}",
        f"Keys that are numbers, compared with one of {' '.join(OPERATORS)}:\n{_lines(numbers)}"
        * bool(numbers),
        f"Keys that are yes or no, `when KEY` or `when {FLAG_OPERATORS[1]} KEY`:\n{_lines(flags)}"
        * bool(flags),
        f"Keys that are words, compared by == or !=:\n{_lines(choices)}" * bool(choices),
    ]
    return "\n\n".join(filter(None, parts))


def fixed_values(context: RunContext) -> dict[str, str]:
    """The values that are the same in all generations, by variable."""
    schema, classes = context.schema, context.classes
    meanings = {name: schema.counters[c].meaning for name, c in classes.behaviours.items()}
    targets = {
        **{name: f"shows {m}; for a population that lacks it" for name, m in meanings.items()},
        **words()["aims"],
    }
    kinds = {f"{n} (needs {k.needs})": k.meaning for n, k in EDITS.items()}
    staged = stages_differ_by(context)
    values = {
        "task": schema.task,
        "next": _next(context),
        "habits": "\n".join(f"- {habit}" for habit in schema.habits),
        "tiers": "\n".join(_tiers(context)),
        "agent": classes.agent,
        "milestone": title(classes.milestones[0]),
        "top_milestone": title(classes.milestones[-1]),
        "language": language(schema.vocabulary),
        "actions": _lines({n: a.meaning for n, a in schema.vocabulary.actions.items()}),
        "keys": _lines({n: key.meaning for n, key in schema.vocabulary.keys.items()}),
        "targets": _lines(targets),
        "rewards": _rewards(context),
        "episode": "\n".join(f"- {line}" for line in _episode(context)),
        "judged": _judged(context),
        "worlds": _worlds(context),
        "curriculum": " ".join(_curriculum(context)),
        "crisis": _crisis(context),
        "variation": "mutation" if context.by_rate else "crossover and mutation",
        "edit_kinds": _lines(kinds),
        "edit_form": _EDIT_FORM,
        "most_edits": str(context.edits),
        "most_depth": str(context.limits.max_depth),
        "most_nodes": str(context.limits.max_nodes),
        "mutated": _mutated(context),
        "joins": _joins(context),
        "edits_join": _edits_join(context),
    }
    names = {
        "staged": staged,
        "rate": "rate" * context.by_rate,
        "classes": _classes(classes),
        "behaviours": _named(meanings),
        "class_behaviours": ", ".join(classes.specialists.of),
        "milestone_names": ", ".join(classes.milestones),
        "tier_names": _named({n: f"{classes.tier_title(n)}s" for n in classes.tiers}),
        "counters": _counters(context),
        "multiplied": _named(
            {n: m for n, m in schema.components.items() if n in multiplied(context)}
        ),
    }
    return values | {"fields": fill(words()["fields"], "words", names).strip()}


def _named(meanings: Mapping[str, str]) -> str:
    return "; ".join(f"{name}: {meaning}" for name, meaning in meanings.items())


def _counters(context: RunContext) -> str:
    counters = context.schema.counters
    return _named({n: c.meaning + f", {c.unit}" * bool(c.unit) for n, c in counters.items()})


def _classes(classes: Classes) -> str:
    s = classes.specialists
    mostly = {name: f"mostly does {name}" for name in s.of}
    idle = {s.idle: f"does none of {', '.join(s.of)}"}
    return _named({**idle, **mostly, s.mixed: "none of them dominates"})


def _next(context: RunContext) -> str:
    if not context.lag:
        return "the next generation"
    return f"the generation {context.lag + 1} generations after the one in the report"


def _mutated(context: RunContext) -> str:
    """What the mutation rate hits; "" for a search without one."""
    if not context.by_rate:
        return ""
    tree = " and a tree that you write" * context.inject
    if context.gp.mutate_elites:
        return f"Each individual is mutated with this chance, also the best ones{tree}."
    return f"Each child is mutated with this chance; the best individuals{tree} are kept unchanged."


def _joins(context: RunContext) -> str:
    """What happens to a tree that the model writes."""
    when = _next(context)
    if not context.by_rate:
        return (
            f"It is evaluated in {when}, unchanged; the search then treats it like all other"
            " evaluated trees."
        )
    if context.gp.mutate_elites:
        return f"It joins {when}, is mutated with the same chance as all others, and evaluated."
    return f"It joins {when} unchanged and is evaluated; mutation leaves it alone."


def _edits_join(context: RunContext) -> str:
    return (
        f"Each edited tree joins {_next(context)} in a slot of its own and is compared"
        " with the tree before the edit in the same worlds."
    )


def _crisis(context: RunContext) -> str:
    crisis = context.crisis
    return (
        f"A crisis is a diversity below {crisis.diversity_below:g}, or more than"
        f" {crisis.stagnant_epochs_above:g} epochs of stagnation (an epoch has"
        f" {context.curriculum.generations_per_epoch} generations): then the mutation rate is"
        f" {crisis.emergency_rate:g}, whatever you answer."
    )


def _tiers(context: RunContext) -> Iterator[str]:
    classes, counters, n = context.classes, context.schema.counters, context.gp.episodes
    where = "in one episode" if n == 1 else f"on the mean of {n} episodes"
    defined: set[str] = set()
    for name, tier in classes.tiers.items():
        bounds = []
        for word, row in (
            ("at least", tier.at_least), ("above", tier.above), ("at most", tier.at_most)
        ):  # fmt: skip
            for measure, value in row.items():
                what = (
                    ""
                    if measure in defined or measure not in counters
                    else (f" ({counters[measure].meaning})")
                )
                defined.add(measure)
                bounds.append(f"{measure}{what} {word} {value:g}")
        bounds += [f"all that a {classes.tier_title(tier.also)} needs"] if tier.also else []
        yield f"- {classes.tier_title(name)}: {where} {', '.join(bounds) or 'anything'}."


_HEAD: Final = re.compile(r"\A(#[^\n]+\n)+#\n")
"""The first paragraph of a file's comment, which is about the library."""


def examples(part: str, library: Library) -> str:
    """The example trees of the prompts for a part: explore or exploit; by default all trees."""
    names = library.examples.get(part)
    if names is None:
        names = tuple(dict.fromkeys(n for t in library.targets.values() for n in t))
    poor = library.examples.get("poor", ())
    lead = "And one to learn from, not to follow:\n\n" if poor else ""
    shown = "\n".join(_example(name, library) for name in names)
    return (
        shown + "\n" * bool(poor and names) + lead + "\n".join(_example(n, library) for n in poor)
    )


def _example(name: str, library: Library) -> str:
    """The text of a library tree with its targets."""
    targets = [target for target, names in library.targets.items() if name in names]
    lead = f"For {', '.join(targets)}:\n\n" if targets else ""
    return f"{lead}```\n{_HEAD.sub('', library.texts[name].strip())}\n```\n"


_EDIT_FORM: Final = (
    '{"kind": KIND, "of": ID, "at": PATH, "branch": TREE, "number": NUMBER, "term": NUMBER,'
    ' "donor": ID, "donor_at": PATH, "reason": TEXT}'
)


def about(domain: Domain, seed: int | None = None) -> str:
    """A domain's description of its world, in general or for a seed; "" if it has none."""
    method = getattr(domain, "about", None)
    general = "" if method is None else str(method())
    if seed is None or method is None:
        return general
    text = str(method(seed))
    return "" if text == general else text


def multiplied(context: RunContext) -> frozenset[str]:
    """The components with a factor in any stage of the run's curriculum."""
    stages = context.curriculum.stages
    return frozenset(name for k in _stages(context) for name in stages[k].multipliers)


def stages_differ_by(context: RunContext) -> str:
    """How the stages of the run differ, in words; "" with a single stage."""
    stages = [context.curriculum.stages[k] for k in _stages(context)]
    factors = len({tuple(sorted(stage.multipliers.items())) for stage in stages}) > 1
    worlds = len(stages) > 1 and any(stage.world for stage in stages)
    names = ["other factors, so another scale of fitness"] * factors + ["other worlds"] * worlds
    return " and ".join(names)


def _stages(context: RunContext) -> dict[int, int]:
    """The first generation of each stage of the run, by the stage's index."""
    firsts: dict[int, int] = {}
    for generation in range(context.generations):
        firsts.setdefault(context.curriculum.stage(generation), generation)
    return firsts


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
        yield f"Why an episode ended: {_named(endings)}."
    yield _judged(context)
    yield _worlds(context)
    yield from _curriculum(context)


def _judged(context: RunContext) -> str:
    n = context.gp.episodes
    if n == 1:
        return "Each individual is judged by one episode a generation."
    return f"Points, counts and tiers of an individual are means over {n} episodes a generation."


def _worlds(context: RunContext) -> str:
    gp = context.gp
    many = gp.episodes > 1
    seeds = f"{'worlds' if many else 'a world'} of its own for each individual"
    if gp.shared_seed:
        seeds = f"the same {'worlds' if many else 'world'} for all individuals"
    if gp.reseed_every == "never":
        return f"The worlds never change ({seeds}), so luck of the world explains no change."
    period = "Every generation" if gp.reseed_every == "generation" else "Every epoch"
    return f"{period} has new worlds ({seeds}), so the best fitness rises and falls by luck too."


def _curriculum(context: RunContext) -> Iterator[str]:
    if multiplied(context):
        yield (
            "Points are multiplied by a factor for each component; the report has those of the"
            " next generation."
        )
    if staged := stages_differ_by(context):
        yield f"Another stage has {staged}: fitness can jump for that alone."


def _rewards(context: RunContext) -> str:
    """Table 3 of the run in words, with the meaning of each component."""
    rewards, schema = context.rewards, context.schema
    lines: Iterable[str]
    if isinstance(rewards, RewardTable):
        lines = [
            f"- {name}: {schema.events[name].meaning}: {_points(each, schema.events[name].amount)}"
            f" ({each.component})"
            for name, each in rewards.events.items()
        ]
        if rewards.maxima:
            maxima = ", ".join(f"{name} {value:g}" for name, value in rewards.maxima.items())
            lines.append(f"- each component is divided by its largest value: {maxima}")
    else:
        lines = [json.dumps(rewards.model_dump(mode="json"))[:MAX_REWARDS]]
    factors = ", before the factors" * bool(multiplied(context))
    return "\n".join(
        (
            f"Points of an event{factors}; the component of the fitness is in brackets:",
            *lines,
            f"Components: {_named(schema.components)}.",
        )
    )


def _points(reward: Reward, amount: str) -> str:
    """The points of one event in words, e.g. "200 and 100 x items"."""
    bands = [f"{band.points:g} if {amount} is below {band.below:g}" for band in reward.bands]
    terms = [f"{reward.base:g}"] if reward.base or not reward.per_unit else []
    terms += [f"{reward.per_unit:g} x {amount}"] if reward.per_unit else []
    parts = [*bands, ("else " if bands else "") + " and ".join(terms)]
    over = f"; nothing up to {reward.over:g} {amount}" if reward.over is not None else ""
    return ", ".join(parts) + over
