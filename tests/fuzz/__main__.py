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
KEPT = 4  # inputs of a target that are also given to the command
COMMANDS = {
    # target: the file's name, and the words before it
    "language": ("a.bt", ["check"]),
    "xml": ("a.xml", ["import"]),
    "json": ("a.json", ["import"]),
    "declaration": ("v.json", ["check", "tree.bt", "--vocabulary"]),
}


@dataclass
class Found:
    """What a target's search came to."""

    inputs: int = 0
    taken: int = 0
    slowest: float = 0.0  # s of CPU
    slowest_input: bytes = b""
    kept: list[bytes] = field(default_factory=list)  # for the command
    breaks: list[tuple[bytes, str]] = field(default_factory=list)  # an input, and what happened


def search(target: Target, inputs: int, number: int) -> Found:
    """Tries so many inputs; a broken promise ends the search with its smallest example."""
    found = Found()
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
        found.inputs += 1
        begun = time.process_time()
        found.taken += target.check(data)
        took = time.process_time() - begun
        if took > found.slowest:
            found.slowest, found.slowest_input = took, data
        if found.inputs % max(1, inputs // KEPT) == 0:
            found.kept.append(data)

    for warm in target.seeds():
        target.check(warm)  # imports, grammars and the like belong to no input
    try:
        run()
    except Exception as error:
        found.breaks.append((last[0], f"{type(error).__name__}: {error}"[:200]))
    if found.slowest > LIMIT:
        found.breaks.append((found.slowest_input, f"{found.slowest:.1f} s of CPU"))
    return found


def by_command(name: str, data: bytes) -> str:
    """What the real command does wrong with an input; "" for nothing."""
    file, words = COMMANDS[name]
    (place() / file).write_bytes(data)
    (place() / "tree.bt").write_text("PatrolWaypoint\n", encoding="utf-8")
    command = [sys.executable, "-c", "from islandgp.cli import main; main()", *words, file]
    done = subprocess.run(command, capture_output=True, check=False, cwd=place())
    said = done.stdout + done.stderr
    wrong = done.returncode not in (0, 1, 2) or b"Traceback" in said
    return f"exit code {done.returncode}: {said.decode(errors='replace')[-150:]}" if wrong else ""


def wanted(words: list[str] | None, inputs: int) -> dict[str, int]:
    """How many inputs each target gets: those asked for by NAME=INPUTS, or its share of all.

    Raises:
        ValueError: a name that no target has, or a number that is none.
    """
    known = targets()
    asked = dict(word.partition("=")[::2] for word in words or known)
    if unknown := sorted(set(asked) - set(known)):
        raise ValueError(f"there is no target {', '.join(unknown)}; there are {', '.join(known)}")
    shares = sum(known[name].share for name, number in asked.items() if not number)
    return {
        name: int(number) if number else max(1, round(inputs * known[name].share / shares))
        for name, number in asked.items()
    }


def table(rows: dict[str, Found], broken: int, peak: float, words: list[str]) -> str:
    """The rows of a search in Markdown, with the command that made them."""
    lines = [
        "| target | inputs | taken | refused | slowest | broken promises |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    lines += [
        f"| {name} | {found.inputs:,} | {found.taken:,} | {found.inputs - found.taken:,}"
        f" | {found.slowest:.2f} s | {len(found.breaks)} |"
        for name, found in rows.items()
    ]
    command = " ".join(word for word in words if word != "--write")
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
        numbers = wanted(args.only, args.inputs)
    except ValueError as error:
        parser.error(str(error))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    rows: dict[str, Found] = {}
    print(f"{'target':<12}{'inputs':>8}{'taken':>8}{'refused':>9}{'slowest':>10}{'commands':>10}")
    for name, number in numbers.items():
        found = rows[name] = search(targets()[name], number, args.seed)
        kept = found.kept if name in COMMANDS else []
        found.breaks += [(data, wrong) for data in kept if (wrong := by_command(name, data))]
        print(
            f"{name:<12}{found.inputs:>8}{found.taken:>8}{found.inputs - found.taken:>9}"
            f"{found.slowest:>8.2f} s{len(kept):>10}",
            flush=True,
        )
        for data, why in found.breaks:
            file = CORPUS / name / hashlib.sha256(data).hexdigest()[:12]
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
            print(f"  {why}\n  kept as {file}")
    broken = sum(len(found.breaks) for found in rows.values())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory {peak:.0f} MB; {broken} broken promises")
    if args.write:
        written = f"<!-- begin fuzz -->\n{table(rows, broken, peak, sys.argv[1:])}\n<!-- end -->"
        text = PAGE.read_text(encoding="utf-8")
        part = re.compile(r"<!-- begin fuzz -->.*?<!-- end -->", re.DOTALL)
        PAGE.write_text(part.sub(lambda _: written, text), encoding="utf-8")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
