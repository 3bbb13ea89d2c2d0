"""The package knows no world: configuration names one, and only its own folder speaks of it."""

from __future__ import annotations

import re
from pathlib import Path

from tests.architecture.sources import PACKAGE, ROOT, imports, modules
from tests.architecture.test_imports import below

ISLAND = PACKAGE / "domains" / "island"
ISLAND_WORDS = re.compile(
    r"humanoid|pickup|garbage|charger|clearing.?point|batteryLevel", re.IGNORECASE
)


def test_no_module_imports_a_domain() -> None:
    """Not even inside a function: a domain comes from configuration alone."""
    importers = {
        f"{i.module} imports {i.name}"
        for i in imports()
        if below(i.name, "islandgp.domains") and not below(i.module, "domains")
    }
    assert importers == set()


def test_domains_do_not_import_each_other() -> None:
    """Nor does one import anything of another one's folder."""
    importers = {
        f"{i.module} imports {i.name}"
        for i in imports()
        if below(i.module, "domains")
        and below(i.name, "islandgp.domains")
        and i.module.split(".")[1:2] != i.name.split(".")[2:3]
    }
    assert importers == set()


def test_domains_know_the_contract_and_no_more() -> None:
    """The language, the contract and scoring are all that a domain is made with."""
    allowed = (
        *("bt", "domain", "domains", "errors", "leaves", "resources", "seeding"),
        "time_limit",
    )
    imported = {
        i.name.removeprefix("islandgp.")
        for i in imports()
        if below(i.module, "domains") and i.top == "islandgp"
    }
    assert {name for name in imported if not any(below(name, place) for place in allowed)} == set()


def sources() -> list[Path]:
    """Files without the island: Python, JavaScript and prompts outside the domains."""
    files = [*modules(), *PACKAGE.rglob("*.js"), *(ROOT / "prompts").glob("*.md")]
    return sorted(path for path in files if not path.is_relative_to(ISLAND.parent))


def test_no_word_of_the_island_outside_the_domains() -> None:
    """Not even in prompts and scripts of pages."""
    files = {
        str(path.relative_to(ROOT))
        for path in sources()
        if ISLAND_WORDS.search(path.read_text(encoding="utf-8"))
    }
    assert files == set()


def test_the_words_are_those_of_the_island() -> None:
    """The pattern finds what the test above looks for: the island's own files have them."""
    text = "".join(path.read_text(encoding="utf-8") for path in ISLAND.glob("*.py"))
    matches = {word.lower() for word in ISLAND_WORDS.findall(text)}
    assert {"humanoid", "pickup", "garbage", "charger", "clearing_point", "batterylevel"} <= matches
