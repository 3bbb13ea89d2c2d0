"""Which runs make an arm."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.compare.arms import (
    Arm,
    Run,
    arms_of_sweep,
    find,
    in_short,
    matches,
    parse_arm,
    parse_selection,
    select_arms,
)
from islandgp.compare.measures import read_runs
from islandgp.errors import RunError, StudyError
from islandgp.plain import flatten
from islandgp.records.folder import RunFolder
from islandgp.records.sweep import Sweep, SweepJob, write_sweep
from islandgp.results import load
from tests.compare.fake_runs import config, fake_run, written
from tests.tracking.folders import closed_run


def _entry(supervisor: str = "expert", seed: int = 0, **changes: object) -> Run:
    configuration = config(supervisor, seed, **changes)
    return Run(Path(f"{supervisor}-{seed}"), configuration, flatten(configuration), finished=True)


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        ("supervisor=expert", True),
        ("supervisor.name=expert", True),
        ("supervisor=baseline", False),
        ("supervisor=expert seed=3", True),
        ("seed=range(3)", False),
        ("seed=range(2, 5) supervisor=expert", True),
        ("seed=range(4)", True),
        ("gp.mutate_elites=true", True),
        ("gp.mutation_rate=0.4", True),
        ("gp.mutation_rate=0.40", True),
        ("gp.mutation_rate=4e-1", True),
        ("gp.mutation_rate=+.4", True),
        ("gp.mutation_rate=4_0e-2", True),
        ("gp.mutation_rate=4e-2", False),
        ("gp.mutation_rate=much", False),
        ("gp.population=3e1", True),
        ("gp.trees.depth=[2,3.0]", True),
        ("gp.trees.depth=[ 2, 3 ] seed=3", True),
        ("gp.trees.depth=[2]", False),
        ("name='default' seed=3", True),
        ('name="my sweep"', False),
        ("name=3e0", False),
        ("default", True),
        ("name=default", True),
        ("other_sweep", False),
        ("no.such.key=1", False),
    ],
)
def test_what_people_type(text: str, fits: bool) -> None:
    """Keys of the configuration with YAML values, ranges of seeds, short names, sweep names."""
    assert matches(_entry(seed=3), parse_selection(text)) is fits


def test_names_are_texts() -> None:
    """They may hold a space, in quotes; a name that looks like a number is none."""
    assert matches(_entry(name="my sweep"), parse_selection("seed=0 name='my sweep'"))
    assert matches(_entry(name="10"), parse_selection("name=10"))
    assert not matches(_entry(name="10"), parse_selection("name=1e1"))


def test_an_arm_has_a_name_and_a_selection() -> None:
    """The part before the first = is the name; the rest may hold more of them."""
    assert parse_arm("a=supervisor=expert seed=1") == ("a", "supervisor=expert seed=1")
    for text in ("expert", "=supervisor=x", "a=", "a b=c=d"):
        with pytest.raises(StudyError, match="Expected --arm NAME"):
            parse_arm(text)


def test_an_empty_selection_lists_the_runs() -> None:
    """The message lists sweeps, supervisors and seeds, and counts unfinished runs."""
    runs = [_entry("expert", 0), _entry("expert", 1), _entry("baseline", 4)]
    with pytest.raises(StudyError) as error:
        select_arms(["x=supervisor=llm"], runs)
    assert "name=default supervisor=expert: 2 runs, seeds 0-1" in str(error.value)
    assert "name=default supervisor=baseline: 1 runs, seeds 4" in str(error.value)


def test_runs_of_several_sweeps_are_listed(tmp_path: Path) -> None:
    """A folder inside another one adds nothing."""
    for name in ("one", "two"):
        fake_run(folder=tmp_path / name, name=name)
    runs = find([tmp_path, tmp_path / "one"])
    assert len(runs) == 2
    assert len(find([tmp_path], "one")) == 1
    with pytest.raises(StudyError, match=r"sweep named no, found none\.\nThere are:\n  name=one"):
        find([tmp_path], "no")
    with pytest.raises(StudyError, match="those of 2; give --name SWEEP"):
        arms_of_sweep(runs)


def test_an_invalid_range() -> None:
    """A range must hold numbers."""
    with pytest.raises(StudyError, match=r"Expected range\(N\) or range\(M, N\), found range\(a\)"):
        parse_selection("seed=range(a)")
    with pytest.raises(StudyError, match=r"found range\."):
        parse_selection("seed=range")


def test_an_unknown_key_is_named() -> None:
    """A mistyped key and a value that no run has give different messages."""
    with pytest.raises(StudyError, match=r"no key supervisr\."):
        select_arms(["x=supervisr=expert"], [_entry()])


def test_unfinished_runs_are_left_out_and_named(tmp_path: Path) -> None:
    """An unfinished run is no data, and the report mentions it; an arm needs a finished one."""
    fake_run(seed=0, folder=tmp_path / "a")
    run = fake_run(seed=1)
    records = [*RunFolder(run.path).generations()]
    written(tmp_path / "b", records, run.config, finished=False)
    (arm,), notes = select_arms(["x=supervisor=expert"], find([tmp_path]))
    assert arm.seeds == (0,)
    assert "1 runs (b) are left out as unfinished" in notes[0]
    with pytest.raises(StudyError, match="found 1 unfinished"):
        select_arms(["x=supervisor=expert seed=1"], find([tmp_path]))


def test_a_configuration_without_end_is_damaged(tmp_path: Path) -> None:
    """Brackets within brackets do not end the process; the file is named."""
    fake_run(folder=tmp_path / "run")
    (tmp_path / "run" / "config.yaml").write_text("[" * 3_000)
    with pytest.raises(RunError, match=r"config\.yaml, found a damaged file"):
        find([tmp_path])


def test_edited_records_are_refused(tmp_path: Path) -> None:
    """Digits that were changed by hand, a line too many, a line too few: one line each."""
    folder = closed_run(tmp_path / "one", tmp_path)
    arm = Arm("a", "", tuple(find([tmp_path])))
    assert len(read_runs([arm])[0]) == 5
    file = folder.path / "generations.jsonl"
    sound = file.read_bytes()
    lines = sound.splitlines(keepends=True)
    damaged = r"generations\.jsonl, found a damaged file \(changed\)"
    for edited in (
        sound.replace(b'"generation":2,', b'"generation":3,', 1),
        b"".join([*lines, lines[-1]]),
        b"".join(lines[:-1]),
    ):
        file.write_bytes(edited)
        with pytest.raises(RunError, match=damaged) as error:
            read_runs([arm])
        assert "\n" not in str(error.value)
        with pytest.raises(RunError, match=damaged):
            _ = load(tmp_path).generations


def test_no_folder_of_runs(tmp_path: Path) -> None:
    """A missing folder is reported with the remedy."""
    with pytest.raises(StudyError, match="give another folder"):
        find([tmp_path / "nothing"])


def test_spans() -> None:
    """Numbers in short."""
    assert in_short([0, 1, 2, 5, 7, 8]) == "0-2, 5, 7-8"


def test_a_printed_name_selects_an_arm(tmp_path: Path) -> None:
    """The arms of a sweep have the names of its table, in its order; each is a selection."""
    jobs = []
    for value in (100, 1000, 360):
        for seed in (0, 1):
            folder = f"expert-{value}-{seed}"
            change = {"rewards__events__interaction__base": value}
            fake_run(seed=seed, folder=tmp_path / folder, generations=4, **change)
            choices = ("supervisor=expert", f"rewards.events.interaction.base={value}")
            jobs.append(SweepJob(folder, folder, "expert", seed, choices, ""))
    file = Sweep(tmp_path, "0", 1, (), tuple(jobs))
    write_sweep(file)
    runs = find([tmp_path])
    arms, notes = arms_of_sweep(runs)
    names = [f"interaction.base={value}" for value in (100, 1000, 360)]
    assert [arm.name for arm in arms] == names == list(file.arms())
    assert arms[1].levels == {"rewards.events.interaction.base": "1000"}
    assert [arm.seeds for arm in arms] == [(0, 1)] * 3
    assert notes == []
    selected, _ = select_arms(
        ["Interaction.Base=360", "rest=rewards.events.interaction.base=100"], runs
    )
    assert [arm.name for arm in selected] == [names[2], "rest"]
    assert selected[0] == arms[2]
    assert selected[1].runs == arms[0].runs
