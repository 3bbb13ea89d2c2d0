"""Every configuration that the repository ships composes and validates."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.config.settings import Settings
from islandgp.resources import resource
from tests.composed import composed, plain
from tests.profiles import sweep

CONF = resource("conf")


def options(group: str) -> list[str]:
    """The names of a group's files."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


@sweep("experiment", options("experiment"), quick=6)
def test_experiments(experiment: str) -> None:
    """`experiment=...` composes, and is called what its file is called."""
    assert composed(f"experiment={experiment}").name == experiment


def together(*groups: str) -> list[dict[str, str]]:
    """Choices in which each option of each group occurs; groups with fewer repeat theirs."""
    names = [options(group) for group in groups]
    return [
        {group: choices[n % len(choices)] for group, choices in zip(groups, names, strict=True)}
        for n in range(max(map(len, names)))
    ]


@sweep(
    "choice",
    [
        *together("search", "supervisor", "evaluator", "tracking"),
        *together("world", "curriculum", "library"),
        *together("domain"),
        *together("rewards", "classes", "gp"),
    ],
    ids=lambda choice: " ".join(choice.values()),
    quick=8,
)
def test_options(choice: dict[str, str]) -> None:
    """Each option of each group composes, its class can be imported, and its settings fit.

    A search is called what its file is called, and a supervisor's name begins with its file's.
    """
    if choice.get("domain") == "swimmer":
        pytest.importorskip("mujoco", reason="extra `mujoco` is not installed")
    settings = composed(*(f"{group}={name}" for group, name in choice.items()))
    for part in (settings.search, settings.supervisor, settings.evaluator, settings.tracking):
        assert part.settings() is not None
    if "search" in choice:
        assert settings.search.name == choice["search"]
        assert settings.supervisor.name.startswith(choice["supervisor"])


def test_the_paper_differs_from_the_default_by_its_search() -> None:
    """`experiment=paper` is `search=paper` under another name."""
    default, paper = plain("search=paper"), plain("experiment=paper")
    assert {key for key in default if default[key] != paper[key]} == {"name"}
    assert plain()["search"]["name"] == "racing"


def test_smoke_is_small() -> None:
    """`experiment=smoke` keeps every mechanism and cuts population, generations and time."""
    smoke = composed("experiment=smoke")
    assert smoke.gp.population * smoke.gp.generations * smoke.world.episode.length < 10_000


def test_settings_are_values() -> None:
    """Two compositions of the same command are equal, and no setting can be changed."""
    one, two = (Settings.model_validate(plain("experiment=smoke")) for _ in range(2))
    assert one.gp == two.gp
    assert one.world == two.world
    with pytest.raises(ValueError, match="frozen"):
        one.gp.population = 3  # type: ignore[misc]


@pytest.mark.parametrize("path", sorted(CONF.rglob("*.yaml")), ids=lambda p: p.stem)
def test_files_say_what_they_are(path: Path) -> None:
    """Each file opens with a comment on its content."""
    first = path.read_text(encoding="utf-8").removeprefix("# @package _global_\n").splitlines()[0]
    assert first.startswith("# ")
    assert len(first) > 15
