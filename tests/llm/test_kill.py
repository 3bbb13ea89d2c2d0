"""A run that is killed while it waits for an answer ends in the bytes of an undisturbed one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from time import sleep

import pytest

from islandgp.resources import resource
from islandgp.running.app import main
from tests.llm.faults import Fault
from tests.llm.server import MessagesServer

pytestmark = pytest.mark.process

OVERRIDES = (
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

    def run(self, home: Path, *overrides: str) -> int:
        """The command in its own process; returns its exit code."""
        self.process = self.started(home, *overrides)
        return self.process.wait()

    def started(self, home: Path, *overrides: str) -> subprocess.Popen[bytes]:
        """The command in its own process."""
        free = {k: v for k, v in os.environ.items() if not k.startswith("ANTHROPIC")}
        url = f"supervisor.policy.base_url={self.url}"
        return subprocess.Popen(
            [sys.executable, "-m", "islandgp", *OVERRIDES, url, *overrides],
            cwd=home,
            env={**free, "PYTHONPATH": str(resource("conf").parent)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("overrides", "kills"),
    [
        (("gp.generations=10",), set(range(1, 33, 2))),
        (("supervisor.edits=2", "supervisor.policy.prompts=informed"), {1, 4, 9}),
    ],
)
def test_kill_9_and_resume(
    tmp_path: Path,
    overrides: tuple[str, ...],
    kills: set[int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Killed in 3 or 16 requests; only what was under way is asked for again; so is its replay."""
    overrides = ("search=paper", *overrides)  # which asks for rates and trees
    straight, cut, again = (tmp_path / name for name in ("straight", "cut", "again"))
    for home in (straight, cut, again):
        home.mkdir()
    with Killing(set()) as server:
        assert server.run(straight, *overrides) == 0
        count = len(server.requests)
    with Killing(kills) as server:
        codes = []
        while not codes or codes[-1] != 0:
            codes.append(server.run(cut, *overrides))
            assert len(codes) < len(kills) + 2
        assert codes == [-9] * len(kills) + [0]
        # All questions of a generation may be under way.
        assert count < len(server.requests) <= count + 3 * len(kills)
    monkeypatch.chdir(again)
    replay = f"supervisor.policy.transcript='{next(cut.rglob('transcript.jsonl'))}'"
    own = [override for override in overrides if "policy" not in override]
    assert main([*OVERRIDES, "supervisor=replay", *own, replay]) == 0
    records = [
        next(home.rglob("generations.jsonl")).read_bytes() for home in (straight, cut, again)
    ]
    assert records[0] == records[1] == records[2]


class NeverAnswers(Killing):
    """A server that answers the probe, and nothing after it."""

    def __init__(self, answers: int = 1) -> None:
        super().__init__(set())
        self.script = lambda n: Fault.SILENCE if n >= answers else None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cap", "most"),
    [("requests=2", 2), ("requests=7", 7), ("usd=0.035", 3), ("output_tokens=5000", 3)],
)
def test_no_number_of_kills_passes_a_cap(tmp_path: Path, cap: str, most: int) -> None:
    """Killed with SIGKILL whenever a request arrives or a generation is written, ten times.

    Each kill loses an answer, which may have been charged; the server counts what it was sent.
    """
    overrides = (f"supervisor.policy.caps.{cap}", "gp.generations=30")
    kills = 0
    with NeverAnswers() as server:
        while kills < 10:
            before = (len(server.requests), recorded_generations(tmp_path))
            process = server.started(tmp_path, *overrides)
            while process.poll() is None and before == (
                len(server.requests),
                recorded_generations(tmp_path),
            ):
                sleep(0.005)
            process.kill()
            assert process.wait() == -9
            kills += 1
        assert server.run(tmp_path, *overrides) == 3  # the fallback supervised it
        requests = server.requests
    assert 2 <= len(requests) <= most
    *_, last = next(tmp_path.rglob("costs.jsonl")).read_text().splitlines()
    spent = json.loads(last)["llm"]
    assert spent["requests"] == len(requests)
    # What the server could charge: a token for each three bytes, and the longest answers.
    texts = [r["system"] + "".join(m["content"] for m in r["messages"]) for r in requests]
    output = sum(r["max_tokens"] for r in requests[1:])
    charged = (sum(len(text.encode()) for text in texts) / 3 + 5 * output) / 1e6
    assert charged < spent["cost_usd_at_most"] < 0.035 * most / 2
    if cap == "usd=0.035":
        assert spent["cost_usd_at_most"] <= 0.035


def recorded_generations(home: Path) -> int:
    """The number of generations in the record of the only run."""
    return sum(file.read_bytes().count(b"\n") for file in home.rglob("generations.jsonl"))
