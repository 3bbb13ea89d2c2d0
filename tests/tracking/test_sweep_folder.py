"""A sweep's folder and its parent run in MLflow."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from islandgp.errors import RunError
from islandgp.records.files import pretty
from islandgp.records.folder import RunFolder, Status
from islandgp.records.sweep import Sweep, SweepJob, arm_table, at_work, power_line
from islandgp.tracking.store import Store
from islandgp.tracking.upload import RunUploader, levels_first, parent_run, send_sweep
from tests.records.listed import add_to_manifest
from tests.tracking.folders import begun, closed_run


def job(
    folder: str, *choices: str, seed: int = 0, supervisor: str = "baseline", slot: str = ""
) -> SweepJob:
    """An entry of sweep.json; without a slot the folder is the one that its configuration names."""
    command = f"python -m islandgp {folder}"
    return SweepJob(slot or folder, folder, supervisor, seed, choices, command)


def started_sweep(path: Path, *jobs: SweepJob, command: str = "python -m islandgp -m") -> Sweep:
    """A sweep that has been started and is over."""
    with at_work(path, command, jobs) as sweep:
        return sweep


def send(sweep: Sweep, store: Store) -> str:
    """All jobs, then the sweep; the parent's id."""
    for entry in sweep.jobs:
        if sweep.run(entry).about() is not None:
            RunUploader(sweep.run(entry), store).send(sweep.run(entry).status())
    send_sweep(sweep, store, sweep.status())
    parent = store.find(sweep.id)
    assert parent is not None
    return str(parent.info.run_id)


def test_later_commands_add_their_jobs(tmp_path: Path) -> None:
    """The same job again is one job, and a new folder for it takes its place."""
    started_sweep(tmp_path / "s", job("a-seed0"), job("a-seed1"), command="first")
    repeated = job("a-seed1~2", slot="a-seed1")
    sweep = started_sweep(tmp_path / "s", repeated, job("a-seed2"), command="second")
    assert [entry.folder for entry in sweep.jobs] == ["a-seed0", "a-seed1~2", "a-seed2"]
    assert sweep.commands == ("first", "second")


def test_two_sweeps_cannot_work_in_one_folder(tmp_path: Path) -> None:
    """The second is refused with a remedy."""
    with (
        at_work(tmp_path / "s", "c", [job("a-seed0")]),
        pytest.raises(RunError, match=r"only sweep in .*name=\.\.\."),
        at_work(tmp_path / "s", "c", [job("a-seed0")]),
    ):
        pass


def test_arms_differ_in_anything_but_the_seed(tmp_path: Path) -> None:
    """Overrides that all jobs share are in no arm's name."""
    sweep = started_sweep(
        tmp_path / "s",
        job("1", "supervisor=baseline", "gp.population=8", "gp.episodes=1"),
        job("2", "supervisor=baseline", "gp.population=8", "gp.episodes=2"),
        job("3", "supervisor=expert", "gp.population=8", "gp.episodes=1", supervisor="expert"),
        job("4", "supervisor=baseline", "gp.population=8", "gp.episodes=1", seed=1),
    )
    assert {
        name: [entry.folder for entry in entries] for name, entries in sweep.arms().items()
    } == {
        "baseline gp.episodes=1": ["1", "4"],
        "baseline gp.episodes=2": ["2"],
        "expert gp.episodes=1": ["3"],
    }


def test_the_order_of_a_commands_overrides_does_not_matter(tmp_path: Path) -> None:
    """Seeds that a later command adds in another order are in the same arm."""
    first, second = ("gp.population=8", "gp.episodes=1"), ("gp.episodes=1", "gp.population=8")
    sweep = started_sweep(tmp_path / "s", job("1", *first), job("2", *second, seed=1), job("3"))
    arms = {name: len(entries) for name, entries in sweep.arms().items()}
    assert arms == {"gp.episodes=1 gp.population=8": 2, "baseline": 1}


