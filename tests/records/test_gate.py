"""A stranger's folder is data: nothing that it names is imported, reached, written or opened."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pytest
import yaml
from click.testing import CliRunner

import islandgp
from islandgp.cli import islandgp as group
from islandgp.errors import IslandError, UntrustedError
from islandgp.evaluation.base import Problem
from islandgp.gate import CONTROL, cleaned, code_in, must_be_known_code, user_folder
from islandgp.records.files import dump
from islandgp.records.folder import RunFolder
from islandgp.running.app import main
from islandgp.supervision.llm.message import Reply, Request, Usage
from islandgp.supervision.llm.transcript import Attempt, Call, Conclusion, Start, Transcript
from studies.distillation.__main__ import recorded_decisions
from tests.composed import plain
from tests.records.configured import naming
from tests.records.listed import add_to_manifest
from tests.tracking.conftest import template
from tests.tracking.folders import closed_run

__all__ = ["template"]

EVIL: Final = "from pathlib import Path\nPath('it ran').touch()\nclass Domain: ...\n"
ESCAPE: Final = "\x1b]0;title\x07\x1b[31mred"
SERVER: Final = "http://127.0.0.1:9/x"

COMMANDS: Final = {
    "verify": ("verify", "runs"),
    "best": ("best", "runs/s/one", "--workers", "1", "--worlds", "2"),
    "watch": ("watch", "runs/s/one", "--no-open"),
    "sync": ("sync", "runs"),
    "compare": (
        *("compare", "--arm", "a=seed=0", "--arm", "b=seed=0", "--force"),
        *("--worlds", "0", "--out", "report"),
    ),
    "estimate": ("estimate", "--record", "runs/s/one", "supervisor=llm"),
    "replay": ("replay", "runs/s/one/best.bt", "-o", "page.html"),
    "check": ("check", "runs/s/one/best.bt"),
}

KEYS: Final = {
    "domain": ("domain", "factory"),
    "supervisor": ("supervisor", "factory"),
    "search": ("search", "factory"),
    "evaluator": ("evaluator", "factory"),
    "tracking": ("tracking", "factory"),
    "fallback": ("supervisor", "policy", "fallback", "factory"),
    "function": ("gp", "selection"),
    "environment": ("world", "environment"),
}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """A working folder with a finished run and one that was stopped, of one sweep, and a store."""
    home = tmp_path_factory.mktemp("made")
    shutil.copy(request.getfixturevalue("template"), home / "mlflow.db")
    closed_run(home / "runs/s/one", home)
    closed_run(home / "runs/s/two", home, 3)
    entry = {"supervisor": "baseline", "seed": 1, "choices": [], "generations": 5, "command": "c"}
    jobs = [{"slot": name, "folder": name, **entry} for name in ("one", "two")]
    sweep = {"id": "x", "started": 1, "commands": ["c"], "jobs": jobs}
    (home / "runs/s/sweep.json").write_text(json.dumps(sweep))
    return home


@pytest.fixture
def home(original: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of that folder to give commands in, beside a module of the stranger's."""
    home = tmp_path / "home"
    shutil.copytree(original, home)
    monkeypatch.chdir(home)
    monkeypatch.syspath_prepend(str(home))
    (home / "evil.py").write_text(EVIL)
    yield home
    sys.modules.pop("evil", None)


def outcome(name: str, *arguments: str) -> str:
    """The exit code and the output of a command, which shows no traceback."""
    result = CliRunner().invoke(group, [*COMMANDS.get(name, [name]), *arguments])
    error = result.exception
    assert error is None or isinstance(error, IslandError | SystemExit), (name, repr(error))
    message = "" if error is None or isinstance(error, SystemExit) else cleaned(str(error))
    return f"{result.exit_code} {result.output}{message}"


def reads(folder: Path) -> str:
    """The error of `islandgp.load` and its frames; "" for none."""
    try:
        results = islandgp.load(folder)
        assert len(results.runs) + len(results.generations) + len(results.archive)
    except IslandError as error:
        return str(error)
    return ""


