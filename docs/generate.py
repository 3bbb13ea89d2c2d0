"""Writes what is generated from the language's declarations and the island's vocabulary.

    python docs/generate.py [--costs]

These are the tables of docs/language.md and docs/llm.md, between
`<!-- begin NAME -->` and `<!-- end -->`. `tests/trees/test_docs.py` checks them.
With `--costs` it also measures what runs cost, in two runs with the mock, for docs/llm.md.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory
from typing import Any

from islandgp.bt.core.builder import MAX_LEVELS, MAX_NODES, MAX_STEPS
from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.includes import MAX_FILES
from islandgp.bt.core.kind import NodeKind, Sort
from islandgp.bt.core.kinds import ABORTS, COUNTED, COUNTS, KINDS, POLICIES, SECONDS, TIMED
from islandgp.bt.core.language import MAX_CHARACTERS
from islandgp.bt.core.node_builder import MAX_NESTED, MAX_NUMBER, MAX_OPERANDS, MAX_TERMS
from islandgp.commands.setting import configured
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.running.app import main
from islandgp.supervision.llm.budget import ANSWER, cost
from islandgp.supervision.llm.message import Usage
from islandgp.supervision.llm.prompts import PROMPT_SETS
from islandgp.supervision.llm.settings import Facts, LLMSettings
from islandgp.supervision.llm.transcript import Transcript
from tests.llm.mock_model import MockModel
from tests.llm.server import MessagesServer

GENERATIONS = 40  # that are asked about in the default experiment

ROOT = Path(__file__).resolve().parent.parent
TUTORIAL = ROOT / "docs" / "tutorial.md"
LANGUAGE = ROOT / "docs" / "language.md"
COST = ROOT / "docs" / "llm.md"

_PART = re.compile(r"(<!-- begin (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_SORTS = {
    Sort.CONDITION: "KEY < 25",
    Sort.COUNT: "3",
    Sort.SECONDS: "2.5",
    Sort.ASSIGNMENT: "KEY = KEY + 1",
}
_CHILDREN = {(0, 0): "none", (1, 1): "one", (2, 2): "two", (2, 3): "two or three"}


def tables() -> dict[str, str]:
    """The generated parts of docs/language.md, by name."""
    return {
        "nodes": _table(
            ("node", "sign", "children", "what it does"),
            [
                (
                    _example(name, kind),
                    kind.look.sign,
                    _CHILDREN.get(kind.children, "one or more"),
                    kind.meaning,
                )
                for name, kind in KINDS.items()
            ],
        ),
        "actions": _table(
            ("action", "what it does"),
            [(f"`{name}`", action.meaning) for name, action in VOCABULARY.actions.items()],
        ),
        "keys": _table(
            ("key", "asked with", "what it is"),
            [
                (
                    f"`{name}`",
                    f"`when {name}`, `when not {name}`" if key.flag else f"`when {name} < 5`",
                    key.meaning,
                )
                for name, key in VOCABULARY.keys.items()
            ],
        ),
        "words": _table(
            ("where", "words"),
            [
                ("comparison", _codes(OPERATORS)),
                ("between conditions", _codes(["and", "or", "not"])),
                ("`abort`; the last is the default", _codes(ABORTS)),
                (
                    "`success`, `failure` of a parallel",
                    f"{_codes(POLICIES)}, or a whole number from {COUNTS[0]} to {COUNTS[1]:,}",
                ),
                (_codes(TIMED), f"seconds from {SECONDS[0]:g} to {SECONDS[1]:,}"),
                (_codes(COUNTED), f"a whole number from {COUNTS[0]} to {COUNTS[1]:,}"),
            ],
        ),
        "limits": _table(
            ("what", "at most"),
            [
                ("characters of a file", f"{MAX_CHARACTERS:,}"),
                (
                    "characters of a tree's canonical text, each `use` expanded",
                    f"{MAX_CHARACTERS:,}",
                ),
                ("levels of a tree, each `use` expanded", f"{MAX_LEVELS:,}"),
                ("nodes of a tree, each `use` expanded", f"{MAX_NODES:,}"),
                ("a number, with either sign", f"{MAX_NUMBER:,}"),
                ("files that a file includes; their characters count as its own", f"{MAX_FILES:,}"),
                (
                    "nodes and uses that are built for all subtrees and their uses",
                    f"{MAX_STEPS:,}",
                ),
                ("comparisons and flags of a condition", f"{MAX_TERMS:,}"),
                ("keys, numbers and operations in sums of a condition", f"{MAX_OPERANDS:,}"),
                (
                    "levels of a condition: each `and`, `or`, `not` and `(` adds one",
                    f"{MAX_NESTED:,}",
                ),
            ],
        ),
    }


def _example(name: str, kind: NodeKind) -> str:
    """A node of a kind as text."""
    if name == "action":
        return "the name of an action"
    words = [name]
    for argument in kind.arguments:
        value = _SORTS.get(argument.sort) or next(iter(argument.words))
        words.append(value if argument.default is None else f"{argument.name} {value}")
    children = {(0, 0): "", (1, 1): " { x }", (2, 2): " { x y }", (2, 3): " { x y z }"}
    return f"`{' '.join(words)}{children.get(kind.children, ' { ... }')}`"


def measured_characters() -> dict[str, int]:
    """Characters of both questions of a generation by prompt set, the mean of a run with the mock.

    They come from the transcript of a run of a few generations on the island.
    """
    by_prompt_set = {}
    for prompts in PROMPT_SETS:
        with TemporaryDirectory() as home, MessagesServer(answer=MockModel()) as server:
            overrides = [
                "supervisor=llm", "search=paper", f"supervisor.policy.base_url={server.url}",
                f"supervisor.policy.prompts={prompts}", "gp.generations=8",
                "gp.population=20", f"runs='{home}'", "tracking=off", "progress=off",
                "evaluator=serial",
            ]  # fmt: skip
            if main(overrides):
                raise SystemExit("Expected a run with the mock, found an error; see above.")
            transcript = Transcript(next(Path(home).rglob("transcript.jsonl")))
        requests = [a.request for a in transcript.attempts if a.call.part in ("rate", "tree")]
        sizes = [len(request.system) + sum(map(len, request.turns)) for request in requests]
        by_prompt_set[prompts] = round(2 * fmean(sizes))
    return by_prompt_set


def cost_table(characters: Mapping[str, int]) -> str:
    """What a run of 41 generations costs with each model, by prompt set."""
    prices = LLMSettings.model_validate(configured(["supervisor=llm"]).supervisor.policy).prices
    questions = 2 * GENERATIONS
    models: dict[tuple[str, ...], list[str]] = {}  # by what they cost
    for model, price in prices.models.items():
        per_token = prices.facts.get(model, Facts()).characters
        sizes = [round(GENERATIONS * size / per_token) for size in characters.values()]
        costs = [cost(Usage(size, questions * ANSWER), price) for size in sizes]
        models.setdefault(tuple(f"${usd:,.2f}" for usd in costs), []).append(f"`{model}`")
    rows = [(", ".join(names), *costs) for costs, names in models.items()]
    measured = ", ".join(f"{size:,} ({name})" for name, size in characters.items())
    return (
        "Characters of a generation's two questions, as measured in runs with the mock:"
        f" {measured}."
        f" {questions} answers of {ANSWER} tokens; prices of {prices.date}.\n\n"
        + _table(("model", *characters), rows)
    )


def documented_characters(text: str) -> dict[str, int]:
    """The measured characters that a document states."""
    line = text.partition("as measured in runs with the mock: ")[2].partition(".")[0]
    sizes = re.findall(r"([\d,]+) \((\w+)\)", line)
    return {name: int(size.replace(",", "")) for size, name in sizes}


def filled(text: str, parts: Mapping[str, str]) -> str:
    """A text with its generated parts brought up to date."""
    return _PART.sub(lambda part: f"{part[1]}{parts[part[2]]}{part[3]}", text)


def files(tutorial: str) -> dict[str, str]:
    """The trees of the tutorial by file name: blocks that begin with ```bt NAME."""
    return dict(re.findall(r"^```bt (\S+)\n(.*?)^```$", tutorial, re.DOTALL | re.MULTILINE))


def _codes(names: Any) -> str:
    return " ".join(f"`{word}`" for word in names)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    LANGUAGE.write_text(filled(LANGUAGE.read_text(encoding="utf-8"), tables()), encoding="utf-8")
    if "--costs" in sys.argv[1:]:
        costs = {"costs": cost_table(measured_characters())}
        COST.write_text(filled(COST.read_text(encoding="utf-8"), costs), encoding="utf-8")
