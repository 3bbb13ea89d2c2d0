"""`python -m benchmarks.mock_model FOLDER`: the mock model beside expert and baseline.

Runs each arm with the same seeds and prints a table, also for informed prompts without one of their
parts. The mock is a rule, so the table measures the path from state to tree, and no language model.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from islandgp import load
from islandgp.running.app import main
from tests.llm.mock_model import MockModel
from tests.llm.server import MessagesServer

SETTING: Final = (
    "search=paper",
    "gp.population=20",
    "gp.generations=16",
    "tracking=off",
    "progress=off",
)
LLM: Final = ("supervisor=llm", "supervisor.policy.retry.first_wait=0.05")
PORT: Final = 33593
"""The address is in the runs' configuration: with another one they could not go on."""

INFORMED: Final = "supervisor.policy.prompts=informed"
ARMS: Final[dict[str, tuple[str, ...]]] = {
    "baseline": ("supervisor=baseline",),
    "expert": ("supervisor=expert",),
    "mock_paper": LLM,
    "mock_informed": (*LLM, INFORMED),
}
"""Overrides of each arm."""
PARTS: Final[dict[str, tuple[str, ...]]] = {
    f"mock_without_{part}": (*LLM, INFORMED, f"supervisor.policy.informed.{part}={off}")
    for part, off in (
        ("reasoning", "false"),
        ("rewards", "false"),
        ("classes", "false"),
        ("injected", "0"),
        ("traces", "false"),
        ("decisions", "0"),
        ("differ", "false"),
    )
}
"""Overrides of the ablation: informed prompts without one of their parts."""
HEAD: Final = (
    "arm", "best robot", "Complete", "fallback", "tokens in", "tokens out", "episodes",
)  # fmt: skip


def measure(folder: Path, overrides: Sequence[str], *, noise: float, faults: float) -> int:
    """Runs all arms below `folder`, or what is missing of them; returns the exit code."""
    try:
        mock = MessagesServer(answer=MockModel(noise=noise, faults=faults), port=PORT)
    except OSError as error:
        print(f"Expected port {PORT} to be free, found: {error.strerror}.", file=sys.stderr)
        return 2
    with mock as server:
        for name, arm in (ARMS | PARTS).items():
            run_overrides = [f"name={name}", f"runs='{folder}'"]
            if arm[0] == LLM[0]:
                run_overrides.append(f"supervisor.policy.base_url={server.url}")
            code = main([*SETTING, *arm, *run_overrides, *overrides, "-m"])
            if code:
                return code
    print("\n" + "\n".join(table(folder)))
    return 0


def table(folder: Path) -> Iterator[str]:
    """The arms as a table in Markdown: means over their runs."""
    yield f"| {' | '.join(HEAD)} |"
    yield "|" + "---|" * len(HEAD)
    for name in ARMS | PARTS:
        runs = load(folder / name)
        table_of_runs = runs.runs
        costs = [list(run.costs())[-1]["llm"] for run in runs.folders]
        answers = [run.summary()["answers"] for run in runs.folders]
        halves = sum(2 * g["fallback"] - g["in_part"] for g in answers)
        share = halves / (2 * sum(g["total"] for g in answers))
        reached = table_of_runs[
            next(c for c in table_of_runs.columns if c.startswith("first."))
        ].notna()

        def mean(key: str, spent: list[dict[str, Any]] = costs) -> str:
            values = [one.get(key, 0) for one in spent]
            return f"{sum(values) / len(values):,.0f}" if any(values) else ""

        cells = (
            name,
            f"{table_of_runs['validation_mean'].mean():,.0f}",
            f"{reached.sum()} of {len(table_of_runs)}",
            f"{share:.0%}" if name.startswith("mock") else "",
            mean("input_tokens"),
            mean("output_tokens"),
            mean("episodes"),
        )
        yield f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        sys.exit("expected a folder for the runs, found none; python -m benchmarks.mock_model DIR")
    sys.exit(measure(Path(sys.argv[1]).resolve(), sys.argv[2:], noise=0.1, faults=0.1))
