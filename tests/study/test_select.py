"""Which runs make an arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from islandgp.errors import RunError, StudyError
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import RENAMED, flatten, with_present_names
from islandgp.results import load
from islandgp.study.comparable import compare_arms
from islandgp.study.library import reference_trees
from islandgp.study.select import (
    RunEntry,
    arms_of_sweep,
    find,
    in_short,
    matches,
    named,
    overview,
    parse_arm,
    parse_selection,
    read,
    select,
)
from islandgp.sweep.folder import SweepFolder, SweepJob
from tests.study.fake_runs import config, fake_run, individual, write_run
from tests.tracking.folders import closed_run


def _entry(supervisor: str = "expert", seed: int = 0, **changes: object) -> RunEntry:
    configuration = config(supervisor, seed, **changes)
    return RunEntry(
        Path(f"{supervisor}-{seed}"), configuration, flatten(configuration), finished=True
    )


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
        ("gp.trees.depth=[ 2e0, 3 ] seed=3", True),
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
        select("x", "supervisor=llm", runs)
    assert "name=default supervisor=expert: 2 runs, seeds 0-1" in str(error.value)
    assert "name=default supervisor=baseline: 1 runs, seeds 4" in str(error.value)


def test_a_missing_sweep_is_reported_with_the_existing_ones() -> None:
    """So is a folder without any run."""
    assert named("default", [_entry()]) == [_entry()]
    with pytest.raises(StudyError, match="a sweep named nope, found none; there are default"):
        named("nope", [_entry()])
    with pytest.raises(StudyError, match="there are no runs at all"):
        named("nope", [])


def test_a_range_that_is_none() -> None:
    """A range must hold numbers."""
    with pytest.raises(StudyError, match=r"Expected range\(N\) or range\(M, N\), found range\(a\)"):
        parse_selection("seed=range(a)")
    with pytest.raises(StudyError, match=r"found range\."):
        parse_selection("seed=range")


def test_an_unknown_key_is_named_with_the_nearest() -> None:
    """A mistyped key and a value that no run has give different messages."""
    with pytest.raises(StudyError, match="no key supervisr, did you mean supervisor"):
        select("x", "supervisr=expert", [_entry()])


def test_an_arm_without_a_name_is_reported() -> None:
    """What is before the first = is the name, even where it looks like a key."""
    with pytest.raises(StudyError, match='Did you mean --arm NAME="supervisor=expert"'):
        select(*parse_arm("supervisor=expert"), [_entry()])


def test_unfinished_runs_are_left_out_and_named(tmp_path: Path) -> None:
    """An unfinished run is no data, and the report mentions it."""
    write_run(fake_run(seed=0), tmp_path / "a")
    write_run(fake_run(seed=1), tmp_path / "b", finished=False)
    arm, notes = select("x", "supervisor=expert", find(tmp_path))
    assert arm.seeds == (0,)
    assert "1 unfinished runs are left out (b)" in notes[0]


def test_only_unfinished_runs_are_not_enough(tmp_path: Path) -> None:
    """An arm of unfinished runs is an error with its own remedy."""
    write_run(fake_run(), tmp_path / "a", finished=False)
    with pytest.raises(StudyError, match="found 1 unfinished"):
        select("x", "supervisor=expert", find(tmp_path))


def test_a_folder_is_read_back_as_it_was(tmp_path: Path) -> None:
    """Records, costs, champion and configuration survive the way over the disk."""
    two = [individual("0.0", "random"), individual("0.1", "random", tiers=("complete",))]
    original = fake_run("baseline", 5, best=[1.0], populations=[two])
    run = replace(original, validation=(7, 8), validation_mean=6.5)
    write_run(run, tmp_path / "run")
    (entry,) = find(tmp_path)
    reread = read(entry)
    assert (reread.validation, reread.validation_mean) == ((7, 8), 6.5)
    assert (reread.records, reread.costs, reread.champion) == (run.records, run.costs, run.champion)
    assert reread.flat == run.flat


def test_damaged_records_are_named(tmp_path: Path) -> None:
    """A cut-off file is an error that names the folder, not a traceback."""
    write_run(fake_run(), tmp_path / "run")
    (tmp_path / "run" / "summary.json").write_text("{")
    with pytest.raises(StudyError, match="Expected a finished run's summary in"):
        read(find(tmp_path)[0])


def test_a_configuration_without_end_is_damaged(tmp_path: Path) -> None:
    """Brackets within brackets do not end the process; the file is named."""
    write_run(fake_run(), tmp_path / "run")
    (tmp_path / "run" / "config.yaml").write_text("[" * 3_000)
    with pytest.raises(RunError, match=r"config\.yaml, found a damaged file"):
        find(tmp_path)


def test_edited_records_are_refused(tmp_path: Path) -> None:
    """Digits that were changed by hand, a line too many, a line too few: one line each."""
    folder = closed_run(tmp_path / "one", tmp_path)
    (entry,) = find(tmp_path)
    assert len(read(entry).records) == 5
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
        with pytest.raises(StudyError, match=damaged) as error:
            read(entry)
        assert "\n" not in str(error.value)
        with pytest.raises(RunError, match=damaged):
            _ = load(tmp_path).generations


def test_runs_of_version_0_1_are_refused_in_a_line(tmp_path: Path) -> None:
    """They name no domain; a run outside of the selection has no effect."""
    run = fake_run(seed=0)
    old = {key: value for key, value in run.config.items() if key != "domain"}
    write_run(replace(run, config=old), tmp_path / "old")
    write_run(fake_run(seed=1), tmp_path / "new")
    entries = find(tmp_path)
    assert select("a", "seed=1", entries)[0].seeds == (1,)
    with pytest.raises(StudyError, match=r"old: Expected a run .* found one of version 0\.1") as e:
        select("a", "supervisor=expert", entries)
    assert "\n" not in str(e.value)


def test_no_folder_of_runs(tmp_path: Path) -> None:
    """A missing folder is reported with the remedy."""
    with pytest.raises(StudyError, match="--runs FOLDER"):
        find(tmp_path / "nothing")


def test_spans() -> None:
    """Numbers in short."""
    assert in_short([0, 1, 2, 5, 7, 8]) == "0-2, 5, 7-8"
    assert overview([]) == []


def test_configurations_of_version_0_2_are_read_with_present_names(tmp_path: Path) -> None:
    """An arm of 0.2 is comparable with one of today's."""
    old = "gp: {tournament: 3, new_worlds: never, common_world: true}\n"
    (tmp_path / "config.yaml").write_text(old + "allocation: {tournament: [18, 25]}\nseed: 1\n")
    assert RunFolder(tmp_path).configuration() == {
        "gp": {"tournament_size": 3, "reseed_every": "never", "shared_seed": True},
        "allocation": {"tournament_children": [18, 25]},
        "seed": 1,
    }


