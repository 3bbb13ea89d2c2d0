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
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from time import monotonic, sleep
from typing import Final
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
    if place.file is None:
        yield _pages(place, place.uri)
        return
    _must_be_servable(place.file, port)
    pages = _pages(place, f"http://{HOST}:{port}")
    process = subprocess.Popen(
        server_command(place, port),
        # Without its job runner the server takes 0.5 GB in place of 3.5 GB.
        env={
            **os.environ,
            "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
            "PYTHONWARNINGS": "ignore",  # of its libraries
        },
        stdout=2,  # the standard output has the addresses
        start_new_session=True,
    )
    try:
        _wait(process, f"http://127.0.0.1:{port}/health")
        yield pages
    finally:
        _stop(process)


def _pages(place: TrackingStore, server: str) -> Pages:
    """The pages on a server, once the store has the view of the arms. Raises TrackingError."""
    try:
        store = Store(place)
        sweep = share_view(store)
    except TrackingError:
        raise
    except Exception as error:  # a store may be away, or damaged, in any way
        raise TrackingError(
            f"Expected an MLflow store at {place.uri}, found none that answers: {brief(error)}"
        ) from error
    arms = runs_page(server, store.experiment, "CHART") + "&viewStateShareKey=arms"
    return Pages(arms, runs_page(server, store.experiment, "TABLE"), sweep)


def server_command(place: TrackingStore, port: int) -> list[str]:
    """The command of an MLflow server of the store, on a port of this machine alone."""
    hosts = [f"{host}:{port}" for host in (HOST, "127.0.0.1", "localhost")]
    return [
        *(sys.executable, "-m", "mlflow", "server"),
        *("--backend-store-uri", place.address),
        *("--default-artifact-root", location(Path(place.artifacts or "mlartifacts").absolute())),
        *("--host", "127.0.0.1", "--port", str(port), "--workers", "1"),
        *("--uvicorn-opts", "--log-level warning"),
        *("--allowed-hosts", ",".join(hosts)),
        *("--cors-allowed-origins", ",".join(f"http://{host}" for host in hosts)),
    ]


def _must_be_servable(file: Path, port: int) -> None:
    """Raises TrackingError without the file, the whole of MLflow or a free port."""
    if not file.is_file():
        raise TrackingError(
            f"Expected an MLflow store in {file}, found no such file; give --uri of one that"
            " is there, or leave it out for that of the last run."
        )
    try:
        distribution("mlflow")
    except PackageNotFoundError:
        raise TrackingError(
            "Expected MLflow with its pages, found its client alone; pip install 'islandgp[ui]'"
        ) from None
    check_addresses(file)
    with socket.socket() as probe:
        if probe.connect_ex(("127.0.0.1", port)) == 0:
            raise TrackingError(
                f"Expected port {port} to be free, found a server there; stop it, or give --port."
            )


def _wait(process: subprocess.Popen[bytes], address: str) -> None:
    """Waits until the server answers. Raises TrackingError if it ends, or does not answer."""
    end = monotonic() + STARTS
    while monotonic() < end and process.poll() is None:
        with suppress(OSError), urlopen(address, timeout=2):
            return
        sleep(0.2)
    found = "silence" if process.poll() is None else "that it ended, for the reason above"
    raise TrackingError(f"Expected the MLflow server to answer in {STARTS:g} s, found {found}.")


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Ends the server and its child processes; immediately at a second Ctrl-C."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with suppress(subprocess.TimeoutExpired, KeyboardInterrupt, ProcessLookupError):
            os.killpg(process.pid, number)
            process.wait(10)
            return
