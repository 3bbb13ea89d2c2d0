"""Sweeps over any values: no job is lost, and each has its own folder."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from islandgp.config.compose import Planned, planned, run_folder
from islandgp.errors import ConfigError
from islandgp.records.sweep import Sweep, read_sweep
from islandgp.running import sweep as sweep_run
from islandgp.running.app import main
from islandgp.running.sweep import BASIC, run_sweep
from tests.composed import composed, named
from tests.profiles import examples
from tests.running.commands import TINY, fake

INSTANT = (*TINY, "tracking=off", "progress=off", *fake("Instant"))


def jobs_of(home: Path, *arguments: str) -> list[Planned]:
    """The jobs of a sweep, without running them."""
    args = get_args_parser().parse_args([*arguments, "tracking=off", "progress=off", "-m"])
    return list(planned(args, arguments, home))


def listed(jobs: list[Planned]) -> None:
    """Runs a sweep whose launcher starts no job."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweep_run, "launch", lambda *_: None)
        run_sweep(jobs, "c", Path.cwd())


def file_in(folder: Path) -> Sweep:
    """The file of a sweep's folder: its command and jobs."""
    file = read_sweep(folder)
    assert file is not None
    return file


def spellings(number: float) -> list[str]:
    """Ways to write a number that Hydra reads as a number."""
    return [repr(number), f"{number:.3f}", f"{number:.3e}", f"+{number!r}"]


def numbers() -> st.SearchStrategy[list[str]]:
    """Mutation rates that differ, each spelled in some way."""
    thousandths = st.lists(st.integers(0, 1000), min_size=2, max_size=3, unique=True)
    spelled = thousandths.flatmap(
        lambda values: st.tuples(*(st.sampled_from(spellings(n / 1000)) for n in values))
    )
    return spelled.map(lambda values: [f"gp.mutation_rate={','.join(values)}"])


def lists() -> st.SearchStrategy[list[str]]:
    """Lists that differ."""
    pairs = st.tuples(st.integers(), st.integers())
    return st.lists(pairs, min_size=2, max_size=3, unique=True).map(
        lambda depths: [f"gp.trees.depth={','.join(f'[{a}, {b}]' for a, b in depths)}"]
    )


def texts() -> st.SearchStrategy[list[str]]:
    """Texts that differ: with spaces, quotes, slashes, any script, and too long for a folder."""
    signs = st.sampled_from("aA0 .,-_=/|[](){}'\"$~:;#%&*?<>!äß東")
    text = st.text(signs, min_size=1, max_size=20) | st.integers(300, 302).map("x".__mul__)
    return st.lists(text.map(str.strip).filter(bool), min_size=2, max_size=3, unique=True).map(
        lambda values: [
            "supervisor=replay",
            f"supervisor.policy.transcript={','.join(map(quoted, values))}",
        ]
    )


def quoted(text: str) -> str:
    """A text as Hydra reads it."""
    return '"' + text.replace('"', '\\"') + '"'


def split(home: Path, *arguments: str) -> list[Planned]:
    """The jobs of a sweep as `planned` gives them, but not composed, which takes long.

    Their configurations hold the overrides alone.
    """
    (batch,) = BasicSweeper.split_arguments(
        OverridesParser.create().parse_overrides(arguments), None
    )
    return [
        Planned(
            tuple(overrides),
            {**named(composed(overrides[-1])), "overrides": overrides},
            composed(overrides[-1]),
            run_folder(named(composed(overrides[-1])), overrides, home),
            " ".join(overrides),
            {"_target_": BASIC},
        )
        for overrides in batch
    ]


def check_all_there(jobs: list[Planned], output: str, file: Sweep) -> None:
    """Each job once, in its own folder, and two seeds in each arm."""
    assert [job.slot for job in file.jobs] == [job.folder.name for job in jobs]
    assert [job.folder for job in file.jobs] == [job.slot for job in file.jobs]
    assert len({job.folder for job in file.jobs}) == len(jobs)
    arms = file.arms()
    assert {tuple(job.seed for job in arm_jobs) for arm_jobs in arms.values()} == {(0, 1)}
    assert sum(map(len, arms.values())) == len(jobs)
    assert all(" ".join(arm.split()) in output for arm in arms)