@pytest.mark.parametrize(
    ("seeds", "words"),
    [
        (5, "5 an arm, with which no paired test can show a difference (least p 0.062); 6 can."),
        (6, "6 an arm; a paired test finds a difference of about 1.7 standard deviations"),
        (30, "30 an arm; a paired test finds a difference of about 0.55 standard deviations"),
    ],
)
def test_what_so_many_seeds_can_show(seeds: int, words: str) -> None:
    """Of two arms, by the arm with fewer seeds; a single arm is not compared."""
    both = [
        SweepJob(f"{arm}{s}", f"{arm}{s}", arm, s, (f"supervisor={arm}",), "")
        for arm, n in (("expert", seeds), ("baseline", seeds + 1))
        for s in range(n)
    ]
    assert power_line(Sweep(Path(), "0", 1, (), tuple(both))).startswith(f"Seeds: {words}")
    assert power_line(Sweep(Path(), "0", 1, (), tuple(both[:seeds]))) == ""


def test_points_of_different_rewards_are_marked(tmp_path: Path) -> None:
    """The head of the column says so; arms with equal rewards have no mark."""
    heads = []
    for key in ("rewards.events.interaction.base", "gp.population"):
        sweep = started_sweep(tmp_path / key, job("1", f"{key}=8"), job("2", f"{key}=9"))
        heads.append(arm_table(sweep).splitlines()[0])
    assert "validation mean, own scale  " in heads[0]
    assert "validation mean  " in heads[1]


def test_an_arm_is_one_row_of_the_table(tmp_path: Path) -> None:
    """Also where a text in its name holds a line break."""
    sweep = started_sweep(tmp_path / "s", job("1", 'a="x|\ny"'), job("2", "a=z"))
    _, *rows = arm_table(sweep).splitlines()
    assert len(rows) == 2
    assert rows[0].startswith('a="x| y"  0 of 1')


def test_a_sweeps_status_is_that_of_its_jobs(tmp_path: Path) -> None:
    """A stopped job counts for more than a failed one, and that for more than finished ones."""
    sweep = started_sweep(tmp_path / "s", job("one"), job("two"))
    closed_run(tmp_path / "s/one", tmp_path)
    assert sweep.status() is Status.KILLED
    closed_run(tmp_path / "s/two", tmp_path, 2).fail(ValueError("x"))
    assert sweep.status() is Status.FAILED
    closed_run(tmp_path / "s/two", tmp_path)
    assert sweep.status() is Status.FINISHED


def test_jobs_find_the_same_parent(home: Path, store: Store) -> None:
    """The first job makes it; a run that is no job of the sweep has none."""
    started_sweep(home / "runs/s", job("one"), job("two"))
    first = parent_run(home / "runs/s/one", store)
    assert first is not None
    assert parent_run(home / "runs/s/two", store) == first
    assert parent_run(home / "runs/s/three", store) is None


def test_factors_come_first_in_the_groups_of_mlflow() -> None:
    """Its list of groups has room for ten letters."""
    arms = ("curriculum=last interaction.base=100", "expert seed=a=b", "expert", "")
    assert [levels_first(arm) for arm in arms] == [
        *("last 100 (curriculum, interaction.base)", "expert a=b (seed)", "expert", "")
    ]


def test_a_finished_sweep_is_described(home: Path, store: Store) -> None:
    """Table and commands as Markdown, children nested."""
    sweep = started_sweep(home / "runs/s", job("b-seed1", seed=1), job("b-seed2", seed=2))
    for seed in (1, 2):
        closed_run(home / f"runs/s/b-seed{seed}", home, seed=seed)
    parent = send(sweep, store)
    run = store.client.get_run(parent)
    assert run.info.status == "FINISHED"
    assert run.info.run_name == "sweep s"
    note = run.data.tags["mlflow.note.content"]
    assert "    baseline  2 of 2    " in note
    assert "    python -m islandgp -m" in note
    names = {file.path for file in store.client.list_artifacts(parent)}
    assert names == {"arms.txt", "sweep.json"}
    for entry in sweep.jobs:
        about = sweep.run(entry).about()
        assert about is not None
        child = store.find(about.id)
        assert child is not None
        assert child.data.tags["mlflow.parentRunId"] == parent


