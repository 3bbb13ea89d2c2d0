"""Faults of what surrounds a run: clock, encoding, display, MLflow's server and database."""

from __future__ import annotations

import os
import signal
import socket
import sqlite3
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from time import sleep
from typing import Final

from islandgp.tracking.store import TrackingStore
from islandgp.tracking.sync import sync
from islandgp.tracking.ui import server_command
from tests.running.commands import ROOT
from tests.running.histories import store, tracked
from tests.torture.lab import QUICK, SLOW, Lab, assert_refused, communicate, start, under_way, until
from tests.tracking import servers

HERE: Final = Path(__file__).parent
DAY: Final = 86400.0  # s
TRACKED: Final = tuple(word for word in SLOW if word != "tracking=off")
IMPATIENT: Final = "tracking.policy.patience=2"


def clock(lab: Lab) -> None:
    """A clock set back and forth, before a start and in the middle of a run."""
    home = lab.folder()
    shift = home / "shift"
    env = {"CLOCK_SHIFT": str(shift), "PYTHONPATH": f"{HERE / 'clock'}{os.pathsep}{ROOT}"}

    def turn(days: float) -> None:
        new = shift.with_name("new")
        new.write_text(str(days * DAY))
        new.replace(shift)

    for n, days in enumerate((400, -400, 3650, -3650, 0.1, -0.1)):
        turn(days)
        process = start(home, *TRACKED, env=env)
        under_way(home, process, n + 1)
        process.terminate()
        ending = lab.end(process)
        assert ending.code == 130, ending
        assert "Traceback" not in ending.output, ending.output
    lab.assert_finishes(home, TRACKED)

    home = lab.folder()
    process = start(home, *TRACKED, env=env)
    for n, days in enumerate((30, -30, 1000, -1000)):
        under_way(home, process, 2 * n + 1)
        turn(days)
    ending = lab.end(process)
    assert ending.code == 0, ending
    assert "Traceback" not in ending.output, ending.output
    lab.assert_same(home, TRACKED)

    home = lab.folder()
    sweep = (*QUICK, "seed=0,1", "-m")
    for days in (400, -400):
        turn(days)
        ending = lab.run(home, *sweep, env=env)
        assert ending.code == 0, ending
        lab.assert_same(home, sweep)


