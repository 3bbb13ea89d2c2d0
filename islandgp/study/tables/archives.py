"""The runs' archives of elites side by side: descriptive, in no family of tests."""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.gp.archive import ArchiveRecord, ArchiveSettings
from islandgp.statistics import mean_sd
from islandgp.study.arms import Comparison, Run
from islandgp.study.table import Table, spread
from islandgp.study.texts import note


def archives(run: Run) -> Sequence[ArchiveRecord]:
    """A run's archive after each generation; none where a generation has none."""
    per_generation = [record.archive for record in run.records]
    return (
        [archive for archive in per_generation if archive is not None]
        if all(per_generation)
        else []
    )


def one_grid(study: Comparison) -> bool:
    """True if all runs have an archive with the same grid and floor."""
    runs = [run for arm in study.arms for run in arm.runs]
    if not all(archives(run) for run in runs):
        return False
    first, *others = [_grid(run) for run in runs]
    return all(other == first for other in others)


def _grid(run: Run) -> object:
    settings = ArchiveSettings.model_validate(run.config.get("archive") or {})
    return settings.axes(run.classes), settings.floor


def archive_table(study: Comparison) -> Table:
    """Coverage and QD score after the last generation that all runs have."""
    rows = []
    for arm in study.arms:
        last = [archives(run)[study.generations - 1] for run in arm.runs]
        challenges = {str(run.flat.get("archive.again", 0)) for run in arm.runs}
        rows.append(
            [
                ("Arm", arm.name),
                ("coverage, %", spread(*mean_sd([100 * a.coverage for a in last]), 1)),
                ("QD score, points", spread(*mean_sd([a.qd_score for a in last]))),
                ("episodes of a challenge", " and ".join(sorted(challenges))),
            ]
        )
    notes = (note("archive"),)
    return Table.of("archive", "Archives of elites after the last generation", rows, notes)