def changed(file: Path, change: Callable[[Any], None]) -> None:
    """Changes the values of a JSON or YAML file, and its checksum if it has one."""
    text = file.read_text()
    lines = text.splitlines() if file.suffix == ".jsonl" else [text]
    loaded, dumped = (
        (yaml.safe_load, yaml.safe_dump) if file.suffix == ".yaml" else (json.loads, json.dumps)
    )
    value = loaded(lines[0])
    change(value)
    if file.name == "checkpoint.json" and value.get("state") != loaded(lines[0])["state"]:
        value["sha256"] = hashlib.sha256(dump(value.get("state")).encode()).hexdigest()
    file.write_text("\n".join([dumped(value), *lines[1:]]) + "\n")
    if (file.parent / "manifest.json").exists() and file.name != "manifest.json":
        add_to_manifest(file.parent, file.name)


def at(path: tuple[Any, ...], value: Any) -> Callable[[Any], None]:
    """A change of one field; None removes it."""

    def change(values: Any) -> None:
        for key in path[:-1]:
            values = values.setdefault(key, {}) if isinstance(values, dict) else values[key]
        if value is None:
            del values[path[-1]]
        else:
            values[path[-1]] = [*value] if isinstance(value, tuple) else value

    return change


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The paths of all fields, of lists the first item's."""
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield (*path, key)
            yield from leaves(each, (*path, key))
    elif isinstance(value, list) and value:
        yield from leaves(value[0], (*path, 0))


VALUES: Final = {
    "a server": SERVER,
    "an outside path": "../../../outside",
    "a script": "<script>alert(1)</script>",
    "code": "evil:Domain",
    "an escape sequence": ESCAPE,
    "another type": [[]],
    "nothing": None,
}
ATTEMPT: Final = Attempt(
    Call(0, "rate", 0), 1, Request("model", "system", ("question",), 99, schema={"type": "object"}),
    Reply("{}", "end_turn", Usage(5, 1)), 0.1, 1.0, 0.0, "2026-01-01",
)  # fmt: skip


def transcribed(home: Path, number: int) -> Path:
    """A transcript with the line of that number of an attempt at its top; they have no checksum."""
    file = home / f"{number}.jsonl"
    transcript = Transcript(file)
    for entry in (Start({"factory": "x"}), ATTEMPT, Conclusion(0, "rate", "llm", "", ())):
        transcript.add(entry)
    first, *others = file.read_text().splitlines()[number:]
    plain = {key: value for key, value in json.loads(first).items() if key != "checksum"}
    file.write_text("\n".join([json.dumps(plain), *others]) + "\n")
    return file


def resumed(folder: Path) -> str:
    """The error of continuing a run."""
    try:
        RunFolder(folder).resume()
    except IslandError as error:
        return str(error)
    return ""


def of_a_stopped_run(home: Path, _: str) -> str:
    """What reading and continuing it says."""
    return reads(home / "runs") + resumed(home / "runs/s/two")


def in_words(home: Path, name: str) -> str:
    """What the command says about a transcript."""
    return outcome("transcript", str(home / Path(name).name))


READ: Final = {
    "../two/checkpoint.json": of_a_stopped_run,
    **{f"../../../{number}.jsonl": in_words for number in range(3)},
}
"""What reads a file that is not a finished run's, whose folder the paths begin at."""

