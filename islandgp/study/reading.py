"""Run folders on disk: which there are, and what they hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import yaml

from islandgp.errors import RunError, StudyError, brief
from islandgp.evaluation.recorded import check_version
from islandgp.evolution.record import Champion, Cost, GenerationRecord, GuidanceRecord
from islandgp.plain import UNREADABLE
from islandgp.records.checkpoint import individual_record, snapshot
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import flatten
from islandgp.study.arms import Run

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast, if it is there


@dataclass(frozen=True, slots=True)
class Found:
    """A run's folder before its records are read."""

    path: Path
    config: Mapping[str, Any]
    flat: Mapping[str, Any]
    finished: bool


def find(folder: Path) -> list[Found]:
    """Every run's folder in or below a folder, by path.

    Raises:
        StudyError: there is no such folder.
    """
    if not folder.is_dir():
        raise StudyError(
            f"Expected runs in {folder}, found no such folder; run `python -m islandgp` first,"
            " or say --runs FOLDER."
        )
    return list(_folders(folder))


def _folders(root: Path) -> Iterator[Found]:
    for file in sorted(root.rglob("config.yaml")):
        if not (file.parent / "generations.jsonl").exists():
            continue
        try:
            config = yaml.load(file.read_text(encoding="utf-8"), _LOADER)
        except yaml.YAMLError as error:
            raise StudyError(
                f"Expected a run's configuration in {file}, found {error}; delete the run's folder."
            ) from error
        if isinstance(config, dict) and {"seed", "name", "supervisor"} <= set(config):
            yield Found(file.parent, config, flatten(config), RunFolder(file.parent).finished())


def read(found: Found) -> Run:
    """A finished run with all its records.

    Raises:
        StudyError: its files are damaged, or come from another version.
    """
    folder = RunFolder(found.path)
    try:
        check_version(found.config)
    except RunError as error:
        raise StudyError(f"{found.path}: {error}") from None
    try:
        champion = folder.summary()["champion"]
        run = Run(
            path=found.path,
            config=found.config,
            flat=found.flat,
            records=tuple(_record(plain) for plain in folder.records()),
            costs=tuple(_cost(plain) for plain in folder.costs()),
            champion=Champion(champion["generation"], individual_record(champion["record"])),
            validation=tuple((champion["validation"] or {"worlds": ()})["worlds"]),
        )
    except (OSError, RunError, *UNREADABLE) as error:
        raise StudyError(
            f"Expected a finished run's records in {found.path}, found {type(error).__name__}:"
            f" {brief(error)}. They are damaged or from another version: run it again."
        ) from error
    if not run.records or len(run.costs) != len(run.records):
        raise StudyError(
            f"Expected as many costs as generations in {found.path}, found {len(run.costs)} and"
            f" {len(run.records)}; run it again."
        )
    return run


def _cost(plain: dict[str, Any]) -> Cost:
    known = {field.name for field in fields(Cost)}  # a line also says when it was written
    return Cost(**{name: value for name, value in plain.items() if name in known})


def _record(plain: dict[str, Any]) -> GenerationRecord:
    guidance = plain["guidance"]
    return GenerationRecord(
        **{
            **plain,
            "snapshot": snapshot(plain["snapshot"]),
            "worlds": tuple(plain["worlds"]),
            "individuals": tuple(map(individual_record, plain["individuals"])),
            "guidance": None if guidance is None else GuidanceRecord(**guidance),
        }
    )
