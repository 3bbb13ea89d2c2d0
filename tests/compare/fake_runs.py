"""Fake finished runs, as folders on disk."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any, Final

from islandgp.compare.arms import Arm, Run, parse_selection
from islandgp.evolution.validation import Validation
from islandgp.gp.archive import ArchiveRecord
from islandgp.gp.record import (
    Champion,
    Cost,
    GenerationRecord,
    GuidanceRecord,
    IndividualRecord,
    record_values,
)
from islandgp.plain import flatten
from islandgp.records.archive_file import ArchiveFile
from islandgp.records.manifest import write_manifest
from islandgp.records.values import answers
from tests.composed import plain
from tests.samples import ANY, NOTHING, snapshot

TREE = "selector {\n  MoveToGarbage\n  PatrolWaypoint\n}\n"


@cache
def _config(supervisor: str) -> str:
    return json.dumps(plain(f"supervisor={supervisor}"))


def config(supervisor: str = "expert", seed: int = 0, **changes: Any) -> dict[str, Any]:
    """A run's whole configuration; `changes` by dotted key with __ for the dots."""
    values: dict[str, Any] = json.loads(_config(supervisor))
    values["seed"] = seed
    for key, value in changes.items():
        *path, last = key.split("__")
        at = values
        for part in path:
            at = at[part]
        at[last] = value
    return values


def individual(
    name: str, origin: str = "crossover", parents: Sequence[str] = (), **changes: Any
) -> IndividualRecord:
    """An individual that did nothing remarkable."""
    record = IndividualRecord(
        id=name,
        origin=origin,
        parents=tuple(parents),
        mutation="",
        tree=TREE,
        nodes=3,
        depth=2,
        fitness=1000.0,
        components={**NOTHING.components, ANY: 1000.0},
        specialist="pickup",
        tiers=(),
        counters={**NOTHING.counters, "pickups": 1.0, "gathered": 1.0},
        endings=("time",),
    )
    return replace(record, **changes)


def guidance(**changes: Any) -> GuidanceRecord:
    """An answer without content."""
    record = GuidanceRecord(
        asked_at=0,
        source="made",
        phase=None,
        pattern=None,
        target=None,
        intervention=False,
        wanted_rate=0.4,
        crisis="",
        applied_rate=0.4,
        tree=None,
        injected=False,
        refused="",
        risk="",
        reasoning="",
        rationale="",
        notes={},
    )
    return replace(record, **changes)


FOLDER: Final = TemporaryDirectory(prefix="islandgp-fake-runs-")
_numbers = count()


def fake_run(
    supervisor: str = "expert",
    seed: int = 0,
    *,
    generations: int = 41,
    best: Sequence[float] | float = 1000.0,
    complete: int | None = None,
    excellent: int | None = None,
    populations: Sequence[Sequence[IndividualRecord]] | None = None,
    guided: GuidanceRecord | None = None,
    path: str = "",
    folder: Path | None = None,
    **changes: Any,
) -> Run:
    """A run on disk with the given snapshots; `complete` is the first such generation."""
    curve = [float(best)] * generations if isinstance(best, float | int) else list(best)
    last = len(curve) - 1
    records = tuple(
        GenerationRecord(
            snapshot=snapshot(
                g,
                fitness_max=fitness,
                epoch=max(1, -(-g // 5)),
                stage=min(3, (max(1, -(-g // 5)) - 1) // 2),
                complete=int(complete is not None and g >= complete),
                excellent=int(excellent is not None and g >= excellent),
            ),
            worlds=(1_000_000 + g,),
            origins={"crossover": 1},
            stagnant_generations=0,
            individuals=tuple(populations[g])
            if populations is not None
            else (individual(f"{g}.0", fitness=fitness),),
            guidance=None if g == last else guided or guidance(),
            archive=ArchiveRecord(coverage=0.5, qd_score=1.0, new=0, improved=0),
        )
        for g, fitness in enumerate(curve)
    )
    # A name of its own, as the processes of `tests.mutants` have one folder and equal numbers.
    new = mkdtemp(prefix=f"{next(_numbers):06}-", dir=FOLDER.name) if folder is None else ""
    place = folder or Path(new, path or f"{supervisor}-seed{seed}")
    return written(place, records, config(supervisor, seed, **changes))


def written(
    folder: Path,
    records: Sequence[GenerationRecord],
    configuration: Mapping[str, Any],
    *,
    episodes: Sequence[int] = (),
    champion: IndividualRecord | None = None,
    validation: Validation | None = None,
    finished: bool = True,
) -> Run:
    """The folder of a run with these records, as far as the study reads it."""
    everyone = [(i.fitness, -g, i) for g, r in enumerate(records) for i in r.individuals]
    _, g, top = max(everyone, key=lambda each: each[:2])
    best = Champion(-g, champion or top)
    costs = [Cost(1.0, 0.5, 0.1, n) for n in episodes] or [Cost(1.0, 0.5, 0.1, 30)] * len(records)
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(json.dumps(configuration))
    _lines(folder / "generations.jsonl", [record_values(r) for r in records])
    _lines(folder / "costs.jsonl", [{**asdict(c), "at": 1} for c in costs])
    if finished:
        summary = {
            "champion": {
                **asdict(best),
                "validation": validation and asdict(validation),
                "tree": best.record.tree,
                "text": best.record.tree,
                "front": [],
                "changes": [],
                "chosen_in": [],
            },
            "fittest": asdict(best),
            "first": {},
            **dict.fromkeys(
                ("final_fitness_max", "final_fitness_mean", "mean_diversity", "seconds"), 0.0
            ),
            "generations": len(records),
            "answers": answers(()),
            "mostly_fallback": False,
        }
        end = json.dumps(summary)
        about = {
            "id": folder.name, "title": folder.name, "home": "/", "command": "", "started": 1,
            "tags": {"domain": "island"},
        }  # fmt: skip
        (folder / "about.json").write_text(json.dumps(about))
        archive = ArchiveFile("island", {"pickups": (1.0,)}, 0.0, 0.0, 0.0, ())
        (folder / "archive.json").write_bytes(archive.to_bytes())
        for name in ("best.bt", "lineage.csv"):
            (folder / name).touch()
        write_manifest(folder, end.encode())
        (folder / "summary.json").write_text(end)
    return Run(folder, configuration, flatten(configuration), finished)


def validated(mean: float, *worlds: int) -> Validation:
    """A validation with this mean in these worlds."""
    return Validation(worlds, mean, mean, mean, {})


def fake_arm(name: str, runs: Sequence[Run], selection: str = "") -> Arm:
    """An arm of runs."""
    text = selection or f"supervisor={name}"
    parsed = parse_selection(text)
    levels = {key: str(value) for key, value in parsed.items()}
    return Arm(name, text, tuple(runs), frozenset(parsed), levels)


def _lines(file: Path, values: Sequence[Mapping[str, Any]]) -> None:
    file.write_text("".join(json.dumps(v) + "\n" for v in values))
