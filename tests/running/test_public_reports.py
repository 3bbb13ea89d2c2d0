"""What users of Hydra, MLflow and Optuna reported, rebuilt here: each case names its report."""

from __future__ import annotations

import re
import runpy
import shlex
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import optuna
import pytest
from optuna.trial import TrialState

import islandgp
from islandgp.records.folder import RunFolder
from islandgp.running.app import main
from islandgp.tracking.store import MAX_PARAMETER, Store
from islandgp.tracking.sync import sync
from tests.running.commands import ROOT, TINY, fake
from tests.tracking.folders import place

INSTANT = (*TINY, *fake("Instant"), "gp.generations=2", "gp.validation=0", "progress=off")
QUIET = (*INSTANT, "tracking=off")


@pytest.fixture(autouse=True)
def cwd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def runs(cwd: Path) -> list[RunFolder]:
    """All runs below the working folder."""
    return [RunFolder(path.parent) for path in sorted(cwd.glob("runs/*/*/about.json"))]


def test_one_failure_leaves_the_other_jobs(cwd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Hydra 2551, 2284, 3215: others go on, and each failed job has its message and traceback."""
    broken = fake("Breaks", after=0, how="fault", unless="runs/default/stop")
    assert main([*QUIET, *broken, "seed=0,1,2", "-m"]) == 1
    failed = runs(cwd)
    assert len(failed) == 3
    errors = capsys.readouterr().err
    for run in failed:
        assert f"{run.path.name}: failed: ZeroDivisionError: a fault of the program" in errors
        assert "Traceback" in (run.path / "error.txt").read_text()


def test_the_first_failure_ends_a_sweep_on_request(cwd: Path) -> None:
    """Hydra 2824: a fault of every job need not be seen by every job."""
    broken = fake("Breaks", after=0, how="error")
    assert main([*QUIET, *broken, "seed=0,1,2", "keep_going=false", "-m"]) == 1
    assert len(runs(cwd)) == 1


@pytest.mark.parametrize("value", ["a=b", "50%", "me@here", "a b", "it's", 'a "b"', "ü", "?"])
def test_the_message_quotes_a_text_as_it_works(
    value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Hydra 962, 1074, 1577: what a bare text may not have; the printed word is taken as it is."""
    if main([*QUIET, f"runs={value}"]) != 0:
        (quoted,) = re.findall(r"quotes inside and out: (.*)$", capsys.readouterr().err.strip())
        assert main([*QUIET, *shlex.split(quoted)]) == 0
    assert len([*Path(value).glob("*/*/about.json")]) == 1


@pytest.mark.parametrize(
    "override",
    [
        "gp.trees.depth=[2,4]",
        "gp.mutation.operators={swap:9}",
        f"start={'long/' * 80}x.bt",
    ],
)
def test_a_folder_s_name_is_one_plain_word(cwd: Path, override: str) -> None:
    """Hydra 1832, 3018: brackets, slashes and long values do not reach the file system."""
    named = islandgp.compose(*QUIET, "search=paper", override).folder
    assert named.parent == cwd / "runs/default"
    assert re.fullmatch(r"[\w.=,+-]{1,190}", named.name)


def test_a_file_may_be_a_sweep(cwd: Path) -> None:
    """Hydra 1999, 394: without -m; 2946: its launcher is the one that is used."""
    (cwd / "conf/experiment").mkdir(parents=True)
    (cwd / "conf/experiment/mine.yaml").write_text(
        "# @package _global_\ndefaults:\n  - override /hydra/launcher: basic\n"
        "hydra:\n  mode: MULTIRUN\n  sweeper: {params: {seed: 'range(2)'}}\n"
    )
    assert main(["--config-dir", "conf", "experiment=mine", *QUIET]) == 0
    assert len(runs(cwd)) == 2


def test_a_key_of_one_option_of_a_swept_group(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Hydra 2888: refused before the first job, in one line that names the key."""
    assert main([*QUIET, "search=racing,paper", "search.policy.library=0", "-m"]) == 2
    assert capsys.readouterr().err.startswith("islandgp: search.policy.library: unknown key")
    assert not runs(cwd)


def test_the_same_settings_twice(capsys: pytest.CaptureFixture[str]) -> None:
    """Hydra 1476, 1969: repetitions are seeds; a value that is given twice is refused."""
    assert main([*QUIET, "seed=0,0", "-m"]) == 2
    assert "found two that are the same run or" in capsys.readouterr().err
    assert main([*QUIET, "seed=range(2)", "-m"]) == 0


def test_a_stopped_sweep_goes_on_in_its_folders(cwd: Path) -> None:
    """Hydra 1822, 3328, 125: the same command finishes what was stopped, and runs nothing twice."""
    broken = fake("Breaks", after=1, how="interrupt", unless="calm")
    words = [*QUIET, *broken, "seed=0,1", "-m"]
    assert main(words) == 130
    (first,) = runs(cwd)
    assert first.completed_generations() == 1
    (cwd / "calm").touch()
    assert main(words) == 0
    assert [run.completed_generations() for run in runs(cwd)] == [2, 2]
    changed = [(run.path / "generations.jsonl").stat().st_mtime_ns for run in runs(cwd)]
    assert main(words) == 0
    assert changed == [(run.path / "generations.jsonl").stat().st_mtime_ns for run in runs(cwd)]


@pytest.mark.slow
def test_a_moved_folder_keeps_its_store(cwd: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MLflow 3144, 3764: artifacts are found, and nothing is made at the old place."""
    (cwd / "old").mkdir()
    monkeypatch.chdir(cwd / "old")
    assert main([*INSTANT, "tracking.policy.patience=60"]) == 0
    (cwd / "old").rename(cwd / "new 50%")
    monkeypatch.chdir(cwd / "new 50%")
    new = place(cwd / "new 50%")
    assert [len(each) for each in (sync(Path("runs"), new).known,)] == [1]
    store = Store(new)
    (run,) = store.client.search_runs([store.experiment])
    assert "best.svg" in [file.path for file in store.client.list_artifacts(run.info.run_id)]
    assert not (cwd / "old").exists()


@pytest.mark.slow
def test_a_long_value_is_cut_in_the_store_only(cwd: Path) -> None:
    """MLflow 1870, 1976, 6183: a parameter above the store's limit ends no run."""
    stages = ",".join(f"{{epochs:[{k},{k}],multipliers:{{}}}}" for k in range(1, 250))
    long = f"curriculum.stages=[{stages}]"
    assert main([*INSTANT, "tracking.policy.patience=60", long]) == 0
    store = Store(place(cwd))
    (run,) = store.client.search_runs([store.experiment])
    assert max(map(len, run.data.params.values())) == MAX_PARAMETER
    assert len(runs(cwd)[0].configuration()["curriculum"]["stages"]) == 249


@pytest.mark.slow
def test_first_runs_at_once_share_a_new_store(cwd: Path) -> None:
    """MLflow 1811, 4123; hydraflow 245: no run fails on tables that another one makes."""
    assert main([*QUIET, "seed=0,1,2", "-m"]) == 0
    with ThreadPoolExecutor(3) as threads:
        folders = [run.path for run in runs(cwd)]
        results = list(threads.map(lambda path: sync(path, place(cwd)), folders))
    assert [result.failed for result in results] == [{}, {}, {}]
    store = Store(place(cwd))
    assert len(store.client.search_runs([store.experiment], "tags.`seed` != ''")) == 3


@pytest.mark.slow
def test_a_deleted_store_is_filled_again(cwd: Path) -> None:
    """MLflow 14081: the folders have all records; `sync` makes the store from them."""
    assert main([*QUIET]) == 0
    assert len(sync(cwd / "runs", place(cwd)).sent) == 1
    (cwd / "mlflow.db").unlink()
    shutil.rmtree(cwd / "mlartifacts")
    assert len(sync(cwd / "runs", place(cwd)).sent) == 1


@pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning")
def test_a_stopped_trial_is_not_left_running(cwd: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Optuna 485, 913, 3336, 6132: its state is FAIL, and the next command does its run first."""
    names = runpy.run_path(str(ROOT / "examples/optuna_search.py"))
    words = [w for w in QUIET if w not in ("gp.generations=2", "gp.validation=0")]

    def stop(_: optuna.Trial) -> bool:
        if not (cwd / "calm").exists():
            raise KeyboardInterrupt
        return False

    monkeypatch.setattr(optuna.Trial, "should_prune", stop)
    with pytest.raises(KeyboardInterrupt):
        names["search"](words, 1, "sqlite:///optuna.db", 1)
    (cwd / "calm").touch()
    study = names["search"](words, 1, "sqlite:///optuna.db", 1)
    assert [trial.state for trial in study.trials] == [TrialState.FAIL, TrialState.COMPLETE]
    assert study.trials[0].params == study.trials[1].params
    assert len(runs(cwd)) == 1
