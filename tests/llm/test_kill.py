"""A run that is killed while it waits for an answer ends in the bytes of an undisturbed one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from islandgp.resources import resource
from islandgp.testing.faults import Fault
from islandgp.testing.server import MessagesServer

WORDS = (
    "supervisor=llm",
    "gp.population=6",
    "gp.generations=7",
    "world.episode.length=10",
    "evaluator=serial",
    "tracking=off",
    "progress=off",
)


class Killing(MessagesServer):
    """A server that kills the run under way at certain requests, before it answers."""

    def __init__(self, at: set[int]) -> None:
        super().__init__(self._script)
        self.at = at
        self.process: subprocess.Popen[bytes] | None = None

    def _script(self, n: int) -> Fault | None:
        if n not in self.at:
            return None
        assert self.process is not None
        self.process.kill()
        return Fault.SILENCE

    def run(self, home: Path, *words: str) -> int:
        """The command in its own process; returns its exit code."""
        free = {k: v for k, v in os.environ.items() if not k.startswith("ANTHROPIC")}
        url = f"supervisor.policy.base_url={self.url}"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "islandgp", *WORDS, url, *words],
            cwd=home,
            env={**free, "PYTHONPATH": str(resource("conf").parent)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        return self.process.wait()


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0, 2])
def test_kill_9_and_resume(tmp_path: Path, lag: int) -> None:
    """Killed three times with SIGKILL; only what was under way is asked for again."""
    words = (f"supervisor.lag={lag}",)
    straight, cut = tmp_path / "straight", tmp_path / "cut"
    straight.mkdir()
    cut.mkdir()
    with Killing(set()) as server:
        assert server.run(straight, *words) == 0
        asked = len(server.requests)
    with Killing({1, 4, 9}) as server:
        codes = []
        while not codes or codes[-1] != 0:
            codes.append(server.run(cut, *words))
            assert len(codes) < 5
        again = len(server.requests)
    assert codes == [-9, -9, -9, 0]
    records = [next(home.rglob("generations.jsonl")).read_bytes() for home in (straight, cut)]
    assert records[0] == records[1]
    assert asked < again <= asked + 3 * 2  # both questions of a generation may be under way