@examples(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(numbers() | lists() | texts())
def test_every_job_of_a_sweep_is_in_its_file_and_in_an_arm(
    capsys: pytest.CaptureFixture[str], overrides: list[str]
) -> None:
    """For any values."""
    with TemporaryDirectory() as name:
        jobs = split(Path(name), *overrides, "seed=0,1")
        listed(jobs)
        file = file_in(jobs[0].folder.parent)
    check_all_there(jobs, capsys.readouterr().out, file)


def test_a_launcher_that_breaks_down_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once a job has begun, with the jobs that are not finished; by processes: test_launchers."""
    jobs = jobs_of(tmp_path, "seed=0,1")

    def launch(_: object, jobs: list[Planned], *_others: object) -> None:
        jobs[0].folder.mkdir()
        (jobs[0].folder / "config.yaml").write_text("{}")
        raise OSError("a worker was killed")

    monkeypatch.setattr(sweep_run, "launch", launch)
    assert run_sweep(jobs, "c", tmp_path) == 1
    error = capsys.readouterr().err
    assert "the launcher failed (a worker was killed)" in error
    assert "2 of 2 jobs not finished" in error


@given(st.lists(st.text(min_size=1, max_size=100), min_size=2, max_size=2, unique=True))
def test_different_overrides_have_different_folders_that_any_file_system_takes(
    values: list[str],
) -> None:
    """Letters, digits and a few signs, 180 of them at most."""
    names = [run_folder(named(composed()), [f"a={value}"], Path("/h")).name for value in values]
    assert len(set(names)) == 2
    for name in names:
        assert set(name) <= set(
            "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._=,+-"
        )
        assert len(name) <= 180


@pytest.mark.parametrize(
    "override",
    [
        "gp.mutation_rate=0.30,0.3",
        "gp.mutation_rate=1e-1,0.1",
        "gp.trees.depth=[2,3],[2, 3]",
        "evaluator=serial,processes",
    ],
)
def test_one_run_in_two_spellings_is_refused(tmp_path: Path, override: str) -> None:
    """It would count twice; the message names it, before anything is written."""
    with pytest.raises(ConfigError, match="the same run or in the same folder: expert-seed0"):
        listed(jobs_of(tmp_path, override))
    assert not list(tmp_path.iterdir())


def test_jobs_with_one_folder_name_are_refused(tmp_path: Path) -> None:
    """With the folder and a remedy."""
    overrides = ["supervisor=llm", "supervisor.policy.base_url='http://a','http://b'"]
    expected = r"in the same folder: llm-seed0; .*, or give each of them another name="
    with pytest.raises(ConfigError, match=expected):
        listed(jobs_of(tmp_path, *overrides))


def test_a_sweep_may_be_started_in_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also in one whose name means something to Hydra."""
    folder = tmp_path / "it's a,b=[ä]"
    folder.mkdir()
    monkeypatch.chdir(folder)
    assert main([*INSTANT, "-m"]) == 0
    assert [path.name for path in folder.iterdir()] == ["runs"]


@pytest.mark.slow
def test_a_repeated_run_never_takes_the_folder_of_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second run of rate 0 is not in the folder of rate 0.2, which comes later."""
    monkeypatch.chdir(tmp_path)
    overrides = [*INSTANT, "search=paper", "name=d.2", "-m"]
    assert main([*overrides, "gp.mutation_rate=0"]) == 0
    assert main([*overrides, "gp.mutation_rate=0,0.2", "resume=never"]) == 0
    jobs = file_in(tmp_path / "runs/d.2").jobs
    assert [job.choices[-1] for job in jobs] == ["gp.mutation_rate=0", "gp.mutation_rate=0.2"]
    assert [job.folder.removeprefix(job.slot) for job in jobs] == ["~2", ""]
