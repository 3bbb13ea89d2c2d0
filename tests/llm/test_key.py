"""The key: no file or output of a run has it, however it is given, with any error."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from islandgp.config.api_key import NONE, key_in, without_key
from islandgp.errors import ConfigError
from islandgp.resources import resource
from islandgp.running.app import main
from islandgp.supervision.llm.settings import LLMSettings
from tests.composed import composed, plain
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
        ("command", "mlflow"),
        ("command, in a sweep", "off"),
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
    if "command" in source:
        overrides.append(f"supervisor.policy.api_key={KEY}")
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


@pytest.mark.parametrize("source", ["command", "environment"])
def test_a_run_in_this_process_leaves_the_key_nowhere(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    source: str,
) -> None:
    """The quick form of the same: the run's folder and the screen."""
    monkeypatch.chdir(tmp_path)
    overrides = [*SMALL, "tracking=off"]
    if source == "command":
        overrides.append(f"supervisor.policy.api_key={KEY}")
    else:
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
        overrides = [*SMALL, "evaluator=processes", "evaluator.policy.workers=2", "tracking=off"]
        assert main([*overrides, f"supervisor.policy.base_url={server.url}"]) == 0
    assert any(b"popen_loky" in line for line in commands)
    assert [line for line in commands if PIECE in line] == []


@pytest.mark.parametrize(
    "override",
    [
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
def test_a_key_inside_a_value_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    override: str,
    sweep: tuple[str, ...],
) -> None:
    """A key inside a dict has no dotted name by which folders, records and MLflow could hide it."""
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
    assert line.startswith(f"islandgp: {name}: expected no secret inside a value, found ")
    assert "set ANTHROPIC_API_KEY in the environment" in line


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
    assert without_key([word]) == [word]


@pytest.mark.parametrize(
    "override",
    [
        "supervisor.policy.model=",
        "supervisor.policy.retry.attempts=none",
        "supervisor.policy.retri=1",
        "supervisor.policy.caps.usd=-1",
        "supervisor.policy.max_tokens=1",
        "supervisor.lag=99",
        "gp.population=-4",
        "supervisor=lmm",
    ],
)
def test_no_error_shows_the_key(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    override: str,
) -> None:
    """A mistake elsewhere in the command is reported without the rest of the command."""
    monkeypatch.chdir(tmp_path)
    code = main([*SMALL, f"supervisor.policy.api_key={KEY}", override])
    captured = capfd.readouterr()
    assert code == 2
    assert PIECE.decode() not in captured.out + captured.err


def test_the_config_dump_of_hydra_shows_no_key(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """`--cfg job` prints the configuration without a key that the command gives."""
    monkeypatch.chdir(tmp_path)
    assert main(["supervisor=llm", f"supervisor.policy.api_key={KEY}", "--cfg", "job"]) == 0
    output = capfd.readouterr().out
    assert "api_key: null" in output
    assert PIECE.decode() not in output


def test_without_a_key_nothing_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, five ways named, no file written; the same for a sweep."""
    monkeypatch.chdir(tmp_path)
    for arguments in ([], ["-m", "seed=range(3)"]):
        assert main([*arguments, *SMALL]) == 2
        errors = capfd.readouterr().err
        assert errors.startswith("islandgp: Expected a key or an address for supervisor=llm")
        assert [f"{n}. " in errors for n in range(1, 7)] == [True] * 5 + [False]
        assert list(tmp_path.iterdir()) == []


def test_a_key_on_the_command_line_is_moved_to_the_environment() -> None:
    """In every form that Hydra knows; other arguments stay as they are."""
    for form in ("", "+", "++"):
        arguments = ["seed=1", f"{form}supervisor.policy.api_key={KEY}", "-m"]
        assert without_key(arguments) == ["seed=1", NONE, "-m"]
        assert os.environ.pop("ANTHROPIC_API_KEY") == os.environ.pop("OPENAI_API_KEY") == KEY
    for argument in (f"supervisor.policy.api_key='{KEY}'", f" supervisor.policy.api_key = {KEY}"):
        assert without_key([argument]) == [NONE]
        assert os.environ.pop("ANTHROPIC_API_KEY") == os.environ.pop("OPENAI_API_KEY") == KEY
    assert without_key(["supervisor.policy.api_key=null"]) == [NONE]
    assert "ANTHROPIC_API_KEY" not in os.environ


def test_a_key_in_a_file_is_moved_to_the_environment() -> None:
    """Found in what Hydra composed; two different ones are an error that shows neither."""
    config = plain("supervisor=llm", f"supervisor.policy.api_key={KEY}")
    assert not key_in([plain("supervisor=llm"), plain("supervisor=expert")])
    assert key_in([config, plain("supervisor=baseline")])
    assert os.environ["ANTHROPIC_API_KEY"] == os.environ["OPENAI_API_KEY"] == KEY
    other = plain("supervisor=llm", "supervisor.policy.api_key=another")
    for call in (lambda: key_in([config, other]), lambda: without_key([f"{NONE[:-4]}a,b"])):
        with pytest.raises(ConfigError, match="ANTHROPIC_API_KEY") as excinfo:
            call()
        assert KEY not in str(excinfo.value)


def test_settings_do_not_show_the_key() -> None:
    """Neither printed, nor dumped, nor in the error of another field."""
    loaded = settings(f"api_key={KEY}")
    assert KEY not in f"{loaded!r}{loaded}{loaded.model_dump()}{loaded.model_dump_json()}"
    policy = composed("supervisor=llm").supervisor.policy
    with pytest.raises(ValueError, match="phases") as excinfo:
        LLMSettings.model_validate({**policy, "api_key": KEY, "phases": {}})
    assert KEY not in str(excinfo.value)


def test_a_key_of_digits_is_a_key() -> None:
    """A command line takes it for a number."""
    llm_settings = settings("api_key=123456789")
    assert llm_settings.api_key is not None
    assert llm_settings.api_key.get_secret_value() == "123456789"


def test_no_password_in_the_address() -> None:
    """An address is written into the configuration; a password in it would be, too."""
    for url in ("http://user:secret@localhost:1", "localhost:11434", "ftp://x"):
        with pytest.raises(ConfigError) as excinfo:
            settings(f"base_url='{url}'")
        assert "secret" not in str(excinfo.value)
