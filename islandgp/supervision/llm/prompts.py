"""Prompts: the Jinja templates of `prompts/`, and the values that are the same in all generations.

A file has a part `# system` and a part `# user` (section 2.4.6). A variable without a value is an
error before the run. `prompts/parts.jinja` has the texts of most variables; each follows from the
configuration, so that no sentence of a prompt is untrue of the run.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.kinds import KINDS, REPEATS
from islandgp.bt.core.parameters import described, signature
from islandgp.domain import Domain, RewardTable
from islandgp.errors import SupervisionError
from islandgp.gp.edits import EDITS
from islandgp.resources import resource
from islandgp.supervision.base import RunContext
from islandgp.supervision.library import Library
from islandgp.text import in_points, title
from islandgp.text_files import read_text_file

if TYPE_CHECKING:
    from jinja2 import Environment

PROMPT_SETS: Final = ("paper", "informed")
"""The prompts of the folder `prompts`, without or with what a model can learn of the run."""
SMALL_SET: Final = "small"  # the prompts for small models, whose answers are decoded by a grammar
MAX_TREE: Final = 1500  # most characters of a tree
MAX_REWARDS: Final = 2000  # most characters of rewards that are not a table of events
_HEAD: Final = re.compile(r"\A(#[^\n]+\n)+#\n")
"""The first paragraph of a tree file's comment, which is about the library."""
_PART: Final = re.compile(r"^# (system|user)\s*$", re.MULTILINE)

SYNTAX: Final = {
    "parallel": "parallel success one|all failure one|all { NODE NODE ... }",
    "inverter": "inverter { NODE }",
    "repeater": "repeater N { NODE }",
    "when": "when CONDITION abort none|self|lower|both { NODE }",
    "action": "NAME",
}
"""How nodes of a kind are written; other composites are `KIND { NODE NODE ... }`."""


@dataclass(frozen=True, slots=True)
class Prompt:
    """One file of `prompts/`."""

    name: str
    system: str  # template, may be empty
    user: str  # template

    def variables(self, known: Mapping[str, Any]) -> set[str]:
        """The names that the templates use. Raises SupervisionError if one is not known."""
        from jinja2.meta import find_undeclared_variables

        with self._faults():
            trees = [environment().parse(text) for text in (self.system, self.user)]
        names = {name for tree in trees for name in find_undeclared_variables(tree)}
        if unknown := sorted(names - known.keys()):
            near = get_close_matches(unknown[0], known, 1)
            hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(sorted(known))}"
            raise SupervisionError(
                f"prompts/{self.name}.md: expected a known variable, found {unknown[0]}; {hint}"
            )
        return names

    def render(self, values: Mapping[str, Any]) -> tuple[str, str]:
        """The system text and the user text. Raises SupervisionError if a template cannot."""
        with self._faults():
            system, user = map(environment().from_string, (self.system, self.user))
            return system.render(values), user.render(values)

    @contextmanager
    def _faults(self) -> Iterator[None]:
        """Turns the exceptions of a template, which may be the user's, into SupervisionError."""
        try:
            yield
        except Exception as error:
            where = f"line {error.lineno}: " if hasattr(error, "lineno") else ""
            raise SupervisionError(
                f"prompts/{self.name}.md: expected a Jinja template that can be filled in, found"
                f" {where}{error}; correct it."
            ) from None


@cache
def environment() -> Environment:
    """Jinja, with our filters; a user's template cannot reach beyond its values."""
    from jinja2 import FileSystemLoader, StrictUndefined
    from jinja2.sandbox import SandboxedEnvironment

    loader = FileSystemLoader(resource("prompts"))
    jinja = SandboxedEnvironment(loader=loader, undefined=StrictUndefined)
    jinja.filters |= {"g": "{:g}".format, "title_of": title, "points": in_points}
    jinja.filters |= {"shortened": lambda t: t if len(t) <= MAX_TREE else t[: MAX_TREE - 3] + "..."}
    return jinja


def load_prompt(name: str, setting: str) -> Prompt:
    """Reads a file of a prompt set: of `paper`, `informed`, `small`, or of another folder.

    A file that the folder lacks is that of `paper`.

    Raises:
        IslandError: there is no such folder, or the file is not text or has no parts.
    """
    shipped = resource("prompts")
    folder = shipped if setting in PROMPT_SETS else Path(setting)
    folder = shipped / SMALL_SET if setting == SMALL_SET else folder
    path = folder / f"{name}.md"
    if folder.is_dir() and not path.exists():
        path = shipped / f"{name}.md"
    if not path.is_file():
        raise SupervisionError(f"Expected a prompt in {path}, found none.")
    head, *rest = _PART.split(read_text_file(path))
    parts = dict(zip(rest[::2], rest[1::2], strict=True))
    if head.strip() or "user" not in parts:
        raise SupervisionError(
            f"Expected {path} to have a part `# user`, perhaps after a part `# system`,"
            f" found {', '.join(f'# {part}' for part in parts) or 'none of them'}."
        )
    return Prompt(name, parts.get("system", "").strip(), parts["user"].strip())


def fixed_values(context: RunContext, library: Library) -> dict[str, Any]:
    """The values that are the same in all generations: the variables of `parts.jinja`."""
    schema, curriculum, rewards = context.schema, context.curriculum, context.rewards
    behaviours = context.classes.behaviours.items()
    plain = "" if isinstance(rewards, RewardTable) else json.dumps(rewards.model_dump(mode="json"))
    firsts: dict[int, int] = {}  # generation of each stage
    for generation in range(context.generations):
        firsts.setdefault(curriculum.stage(generation), generation)
    data = {
        "run": context,
        "behaviours": {name: schema.counters[counter].meaning for name, counter in behaviours},
        "stages": [
            (k + 1, g, curriculum.stages[k], about(context.domain_in(g))) for k, g in firsts.items()
        ],
        "library": library,
        "plain_rewards": plain[:MAX_REWARDS],
        "kinds_of_edits": EDITS,
        "kinds": {name: kind.meaning for name, kind in KINDS.items() if kind.paper},
        "syntax": SYNTAX,
        "repeats": REPEATS,
        "operators": OPERATORS,
        "signature": signature,
        "described": described,
        "headless": partial(_HEAD.sub, ""),
    }
    module = environment().get_template("parts.jinja").make_module(data)
    names = [name for name in vars(module) if not name.startswith("_")]
    return {n: v for n in names if isinstance(v := getattr(module, n), str | int)}


def about(domain: Domain, seed: int | None = None) -> str:
    """A domain's description of its world, or what a seed's world has besides; "" for none."""
    general = domain.about()
    own = general if seed is None else domain.about(seed)
    return "" if seed is not None and own == general else own
