"""The reference of configuration keys has every key, each with a meaning."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.site.generators import script

reference = script("reference")
GROUPS = (
    "world", "rewards", "curriculum", "classes", "library", "allocation", "gp", "search",
    "search/breeding", "supervisor", "evaluator", "tracking", "hydra/launcher",
)  # fmt: skip
PACKAGES = {"search": "", "search/breeding": "search.policy.breeding"}
"""The package of the keys of a group's files, if not the group's name."""


@pytest.fixture(scope="module")
def chapters() -> list[Any]:
    """Made once, as it composes each option."""
    all_chapters: list[Any] = reference.chapters()
    return all_chapters


def leaves(value: Any, path: str) -> Iterator[str]:
    """The path of each value in a file; places in lists are numbers."""
    if isinstance(value, dict) and value:
        for name, inner in value.items():
            if name != "defaults":
                yield from leaves(inner, f"{path}.{name}")
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for i, inner in enumerate(value):
            yield from leaves(inner, f"{path}.{i}")
    else:
        yield path


def configured_keys() -> Iterator[tuple[str, Path]]:
    """Each key that a file of `conf` gives, with the file."""
    for group in GROUPS:
        for file in sorted((reference.CONF / group).glob("*.yaml")):
            values = yaml.safe_load(file.read_text(encoding="utf-8"))
            for path in leaves(values, PACKAGES.get(group, group.replace("/", "."))):
                path = path.removeprefix(".")
                yield path.replace(".@policy", ".policy").replace("_target_", ""), file
    for name in yaml.safe_load((reference.CONF / "config.yaml").read_text()):
        if name not in ("defaults", "hydra"):
            yield name, reference.CONF / "config.yaml"


@pytest.mark.slow
def test_every_key_of_every_file_is_there(chapters: list[Any]) -> None:
    """NAME and N match any name or place; a mapping's keys match the mapping."""
    keys = {key.path for chapter in chapters for key in chapter.keys}
    patterns = [
        re.compile(re.escape(key).replace("NAME", r"[^.]+").replace(r"\.N", r"\.\d+") + r"(\..*)?$")
        for key in keys
    ]
    missing = [
        f"{file.name}: {path}"
        for path, file in configured_keys()
        if not path.endswith(".")
        and not any(pattern.match(path) for pattern in patterns)
        and not any(key.startswith(f"{path}.") for key in keys)
    ]
    assert missing == []
    assert len(keys) > 150


@pytest.mark.slow
def test_every_key_has_a_type_and_a_meaning(chapters: list[Any]) -> None:
    """A new key needs a comment beside its field or in its file."""
    bare = [key.path for chapter in chapters for key in chapter.keys if not key.meaning]
    assert bare == []
    assert all(key.type for chapter in chapters for key in chapter.keys)


@pytest.mark.slow
def test_a_key_by_hand(chapters: list[Any]) -> None:
    """Type, range and default come from the model, the paper's section from the file."""
    keys = {key.path: key for chapter in chapters for key in chapter.keys}
    assert keys["gp.population"].range == ">= 4; <= 10,000"
    assert keys["gp.population"].default == "`30`"
    assert keys["gp.population"].paper == "section 2.3"
    assert keys["gp.reseed_every"].range == "`generation`, `epoch`, `never`"
    assert keys["supervisor.policy.max_tokens"].type == "int"
    assert "| `gp.tournament_size` | int | >= 1 | `3` |" in reference.page(chapters)


def test_links_of_pages_are_made_to_fit() -> None:
    """To pages that moved; a file that the site lacks is named; code stays as it is."""
    pages = script("pages")
    places = pages.sources()
    text = "[a](docs/running.md#x) [b](pyproject.toml) `[c](docs/running.md)`"
    assert pages.rewritten(text, "README.md", places) == (
        "[a](running.md#x) b (`pyproject.toml`) `[c](docs/running.md)`"
    )
    with pytest.raises(SystemExit, match="none; correct the link"):
        pages.rewritten("[a](nowhere.md)", "README.md", places)
