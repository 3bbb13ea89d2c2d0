"""The user's password for a store: only servers that the user names get it."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from islandgp.cli import islandgp
from islandgp.records.parameters import redacted, without_credentials
from islandgp.running.app import main
from tests.records.listed import add_to_manifest
from tests.tracking import servers
from tests.tracking.folders import closed_run

PASSWORD = "s3cret-w%40rd"
PIECE = "s3cret"
BASIC = "Basic " + b64encode(b"me:s3cret-w@rd").decode()


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
            file.write_text(f"defaults: [mlflow]\npolicy: {{uri: '{address}'}}")
            arguments += ["--config-dir", "conf"]
        result = CliRunner().invoke(islandgp, arguments)
    assert bool(credentials) == (source != "run")
    assert ("which only the run names; give --uri" in str(result.exception)) == (source == "run")


@pytest.mark.parametrize("option", ["tracking.policy.uri=", "--uri"])
def test_an_address_has_no_password(
    option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The message names the variables instead, and hides it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    address = f"http://me:{PASSWORD}@host"
    if option == "--uri":
        message = str(CliRunner().invoke(islandgp, ["sync", "--uri", address]).exception)
    else:
        assert main([f"{option}{address}"]) == 2
        message = "".join(capfd.readouterr())
    assert "MLFLOW_TRACKING_USERNAME" in message
    assert PIECE not in message


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