FILES: Final = (
    "about.json", "config.yaml", "summary.json", "archive.json", "costs.jsonl",
    "generations.jsonl", "manifest.json", "../sweep.json", *READ,
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("kind", VALUES)
def test_any_value_in_any_field(name: str, kind: str, home: Path, tmp_path: Path) -> None:
    """A value is read or rejected with a message; nothing is imported or written outside."""
    run = home / "runs/s/one"
    for number in range(3):
        transcribed(home, number)
    before = {file: file.read_bytes() for file in home.rglob("*.json*")}
    text = (run / name).read_text()
    text = text.splitlines()[0] if name.endswith(".jsonl") else text
    fields = [*leaves(yaml.safe_load(text) if name.endswith(".yaml") else json.loads(text))]
    places = {file.name for file in tmp_path.iterdir()}
    read = READ.get(name, lambda home, _: f"{reads(home / 'runs')}{outcome('verify')}")
    config = (run / "config.yaml").read_bytes()
    for field in fields:
        changed(run / name, at(field, VALUES[kind]))
        assert not CONTROL.search(read(home, name)), field
        for file, content in before.items():
            if not file.exists() or file.read_bytes() != content:
                file.write_bytes(content)
        (run / "config.yaml").write_bytes(config)
    assert "evil" not in sys.modules
    assert {file.name for file in tmp_path.iterdir()} == places


EXPECTED: Final = {
    # file, field, value: command, and what it prints
    ("config.yaml", ("domain", "factory"), "evil:Domain"): {
        "best": "Expected code that your own configuration names, found 'evil:Domain'",
        "watch": "no replay of the best robot: Expected code that your own configuration names",
    },
    ("config.yaml", ("world", "environment"), "evil:ns/Env-v0"): {"best": "found 'evil:ns/Env-v0'"},
    ("config.yaml", ("tracking", "policy", "uri"), SERVER): {"sync": f"found {SERVER} with"},
    ("config.yaml", ("tracking", "policy", "uri"), f"http://{ESCAPE}"): {"sync": "found http://?]0;"},
    ("config.yaml", ("tracking", "policy", "artifacts"), "/outside"): {"sync": "2 sent"},
    ("config.yaml", ("name",), ESCAPE): {"verify": "verified", "sync": "2 sent"},
    ("about.json", ("home",), "/outside"): {"sync": "2 sent", "watch": "run.html"},
    ("about.json", ("title",), "<script>"): {"watch": "run.html"},
    ("about.json", ("id",), None): {"verify": "id: field required", "watch": "id: field"},
    ("summary.json", ("champion", "tree"), 7): {"best": "champion.tree: input should be"},
    ("manifest.json", ("best.bt",), None): {"verify": "best.bt: added"},
    ("costs.jsonl", ("at",), "x"): {"sync": "at: input should be a valid"},
    ("../sweep.json", ("jobs", 0, "folder"), "../../outside"): {
        "sync": "the job '../../outside' is not in"
    },
    ("../sweep.json", ("jobs", 0, "folder"), "/outside"): {"sync": "the job '/outside' is not"},
    ("../sweep.json", ("jobs", 0, "choices", ), (ESCAPE,)): {"sync": "2 sent"},
}  # fmt: skip


@pytest.mark.parametrize("case", EXPECTED, ids=lambda c: f"{c[0]}-{'.'.join(map(str, c[1]))}")
def test_the_line_for_a_value(case: tuple[str, tuple[Any, ...], Any], home: Path) -> None:
    """Each command says what it found; none of it reaches the terminal as an escape sequence."""
    name, field, value = case
    changed(home / "runs/s/one" / name, at(field, value))
    for command, expected in EXPECTED[case].items():
        text = outcome(command)
        assert expected in text, (command, text)
        assert not CONTROL.search(text)
    assert not (home / "it ran").exists()
    assert not Path("/outside").exists()


PLACES: Final = (
    "about.json", "config.yaml", "generations.jsonl", "costs.jsonl",
    "best.bt", "lineage.csv", "archive.json", "summary.json", "manifest.json", "run.html",
    "error.txt", ".lock", ".tracking.lock", "transcript.jsonl",
)  # fmt: skip


def put(kind: str, file: Path, target: Path) -> None:
    """Puts a link to the target, a pipe or a folder in a file's place."""
    match kind:
        case "link":
            file.symlink_to(target)
        case "pipe":
            os.mkfifo(file)
        case _:
            file.mkdir()


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
@pytest.mark.parametrize("name", PLACES)
def test_something_else_in_a_file_s_place(name: str, kind: str, home: Path) -> None:
    """One line names it, in each command; what a link leads to stays as it is."""
    file, secret = home / "runs/s/one" / name, home / "secret"
    secret.write_text("mine")
    file.unlink(missing_ok=True)
    put(kind, file, secret)
    what = "a link" if kind == "link" else "none"
    line = rf"Expected a file of the run in .*{re.escape(name)}, found {what}"
    for command in ("verify", "watch"):
        assert re.search(line, outcome(command)), command
    assert re.search(line, reads(home / "runs"))
    assert secret.read_text() == "mine"


@pytest.mark.parametrize("name", ["archive.json", "summary.json", "about.json", "costs.jsonl"])
def test_an_absent_file_is_damage(name: str, home: Path) -> None:
    """The same file is named by each reader."""
    (home / "runs/s/one" / name).unlink()
    for command in ("best", "watch", "sync", "compare"):
        assert f"{name}, found a damaged file (missing)" in outcome(command), command
    assert f"{name}, found a damaged file (missing)" in reads(home / "runs")
    assert name in outcome("verify")
    assert outcome("verify").startswith("1 ")


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("form", ["evil:Domain", "evil.Domain"])
def test_no_command_imports_what_only_a_run_names(name: str, form: str, home: Path) -> None:
    """For any result of the command, the module was not run."""
    changed(home / "runs/s/one/config.yaml", at(("domain", "factory"), form))
    outcome(name)
    assert "evil" not in sys.modules
    assert not (home / "it ran").exists()


@pytest.mark.parametrize("part", KEYS)
def test_decisions_look_at_all_code_that_a_run_names(part: str, home: Path) -> None:
    """The study reads the whole configuration, which imports each class and function."""
    changed(home / "runs/s/one/config.yaml", at(KEYS[part], "evil:Domain"))
    run = home / "runs/s/one"
    with pytest.raises(UntrustedError):
        next(recorded_decisions(run, RunFolder(run).configuration(), None))
    assert not (home / "it ran").exists()


def test_the_user_s_folder_names_code(home: Path) -> None:
    """A file of a group of --config-dir; a run below that folder does not."""
    config = {**plain(), "domain": {"factory": "evil:Domain"}}
    runs = home / "conf/runs/name/run"
    runs.mkdir(parents=True)
    (runs / "config.yaml").write_text(yaml.safe_dump(config))
    with user_folder(home / "conf"), pytest.raises(UntrustedError):
        Problem.recorded(config)
    with user_folder(naming(home / "conf", "evil:Domain")):
        must_be_known_code(config)


def test_a_page_of_a_stranger_is_neither_opened_nor_sent(home: Path) -> None:
    """It is written again from the records, also if the manifest has its checksum."""
    for name in ("one", "two"):
        (home / "runs/s" / name / "run.html").write_text("<script>steal()</script>")
    add_to_manifest(home / "runs/s/one", "run.html")
    assert "2 sent" in outcome("sync")
    outcome("watch")
    pages = [*home.rglob("run.html")]
    assert len(pages) == 4
    assert [page for page in pages if "steal()" in page.read_text()] == []


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_a_start_from_a_stranger_s_archive(kind: str, home: Path, capsys: Any) -> None:
    """`start=DIR` reads text and JSON of a plain file."""
    folder = home / "start"
    folder.mkdir()
    file = folder / "archive.json"
    put(kind, file, home / "runs/s/one/archive.json")
    small = ("gp.population=4", "gp.generations=2", "evaluator=serial", "tracking=off")
    assert main([f"start={folder}", *small]) == 2
    assert "Expected a file of the run in" in capsys.readouterr().err


def test_a_replayed_transcript_names_no_class(home: Path) -> None:
    """`supervisor=replay` reads settings from a transcript, with the class of the fallback."""
    policy = plain("supervisor=llm")["supervisor"]["policy"]
    policy["fallback"] = {"factory": "evil:Domain", "policy": {}}
    start = {"line": "start", "settings": policy, "dialect": None}
    (home / "transcript.jsonl").write_text(json.dumps(start) + "\n")
    overrides = ("supervisor=replay", f"supervisor.policy.transcript={home}", "tracking=off")
    assert main([*overrides, "gp.population=4", "gp.generations=2", "evaluator=serial"]) == 2
    assert not (home / "it ran").exists()


@pytest.mark.parametrize(
    ("config", "names"),
    [
        ({"factory": "a.b.C"}, ["a.b.C"]),
        ({"x": [{"y": "m.n:f"}], "z": "sqlite:///a.db", "t": "08:30", "w": "a: b"}, ["m.n:f"]),
        ({"x": "m:ns/Env-v0", "y": "http://a"}, ["m:ns/Env-v0"]),
    ],
)
def test_what_names_code(config: dict[str, Any], names: list[str]) -> None:
    """Each `factory`, with or without a colon, and what looks like a module's name."""
    assert list(code_in(config)) == names
    with pytest.raises(UntrustedError):
        must_be_known_code(config)
