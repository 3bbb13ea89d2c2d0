"""Prompts: the files of `prompts/`, and how they are filled in (section 2.4.6).

A file has a part `# system`, which is the same in every generation, and a part `# user`.
`{{name}}` is replaced by a value; a name without a value is an error with its place. Text between
`{{#name}}` and `{{/name}}` is left out if the value is empty.

`fixed_values` and `run_facts` follow from the configuration and are the same in all generations.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Final

from islandgp.bt.core.condition import FLAG_OPERATORS, OPERATORS
from islandgp.bt.core.kinds import KINDS, REPEATS
from islandgp.bt.core.parameters import described, signature
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain import Domain
from islandgp.errors import SupervisionError
from islandgp.gp.edits import EDITS
from islandgp.resources import resource
from islandgp.scoring.classes import Classes
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import RunContext
from islandgp.supervision.library import Library
from islandgp.supervision.state_json import field_meanings, words
from islandgp.text import in_points, title

_VARIABLE: Final = re.compile(r"\{\{\s*#?\s*([A-Za-z_][\w.]*)\s*\}\}")
_SECTION: Final = re.compile(r"\{\{#([A-Za-z_][\w.]*)\}\}(.*?)\{\{/\1\}\}", re.DOTALL)
_MARK: Final = re.compile(r"\{\{[#/][\w.]*\}\}")
_PART: Final = re.compile(r"^# (system|user)\s*$", re.MULTILINE)

PROMPT_SETS: Final = ("paper", "informed")
"""The shipped prompt sets; `paper` is the folder `prompts` itself."""
SMALL_SET: Final = "small"
"""The prompts for small models, whose answers are decoded by a grammar."""


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


def prompt_folder(setting: str) -> Path:
    """The folder of a prompt set: `paper`, `informed`, `small`, or the path of another folder."""
    if setting == "paper":
        return resource("prompts")
    return resource("prompts") / setting if setting in (*PROMPT_SETS, SMALL_SET) else Path(setting)


def load_prompt(name: str, folder: Path) -> Prompt:
    """Reads `<folder>/<name>.md`. Raises SupervisionError if it is missing or has no parts."""
    path = folder / f"{name}.md"
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
    return _fill(prompt.system, prompt.name, values), _fill(prompt.user, prompt.name, values)


def _fill(template: str, name: str, values: Mapping[str, str]) -> str:
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


_FILES: Final = ("domain:", "include:", "library:")
"""Rules of the grammar that are used in files only."""

_OF_ARGUMENTS: Final = re.compile(
    r"^(?:values?: |FILE: | *\| FILE \| NAME values).*\n|(?<=^action: NAME) values\?", re.MULTILINE
)
"""The rules of the grammar for arguments of actions."""


def shown_grammar(*, arguments: bool) -> str:
    """The grammar without the rules for files, and with the paper's node kinds only.

    Args:
        arguments: True if actions can have arguments.
    """
    text = (resource("grammar") / "bt.lark").read_text(encoding="utf-8").strip()
    parts = [
        part
        for part in text.split("\n\n")
        if "docs/" not in part and not any(line.startswith(_FILES) for line in part.splitlines())
    ]
    grammar = "\n\n".join(parts).replace("domain? include* ", "")
    names = "|".join(name for name, kind in KINDS.items() if not kind.paper)
    grammar = re.sub(
        rf"^[ !]*\|? *({names})\b.*\n| *\| _number\b.*\n",
        "",
        grammar,
        flags=re.MULTILINE | re.IGNORECASE,
    )
    return grammar if arguments else _OF_ARGUMENTS.sub("", grammar)


def language(vocabulary: Vocabulary) -> str:
    """The reference of the language, from the grammar and the domain's vocabulary."""
    arguments = any(action.arguments for action in vocabulary.actions.values())
    numbers = [n for n, key in vocabulary.keys.items() if not key.flag and not key.words]
    choices = {name: key for name, key in vocabulary.keys.items() if key.words}
    flags = [name for name, key in vocabulary.keys.items() if key.flag]
    has_resources = any(action.uses for action in vocabulary.actions.values())
    shared = "; two that use the same resource never run in the same tick" * has_resources
    return "\n".join(
        (
            "The grammar, in Lark's notation:",
            "",
            f"```lark\n{shown_grammar(arguments=arguments)}\n```",
            "",
            "Nodes:",
            *(f"- {name}: {kind.meaning}" for name, kind in KINDS.items() if kind.paper),
            "",
            "How a tree continues from tick to tick:",
            *(f"- {name}: {rule}" for name, rule in words("ticks").items()),
            "",
            f"A repeater counts from {REPEATS[0]} to {REPEATS[1]}. What a `when` stops:",
            *(f"- abort {name}: {rule}" for name, rule in words("abort_rules").items()),
            "",
            f"Actions{shared}:",
            *(
                f"- {signature(name, action.arguments)}:"
                f" {described(action.meaning, action.arguments, action.uses)}"
                for name, action in vocabulary.actions.items()
            ),
            "",
            f"Keys that are numbers, compared with one of {' '.join(OPERATORS)}:",
            *(f"- {name}: {vocabulary.keys[name].meaning}" for name in numbers),
            "",
            f"Keys that are yes or no, as `when KEY` or `when {FLAG_OPERATORS[1]} KEY`:",
            *(f"- {name}: {vocabulary.keys[name].meaning}" for name in flags),
            *(["", "Keys that are words, compared by == or !=:"] if choices else []),
            *(f"- {n}: {key.meaning}: {' | '.join(key.words)}" for n, key in choices.items()),
        )
    )


