"""`python -m benchmarks.mock_model`: the table of docs/llm/mock.md."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from benchmarks.mock_model import ARMS, PARTS, PORT, measure

TINY = ("gp.generations=3", "world.episode.length=20", "gp.validation=0", "seed=0,1")


@pytest.mark.slow
def test_it_measures_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A row an arm; what a second command finds it does not run again."""
    arms = [*ARMS, *PARTS]
    assert measure(tmp_path, TINY, noise=0.1, faults=0.1) == 0
    first = capsys.readouterr().out.splitlines()[-len(arms) :]
    assert [line.split(" | ")[0] for line in first] == [f"| {name}" for name in arms]
    ended = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("summary.json")}
    assert len(ended) == 2 * len(arms)
    assert measure(tmp_path, TINY, noise=0.1, faults=0.1) == 0
    assert capsys.readouterr().out.splitlines()[-len(arms) :] == first
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("summary.json")} == ended


def test_somebody_else_has_the_port(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, and nothing is run."""
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", PORT))
        other.listen()
        assert measure(tmp_path, TINY, noise=0.1, faults=0.1) == 2
    assert f"port {PORT}" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())
