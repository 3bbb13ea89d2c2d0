"""`make fuzz`: a long search, with figures; what it finds goes into the corpus.

python -m tests.fuzz --inputs 50000 --seed 1 --only xml
python -m tests.fuzz --only language=25000 --only xml=1000 --only json=1000 --write
"""

from __future__ import annotations

import argparse
import hashlib
import re
import resource
import subprocess
import sys
import time
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.targets import Target, place, targets
from tests.running.commands import ROOT

CORPUS = Path(__file__).parent / "corpus"
PAGE = ROOT / "docs" / "reliability.md"
LIMIT = 1.0  # s of CPU for one input
MEMORY = 2**30  # bytes that the search may hold
SAMPLES = 4  # inputs of a target that are also given to the command
COMMANDS = {
    # target: the file's name, and the words before it
    "language": ("a.bt", ["check"]),
    "xml": ("a.xml", ["import"]),
    "json": ("a.json", ["import"]),
    "declaration": ("v.json", ["check", "tree.bt", "--vocabulary"]),
}


@dataclass
class SearchResult:
    """The result of a target's search."""

    inputs: int = 0
    accepted: int = 0
    slowest: float = 0.0  # s of CPU
    slowest_input: bytes = b""
    samples: list[bytes] = field(default_factory=list)  # for the command
    breaks: list[tuple[bytes, str]] = field(default_factory=list)  # an input, and what happened


def search(target: Target, inputs: int, number: int) -> SearchResult:
    """Tries so many inputs; a broken promise ends the search with its smallest example."""
    result = SearchResult()
    last: list[bytes] = []

    @seed(number)
    @settings(
        max_examples=inputs,
        database=None,
        deadline=None,
        derandomize=False,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    @given(target.inputs)
    def run(data: bytes) -> None:
        last[:] = [data]
        result.inputs += 1
        begun = time.process_time()
        result.accepted += target.check(data)
        took = time.process_time() - begun
        if took > result.slowest:
            result.slowest, result.slowest_input = took, data
        if result.inputs % max(1, inputs // SAMPLES) == 0:
            result.samples.append(data)

    for warm in target.seeds():
        target.check(warm)  # imports, grammars and the like belong to no input
    try:
        run()
    except Exception as error:
        result.breaks.append((last[0], f"{type(error).__name__}: {error}"[:200]))
    if result.slowest > LIMIT:
        result.breaks.append((result.slowest_input, f"{result.slowest:.1f} s of CPU"))
    return result


def by_command(name: str, data: bytes) -> str:
    """The fault of the real command with an input; "" if there is none."""
    file, arguments = COMMANDS[name]
    (place() / file).write_bytes(data)
    (place() / "tree.bt").write_text("PatrolWaypoint\n", encoding="utf-8")
    command = [sys.executable, "-c", "from islandgp.cli import main; main()", *arguments, file]
    process = subprocess.run(command, capture_output=True, check=False, cwd=place())
    output = process.stdout + process.stderr
    failed = process.returncode not in (0, 1, 2) or b"Traceback" in output
    return (
        f"exit code {process.returncode}: {output.decode(errors='replace')[-150:]}"
        if failed
        else ""
    )


def inputs_by_target(options: list[str] | None, inputs: int) -> dict[str, int]:
    """How many inputs each target gets: those asked for by NAME=INPUTS, or its share of all.

    Raises:
        ValueError: a name that no target has, or a number that is none.
    """
    known_targets = targets()
    requests = dict(word.partition("=")[::2] for word in options or known_targets)
    if unknown := sorted(set(requests) - set(known_targets)):
        raise ValueError(
            f"there is no target {', '.join(unknown)}; there are {', '.join(known_targets)}"
        )
    shares = sum(known_targets[name].share for name, number in requests.items() if not number)
    return {
        name: int(number) if number else max(1, round(inputs * known_targets[name].share / shares))
        for name, number in requests.items()
    }


def table(rows: dict[str, SearchResult], broken: int, peak: float, options: list[str]) -> str:
    """The rows of a search in Markdown, with the command that made them."""
    lines = [
        "| target | inputs | taken | refused | slowest | broken promises |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    lines += [
        f"| {name} | {result.inputs:,} | {result.accepted:,} | {result.inputs - result.accepted:,}"
        f" | {result.slowest:.2f} s | {len(result.breaks)} |"
        for name, result in rows.items()
    ]
    command = " ".join(word for word in options if word != "--write")
    lines += ["", f"`python -m tests.fuzz {command}`, {date.today()}: peak memory {peak:.0f} MB,"]
    lines += [f"{broken} broken promises."]
    return "\n".join(lines)


def main() -> int:
    """Returns 1 where a promise was broken."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("--inputs", type=int, default=5000, help="of all targets together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", metavar="NAME[=INPUTS]", action="append")
    parser.add_argument(
        "--write", action="store_true", help="put the table into docs/reliability.md"
    )
    args = parser.parse_args()
    try:
        numbers = inputs_by_target(args.only, args.inputs)
    except ValueError as error:
        parser.error(str(error))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    rows: dict[str, SearchResult] = {}
    print(f"{'target':<12}{'inputs':>8}{'taken':>8}{'refused':>9}{'slowest':>10}{'commands':>10}")
    for name, number in numbers.items():
        result = rows[name] = search(targets()[name], number, args.seed)
        samples = result.samples if name in COMMANDS else []
        result.breaks += [(data, fault) for data in samples if (fault := by_command(name, data))]
        print(
            f"{name:<12}{result.inputs:>8}{result.accepted:>8}{result.inputs - result.accepted:>9}"
            f"{result.slowest:>8.2f} s{len(samples):>10}",
            flush=True,
        )
        for data, reason in result.breaks:
            file = CORPUS / name / hashlib.sha256(data).hexdigest()[:12]
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
            print(f"  {reason}\n  kept as {file}")
    broken = sum(len(result.breaks) for result in rows.values())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory {peak:.0f} MB; {broken} broken promises")
    if args.write:
        section = f"<!-- begin fuzz -->\n{table(rows, broken, peak, sys.argv[1:])}\n<!-- end -->"
        text = PAGE.read_text(encoding="utf-8")
        part = re.compile(r"<!-- begin fuzz -->.*?<!-- end -->", re.DOTALL)
        PAGE.write_text(part.sub(lambda _: section, text), encoding="utf-8")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
