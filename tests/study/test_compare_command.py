"""`islandgp compare` as a user meets it, on real runs; the commands are those of docs/study.md."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from islandgp.commands.compare_command import command
from islandgp.errors import IslandError, StudyError
from islandgp.running import app
from tests.running.commands import fake

DOCS = Path(__file__).parents[2] / "docs" / "study.md"


def _documented(start: str) -> list[list[str]]:
    lines = [line.strip() for line in DOCS.read_text().splitlines() if line.startswith("    ")]
    return [shlex.split(line) for line in lines if line.startswith(start)]


(SWEEP,) = _documented("python -m islandgp")
SWEEP_ARMS, SMALL, THREE = _documented("islandgp compare")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the documented sweep has run, with fewer and shorter episodes."""
    folder = tmp_path_factory.mktemp("home")
    small = ["gp.population=6", "gp.tournament_size=2", "world.episode.length=10"]
    small += ["gp.generations=4", *fake("Instant")]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert app.main([*small, *SWEEP[3:]]) == 0
    return folder


def _compare(home: Path, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> Result:
    monkeypatch.chdir(home)
    return CliRunner().invoke(command, arguments)


@pytest.mark.slow
def test_the_documented_comparison(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two arms of a real sweep become a page with the champions on unseen worlds."""
    result = _compare(home, [*SMALL[2:], "--worlds", "2", "--workers", "1"], monkeypatch)
    assert result.exit_code == 0, result.output
    assert "Complete Robots come earlier" in result.output
    page = (home / "study" / "expert-baseline" / "index.html").read_text()
    assert "Best robots in 2 unseen worlds" in page
    assert "4" in page


def test_without_arms_a_sweep_has_those_of_its_settings(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same runs and tests as with a selection for each; the folder has the sweep's name."""
    by_sweep = _compare(home, [*SWEEP_ARMS[2:], "--worlds", "0"], monkeypatch)
    selected = _compare(home, [*SMALL[2:], "--worlds", "0", "-o", "selected"], monkeypatch)
    assert by_sweep.exit_code == selected.exit_code == 0, by_sweep.output
    for file in ("runs.csv", "tests.csv"):
        assert (home / "study" / "smoke" / file).read_text() == (
            home / "selected" / file
        ).read_text()


@pytest.mark.usefixtures("blank")
def test_the_documented_three_arms(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three arms on different seeds need --force, and the page notes it."""
    refused = _compare(home, [word for word in THREE[2:] if word != "--force"], monkeypatch)
    assert isinstance(refused.exception, StudyError)
    assert "seeds differ: expert 0-3; low 0-1; high 2-3" in str(refused.exception)
    assert not (home / "study" / "three").exists()
    forced = _compare(home, THREE[2:], monkeypatch)
    assert forced.exit_code == 0
    assert "not comparable: seeds differ: expert 0-3; low 0-1; high 2-3" in forced.output
    assert "not comparable" in (home / "study" / "three" / "index.html").read_text()


def test_an_empty_selection_lists_the_runs(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user who asks for what is not there reads what is."""
    arguments = ["--arm", "a=supervisor=llm", "--arm", "b=supervisor=baseline"]
    error = _compare(home, arguments, monkeypatch).exception
    assert isinstance(error, StudyError)
    assert "name=smoke supervisor=expert: 4 runs, seeds 0-3" in str(error)


@pytest.mark.parametrize("out", ["file", "file/in_it", "/proc/nowhere"])
def test_a_report_that_cannot_be_written_is_one_message(
    home: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, out: str
) -> None:
    """A file in the way of the folder, or a place where none can be made."""
    (tmp_path / "file").touch()
    arguments = [*SMALL[2:], "--worlds", "0", "-o", str(tmp_path / out)]
    error = _compare(home, arguments, monkeypatch).exception
    assert isinstance(error, IslandError)
    assert f"Expected a folder for files in {tmp_path / out}, found: " in str(error)
    assert str(error).endswith("give another with -o.")
