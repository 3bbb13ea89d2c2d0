"""`islandgp compare` as a user meets it, on real runs; the commands are those of docs/study.md."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from islandgp.commands.compare_command import command
from islandgp.errors import IslandError, StudyError
from islandgp.running import app
from islandgp.study.select import find
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
    arguments = [*SMALL[2:], "--worlds", "0", "--no-mlflow", "-o", str(tmp_path / out)]
    error = _compare(home, arguments, monkeypatch).exception
    assert isinstance(error, IslandError)
    assert f"Expected a folder for files in {tmp_path / out}, found: " in str(error)
    assert str(error).endswith("give another with -o.")


@pytest.mark.slow
@pytest.mark.usefixtures("blank")
def test_an_unreachable_store_costs_no_report(
    home: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The files are written without MLflow, and a message reports its failure."""
    (tmp_path / "wall").write_text("no folder")
    arguments = [w for w in SMALL[2:] if w != "--no-mlflow"]
    arguments += ["--worlds", "0", "-o", str(tmp_path / "out")]
    arguments += ["--uri", f"sqlite:///{tmp_path / 'wall' / 'mlflow.db'}"]
    result = _compare(home, arguments, monkeypatch)
    assert result.exit_code == 0
    assert "has not got the report" in result.output
    assert (tmp_path / "out" / "index.html").exists()


@pytest.mark.slow
def test_a_comparison_lives_in_mlflow(
    home: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Runs are fetched by a filter string, and the report becomes a run with its files."""
    from islandgp.tracking.store import MLflowSettings, Place, Store
    from islandgp.tracking.sync import sync

    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    artifacts = str(tmp_path / "artifacts")
    settings = MLflowSettings(uri=uri, artifacts=artifacts, experiment="islandgp", patience=0)
    place = Place.of(settings, tmp_path)
    sync(home / "runs", place)
    assert len(find(home / "runs")) == 8
    arguments = ["--uri", uri, "--worlds", "0", "-o", str(tmp_path / "out")]
    for name in ("expert", "baseline"):
        arguments += ["--arm", f"{name}=mlflow:params.`supervisor.name` = '{name}'"]
    result = _compare(home, arguments, monkeypatch)
    assert result.exit_code == 0, (result.output, result.exception)
    store = Store(place)
    (comparison,) = store.client.search_runs([store.experiment], "tags.kind = 'comparison'")
    assert "p_bh/first_complete" in comparison.data.metrics
    names = {f.path for f in store.client.list_artifacts(comparison.info.run_id)}
    assert {"index.html", "report.md", "figures", "tables", "runs.csv"} <= names
    refused = _compare(home, ["--uri", uri, *arguments[-4:-1], "a=mlflow:nonsense !"], monkeypatch)
    assert isinstance(refused.exception, StudyError)
    assert "Expected an MLflow filter" in str(refused.exception)
    nowhere = tmp_path / "nowhere.db"
    refused = _compare(home, ["--uri", f"sqlite:///{nowhere}", *arguments[-4:]], monkeypatch)
    assert f"Expected an MLflow store in {nowhere}, found none" in str(refused.exception)
    assert not nowhere.exists()
