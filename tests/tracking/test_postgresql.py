"""Several processes at once with an MLflow server on PostgreSQL."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from time import monotonic, sleep
from urllib.error import URLError
from urllib.request import urlopen

import pytest

from tests.running.commands import finish, start
from tests.tracking.test_ui import free_port

GENERATIONS = 4
TINY = (
    "supervisor=baseline", "gp.population=6", f"gp.generations={GENERATIONS}",
    "world.episode.length=20", "evaluator=serial", "progress=plain", "tracking.policy.patience=600",
)  # fmt: skip


def programs() -> Path | None:
    """The folder of PostgreSQL's programs; Debian keeps them off the path."""
    if program := shutil.which("initdb"):
        return Path(program).resolve().parent
    return max(Path("/usr/lib/postgresql").glob("*/bin"), default=None)


def as_nobody_special() -> dict[str, str]:
    """Arguments of a process that must not be root's, as PostgreSQL refuses root."""
    return {"user": "postgres", "group": "postgres"} if os.geteuid() == 0 else {}


@pytest.fixture
def database() -> Iterator[str]:
    """The address of a private PostgreSQL server on loopback, in a separate folder."""
    folder = programs()
    if folder is None or find_spec("psycopg2") is None:
        pytest.skip("needs PostgreSQL (apt-get install postgresql) and islandgp[postgresql]")
    home = Path(tempfile.mkdtemp())
    account = as_nobody_special()
    if account:
        shutil.chown(home, account["user"], account["group"])
    port, data = free_port(), str(home / "data")
    quiet = {"check": True, "stdout": subprocess.DEVNULL, "cwd": home, **account}
    options = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories='' -c fsync=off"
    try:
        subprocess.run([folder / "initdb", "-D", data, "-U", "me", "-A", "trust", "-N"], **quiet)
        control = [folder / "pg_ctl", "-D", data, "-w", "-t", "120", "-l", str(home / "log")]
        subprocess.run([*control, "-o", options, "start"], **quiet)
        try:
            yield f"postgresql+psycopg2://me@127.0.0.1:{port}/postgres"
        finally:
            subprocess.run([*control, "-m", "immediate", "stop"], **quiet)
    finally:
        shutil.rmtree(home)


@pytest.fixture
def server(database: str, tmp_path: Path) -> Iterator[str]:
    """The address of an MLflow server on that database."""
    port = free_port()
    command = [
        sys.executable, "-m", "mlflow", "server", "--backend-store-uri", database,
        "--artifacts-destination", str(tmp_path / "artifacts"), "--host", "127.0.0.1",
        "--port", str(port), "--workers", "1",
    ]  # fmt: skip
    address = f"http://127.0.0.1:{port}"
    with (tmp_path / "server.log").open("wb") as log:
        process = subprocess.Popen(
            command,
            cwd=tmp_path,
            env={**os.environ, "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"},
            stdout=log,
            stderr=log,
        )
        try:
            end = monotonic() + 600
            while not answers(address):
                assert process.poll() is None, (tmp_path / "server.log").read_text()
                assert monotonic() < end, (tmp_path / "server.log").read_text()
                sleep(0.5)
            yield address
        finally:
            process.terminate()
            process.wait()


def answers(address: str) -> bool:
    """Whether the server is up."""
    try:
        urlopen(f"{address}/health", timeout=5).close()
    except (URLError, TimeoutError):
        return False
    return True


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_four_processes_at_once(server: str, tmp_path: Path) -> None:
    """Each run's metrics arrive, a point for each of its generations; all runs are finished."""
    from mlflow import MlflowClient

    processes = [
        start(tmp_path, *TINY, f"seed={seed}", f"tracking.policy.uri={server}") for seed in range(4)
    ]
    ends = [finish(process, 1500) for process in processes]
    assert [code for code, _ in ends] == [0] * 4, ends
    client = MlflowClient(server)
    experiment = client.get_experiment_by_name("islandgp")
    assert experiment is not None
    runs = client.search_runs([experiment.experiment_id])
    assert sorted(run.data.tags["seed"] for run in runs) == ["0", "1", "2", "3"]
    for run in runs:
        assert run.info.status == "FINISHED"
        for name in ("fitness_max", "fitness_mean"):
            points = client.get_metric_history(run.info.run_id, name)
            assert [point.step for point in points] == list(range(GENERATIONS)), (run, name)
