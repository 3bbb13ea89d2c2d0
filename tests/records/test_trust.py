"""A stranger's run folder runs no code: commands refuse the classes that only it names."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner, Result

from islandgp.cli import islandgp
from islandgp.errors import UntrustedError
from islandgp.evaluation.base import Problem
from islandgp.experiment import recorded_decisions
from islandgp.records.manifest import add_to_manifest
from islandgp.running.app import main
from islandgp.tracking.place import place_from
from islandgp.tracking.store import Store
from islandgp.tracking.sync import sync
from islandgp.trust import code_in, is_trusted, must_trust_code, trust, trust_folder, trusting
from tests.composed import plain
from tests.tracking.folders import closed_run

EVIL = "from pathlib import Path\nPath('it ran').touch()\nclass Domain: ...\nDomain.Fn = print\n"
KEYS = {
    "domain": ("domain", "factory"),
    "supervisor": ("supervisor", "factory"),
    "search": ("search", "factory"),
    "evaluator": ("evaluator", "factory"),
    "tracking": ("tracking", "factory"),
    "fallback": ("supervisor", "policy", "fallback", "factory"),
    "function": ("gp", "selection"),
    "environment": ("world", "environment"),
}


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A folder to give commands in, with a module of a stranger's; nothing is trusted."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "evil.py").write_text(EVIL, encoding="utf-8")
    with trusting():
        yield
    sys.modules.pop("evil", None)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run."""
    home = tmp_path_factory.mktemp("made")
    return closed_run(home / "run", home).path


def stranger(original: Path, folder: Path, part: str = "domain", name: str = "evil:Domain") -> Path:
    """A finished run whose configuration names an untrusted class."""
    shutil.copytree(original, folder)
    config = yaml.safe_load((folder / "config.yaml").read_text())
    at: dict[str, Any] = config
    *path, last = KEYS[part]
    for key in path:
        at = at.setdefault(key, {})
    at[last] = name
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    add_to_manifest(folder, "config.yaml")
    return folder


def command(*arguments: str) -> Result:
    """The result of a command."""
    return CliRunner().invoke(islandgp, [*arguments])


COMMANDS = {
    "best": ("best", "RUN", "--workers", "1"),
    "sync": ("sync", "RUN", "--uri", "sqlite:///mlflow.db"),
    "compare": ("compare", "--runs", "RUN", "--arm", "a=seed=0", "--arm", "b=seed=0", "--force"),
    "watch": ("watch", "RUN", "--no-open"),
    "verify": ("verify", "RUN"),
    "estimate": ("estimate", "--record", "RUN", "supervisor=llm"),
    "play": ("play", "RUN/best.bt", "--seeds", "1"),
    "replay": ("replay", "RUN/best.bt"),
    "check": ("check", "RUN/best.bt"),
}


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("form", ["evil:Domain", "evil.Domain"])
def test_no_command_imports_what_only_a_run_names(
    original: Path, name: str, form: str, tmp_path: Path
) -> None:
    """For any result of the command, the untrusted module was not run."""
    run = stranger(original, tmp_path / "run", name=form)
    command(*(word.replace("RUN", str(run)) for word in COMMANDS[name]))
    assert "evil" not in sys.modules
    assert not (tmp_path / "it ran").exists()


@pytest.mark.parametrize("name", ["best", "sync"])
def test_a_refusal_names_the_class_and_the_remedy(
    original: Path, name: str, tmp_path: Path
) -> None:
    """One message; with --trust the class is imported."""
    run = stranger(original, tmp_path / "run")
    arguments = [word.replace("RUN", str(run)) for word in COMMANDS[name]]
    result = command(*arguments)
    text = result.output + str(result.exception)
    assert "Expected code that your own configuration names, found 'evil:Domain'" in text
    assert "--config-dir FOLDER" in text
    if name == "best":
        command(*arguments, "--trust")
        assert (tmp_path / "it ran").exists()
        assert not is_trusted("evil:Domain")


