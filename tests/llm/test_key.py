"""The key: no file or output of a run has it, however it is given, with any error."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from islandgp.errors import ConfigError
from islandgp.records.parameters import secret_in
from islandgp.resources import resource
from islandgp.running.app import main
from islandgp.supervision.llm.settings import LLMSettings
from tests.composed import composed
from tests.llm.faults import Fault, every
from tests.llm.samples import settings
from tests.llm.server import MessagesServer

pytestmark = pytest.mark.process

KEY = "sk-ant-test-0123456789abcdefXYZ"
PIECE = KEY[7:23].encode()  # part of it is too much, too
SMALL = (
    "gp.population=6",
    "gp.generations=3",
    "world.episode.length=10",
    "evaluator=serial",
    "supervisor=llm",
)


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Changes of the variable by these tests are undone."""
    for name in ("ANTHROPIC_API_KEY", "OPENAI_API_KEY"):
        monkeypatch.setenv(name, "x")
        monkeypatch.delenv(name)


def holders(folder: Path) -> list[Path]:
    """The files below a folder, hidden ones included, that hold a piece of the key."""
    return [f for f in folder.rglob("*") if f.is_file() and PIECE in f.read_bytes()]


def run(home: Path, *arguments: str, environment: dict[str, str] | None = None) -> str:
    """The whole command in its own process; returns all that it printed."""
    free = {k: v for k, v in os.environ.items() if not k.startswith("ANTHROPIC")}
    root = str(resource("conf").parent)
    process = subprocess.run(
        [sys.executable, "-m", "islandgp", *arguments],
        cwd=home,
        env={**free, "PYTHONPATH": root, **(environment or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    return f"{process.returncode}\n{process.stdout}\n{process.stderr}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "tracking"),
    [
        ("environment", "off"),
        ("file", "off"),
        ("file, in a sweep", "mlflow"),
    ],
)
def test_a_run_leaves_the_key_nowhere(tmp_path: Path, source: str, tracking: str) -> None:
    """Not in records, config dump, transcript, MLflow's store and artifacts, nor on the screen.

    The server quotes the key in its errors, which is the hardest case.
    """
    home, conf = tmp_path / "home", tmp_path / "conf" / "experiment"
    home.mkdir()
    conf.mkdir(parents=True)
    (conf / "mine.yaml").write_text(
        f"# @package _global_\nsupervisor: {{policy: {{api_key: {KEY}}}}}\n", encoding="utf-8"
    )
    overrides = [f"tracking={tracking}", *SMALL]
    flags = []
    if "file" in source:
        flags = ["--config-dir", str(conf.parent)]
        overrides.append("experiment=mine")
    if "sweep" in source:
        overrides.append("seed=range(2)")
        flags.append("-m")
    environment = {"ANTHROPIC_API_KEY": KEY} if source == "environment" else None
    with MessagesServer(every(3, [Fault.UNAUTHORISED, Fault.RETRY_SOON])) as server:
        url = f"supervisor.policy.base_url={server.url}"
        output = run(home, *flags, *overrides, url, environment=environment)
        assert server.keys
        assert {key.removeprefix("Bearer ") for key in server.keys} == {KEY}
    assert output.startswith("0\n"), output
    assert PIECE.decode() not in output
    assert holders(home) == []
    transcripts = list(home.rglob("transcript.jsonl"))
    assert transcripts
    assert any(b"invalid key Bearer [key]" in t.read_bytes() for t in transcripts)
    assert list(home.rglob("config.yaml"))
    assert bool(list(home.rglob("mlflow.db"))) == (tracking == "mlflow")


def test_a_run_in_this_process_leaves_the_key_nowhere(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """The quick form of the same: the run's folder and the screen."""
    monkeypatch.chdir(tmp_path)
    overrides = [*SMALL, "tracking=off"]
    monkeypatch.setenv("ANTHROPIC_API_KEY", KEY)
    with MessagesServer(every(3, [Fault.UNAUTHORISED])) as server:
        assert main([*overrides, f"supervisor.policy.base_url={server.url}"]) == 0
        assert {key.removeprefix("Bearer ") for key in server.keys} == {KEY}
    captured = capfd.readouterr()
    assert PIECE.decode() not in captured.out + captured.err
    assert holders(tmp_path) == []
    assert PIECE.decode() not in " ".join(map(str, tmp_path.rglob("*")))


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
def test_the_key_is_in_no_process_list(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While a model is asked, no process that the run has started shows the key in its command."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ANTHROPIC_API_KEY", KEY)
    commands: list[bytes] = []

    def look(n: int) -> Fault | None:  # noqa: ARG001 -- a script's form
        for process in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):  # it ended meanwhile
                commands.append((process / "cmdline").read_bytes())
        return None

    with MessagesServer(look) as server:
        workers = ("evaluator=processes", "evaluator.policy.workers=2")
        overrides = [*SMALL, "gp.generations=2", *workers, "tracking=off"]
        assert main([*overrides, f"supervisor.policy.base_url={server.url}"]) == 0
    assert any(b"popen_loky" in line for line in commands)
    assert [line for line in commands if PIECE in line] == []


@pytest.mark.parametrize(
    "override",
    [
        f"supervisor.policy.api_key={KEY}",
        f"++supervisor.policy.api_key='{KEY}'",
        f"supervisor.policy.my_token={KEY}=b",  # Hydra would quote it
        f"supervisor.policy={{api_key: {KEY}, base_url: 'http://127.0.0.1:1'}}",
        f"++supervisor.policy={{base_url: 'http://127.0.0.1:1', api_key : {KEY}}}",
        f"supervisor.policy={{caps: {{seconds: 1}}, Api_Key:{KEY}}}",
        f"supervisor.policy={{caps: {{seconds: 1}}}},{{api_key: {KEY}}}",
        f"supervisor.policy={{api_key: {KEY}",  # no bracket: Hydra would quote it
        f"supervisor.policy='{{api_key: {KEY}}}'",
        f'supervisor.policy={{"api_key": {KEY}}}',
        f"supervisor.policy.fallback.policy={{my_token: {KEY}}}",
        f"hydra.sweeper.params={{supervisor.policy.api_key: {KEY}}}",
    ],
)
@pytest.mark.parametrize("sweep", [(), ("seed=0,1", "-m")])
def test_a_key_on_the_command_line_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    override: str,
    sweep: tuple[str, ...],
) -> None:
    """Other processes could read it there; the line does not show it."""
    monkeypatch.chdir(tmp_path)
    quick = ("supervisor.policy.retry.attempts=1", "supervisor.policy.retry.first_wait=0")
    code = main([*SMALL, *quick, *sweep, override])
    captured = capfd.readouterr()
    assert PIECE.decode() not in captured.out + captured.err
    assert holders(tmp_path) == []
    assert PIECE.decode() not in " ".join(map(str, tmp_path.rglob("*")))
    assert list(tmp_path.iterdir()) == []
    assert code == 2
    (line,) = captured.err.splitlines()
    name = override.partition("=")[0].lstrip("+")
    assert line.startswith(f"islandgp: {name}: expected no secret on the command line, found ")
    assert "set ANTHROPIC_API_KEY or OPENAI_API_KEY in the environment" in line


@pytest.mark.parametrize(
    "word",
    [
        "tracking.policy.uri=http://token:abc@localhost:5000",
        "supervisor.policy={max_tokens: 512, model: x}",
        "name=token",
    ],
)
def test_words_without_a_secret_stay_as_they_are(word: str) -> None:
    """A limit in tokens is no secret, and an address has its own check."""
    assert secret_in(word) == ""


def test_without_a_key_nothing_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, the ways named, no file written; the same for a sweep."""
    monkeypatch.chdir(tmp_path)
    for arguments in ([], ["-m", "seed=range(3)"]):
        assert main([*arguments, *SMALL]) == 2
        errors = capfd.readouterr().err
        assert errors.startswith("islandgp: Expected a key or an address for supervisor=llm")
        ways = ("ANTHROPIC_API_KEY", "base_url", "docs/llm.md", "supervisor=local")
        assert all(way in errors for way in ways)
        assert list(tmp_path.iterdir()) == []


def test_settings_do_not_show_the_key() -> None:
    """Neither printed, nor dumped, nor in the error of another field."""
    loaded = settings(f"api_key={KEY}")
    assert KEY not in f"{loaded!r}{loaded}{loaded.model_dump()}{loaded.model_dump_json()}"
    policy = composed("supervisor=llm").supervisor.policy
    with pytest.raises(ValueError, match="phases") as excinfo:
        LLMSettings.model_validate({**policy, "api_key": KEY, "phases": {}})
    assert KEY not in str(excinfo.value)


def test_no_password_in_the_address() -> None:
    """An address is written into the configuration; a password in it would be, too."""
    for url in ("http://user:secret@localhost:1", "localhost:11434", "ftp://x"):
        with pytest.raises(ConfigError) as excinfo:
            settings(f"base_url='{url}'")
        assert "secret" not in str(excinfo.value)
