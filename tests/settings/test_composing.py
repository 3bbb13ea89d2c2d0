"""Every configuration that the repository ships composes and validates."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.config.settings import Settings
from islandgp.resources import resource
from tests.composed import composed, plain

CONF = resource("conf")
OWN_GROUPS = (
    "domain", "world", "curriculum", "rewards", "classes", "library", "allocation", "gp",
    "search", "supervisor", "evaluator", "tracking",
)  # fmt: skip


def options(group: str) -> list[str]:
    """The names of a group's files."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


@pytest.mark.parametrize("experiment", options("experiment"))
def test_experiments(experiment: str) -> None:
    """`experiment=...` composes, and is called what its file is called."""
    assert composed(f"experiment={experiment}").name == experiment


@pytest.mark.parametrize(
    "choice", [f"{group}={name}" for group in OWN_GROUPS for name in options(group)]
)
def test_options(choice: str) -> None:
    """Each option of each group composes, its class can be imported, and its settings fit."""
    settings = composed(choice)
    for part in (settings.search, settings.supervisor, settings.evaluator, settings.tracking):
        assert part.settings() is not None


def test_supervisors_are_called_what_their_files_are_called() -> None:
    """The name in a record leads back to the file, unless a name says which variant it is."""
    for name in options("supervisor"):
        assert composed(f"supervisor={name}").supervisor.name.startswith(name)


def test_searches_are_called_what_their_files_are_called() -> None:
    """The name in tags and tables is the one that chooses the search."""
    for name in options("search"):
        assert composed(f"search={name}").search.name == name


def test_the_paper_is_the_default() -> None:
    """`experiment=paper` changes nothing but the name."""
    default, paper = plain(), plain("experiment=paper")
    assert {key for key in default if default[key] != paper[key]} == {"name"}


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
    """Each file opens with a comment that says what it holds."""
    first = path.read_text(encoding="utf-8").removeprefix("# @package _global_\n").splitlines()[0]
    assert first.startswith("# ")
    assert len(first) > 15
