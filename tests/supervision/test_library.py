"""The trees that supervisors inject: from a folder, or found by a search."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import ConfigError, DomainError, IslandError, UnknownNameError
from islandgp.running.parts import make_library
from islandgp.supervision.library import Library, LibrarySettings, library_folder, read_library
from tests.composed import composed
from tests.running.commands import fake
from tests.samples import CLASSES

EACH = dict.fromkeys(CLASSES.behaviours, ("work",))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with two trees."""
    (tmp_path / "work.bt").write_text("# everything\nselector { PickupGarbage }\n")
    (tmp_path / "rest.bt").write_text("domain island\nPatrolWaypoint\n")
    return tmp_path


def read(folder: Path, **settings: Any) -> Library:
    """The library of a folder, for the paper's classes."""
    library_settings = LibrarySettings.model_validate({"trees": EACH, **settings})
    return read_library(library_settings, folder, VOCABULARY, CLASSES)


def test_trees_and_their_texts(folder: Path) -> None:
    """Every tree that is named is read once, with its comments."""
    library = read(folder, trees={**EACH, "rare": ["rest", "work"]}, examples={"poor": ["rest"]})
    assert library.trees == {
        "rest": parse("PatrolWaypoint"),
        "work": parse("selector { PickupGarbage }"),
    }
    assert library.texts["work"] == "# everything\nselector { PickupGarbage }\n"
    assert library.targets["rare"] == ("rest", "work")
    assert library.examples == {"poor": ("rest",)}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"trees": {**EACH, "flying": ["work"]}},
            r"library\.trees: expected targets \(pickup, humanoid, charging, clearing, rare,"
            r" integration, exploration\), found 'flying'",
        ),
        (
            {"trees": {"pickup": ["work"], "clearing": []}},
            r"library\.trees: expected a tree for each behaviour, missing humanoid, charging,"
            r" clearing",
        ),
        (
            {"trees": {**EACH, "rare": ["wrok"]}},
            r"expected a tree in .*wrok\.bt, found none; there are rest, work",
        ),
        ({"examples": {"poor": ["bad"]}}, r"expected a tree in .*bad\.bt"),
    ],
)
def test_what_is_missing_is_reported(folder: Path, settings: Any, message: str) -> None:
    """A name of no target, a behaviour without a tree, a file that is not there."""
    with pytest.raises(ConfigError, match=message):
        read(folder, **settings)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("selector { Fly }", UnknownNameError, "unknown action 'Fly'"),
        ("selector {", IslandError, "too early"),
        ("domain maze PatrolWaypoint", DomainError, "for the domain 'maze', not for 'island'"),
        ("", IslandError, "the text is empty"),
    ],
)
def test_a_file_that_is_no_tree_is_reported(
    folder: Path, text: str, error: type[Exception], message: str
) -> None:
    """With its path and place, as `islandgp check` does."""
    (folder / "work.bt").write_text(text)
    with pytest.raises(error, match=rf"work\.bt:1:\d+: .*{message}"):
        read(folder)


def test_where_a_folder_is_looked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the working folder, or in the project; the error names the alternative."""
    domain = composed().make_domain()
    assert (library_folder("grammar/examples", domain) / "poor.bt").is_file()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    assert library_folder("mine", domain) == Path("mine")
    with pytest.raises(ConfigError, match=r"found no 'yours'; .*library=automatic"):
        library_folder("yours", domain)


# Found by a search


@pytest.fixture
def automatic(tmp_path: Path) -> Callable[..., Library]:
    """The library of a run with made-up outcomes, whose records are in a folder of the test."""

    def make(*overrides: str) -> Library:
        fewer = "gp.trees.kinds.parallel=0.5"  # with made-up outcomes, trees for all behaviours
        arguments = [*fake("Instant"), "library=automatic", fewer, f"runs={tmp_path}", *overrides]
        settings = composed(*arguments)
        return make_library(settings, settings.make_domain())

    return make


def files(folder: Path) -> list[Path]:
    """The libraries that are kept in a folder of runs."""
    return sorted((folder / ".libraries").glob("*.json"))


def test_a_tree_for_each_behaviour_is_found(
    automatic: Callable[..., Library], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is reported, done once for all runs that are alike, and gives the same trees."""
    first = automatic("seed=1")
    first_line, *others = capsys.readouterr().err.splitlines()
    assert first_line == "islandgp: searching for a tree of each behaviour, once"
    assert [line.split(": ")[1] for line in others] == [*CLASSES.behaviours]
    assert first.targets == {name: (name,) for name in CLASSES.behaviours}
    (file,) = files(tmp_path)
    library = json.loads(file.read_text())
    assert library["trees"] == {name: to_text(tree) for name, tree in first.trees.items()}
    assert library["episodes"] == first.episodes > 0
    assert automatic("seed=2", "supervisor=editor", "name=other") == first
    assert capsys.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        "world.episode.length=60",
        pytest.param("rewards.events.idle.base=-1", marks=pytest.mark.slow),
    ],
)
def test_another_world_has_another_library(
    automatic: Callable[..., Library], tmp_path: Path, change: str
) -> None:
    """What the search depends on is in the name of its file."""
    automatic()
    automatic(change)
    assert len(files(tmp_path)) == 2


@pytest.mark.slow
def test_an_empty_search_is_reported(
    automatic: Callable[..., Library], capsys: pytest.CaptureFixture[str]
) -> None:
    """The library is empty, and a line names the behaviours."""
    none = [f"classes.behaviours.{name}=collisions" for name in CLASSES.behaviours]
    assert automatic(*none).trees == {}
    assert "found no tree for pickup, " in capsys.readouterr().err