def test_a_sweep_that_goes_on_keeps_its_parent(home: Path, store: Store) -> None:
    """Stopped it is KILLED, then FINISHED, under the same id."""
    sweep = started_sweep(home / "runs/s", job("one"), job("two"))
    closed_run(home / "runs/s/one", home)
    closed_run(home / "runs/s/two", home, 2)
    parent = send(sweep, store)
    run = store.client.get_run(parent)
    assert run.info.status == "KILLED"
    closed_run(home / "runs/s/two", home)
    assert send(sweep, store) == parent
    assert store.client.get_run(parent).info.status == "FINISHED"


def test_a_sweep_at_work_is_running_again(home: Path, store: Store) -> None:
    """The first job of a resumed sweep takes the parent out of its old status."""
    sweep = started_sweep(home / "runs/s", job("one"))
    closed_run(home / "runs/s/one", home, 2)
    parent = send(sweep, store)
    with at_work(sweep.path, "c", [job("one")]):
        folder = begun(home / "runs/s/one", home)
        RunUploader(folder, store).send(Status.RUNNING)
        folder.close()
    assert store.client.get_run(parent).info.status == "RUNNING"


def with_summary(folder: RunFolder, **changes: object) -> None:
    """Change values of a finished run's summary, as if it had ended with them."""
    file = folder.path / "summary.json"
    file.write_text(json.dumps({**folder.summary(), **changes}))
    add_to_manifest(folder.path, file.name)


def test_the_table_shows_how_many_answers_were_the_fallbacks(tmp_path: Path) -> None:
    """In a separate column, over an arm's finished runs, and only where any were."""
    sweep = started_sweep(tmp_path / "s", job("one"), job("two", seed=1), job("three", seed=2))
    for name in ("one", "two"):
        closed_run(tmp_path / "s" / name, tmp_path)
    assert "fallback" not in arm_table(sweep)
    folder = sweep.run(job("one"))
    assert folder.summary()["answers"] == {"total": 4, "fallback": 0, "in_part": 0}
    with_summary(folder, answers={"total": 4, "fallback": 3, "in_part": 1})
    head, row = arm_table(sweep).splitlines()
    assert head.endswith("  diversity  fallback's answers")
    assert row.endswith("  3 of 8, 1 of them in part")


@pytest.mark.parametrize(
    ("firsts", "expected"),
    [
        ((3, None), "not reached (1 of 2)"),
        ((3, 9, None), "9 (2 of 3)"),
        ((3, 4), "3.5 (2 of 2)"),
        ((None, None), "never (0 of 2)"),
    ],
)
def test_the_table_s_median_is_over_all_runs(
    tmp_path: Path, firsts: tuple[int | None, ...], expected: str
) -> None:
    """A run that never had such a robot is later than any: it is not left out of the median."""
    jobs = [job(f"run{k}", seed=k) for k in range(len(firsts))]
    sweep = started_sweep(tmp_path / "s", *jobs, job("open", seed=9))
    for k, first in enumerate(firsts):
        folder = closed_run(tmp_path / "s" / f"run{k}", tmp_path)
        summary = folder.summary()
        summary["first"]["complete"] = first
        (folder.path / "summary.json").write_bytes(pretty(summary))
        add_to_manifest(folder.path, "summary.json")
    (row,) = arm_table(sweep).splitlines()[1:]
    assert row.startswith(f"baseline  {len(firsts)} of {len(firsts) + 1}  ")
    assert f"  {expected}  " in row


def test_a_milestone_of_another_domain_s_arm_is_no_cell_of_this_one(tmp_path: Path) -> None:
    """Where a sweep has several domains, nobody could reach the others' milestones."""
    sweep = started_sweep(tmp_path / "s", job("here"), job("there", "domain=there"))
    for name in ("here", "there"):
        closed_run(tmp_path / "s" / name, tmp_path)
    folder = sweep.run(job("there", "domain=there"))
    with_summary(folder, first={"solved": 3})
    rows = arm_table(sweep).splitlines()
    assert rows[0].endswith("  Solved      diversity")
    assert ["3 (1 of 1)" in row for row in rows[1:]] == [False, True]