def fixed_values(context: RunContext) -> dict[str, str]:
    """The constant values: the task, the language, the fields of the state, the examples."""
    schema, classes, library = context.schema, context.classes, context.library()
    meanings = field_meanings(schema, classes, multiplied(context))
    counters = {name: schema.counters[c].meaning for name, c in classes.behaviours.items()}
    targets = {
        **{
            name: f"shows {text}; for a population that lacks it" for name, text in counters.items()
        },
        **words("aims"),
    }
    return {
        "task": schema.task,
        "habits": "\n".join(f"- {habit}" for habit in schema.habits),
        "tiers": "\n".join(_tier(name, classes, context.gp.episodes) for name in classes.tiers),
        "agent": classes.agent,
        "milestone": title(classes.milestones[0]),
        "top_milestone": title(classes.milestones[-1]),
        "language": language(schema.vocabulary),
        "actions": "\n".join(f"- {n}: {a.meaning}" for n, a in schema.vocabulary.actions.items()),
        "keys": "\n".join(f"- {n}: {key.meaning}" for n, key in schema.vocabulary.keys.items()),
        "fields": "\n".join(f"- {name}: {meaning}" for name, meaning in meanings.items()),
        "targets": "\n".join(f"- {name}: {meaning}" for name, meaning in targets.items()),
        **{f"examples.{part}": _examples(part, library) for part in ("explore", "exploit", "poor")},
    }


def _tier(name: str, classes: Classes, episodes: int) -> str:
    tier = classes.tiers[name]
    bounds = [f"{measure} of at least {value:g}" for measure, value in tier.at_least.items()]
    bounds += [f"{measure} above {value:g}" for measure, value in tier.above.items()]
    bounds += [f"{measure} of at most {value:g}" for measure, value in tier.at_most.items()]
    bounds += [f"and all that is asked of {classes.tier_title(tier.also)}s"] if tier.also else []
    where = "in one episode" if episodes == 1 else f"on the mean of {episodes} episodes"
    return f"- {classes.tier_title(name)}: {where} {', '.join(bounds) or 'anything'}."


def _examples(part: str, library: Library) -> str:
    """The example trees of a prompt; by default those of the single behaviours."""
    names = library.examples.get(part)
    if names is None:
        names = (
            ()
            if part == "poor"
            else tuple(dict.fromkeys(n for t in library.targets.values() for n in t))
        )
    lead = "And one to learn from, not to follow:\n\n" if part == "poor" and names else ""
    return lead + "\n".join(_example(name, library) for name in names)


