"""A password in a store's address: the server gets it, and nothing and nobody else."""

from __future__ import annotations

import os
from base64 import b64encode
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from islandgp.cli import islandgp
from islandgp.records.manifest import add_to_manifest
from islandgp.records.parameters import redacted, without_credentials
from islandgp.running.app import main
from islandgp.tracking.store import ACCOUNT, MLflowSettings, TrackingStore, _authenticate
from islandgp.tracking.sync import sync
from tests.profiles import sweep
from tests.running.commands import TINY, fake, finish, start
from tests.tracking import servers
from tests.tracking.folders import closed_run

PASSWORD = "s3cret-w%40rd"
PIECE = "s3cret"
BASIC = "Basic " + b64encode(b"me:s3cret-w@rd").decode()


def secret_overrides(source: str, address: str, home: Path) -> list[str]:
    """Overrides of a command in `home` that send to the address, with the password in it."""
    uri = address.replace("://", f"://me:{PASSWORD}@")
    overrides = [*TINY, *fake("Instant"), f"tracking.policy.uri={uri}"]
    if source == "file":
        conf = home.parent / "conf/tracking"
        conf.mkdir(parents=True)
        (conf / "mine.yaml").write_text(f"defaults: [mlflow]\npolicy: {{uri: {uri!r}}}\n")
        (home / "conf").symlink_to(conf.parent)
        overrides[-1:] = ["tracking=mine", "--config-dir", "conf"]
    if source in ("sweep", "local"):
        overrides += ["seed=0,1", "-m"]
    if source == "local":  # the jobs' processes send, and at the end this one
        overrides += ["hydra/launcher=local", "hydra.launcher.n_jobs=2"]
    return overrides


def check_secret(home: Path, output: str, credentials: list[str]) -> None:
    """The server got the password; no file below the folder and no line has a piece of it."""
    assert set(credentials) == {BASIC}
    assert PIECE not in output
    assert "***@127.0.0.1" in (next(home.rglob("config.yaml"))).read_text()
    assert [f for f in home.rglob("*") if f.is_file() and PIECE in f.read_text()] == []


