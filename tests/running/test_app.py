"""The command: exit codes, messages, and a sweep's report of its jobs. In this process."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from hydra._internal.config_loader_impl import ConfigLoaderImpl

from islandgp.config.compose import run_folder
from islandgp.records.files import PAGE, Lines, RunMetadata
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import identity_config
from islandgp.resources import resource
from islandgp.running.app import main
from islandgp.running.resume import differences
from tests.composed import composed, named
from tests.profiles import sweep
from tests.running.commands import TINY, fake
from tests.running.histories import store, tracked

INSTANT = (*TINY, "tracking=off", *fake("Instant"))


@pytest.fixture
def cwd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def leaf(cwd: Path, name: str = "default") -> list[str]:
    """The folders of a name's runs."""
    return sorted(path.name for path in (cwd / "runs" / name).iterdir() if path.is_dir())


def test_a_run_writes_its_records_and_prints_where(
    cwd: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 0, a summary with the best tree, and nothing else in the folder.

    The configuration is composed once.
    """
    compositions: list[Any] = []
    compose = ConfigLoaderImpl.load_configuration
    monkeypatch.setattr(
        ConfigLoaderImpl,
        "load_configuration",
        lambda *args, **named: compositions.append(args) or compose(*args, **named),
    )
    assert main(INSTANT) == 0
    assert len(compositions) == 1
    output = capsys.readouterr().out
    (folder,) = leaf(cwd)
    assert f"Results: {cwd}/runs/default/{folder}" in output
    assert "Best robot" in output
    assert {path.name for path in cwd.iterdir()} == {"runs"}


@pytest.mark.replay
def test_the_page_of_a_finished_run_holds_its_champions_episode(cwd: Path) -> None:
    """The replay is the champion's: it opens with the run's folder and the generation."""
    assert main([*INSTANT, "gp.generations=2"]) == 0
    (name,) = leaf(cwd)
    text = (cwd / "runs/default" / name / PAGE).read_text(encoding="utf-8")
    (replay,) = re.findall(r'<script[^>]* id="replay"[^>]*>(.*?)</script>', text, re.DOTALL)
    assert f"{name}: the best robot, of generation " in json.loads(replay)


def test_what_a_runs_folder_is_called() -> None:
    """Supervisor, seed and the overrides that shape the records; no machinery, address or key."""
    overrides = [
        "supervisor=llm",
        "supervisor.policy.base_url=http://localhost:11434",
        "supervisor.policy.temperature=0.2",
        "supervisor.edits=1",
        "supervisor.edits=2",
        "evaluator=serial",
        "tracking.policy.patience=3",
        "seed=7",
        "gp.population=12",
    ]
    config = {"runs": "runs", "name": "x", "supervisor": {"name": "llm"}, "seed": 7}
    assert run_folder(config, overrides, Path("/home")) == Path(
        "/home/runs/x/llm-seed7-gp.population=12-supervisor.edits=2-supervisor.policy.temperature=0.2"
    )


def test_a_long_name_ends_in_a_digest_of_the_whole() -> None:
    """Runs that differ where the name is cut have different folders, always the same ones."""
    config, overrides = named(composed()), [f"gp.state.x{i:02}=0.123456" for i in range(12)]
    folders = [
        run_folder(config, [*overrides, f"world.robot.speed={speed}"], Path("/home")).name
        for speed in (6, 7, 6)
    ]
    assert len(set(folders)) == 2
    assert folders[0] == folders[2]
    assert {len(name) for name in folders} == {180}
    assert len({name[:-8] for name in folders}) == 1


def test_the_same_command_again_does_nothing(cwd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A finished run is shown, not repeated."""
    main(INSTANT)
    (folder,) = leaf(cwd)
    file = cwd / "runs/default" / folder / "generations.jsonl"
    before = file.stat().st_mtime_ns
    assert main(INSTANT) == 0
    assert "This run was complete already; resume=never runs it again." in capsys.readouterr().out
    assert file.stat().st_mtime_ns == before


def test_a_run_that_another_process_finishes_meanwhile_stays_complete(
    cwd: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the look at a folder and its lock the run may come to its end elsewhere."""

    def late(folder: RunFolder, config: str, about: RunMetadata) -> None:
        (cwd / "elsewhere").rename(cwd / "runs")
        before(folder, config, about)

    before = RunFolder.open
    main(INSTANT)
    (name,) = leaf(cwd)
    folder = cwd / "runs/default" / name
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    (cwd / "runs").rename(cwd / "elsewhere")
    monkeypatch.setattr(RunFolder, "open", late)
    capsys.readouterr()
    assert main(INSTANT) == 0
    assert "This run was complete already" in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == files


def test_resume_never_takes_a_new_folder(cwd: Path) -> None:
    """The old run stays as it is, and the new one has the same records."""
    main(INSTANT)
    assert main([*INSTANT, "resume=never"]) == 0
    assert main([*INSTANT, "resume=never"]) == 0
    first, second, third = leaf(cwd)
    assert (second, third) == (f"{first}~2", f"{first}~3")
    records = [
        (cwd / "runs/default" / name / "generations.jsonl").read_bytes() for name in leaf(cwd)
    ]
    assert records[0] == records[1] == records[2]


def test_a_changed_configuration_is_refused_with_the_keys_that_differ(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and `key: old -> new`; the keys that do not shape the records may differ."""
    broken = [*TINY, "tracking=off", "name=x", *fake("Breaks", after=2, how="error")]
    assert main(broken) == 2
    (folder,) = leaf(cwd, "x")
    config = cwd / "runs/x" / folder / "config.yaml"
    config.write_text(config.read_text().replace("tournament_size: 3", "tournament_size: 4"))
    capsys.readouterr()
    assert main([*broken, "progress=off"]) == 2
    errors = capsys.readouterr().err
    assert "  gp.tournament_size: 4 -> 3\n" in errors
    assert "progress" not in errors
    assert "Traceback" not in errors


def test_a_fault_of_the_program_gives_its_traceback_once(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1; the traceback is also in the run's folder."""
    assert main([*TINY, "tracking=off", *fake("Breaks", after=1, how="fault")]) == 1
    errors = capsys.readouterr().err
    assert errors.count("ZeroDivisionError: a fault of the program") == 1
    (folder,) = leaf(cwd)
    assert "ZeroDivisionError" in (cwd / "runs/default" / folder / "error.txt").read_text()


def in_a_line(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line of a command that must end with exit code 2."""
    capsys.readouterr()
    assert main([*arguments, "progress=off"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@sweep(
    ("generation", "reason"), [(0, errno.ENOSPC), (3, errno.EROFS), (5, errno.EACCES)], quick=1
)  # the first generation, one between, and the last of 6
def test_a_generation_that_cannot_be_written_down_ends_the_run(
    generation: int,
    reason: int,
    cwd: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One line; what was written before is kept, and the same command continues from there."""

    def append(lines: Lines, value: dict[str, Any]) -> bytes:
        if "snapshot" in value and value["snapshot"]["generation"] == generation:
            raise OSError(reason, os.strerror(reason))
        return before(lines, value)

    before = Lines.append
    with monkeypatch.context() as full:
        full.setattr(Lines, "append", append)
        assert f"found: {os.strerror(reason)}; correct that" in in_a_line(capsys, *INSTANT)
    (name,) = leaf(cwd)
    folder = RunFolder(cwd / "runs/default" / name)
    assert folder.completed_generations() == generation
    assert os.strerror(reason) in folder.reason()
    assert main(INSTANT) == 0
    assert len(list(folder.records())) == 6


@pytest.mark.usefixtures("cwd")
def test_a_full_disk_is_reported_in_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not even the file with the reason can be written: the terminal shows it."""

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as disk:
        disk.setattr("os.fsync", full)
        assert os.strerror(errno.ENOSPC) in in_a_line(capsys, *INSTANT)
    assert main(INSTANT) == 0


@pytest.mark.parametrize("sweep", [(), ("-m",)], ids=["run", "sweep"])
@pytest.mark.parametrize("place", ["a_file", "a_file/in_it", "/proc/nowhere"])
def test_an_impossible_folder_for_runs_is_one_line(
    place: str, sweep: tuple[str, ...], cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file where a folder is needed, or a place where none can be made."""
    (cwd / "a_file").touch()
    message = in_a_line(capsys, *INSTANT, f"runs={place}", *sweep)
    assert f"{cwd / place}/default" in message
    assert "choose another place with runs=" in message


def test_a_damaged_folder_is_one_line(cwd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The file, what is wrong with it, and a remedy that works."""
    main(INSTANT)
    (name,) = leaf(cwd)
    for file, data, options in (
        ("summary.json", b'{"champion": ', ()),
        ("summary.json", b"{}", ("-m",)),
        ("summary.json", b"3", ()),
        ("config.yaml", b"seed: [0", ("-m",)),
        ("config.yaml", b"", ()),
        ("config.yaml", b"\xff\xfe", ()),
    ):
        path = cwd / "runs/default" / name / file
        content = path.read_bytes()
        path.write_bytes(data)
        message = in_a_line(capsys, *INSTANT, *options)
        assert f" in {path}, found a damaged file (" in message
        assert message.endswith("delete the run's folder or use resume=never.")
        if data in (b"{}", b""):
            assert main([*INSTANT, "resume=never", *options]) == 0
        path.write_bytes(content)


def test_a_damaged_sweep_is_one_line(cwd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its list of jobs can be made again; no run is lost with it."""
    main([*INSTANT, "-m"])
    file = cwd / "runs/default/sweep.json"
    file.write_text('{"id": "1"}')
    message = in_a_line(capsys, *INSTANT, "-m")
    assert f" in {file}, found a damaged file (started: field required); delete it" in message
    file.unlink()
    assert main([*INSTANT, "-m"]) == 0


@pytest.mark.usefixtures("cwd")
@pytest.mark.parametrize("arguments", [["--seed", "3"], ["--check"], ["--cfg", "bogus"]])
def test_an_unknown_option_gets_one_line(
    arguments: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    """Without argparse's usage: the option, and how settings are written."""
    assert main(arguments) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert arguments[0] in err
    assert "KEY=VALUE" in err


def test_a_failed_job_is_reported_at_the_end_and_the_others_go_on(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1, the reason, the file with the traceback, and a command that mends it."""
    repaired = cwd / "well"
    overrides = [*TINY, "tracking=off", *fake("Breaks", after=2, how="error", unless=repaired)]
    assert main([*overrides, "seed=0,1", "-m"]) == 1
    errors = capsys.readouterr().err
    assert "2 of 2 jobs not finished" in errors
    assert "Expected an outcome, found trouble." in errors
    assert re.search(rf"error:  {cwd}/runs/default/baseline-seed0\S*/error.txt", errors)
    command = re.search(r"again:  python -m islandgp (.*seed=1.*)", errors)
    assert command is not None
    repaired.touch()
    assert main(shlex.split(command[1])) == 0
    assert main([*overrides, "seed=0,1", "-m"]) == 0
    finished = {path.parent.name for path in cwd.rglob("summary.json")}
    assert finished == set(leaf(cwd))


def test_a_job_on_which_another_process_works_is_not_failed(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is left as it is, nothing is written into its folder, and the others go on."""
    evaluator = fake("Breaks", after=2, how="error", unless="mended", mark="true")
    overrides = [*TINY, "tracking=off", *evaluator]
    assert main(overrides) == 2
    (name,) = leaf(cwd)
    folder = RunFolder(cwd / "runs/default" / name)
    (folder.path / "error.txt").unlink()
    before = {file.name: file.read_bytes() for file in folder.path.iterdir()}
    about = folder.about()
    assert about is not None
    folder.open((folder.path / "config.yaml").read_text(), about)
    capsys.readouterr()
    try:
        assert main([*overrides, "seed=0,1", "-m"]) == 1
    finally:
        folder.close()
    errors = capsys.readouterr().err
    assert errors.count(f"{name}: another process is at work on it") == 2  # then, and at the end
    assert "1 of 2 jobs not finished" in errors
    assert {file.name: file.read_bytes() for file in folder.path.iterdir()} == before


@pytest.mark.usefixtures("cwd")
def test_a_sweep_reports_its_progress(capsys: pytest.CaptureFixture[str]) -> None:
    """After each job the number of those that are done and its result; then a table of arms."""
    assert main([*INSTANT, "seed=0,1", "-m"]) == 0
    captured = capsys.readouterr()
    assert re.search(r"^1 of 2 jobs done: baseline-seed0\S*: validation mean", captured.err, re.M)
    assert re.search(r"^2 of 2 jobs done: baseline-seed1\S*: validation mean", captured.err, re.M)
    head, row = captured.out.split("\n\n")[0].strip().splitlines()
    assert head.split("  ")[0] == "arm"
    assert re.match(r"baseline +2 of 2 ", row)


def test_a_failed_job_fails_its_parent(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The child is FAILED and has its error; so is the parent; nothing stays RUNNING.

    The error is no artifact, which could not be taken back when the run goes on.
    """
    monkeypatch.chdir(home)
    overrides = [*TINY, *fake("Breaks", after=2, how="fault"), "seed=3", "-m"]
    assert main(overrides) == 1
    runs = tracked(store(home))
    assert [run.status for run in runs] == ["FAILED", "FAILED"]
    (child,) = (run for run in runs if run.parent)
    assert "error.txt" not in child.artifacts
    assert "ZeroDivisionError" in child.tags["mlflow.note.content"]


@pytest.mark.usefixtures("cwd")
def test_another_user_evaluator_is_another_run(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It may change the records: a finished run of the same name is not taken for this one."""
    assert main(INSTANT) == 0
    capsys.readouterr()
    assert main([*TINY, "tracking=off", *fake("Slow", seconds=0)]) == 2
    errors = capsys.readouterr().err
    assert (
        "evaluator.factory: tests.running.evaluators:Instant -> tests.running.evaluators:Slow"
        in errors
    )
    assert "resume=never" in errors
    assert main([*TINY, "tracking=off", "evaluator=serial"]) == 2  # nor for one of the package's
    assert main(INSTANT) == 0
    assert "complete already" in capsys.readouterr().out


@pytest.mark.parametrize("other", [{"cache": False}, {"policy": {"workers": 3}}])
def test_evaluators_of_the_package_are_not_part_of_a_runs_identity(other: dict[str, Any]) -> None:
    """They give the same outcomes; those of others need not."""
    ours = {"factory": "islandgp.evaluation.processes:Processes", "cache": True, "policy": {}}
    theirs = {**ours, "factory": "mine:Evaluator"}
    assert identity_config({"seed": 1, "evaluator": ours}) == {"seed": 1}
    assert identity_config({"seed": 1, "evaluator": theirs}) == {"seed": 1, "evaluator": theirs}
    assert differences({"evaluator": ours}, {"evaluator": ours | other}) == []
    assert len(differences({"evaluator": theirs}, {"evaluator": theirs | other})) == 1
    assert differences({"evaluator": ours}, {"evaluator": theirs}) == [
        "evaluator.factory: islandgp.evaluation.processes:Processes -> mine:Evaluator"
    ]


def test_a_user_s_configuration_comes_first(cwd: Path) -> None:
    """By --config-name, as people who know Hydra expect."""
    (cwd / "own").mkdir()
    (cwd / "own/mine.yaml").write_text("defaults: [config, _self_]\nname: mine\nseed: 5\n")
    assert main(["--config-dir", "own", "--config-name", "mine", *INSTANT]) == 0
    (leaf_,) = leaf(cwd, "mine")
    assert leaf_.startswith("baseline-seed5")


@pytest.mark.slow
def test_a_first_file_without_defaults_of_a_domain(cwd: Path) -> None:
    """It names its domain's class itself, without the group whose files are called as domains."""
    parts = {"world": "island", "library": "single", "supervisor": "expert"}
    papers = dict.fromkeys(("rewards", "curriculum", "classes", "gp", "search"), "paper")
    machinery = {"evaluator": "processes", "tracking": "off"}
    config = yaml.safe_load(resource("conf/config.yaml").read_text(encoding="utf-8"))
    config["defaults"] = [
        "_self_",
        *({group: choice} for group, choice in {**parts, **papers, **machinery}.items()),
        *(line for line in config["defaults"] if "hydra" in str(line) or "allocation" in str(line)),
    ]
    config |= {"domain": {"factory": "islandgp.domains.island:Island"}, "name": "whole"}
    (cwd / "own").mkdir()
    (cwd / "own/mine.yaml").write_text(yaml.safe_dump(config, sort_keys=False))
    assert main(["--config-dir", "own", "--config-name", "mine", *INSTANT]) == 0
    (leaf_,) = leaf(cwd, "whole")
    assert RunFolder(cwd / "runs/whole" / leaf_).summary()["champion"]
