"""A run's own folder: the truth about the run, whatever becomes of a tracking server.

config.yaml         the resolved configuration
generations.jsonl   one generation record a line (evolution.record.GenerationRecord)
costs.jsonl         what each generation took; differs from machine to machine
checkpoint.json     the state to go on from; gone when the run is finished
best.bt             the champion's tree
lineage.csv         every individual with its parents
summary.json        the end of the run; it exists only when the run is finished
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from islandgp.errors import RunError
from islandgp.evolution.checkpoint import dump, load_state, save_state, write_atomic
from islandgp.evolution.record import RunState, Step

LINEAGE = ("generation", "id", "origin", "parents", "mutation", "fitness", "specialist", "tiers")


class RunFolder:
    """Writes and reads one run's folder; only one process writes at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = FileLock(path / ".lock")

    def open(self, config: str) -> None:
        """Takes the folder for this process and writes its configuration.

        Raises:
            RunError: another process is writing here.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        try:
            self._lock.acquire(timeout=0)
        except Timeout:
            raise RunError(
                f"Expected to be the only one who writes to {self.path}, found another run at work"
                " there; wait for it, or give this one another name=..."
            ) from None
        write_atomic(self.path / "config.yaml", config.encode())

    def close(self) -> None:
        """Gives the folder back."""
        self._lock.release()

    def config(self) -> str | None:
        """The configuration of the run that was here before, as YAML; None if there was none."""
        file = self.path / "config.yaml"
        return file.read_text(encoding="utf-8") if file.exists() else None

    def finished(self) -> bool:
        """Whether the run came to its end."""
        return (self.path / "summary.json").exists()

    def resume(self) -> RunState | None:
        """The state to go on from; cuts off what was written after it. None: from the start."""
        checkpoint = self.path / "checkpoint.json"
        state = load_state(checkpoint) if checkpoint.exists() else None
        for name in ("generations.jsonl", "costs.jsonl"):
            file = self.path / name
            lines = file.read_bytes().splitlines(keepends=True) if file.exists() else []
            keep = lines[: state.generation if state else 0]
            if keep != lines or not file.exists():
                write_atomic(file, b"".join(keep))
        return state

    def append(self, step: Step) -> None:
        """Writes a generation down, then the state to go on from."""
        self._line("generations.jsonl", asdict(step.record))
        self._line("costs.jsonl", asdict(step.cost))
        write_atomic(self.path / "best.bt", step.champion.record.tree.encode())
        if step.state is not None:
            save_state(self.path / "checkpoint.json", step.state)

    def _line(self, name: str, value: dict[str, Any]) -> None:
        with (self.path / name).open("ab") as file:
            file.write(dump(value).encode() + b"\n")

    def finish(self, summary: dict[str, Any]) -> None:
        """Writes the lineage and the summary, and throws the checkpoint away."""
        with (self.path / "lineage.csv").open("w", newline="", encoding="utf-8") as file:
            out = csv.writer(file)
            out.writerow(LINEAGE)
            for record in self.records():
                generation = record["snapshot"]["generation"]
                for i in record["individuals"]:
                    row = {**i, "generation": generation}
                    row["parents"], row["tiers"] = " ".join(i["parents"]), " ".join(i["tiers"])
                    out.writerow([row[name] for name in LINEAGE])
        write_atomic(self.path / "summary.json", (json.dumps(summary, indent=1) + "\n").encode())
        (self.path / "checkpoint.json").unlink(missing_ok=True)

    def records(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """The generation records from the `first` on, as plain JSON values."""
        yield from self._read("generations.jsonl", first)

    def costs(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """What the generations took, from the `first` on."""
        yield from self._read("costs.jsonl", first)

    def _read(self, name: str, first: int) -> Iterator[dict[str, Any]]:
        file = self.path / name
        if not file.exists():
            return
        with file.open(encoding="utf-8") as lines:
            for i, line in enumerate(lines):
                if i >= first and line.endswith("\n"):
                    yield json.loads(line)

    def summary(self) -> dict[str, Any]:
        """The end of a finished run."""
        found: dict[str, Any] = json.loads((self.path / "summary.json").read_text(encoding="utf-8"))
        return found