def test_every_renamed_key_has_its_present_name() -> None:
    """At any depth; other keys are unchanged, also those with the name of a renamed one."""
    for old, new in RENAMED.items():
        *path, last = old.split(".")
        config: dict[str, Any] = {last: 1, "other": 2}
        for key in reversed(path):
            config = {key: config}
        present = flatten(with_present_names(config))
        assert present == {new: 1, f"{'.'.join(path)}.other": 2}
    assert with_present_names({"shown": {"tournament": 1}}) == {"shown": {"tournament": 1}}


def test_a_library_of_another_version_is_one_clear_error() -> None:
    """Expected, found and the remedy."""
    with pytest.raises(
        RunError, match=r"found library\.colour: .*; look at the run with the version"
    ):
        reference_trees({"library": {"folder": None, "colour": "red"}})


def test_arms_of_a_sweep_are_named_and_ordered(tmp_path: Path) -> None:
    """By supervisor and settings, those without a supervisor last; unfinished runs are noted."""
    for supervisor in ("baseline", "expert"):
        for seed in (0, 1):
            run = fake_run(supervisor, seed)
            write_run(
                run, tmp_path / f"{supervisor}-{seed}", finished=(supervisor, seed) != ("expert", 1)
            )
    arms, notes = arms_of_sweep(find(tmp_path))
    assert [(arm.name, arm.selection, arm.seeds) for arm in arms] == [
        ("expert", "supervisor=expert", (0,)),
        ("baseline", "supervisor=baseline", (0, 1)),
    ]
    assert "expert: 1 unfinished runs are left out (expert-1)" in notes[0]


def _sweep(folder: Path, arms: Mapping[tuple[str, ...], dict[str, Any]]) -> None:
    """Writes a sweep with a run for each arm, given as overrides and changes of fake_run."""
    jobs = []
    for number, (choices, changes) in enumerate(arms.items()):
        write_run(fake_run("expert", 0, **changes), folder / f"job{number}")
        job = f"job{number}"
        jobs.append(SweepJob(job, job, "expert", 0, ("gp.population=30", *choices), 4, ""))
    SweepFolder(folder).open("sweep", jobs)


def test_arms_of_a_sweep_may_differ_in_what_it_varies(tmp_path: Path) -> None:
    """Also in added keys, packages of groups, whole mappings, and keys of a later command only."""
    _sweep(
        tmp_path,
        {
            (): {},
            ("+perturb.noise=1",): {"perturb": {"noise": 1}},
            ("search/breeding=paper",): {"search": {"policy": {"breeding": {"lists": 1}}}},
            ("gp.founders=true",): {"gp__founders": True},
        },
    )
    arms, _ = arms_of_sweep(find(tmp_path))
    assert [arm.name for arm in arms] == [
        "expert",
        "expert-perturb.noise-1",
        "expert-search-breeding-paper",
        "expert-gp.founders-true",
    ]
    assert not compare_arms(arms).comparability_warnings