def encodings(lab: Lab) -> None:
    """Terminals and locales without the characters of a name, and bytes that are no characters."""
    plain = {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    for env in (
        plain,
        {"PYTHONIOENCODING": "ascii"},
        {"PYTHONIOENCODING": "ascii:strict"},
        {"PYTHONIOENCODING": "latin-1"},
        {"PYTHONIOENCODING": "utf-16"},
        {**plain, "LC_ALL": "POSIX", "TERM": "dumb", "COLUMNS": "1"},
        {"LC_ALL": "nowhere.UTF-8"},
    ):
        home = lab.folder() / "Räuber Ω"
        home.mkdir()
        ending = lab.run(home, *QUICK, env=env)
        assert ending.code == 0, (env, ending)
        assert "Traceback" not in ending.output, ending.output
        lab.assert_same(home, QUICK)
    home = lab.folder() / os.fsdecode(b"no\xff\xe4character")
    home.mkdir()
    ending = lab.run(home, *QUICK)
    assert ending.code == 0, ending
    assert "Traceback" not in ending.output, ending.output
    lab.assert_same(home, QUICK)
    odd = os.fsdecode(b"name=\xff\xfe")
    ending = lab.run(lab.folder(), *QUICK, odd)
    assert_refused(ending, "name")


def display(lab: Lab) -> None:
    """Output that is closed, full or read by nobody any more."""
    for streams in ("2>&-", ">&- 2>&-", "<&- >&- 2>&-", "2>/dev/full", "2>&1 | head -1"):
        home = lab.folder()
        ends = f'"$@" {streams}; exit "${{PIPESTATUS[0]}}"'
        ending = lab.run(home, *QUICK, prefix=("bash", "-c", ends, "bash"))
        assert ending.code == 0, (streams, ending)
        lab.assert_same(home, QUICK)
    home = lab.folder()
    ending = lab.run(home, *QUICK, prefix=("bash", "-c", '"$@" >/dev/full', "bash"))
    assert_refused(ending, "standard output")
    lab.assert_same(home, QUICK)


@contextmanager
def slow_server(seconds: float = 3.0) -> Iterator[str]:
    """A server that takes its time and then refuses."""

    class Slow(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            sleep(seconds)
            self.send_response(503)
            self.end_headers()

        do_POST = do_PUT = do_PATCH = do_GET

        def log_message(self, format: str, *args: object) -> None:
            """Prints nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Slow)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()


def tracking_server(lab: Lab) -> None:
    """An MLflow server that is away, silent, slow, or answers 500; then `sync` elsewhere."""
    makers: tuple[Callable[[], AbstractContextManager[str]], ...] = (
        servers.refusing,
        servers.stalling,
        servers.broken,
        slow_server,
    )
    for make in makers:
        home = lab.folder()
        with make() as uri:
            ending = lab.run(home, *TRACKED, IMPATIENT, f"tracking.policy.uri={uri}")
        assert ending.code == 0, (make, ending)
        assert "islandgp sync" in ending.output
        assert "Traceback" not in ending.output, ending.output
        lab.assert_same(home, SLOW)
        assert_sent(home)


def dying_server(lab: Lab) -> None:
    """MLflow's server killed while a run sends to it: the run goes on, and `sync` catches up."""
    home = lab.folder()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    place = TrackingStore(f"sqlite:///{home / 'server.db'}", str(home / "kept"), "islandgp")
    server = subprocess.Popen(
        server_command(place, port),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        until(lambda: answers(port), "MLflow's server answers")
        uri = f"tracking.policy.uri=http://127.0.0.1:{port}"
        process = start(home, *TRACKED, IMPATIENT, uri)
        under_way(home, process, 2)
    finally:
        os.killpg(server.pid, signal.SIGKILL)
        server.wait()
    ending = lab.end(process)
    assert ending.code == 0, ending
    assert "islandgp sync" in ending.output
    assert "Traceback" not in ending.output, ending.output
    lab.assert_same(home, SLOW)
    assert_sent(home)


def answers(port: int) -> bool:
    """Whether somebody listens at a port of loopback."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def assert_sent(home: Path) -> None:
    """Asserts that `sync` brings the run to a store, each generation once."""
    mlflow_store = store(home)
    assert not sync(home / "runs", mlflow_store.place).failed
    (run,) = tracked(mlflow_store)
    assert run.status == "FINISHED", run
    assert [step for step, _ in run.points["fitness_max"]] == list(range(12)), run


def database(lab: Lab) -> None:
    """A database that another program locks, that is no database, or that is a folder."""
    home = lab.folder()
    code, output = communicate(start(home, *TRACKED, "seed=5"))
    assert code == 0, output
    with sqlite3.connect(home / "mlflow.db", isolation_level=None) as connection:
        connection.execute("begin exclusive")
        ending = lab.run(home, *TRACKED, IMPATIENT)
        assert ending.code == 0, ending
        assert "islandgp sync" in ending.output
        assert "Traceback" not in ending.output, ending.output
        connection.execute("rollback")
    connection.close()
    assert not sync(home / "runs", store(home).place).failed
    assert sorted(run.status for run in tracked(store(home))) == ["FINISHED"] * 2

    spoils: tuple[Callable[[Path], object], ...] = (
        lambda file: file.write_bytes(b"no database at all\n" * 500),
        lambda file: file.write_bytes(b""),
        Path.mkdir,
    )
    for spoil in spoils:
        home = lab.folder()
        spoil(home / "mlflow.db")
        ending = lab.run(home, *TRACKED, IMPATIENT)
        assert ending.code in (0, 2), ending
        assert "Traceback" not in ending.output, ending.output
        if ending.code:
            assert_refused(ending)
        else:
            lab.assert_same(home, SLOW)


def killed_between_run_and_store(lab: Lab) -> None:
    """`kill -9` while records go to MLflow; the same command gives it each point once."""
    home = lab.folder()
    for n in range(4):
        process = start(home, *TRACKED)
        under_way(home, process, 2 * n + 1)
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        lab.cases += 1
    lab.assert_finishes(home, TRACKED)
    assert_sent(home)