@pytest.mark.parametrize("part", KEYS)
def test_decisions_look_at_all_code_that_a_run_names(
    original: Path, part: str, tmp_path: Path
) -> None:
    """`recorded_decisions` reads the whole configuration, which imports each class and function."""
    run = stranger(
        original, tmp_path / "run", part, "evil:Fn" if part == "function" else "evil:Domain"
    )
    with pytest.raises(UntrustedError):
        next(recorded_decisions(run))
    assert not (tmp_path / "it ran").exists()


@pytest.mark.parametrize("group", ["domain", "environment"])
def test_names_in_the_user_s_folder_are_trusted(group: str, tmp_path: Path) -> None:
    """A file of a group of --config-dir vouches for the class; a run below that folder does not."""
    config = plain()
    config["domain"] = {"factory": "evil:Domain"} if group == "domain" else config["domain"]
    config["world"] = {"environment": "evil:Env-v0"} if group == "environment" else {}
    runs = tmp_path / "conf/runs/name/run"
    runs.mkdir(parents=True)
    (runs / "config.yaml").write_text(yaml.safe_dump(config))
    trust_folder(tmp_path / "conf")
    with pytest.raises(UntrustedError):
        Problem.recorded(config)
    file = tmp_path / "conf/domain/mine.yaml"
    file.parent.mkdir()
    file.write_text(yaml.safe_dump({k: config[k] for k in ("domain", "world")}))
    (file.parent / "broken.yaml").write_text("{")
    trust_folder(tmp_path / "conf")
    must_trust_code({key: config[key] for key in ("domain", "world")})


def test_a_composed_configuration_is_trusted(tmp_path: Path) -> None:
    """A run of the user's own class needs no further word, in its own process."""
    evaluator = ("evaluator=serial", "evaluator.factory=tests.running.evaluators:Instant")
    small = ("supervisor=baseline", "gp.population=4", "gp.generations=2", "progress=off")
    assert main([*small, *evaluator, "gp.validation=0", "tracking=off", f"runs={tmp_path}/r"]) == 0
    assert is_trusted("tests.running.evaluators:Instant")


def test_a_replayed_transcript_names_no_class(tmp_path: Path) -> None:
    """`supervisor=replay` reads settings from a transcript, with the class of the fallback."""
    policy = plain("supervisor=llm")["supervisor"]["policy"]
    policy["fallback"] = {"factory": "evil:Domain", "policy": {}}
    start = {"line": "start", "settings": policy, "dialect": None}
    (tmp_path / "transcript.jsonl").write_text(json.dumps(start) + "\n")
    overrides = ("supervisor=replay", f"supervisor.policy.transcript={tmp_path}", "tracking=off")
    assert main([*overrides, "gp.population=4", "gp.generations=2", "evaluator=serial"]) == 2
    assert not (tmp_path / "it ran").exists()


def test_a_run_that_starts_from_a_stranger_s_archive_runs_none_of_its_code(
    original: Path, tmp_path: Path
) -> None:
    """`start=RUN` reads text and JSON."""
    run = stranger(original, tmp_path / "run")
    small = ("gp.population=4", "gp.generations=2", "evaluator=serial", "tracking=off")
    main([f"start={run}", *small])
    assert not (tmp_path / "it ran").exists()


def test_sync_as_a_function_refuses_as_well(original: Path, tmp_path: Path) -> None:
    """The result names the folder; nothing was sent of it."""
    run = stranger(original, tmp_path / "run")
    report = sync(run, place_from("sqlite:///mlflow.db", "islandgp"))
    assert isinstance(report.failed[run], UntrustedError)
    store = Store(place_from("sqlite:///mlflow.db", "islandgp"))
    assert store.client.search_runs([store.experiment]) == []


@pytest.mark.parametrize(
    ("config", "names"),
    [
        ({"factory": "a.b.C"}, ["a.b.C"]),
        ({"x": [{"y": "m.n:f"}], "z": "sqlite:///a.db", "t": "08:30", "w": "a: b"}, ["m.n:f"]),
    ],
)
def test_what_names_code(config: dict[str, Any], names: list[str]) -> None:
    """Each `factory`, with or without a colon, and what looks like a module's name."""
    assert list(code_in(config)) == names
    with trusting(), pytest.raises(UntrustedError):
        must_trust_code(config)
    with trusting():
        trust(names)
        must_trust_code(config)
