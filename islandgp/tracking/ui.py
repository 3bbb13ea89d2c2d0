"""Starts MLflow's UI for a store, with the smallest server that MLflow offers.

Its addresses are those of the runs page: the arms of the latest sweep as charts, and all runs as a
table. MLflow stores a view as a tag of the experiment and opens it by its key in the address.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from time import monotonic, sleep
from typing import Final
from urllib.error import URLError
from urllib.request import urlopen

from islandgp.errors import TrackingError, brief
from islandgp.gate import cleaned
from islandgp.tracking.sqlite_paths import check_addresses, location
from islandgp.tracking.store import Store, TrackingStore

HOST: Final = "mlflow.localhost"
"""The host in the pages' addresses, which browsers resolve to 127.0.0.1.

On localhost and 127.0.0.1 MLflow opens its assistant over a quarter of the page.
"""


def runs_page(server: str, experiment: str, mode: str) -> str:
    """The address of an experiment's runs in a mode: MLflow itself opens on an empty page."""
    query = f"workflowType=machine_learning&compareRunsMode={mode}"
    return f"{server}/#/experiments/{experiment}/runs?{query}"


def share_view(store: Store) -> str:
    """Store the view of the arms; return the name of the latest sweep, or "" if there is none.

    `arms_view.json` has the view in the format of MLflow's pages: runs grouped by their arm.
    """
    view = json.loads(Path(__file__).with_name("arms_view.json").read_text(encoding="utf-8"))
    sweeps = store.client.search_runs(
        [store.experiment], "tags.kind = 'sweep'", max_results=1, order_by=["start_time DESC"]
    )
    for sweep in sweeps:
        view["searchFilter"] = f"tags.`mlflow.parentRunId` = '{sweep.info.run_id}'"
    text = json.dumps(view, separators=(",", ":"))
    store.client.set_experiment_tag(store.experiment, "mlflow.sharedViewState.arms", text)
    return next((cleaned(sweep.data.tags.get("sweep", "")) for sweep in sweeps), "")


STARTS: Final = 300.0  # s that the server may take to start; on a busy machine it takes a minute


@dataclass(frozen=True, slots=True)
class Pages:
    """Addresses to open in a browser."""

    arms: str  # charts, a curve for each arm
    runs: str  # a table of all runs
    sweep: str = ""  # whose arms are shown; "": the store has no sweep, all runs are shown


@contextmanager
def served(place: TrackingStore, port: int) -> Iterator[Pages]:
    """Context with a running server of the store; a tracking server runs already.

    Raises:
        TrackingError: there is no such file, the port is taken, or the server does not start.
    """
    if place.file is not None and not place.file.is_file():
        raise TrackingError(
            f"Expected an MLflow store in {place.file}, found no such file; give --uri of one that"
            " is there, or leave it out for that of the last run."
        )
    if place.file is not None:
        _must_have_server()
        check_addresses(place.file)
    store, sweep = _opened(place)
    if place.file is None:
        yield _pages(place.uri, store.experiment, sweep)
        return
    _must_be_free(port)
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            server_command(place, port),
            # Without its job runner the server takes 0.5 GB in place of 3.5 GB.
            env={**os.environ, "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"},
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
        try:
            _wait(process, f"http://127.0.0.1:{port}")
            place.remove_stray_folder()
            yield _pages(f"http://{HOST}:{port}", store.experiment, sweep)
        except TrackingError as error:
            log.seek(0)
            output = log.read().decode(errors="replace").strip()[-1000:]
            raise TrackingError(f"{error}\n{output}") from None
        finally:
            _stop(process)


def _pages(server: str, experiment: str, sweep: str) -> Pages:
    arms = runs_page(server, experiment, "CHART") + "&viewStateShareKey=arms"
    return Pages(arms, runs_page(server, experiment, "TABLE"), sweep)


def _opened(place: TrackingStore) -> tuple[Store, str]:
    """The store with its view, and the name of its latest sweep."""
    try:
        store = Store(place)
        return store, share_view(store)
    except TrackingError:
        raise
    except Exception as error:  # a store may be away, or damaged, in any way
        raise TrackingError(
            f"Expected an MLflow store at {place.uri}, found none that answers: {brief(error)}"
        ) from error


def server_command(place: TrackingStore, port: int) -> list[str]:
    """The command of an MLflow server of the store, on a port of this machine alone."""
    hosts = [f"{host}:{port}" for host in (HOST, "127.0.0.1", "localhost")]
    return [
        *(sys.executable, "-m", "mlflow", "server"),
        *("--backend-store-uri", place.address),
        *("--default-artifact-root", location(Path(place.artifacts or "mlartifacts").absolute())),
        *("--host", "127.0.0.1", "--port", str(port), "--workers", "1"),
        *("--allowed-hosts", ",".join(hosts)),
        *("--cors-allowed-origins", ",".join(f"http://{host}" for host in hosts)),
    ]


def _must_have_server() -> None:
    """Raises TrackingError if only MLflow's client (mlflow-skinny) is installed."""
    try:
        distribution("mlflow")
    except PackageNotFoundError:
        raise TrackingError(
            "Expected MLflow with its pages, found its client alone; pip install 'islandgp[ui]'"
        ) from None


def _must_be_free(port: int) -> None:
    with socket.socket() as probe:
        if probe.connect_ex(("127.0.0.1", port)) == 0:
            raise TrackingError(
                f"Expected port {port} to be free, found a server there; stop it, or give --port."
            )


def _wait(process: subprocess.Popen[bytes], address: str) -> None:
    end = monotonic() + STARTS
    while monotonic() < end:
        if process.poll() is not None:
            raise TrackingError("Expected the MLflow server to start, found that it ended:")
        try:
            with urlopen(f"{address}/health", timeout=2):
                return
        except (URLError, OSError):
            sleep(0.2)
    raise TrackingError(f"Expected the MLflow server to answer in {STARTS:g} s, found silence:")


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Ends the server and its child processes; immediately at a second Ctrl-C."""
    if process.poll() is not None:
        return
    try:
        _end(process, kill=False)
        process.wait(10)
    except (subprocess.TimeoutExpired, KeyboardInterrupt):
        _end(process, kill=True)
        process.wait()


def _end(process: subprocess.Popen[bytes], *, kill: bool) -> None:
    if os.name == "posix":
        os.killpg(process.pid, signal.SIGKILL if kill else signal.SIGTERM)
    else:
        process.kill()
