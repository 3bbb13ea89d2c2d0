"""`islandgp compare` as a user meets it, on real runs; the commands are those of docs/study.md."""

from __future__ import annotations

import shlex
from pathlib import Path

import pandas as pd  # type: ignore[import-untyped] # its stubs are a package apart
import pytest
from click.testing import CliRunner, Result

from islandgp.commands.comparisons import compare_command as command
from islandgp.errors import IslandError, StudyError
from islandgp.results import load
from islandgp.running import app
from tests.running.commands import fake

DOCS = Path(__file__).parents[2] / "docs" / "study.md"


def _documented(start: str) -> list[list[str]]:
    lines = [line.strip() for line in DOCS.read_text().splitlines() if line.startswith("    ")]
    return [shlex.split(line) for line in lines if line.startswith(start)]


SWEEP, REWARDS = _documented("python -m islandgp")
SWEEP_ARMS, SMALL, THREE, CROSS = _documented("islandgp compare")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the documented sweep has run, with fewer and shorter episodes."""
    folder = tmp_path_factory.mktemp("home")
    small = ["gp.population=6", "world.episode.length=10"]
    small += ["gp.generations=4", *fake("Instant")]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for sweep in (SWEEP, REWARDS):
            assert app.main([*small, *sweep[3:]]) == 0
    return folder


def _compare(home: Path, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> Result:
    monkeypatch.chdir(home)
    return CliRunner().invoke(command, arguments)


@pytest.mark.slow
def test_the_documented_comparison(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two arms of a real sweep become a page with the champions on unseen worlds."""
    result = _compare(home, [*SMALL[2:], "--worlds", "2", "--workers", "1"], monkeypatch)
    assert result.exit_code == 0, result.output
    assert result.output.startswith("Question: Does supervisor matter?\nArms: expert (4 runs, ")
    page = (home / "study" / "expert-baseline" / "index.html").read_text()
    assert "Best robots in 2 unseen worlds" in page
    assert "4" in page


@pytest.mark.usefixtures("blank")
def test_without_arms_a_sweep_has_those_of_its_settings(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same runs and tests as with a selection for each; the folder has the sweep's name."""
    by_sweep = _compare(home, [*SWEEP_ARMS[2:], "--worlds", "0"], monkeypatch)
    selected = _compare(home, [*SMALL[2:], "--worlds", "0", "-o", "selected"], monkeypatch)
    assert by_sweep.exit_code == selected.exit_code == 0, by_sweep.output
    tests = [home / folder / "tests.csv" for folder in ("study/smoke", "selected")]
    assert tests[0].read_text() == tests[1].read_text()


@pytest.mark.slow
@pytest.mark.usefixtures("blank")
def test_the_documented_rewards(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each best robot under the rewards of each arm; points of training are not compared."""
    result = _compare(home, [*CROSS[2:-1], "2", "--workers", "1"], monkeypatch)
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0] == "Question: Does interaction.base matter?"
    assert "interaction.base=100 (2 runs, seeds 0-1); interaction.base=1000 (2 runs" in lines[1]
    assert "the report has all best robots under 2 tasks." in result.output
    page = (home / "study" / "rewards" / "index.html").read_text(encoding="utf-8")
    assert "Best robots in 2 unseen worlds, under the task of each arm" in page
    assert page.count("(own task)") == 2
    factor = load(home / "runs" / "rewards").runs["factor.rewards.events.interaction.base"]
    assert sorted(factor) == [100, 100, 1000, 1000]
    tests = pd.read_csv(home / "study" / "rewards" / "tests.csv")
    assert {"unseen_1", "unseen_2", "counters.interactions"} <= {*tests["measure"]}
    assert not {"mean_fitness_max", "final_fitness_max"} & {*tests["measure"]}


@pytest.mark.usefixtures("blank")
def test_the_documented_three_arms(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three arms on different seeds need --force, and the page notes it."""
    refused = _compare(home, [word for word in THREE[2:] if word != "--force"], monkeypatch)
    assert isinstance(refused.exception, StudyError)
    assert "two arms share no seed: expert 0-3; low 0-1; high 2-3" in str(refused.exception)
    assert not (home / "study" / "three").exists()
    forced = _compare(home, THREE[2:], monkeypatch)
    assert forced.exit_code == 0
    assert "Not comparable: two arms share no seed: expert 0-3; low 0-1; high 2-3" in forced.output
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
    assert f"Expected a place to write {tmp_path / out}, found: " in str(error)
    assert str(error).endswith("give another with -o.")
