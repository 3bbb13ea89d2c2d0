"""Signals that end a command as Ctrl-C does."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from islandgp import startup
from islandgp.commands import trees
from islandgp.running.console import as_ctrl_c
from islandgp.startup import stop_before_work
from tests.running.commands import ROOT
from tests.trees.shell import shell


class Finalized:
    """Its end takes a while, in which a signal comes."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGTERM)


def work() -> None:
    """A signal comes in a finalizer; then it goes on for ten seconds, unless something ends it."""
    Finalized()
    until = time.monotonic() + 10
    while time.monotonic() < until:
        time.sleep(0.01)


def test_a_signal_that_a_finalizer_swallows_comes_again() -> None:
    """Python lets no exception out of a finalizer, and a simulator frees its spaces in one."""
    ours = sys.unraisablehook
    with pytest.raises(KeyboardInterrupt), as_ctrl_c("SIGTERM"):
        work()
    assert sys.unraisablehook is ours


def test_other_faults_of_finalizers_are_reported_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """They end nothing."""
    reported: list[object] = []
    monkeypatch.setattr(
        sys, "unraisablehook", lambda unraisable: reported.append(unraisable.exc_value)
    )

    class Faulty:
        def __del__(self) -> None:
            raise ValueError("no")

    with as_ctrl_c("SIGTERM"):
        Faulty()
    assert [str(fault) for fault in reported] == ["no"]


@pytest.fixture
def handlers() -> Iterator[None]:
    """Puts the handlers of the signals back that the test sets."""
    old = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in old.items():
        signal.signal(number, handler)


@pytest.mark.skipif(os.name != "posix", reason="needs SIGHUP")
@pytest.mark.usefixtures("handlers")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_before_the_work_ends_the_process_with_a_line(
    name: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit code 130, before `as_ctrl_c` and after it; within it there is an exception."""
    codes: list[int] = []
    monkeypatch.setattr(startup.os, "_exit", codes.append)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    number = getattr(signal, name)
    stop_before_work("SIGTERM", "SIGHUP")
    signal.raise_signal(number)
    with pytest.raises(KeyboardInterrupt), as_ctrl_c("SIGTERM", "SIGHUP"):
        signal.raise_signal(number)
    signal.raise_signal(number)
    assert codes == [130, 130]
    assert capfd.readouterr().err == "islandgp: stopped\n" * 2


@pytest.mark.skipif(os.name != "posix", reason="needs SIGHUP")
@pytest.mark.usefixtures("handlers")
def test_an_ignored_signal_stays_ignored_from_the_start() -> None:
    """As under `nohup`."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    stop_before_work("SIGTERM", "SIGHUP")
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


AT_AN_IMPORT = """
import os, runpy, signal, sys
class Sends:
    def find_spec(self, name, *_):
        if name == {module!r}:
            os.kill(os.getpid(), signal.{signal})
sys.meta_path.insert(0, Sends())
sys.argv[0] = "islandgp"
{start}
"""
STARTS = {
    "module": 'runpy.run_module("islandgp", run_name="__main__", alter_sys=True)',
    "script": "from islandgp.__main__ import script; script()",
}


@pytest.mark.process
@pytest.mark.skipif(os.name != "posix", reason="needs SIGTERM")
@pytest.mark.parametrize(
    ("name", "start", "module"),
    [
        ("SIGINT", "module", "hydra.errors"),
        ("SIGTERM", "script", "islandgp.cli"),
        pytest.param("SIGTERM", "module", "islandgp.running.app", marks=pytest.mark.slow),
        pytest.param("SIGINT", "script", "click.core", marks=pytest.mark.slow),
    ],
)
def test_a_signal_while_a_command_starts(name: str, start: str, module: str) -> None:
    """A line and exit code 130 while modules are imported, in place of a traceback or -15."""
    code = AT_AN_IMPORT.format(module=module, signal=name, start=STARTS[start])
    with TemporaryDirectory() as folder:  # of a short name, as the path of a socket is limited
        process = subprocess.run(
            [sys.executable, "-c", code, "seed=1"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "TMPDIR": folder},
        )
        assert [*Path(folder).iterdir()] == []
    assert (process.returncode, process.stdout, process.stderr) == (130, "", "islandgp: stopped\n")


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_stops_any_command_with_a_line(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As it stops a run: exit code 130."""

    def read(_: str) -> str:
        signal.raise_signal(getattr(signal, name))
        return ""

    monkeypatch.setattr(trees, "read_tree_text", read)
    result = shell(monkeypatch, capsys)("fmt", "-")
    assert (result.code, result.err.strip()) == (130, "islandgp: stopped")


DRAWS = """
import os, signal
from islandgp.domains.gymnasium.domain import environment
env = environment("CartPole-v1", "{}", True)
env.reset()
env.render()
os.kill(os.getpid(), signal.SIGTERM)
"""


@pytest.mark.process
@pytest.mark.skipif(os.name != "posix", reason="needs SIGTERM")
def test_sigterm_ends_a_script_that_has_drawn_a_scene() -> None:
    """The library that draws CartPole leaves the signal alone."""
    pytest.importorskip("pygame")
    command = [sys.executable, "-c", DRAWS]
    assert subprocess.run(command, cwd=ROOT, check=False).returncode == -signal.SIGTERM


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.skipif(os.name != "posix", reason="needs process groups")
@pytest.mark.parametrize("delay", [0.3, 0.6, 1.0])
def test_ctrl_c_while_a_run_starts_its_processes(tmp_path: Path, delay: float) -> None:
    """A terminal signals the workers as well; none of them prints a traceback.

    Python ends by the signal itself (-2) where it comes in the first lines of the program; a
    shell shows 130 for that, too.
    """
    command = [sys.executable, "-m", "islandgp", "tracking=off", "progress=off"]
    run = subprocess.Popen(
        command,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    time.sleep(delay)
    os.killpg(run.pid, signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    assert run.returncode in (130, -signal.SIGINT)
    assert "Traceback" not in errors
    assert errors.splitlines()[-1].startswith("islandgp: stopped")


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="Linux lists threads there")
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="needs two cores")
@pytest.mark.parametrize(("number", "more"), [(None, False), ("2", True)])
def test_imports_start_no_threads_for_linear_algebra(number: str | None, more: bool) -> None:
    """Unless the user sets their number."""
    code = (
        "import os; from islandgp.startup import without_blas_threads\n"
        "without_blas_threads(); import numpy, scipy.linalg\n"
        "print(len(os.listdir('/proc/self/task')))"
    )
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    if number:
        environment["OPENBLAS_NUM_THREADS"] = number
    threads = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    ).stdout
    assert (int(threads) > 1) is more


@pytest.mark.parametrize(("code", "ends"), [(130, True), (0, False)])
def test_a_thread_that_never_ends_is_given_up_after_ctrl_c(code: int, ends: bool) -> None:
    """Its lock was taken when Ctrl-C came, and is never released."""
    program = (
        "import threading; from islandgp import startup\n"
        "startup.EXIT_LIMIT = 0.1\n"
        "lock = threading.Lock(); lock.acquire()\n"
        "threading.Thread(target=lock.acquire).start()\n"
        f"startup.leave({code})"
    )
    process = subprocess.Popen([sys.executable, "-c", program], cwd=ROOT)
    try:
        assert process.wait(timeout=60 if ends else 0.5) == code
    except subprocess.TimeoutExpired:
        assert not ends
    finally:
        process.kill()
        process.wait()