@sweep("source", ["command", "file"], quick=1)
def test_only_the_server_gets_the_password(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A run in this process."""
    home, credentials = tmp_path / "home", list[str]()
    home.mkdir()
    monkeypatch.chdir(home)
    with servers.broken(credentials) as address:
        overrides = secret_overrides(source, address, home)
        assert main([*overrides, "gp.generations=2", "tracking.policy.patience=2"]) == 0
    check_secret(home, "".join(capfd.readouterr()), credentials)


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize("source", ["command", "sweep", "local", "file"])
def test_only_the_server_gets_the_password_of_a_process(source: str, tmp_path: Path) -> None:
    """Runs and sweeps as a user starts them."""
    home, credentials = tmp_path / "home", list[str]()
    home.mkdir()
    with servers.broken(credentials) as address:
        overrides = secret_overrides(source, address, home)
        code, output = finish(start(home, *overrides, "tracking.policy.patience=15"))
    assert code == 0, output
    check_secret(home, output, credentials)


@pytest.mark.parametrize("is_users", [True, False])
def test_a_sweep_s_end_knows_what_the_folders_lack(
    is_users: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The jobs' processes may have sent nothing: each request of the last one has the password.

    A server that only the folder names gets none.
    """
    for name in ("USERNAME", "PASSWORD"):
        monkeypatch.setenv(f"MLFLOW_TRACKING_{name}", "")
    credentials: list[str] = []
    with servers.broken(credentials) as address:
        run_on(tmp_path / "sweep/one", address.replace("://", "://***@"))
        settings = MLflowSettings(
            uri=address.replace("://", f"://me:{PASSWORD}@"),
            artifacts="a",
            experiment="islandgp",
            patience=0,
        )
        places = (TrackingStore.of(settings, tmp_path),) if is_users else ()
        sync(tmp_path, places=places)
    assert set(credentials) == ({BASIC} if is_users else set())
    assert [PIECE in repr(place) for place in places] == [False] * is_users


def run_on(path: Path, address: str) -> None:
    """A finished run whose configuration names a server."""
    folder = closed_run(path, path.parent)
    config = folder.configuration()
    config["tracking"]["policy"]["uri"] = address
    (path / "config.yaml").write_text(yaml.safe_dump(config))
    add_to_manifest(path, "config.yaml")


@pytest.mark.parametrize("source", ["run", "variable", "file"])
def test_a_server_that_only_a_folder_names_is_not_asked(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The variables, the command or a file of the user's can name it."""
    monkeypatch.setenv("MLFLOW_TRACKING_USERNAME", "me")
    monkeypatch.setenv("MLFLOW_TRACKING_PASSWORD", "b")
    monkeypatch.chdir(tmp_path)
    credentials: list[str] = []
    arguments = ["sync", "runs"]
    with servers.broken(credentials) as address:
        run_on(tmp_path / "runs/one", address)
        if source == "variable":
            monkeypatch.setenv("MLFLOW_TRACKING_URI", f"{address}/")
        elif source == "file":
            file = tmp_path / "conf/tracking/mine.yaml"
            file.parent.mkdir(parents=True)
            uri = address.replace("://", "://a:b@")
            file.write_text(f"defaults: [mlflow]\npolicy: {{uri: '{uri}'}}")
            arguments += ["--config-dir", "conf"]
        result = CliRunner().invoke(islandgp, arguments)
    assert bool(credentials) == (source != "run")
    assert ("which only the run names; give --uri" in str(result.exception)) == (source == "run")


def test_each_store_has_its_password(monkeypatch: pytest.MonkeyPatch) -> None:
    """The one of an address is not sent to the next store, which gets the user's variables."""
    _authenticate(TrackingStore("http://two", None, "e"))
    monkeypatch.setenv("MLFLOW_TRACKING_USERNAME", "outside")
    monkeypatch.delenv("MLFLOW_TRACKING_PASSWORD", raising=False)
    one = TrackingStore("http://one", None, "e", credentials="me:pass")
    _authenticate(one)
    assert [os.environ.get(variable) for variable in ACCOUNT] == ["me", "pass"]
    _authenticate(TrackingStore("http://two", None, "e"))
    assert [os.environ.get(variable) for variable in ACCOUNT] == ["outside", None]


def test_a_wrong_address_is_reported_without_its_password(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The message of a mistake shows the value that is wrong."""
    monkeypatch.chdir(tmp_path)
    assert main([f"tracking.policy.uri=ftp://me:{PASSWORD}@host"]) == 2
    output = "".join(capfd.readouterr())
    assert "ftp://***@host" in output
    assert PIECE not in output


@pytest.mark.parametrize(
    ("text", "redacted_text"),
    [
        ("http://me:pass@host:5000/x", "http://***@host:5000/x"),
        ("see https://a:b@c@host, and http://host", "see https://***@host, and http://host"),
        ("http://host/a@b", "http://host/a@b"),
        ("sqlite:////home/a@b/mlflow.db", "sqlite:////home/a@b/mlflow.db"),
    ],
)
def test_which_addresses_hold_credentials(text: str, redacted_text: str) -> None:
    """What is before an @ and the first slash; paths stay as they are."""
    assert without_credentials(text) == redacted_text
    assert redacted({"a": {"b": [text]}, "c": text}) == {
        "a": {"b": [redacted_text]},
        "c": redacted_text,
    }


def test_a_place_is_the_same_with_and_without_credentials(tmp_path: Path) -> None:
    """So a run finds what it has sent, and an address from a run's folder works as well."""
    places = {
        TrackingStore.of(
            MLflowSettings(
                uri=f"http://{user}host:5000", artifacts="a", experiment="e", patience=0
            ),
            tmp_path,
        )
        for user in ("", "me:pass@", "***@")
    }
    (place,) = places
    assert place.uri == "http://host:5000"
    assert "pass" not in repr(places)
