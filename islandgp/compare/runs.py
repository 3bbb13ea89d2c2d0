"""A finished run, read from its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from islandgp.errors import RunError, StudyError, brief
from islandgp.gp.record import (
    Champion,
    Cost,
    GenerationRecord,
    GuidanceRecord,
    updated_champion,
)
from islandgp.plain import DECODE_ERRORS, from_plain
from islandgp.records.folder import RunFolder, is_copy
from islandgp.records.parameters import flatten
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints, recorded_constraints
from islandgp.scoring.generation_stats import GenerationStats


@dataclass(frozen=True, slots=True)
class RunEntry:
    """A run's folder before its records are read."""

    path: Path
    config: Mapping[str, Any]
    flat: Mapping[str, Any]  # the same by dotted key
    finished: bool


@dataclass(frozen=True, slots=True)
class Run:
    """One finished run, read from its folder.

    Generations count as in the records, from 0: the initial population is generation 0.
    """

    path: Path
    config: Mapping[str, Any]  # nested, resolved
    flat: Mapping[str, Any]  # the same by dotted key
    records: tuple[GenerationRecord, ...]  # by generation
    costs: tuple[Cost, ...]  # by generation
    champion: Champion  # the run's best robot
    validation: tuple[int, ...] = ()  # seeds of the worlds of its choice and of its test
    validation_mean: float | None = None  # mean points of the best robot there, if validated
    feasible: float | None = None  # share of these worlds in which it keeps the constraints

    @property
    def seed(self) -> int:
        """The run's seed."""
        return int(self.config["seed"])

    @property
    def supervisor(self) -> str:
        """The supervisor's name."""
        return str(self.config["supervisor"]["name"])

    @property
    def classes(self) -> Classes:
        """The behaviours, classes and tiers of its individuals."""
        return Classes(**self.config["classes"])

    @property
    def constraints(self) -> Constraints:
        """The constraints of the run, by counter; {} for none."""
        return recorded_constraints(self.config)

    @property
    def snapshots(self) -> tuple[GenerationStats, ...]:
        """The statistics of each generation."""
        return tuple(r.snapshot for r in self.records)

    @property
    def guidance(self) -> tuple[GuidanceRecord, ...]:
        """The supervisor's decisions, by generation."""
        return tuple(r.guidance for r in self.records if r.guidance is not None)


def find(folder: Path) -> list[RunEntry]:
    """All run folders in a folder, sorted by path, without MLflow's copies of runs.

    Raises:
        StudyError: there is no such folder.
        RunError: a run's configuration is damaged.
    """
    if not folder.is_dir():
        raise StudyError(
            f"Expected runs in {folder}, found no such folder; run `python -m islandgp` first,"
            " or set --runs FOLDER."
        )
    runs = []
    for file in sorted(folder.rglob("config.yaml")):
        if not (file.parent / "generations.jsonl").exists() or is_copy(file.parent, folder):
            continue
        run = RunFolder(file.parent)
        config = run.configuration()
        if {"domain", "seed", "name", "supervisor"} <= set(config):
            runs.append(RunEntry(file.parent, config, flatten(config), run.finished()))
    return runs


def read(entry: RunEntry) -> Run:
    """A finished run with all its records.

    Raises:
        StudyError: its files are damaged, or come from another version.
    """
    folder = RunFolder(entry.path)
    try:
        champion = folder.summary()["champion"]
        champion["record"] |= {"tree": champion["tree"]}  # shortened
        validation = champion["validation"] or {"worlds": (), "mean": None}
        run = Run(
            path=entry.path,
            config=entry.config,
            flat=entry.flat,
            records=tuple(folder.generations()),
            costs=tuple(from_plain(Cost, plain) for plain in folder.costs()),
            champion=from_plain(Champion, champion),
            validation=(*champion["chosen_in"], *validation["worlds"]),
            validation_mean=validation["mean"],
            feasible=validation.get("feasible"),
        )
    except RunError as error:
        raise StudyError(str(error)) from error
    except (OSError, *DECODE_ERRORS) as error:
        raise StudyError(
            f"Expected a finished run's records in {entry.path}, found {type(error).__name__}:"
            f" {brief(error)}. They are damaged or from another version: run it again."
        ) from error
    if not run.records or len(run.costs) != len(run.records):
        raise StudyError(
            f"Expected as many costs as generations in {entry.path}, found {len(run.costs)} and"
            f" {len(run.records)}; run it again."
        )
    return run


def cut(run: Run, generations: int) -> Run:
    """The run cut after a number of generations.

    Its champion is then the fittest individual of the last stage, without validation.
    """
    if len(run.records) <= generations:
        return run
    *before, last = run.records[:generations]
    records = (*before, replace(last, guidance=None))  # there is no guidance after the last one
    champion = None
    for generation, record in enumerate(records):
        if record.snapshot.stage == last.snapshot.stage:
            champion = updated_champion(champion, generation, record.individuals, run.constraints)
    assert champion is not None
    return replace(
        run,
        records=records,
        costs=run.costs[:generations],
        champion=champion,
        validation=(),
        validation_mean=None,
        feasible=None,
    )