def test_arms_of_a_sweep_must_not_differ_in_other_keys(tmp_path: Path) -> None:
    """Neither in a key with the same beginning nor in one that defines fitness."""
    _sweep(
        tmp_path,
        {
            ("gp.mutation=1",): {"gp__mutation": 1, "gp__mutation_rate": 0.1},
            ("gp.mutation=2",): {"gp__mutation": 2, "gp__mutation_rate": 0.2},
        },
    )
    arms, _ = arms_of_sweep(find(tmp_path))
    with pytest.raises(StudyError, match=r"found:\n  gp\.mutation_rate differs: 0\.1") as info:
        compare_arms(arms)
    assert "gp.mutation differs" not in str(info.value)


def test_arms_of_a_sweep_have_different_names(tmp_path: Path) -> None:
    """Overrides that differ in replaced characters only get a number."""
    lists = {(f"gp.depth={text}",): {"gp__depth": [1, 2]} for text in ("[1,2]", "[[1],2]")}
    _sweep(tmp_path, lists)
    arms, _ = arms_of_sweep(find(tmp_path))
    assert [arm.name for arm in arms] == ["expert-gp.depth-1-2", "expert-gp.depth-1-2-2"]


def test_a_long_name_of_an_arm_is_cut(tmp_path: Path) -> None:
    """It ends in a digest, so names differ; a longer one in --arm is refused."""
    longer = [(f"gp.tags={'x' * 300}{end}",) for end in "ab"]
    _sweep(tmp_path, {choices: {} for choices in longer})
    arms, _ = arms_of_sweep(find(tmp_path))
    first, second = [arm.name for arm in arms]
    assert len(first) == len(second) == 80
    assert first != second
    assert parse_arm(f"{first}=seed=1") == (first, "seed=1")
    with pytest.raises(StudyError, match="at most 80 characters, found 81: xxx"):
        parse_arm(f"{'x' * 81}=seed=1")


def test_runs_beside_those_of_a_sweep_are_left_out(tmp_path: Path) -> None:
    """A copy of a job, or a single run of the same name, is in no arm; a note names it."""
    _sweep(tmp_path, {("gp.founders=true",): {}, ("gp.founders=false",): {}})
    write_run(fake_run("expert", 0), tmp_path / "copy")
    arms, notes = arms_of_sweep(find(tmp_path))
    assert [len(arm.runs) for arm in arms] == [1, 1]
    assert notes == [
        "1 runs that are not jobs of the sweep are left out (copy); --arm selects any run."
    ]


def test_copies_of_runs_in_mlflow_s_folder_are_left_out(tmp_path: Path) -> None:
    """So --runs may also be the folder of the project."""
    write_run(fake_run("expert", 0), tmp_path / "runs" / "expert")
    write_run(fake_run("expert", 0), tmp_path / "mlartifacts" / "7" / "artifacts")
    assert [run.path.name for run in find(tmp_path)] == ["expert"]


def test_a_sweep_without_jobs_has_no_studied_keys(tmp_path: Path) -> None:
    """A search that was stopped before its first trial; the runs beside it are none of its jobs."""
    write_run(fake_run("expert", 0), tmp_path / "expert")
    sweep = SweepFolder(tmp_path)
    sweep.open("command", [])
    sweep.close()
    with pytest.raises(StudyError, match="two arms or more with finished runs, found none;"):
        arms_of_sweep(find(tmp_path))


def test_unfinished_runs_are_counted_if_arms_are_missing(tmp_path: Path) -> None:
    """The message has the finished arms and the number of unfinished runs."""
    write_run(fake_run("expert", 0), tmp_path / "expert")
    write_run(fake_run("baseline", 0), tmp_path / "baseline", finished=False)
    with pytest.raises(StudyError, match=r"found expert \(unfinished runs: 1\); "):
        arms_of_sweep(find(tmp_path))


def test_a_sweep_must_be_named_and_have_two_arms() -> None:
    """Otherwise the error lists the sweeps, or the arms."""
    with pytest.raises(StudyError, match=r"--name or --arm, as there are runs of 2 sweeps") as info:
        arms_of_sweep([_entry(), _entry(name="other")])
    assert "name=other supervisor=expert: 1 runs, seeds 0" in str(info.value)
    with pytest.raises(StudyError, match="two arms or more with finished runs, found expert;"):
        arms_of_sweep([_entry(), _entry(seed=1)])
    with pytest.raises(StudyError, match="found none;"):
        arms_of_sweep([])