def _example(name: str, library: Library) -> str:
    """The text of a library tree with its targets."""
    targets = [target for target, names in library.targets.items() if name in names]
    lead = f"For {', '.join(targets)}:\n\n" if targets else ""
    return f"{lead}```\n{library.texts[name].strip()}\n```\n"


def urgency(state: PopulationState, rare: float) -> str:
    """The urgency of each behaviour in words, the most urgent first (section 2.4.6).

    `rare` is the share of the population below which a behaviour counts as rare.
    """
    lines = []
    for name in state.rarest_behaviours:
        count = state.now.behaviour_counts[name]
        level = "MISSING" if not count else "rare" if count < rare * state.population else "present"
        lines.append(f"- {name}: {count} of {state.population} individuals do it: {level}")
    return "\n".join(lines)


def progress(state: PopulationState) -> str:
    """The generation, and how fitness and diversity have changed in it, in one line."""
    now = state.now
    return (
        f"Generation {now.generation} of {state.generations}: best fitness {in_points(now.best)}"
        f" ({in_points(state.best_change, '+')}), mean {in_points(now.mean)}"
        f" ({in_points(state.mean_change, '+')}), diversity {now.diversity:.2f}."
    )


_EDIT_FORM: Final = (
    '{"kind": KIND, "of": ID, "at": PATH, "branch": TREE, "number": NUMBER, "term": NUMBER,'
    ' "donor": ID, "donor_at": PATH, "reason": TEXT}'
)


def fixed_edit_values(context: RunContext) -> dict[str, str]:
    """The constant values of `prompts/edits.md`."""
    kinds = (f"- {n} (needs {k.needs}): {k.meaning}" for n, k in EDITS.items())
    return {
        "edit_kinds": "\n".join(kinds),
        "edit_form": _EDIT_FORM,
        "most_edits": str(context.edits),
        "tree_depth": str(context.limits.max_depth),
        "tree_nodes": str(context.limits.max_nodes),
    }


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


_MUTATED: Final = {
    # by gp.mutate_elites: the individuals that are mutated
    True: "Each individual is mutated with this chance, also the best\n"
    "ones and a tree that you write.",
    False: "Each child is mutated with this chance; the best individuals\n"
    "and a tree that you write are kept unchanged.",
}
_JOINS: Final = {
    # by gp.mutate_elites: whether an injected tree is mutated
    True: "It joins the next generation as an equal: it is\n"
    "mutated, evaluated and selected like all others.",
    False: "It joins the next generation unchanged: it is\n"
    "evaluated and selected like all others; mutation leaves it alone.",
}


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
    gp = context.gp
    repeated = gp.episodes > 1
    seeds = (
        f"the same {'worlds' if repeated else 'world'} for all individuals"
        if gp.shared_seed
        else f"{'worlds' if repeated else 'a world'} of its own for each individual"
    )
    if gp.reseed_every == "never":
        return f"The worlds never change ({seeds}), so luck of the world explains no change."
    period = "Every generation" if gp.reseed_every == "generation" else "Every epoch"
    return f"{period} has new worlds ({seeds}), so the best fitness rises and falls by luck too."


def _curriculum(context: RunContext) -> Iterator[str]:
    stages = [context.curriculum.stages[k] for k in _stages(context)]
    if any(stage.multipliers for stage in stages):
        yield (
            "The curriculum multiplies components of the points; the report has the factors of"
            " the next generation."
        )
    if len({tuple(sorted(stage.multipliers.items())) for stage in stages}) > 1:
        yield "The factors change with the stage: fitness in a new stage may jump for that alone."
    if any(stage.world for stage in stages) and len(stages) > 1:
        yield (
            "The curriculum changes the worlds with the stage: a fall of fitness in a new stage can"
            " come from that."
        )
