"""Run folders with made-up generations, written as a run writes them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import yaml

from islandgp.evolution.loop import evolve
from islandgp.evolution.validation import Best, Validation
from islandgp.gp.archive import archive_record
from islandgp.gp.record import Step
from islandgp.records.archive_file import ArchiveFile
from islandgp.records.files import RunMetadata, RunSummary
from islandgp.records.folder import RunFolder
from islandgp.running.report import summary
from islandgp.supervision.baseline import Baseline, BaselineSettings
from islandgp.tracking.store import MLflowSettings, Store, TrackingStore
from islandgp.viewer.history import read_history
from tests.composed import composed, composed_plan, plain
from tests.evolution.fake import Fake
from tests.samples import best_of

MILESTONES = ("complete", "excellent")
SMALL = ("supervisor=baseline", "gp.population=8", "gp.generations=5", "tracking=mlflow")


def about(name: str, home: Path, *, seed: int = 1, **changes: str) -> RunMetadata:
    """The metadata of a run of that name."""
    fields = {"id": f"id-{name}", "command": "python -m islandgp", **changes}
    return RunMetadata(
        title=name,
        home=str(home),
        started=1_700_000_000_000,
        tags={"supervisor": "baseline", "seed": str(seed)},
        **fields,
    )


def steps(seed: int = 1) -> list[Step]:
    """A whole evolution on made-up outcomes."""
    return list(_steps(seed))


@cache
def _steps(seed: int) -> tuple[Step, ...]:
    settings = composed(*SMALL)
    supervisor = Baseline(BaselineSettings(**settings.supervisor.policy))
    return tuple(evolve(composed_plan(*SMALL), seed, supervisor, Fake()))


def begun(path: Path, home: Path, *, seed: int = 1, **changes: str) -> RunFolder:
    """A folder that a run has just opened; close it."""
    folder = RunFolder(path)
    folder.open(yaml.safe_dump(plain(*SMALL)), about(path.name, home, seed=seed, **changes))
    folder.resume()
    return folder


def closed_run(
    path: Path,
    home: Path,
    generations: int = 5,
    *,
    seed: int = 1,
    validation: Validation | None = None,
) -> RunFolder:
    """A closed folder after some generations; with all five the run is finished."""
    folder = begun(path, home, seed=seed)
    state, all_steps = folder.resume(), steps(seed)[:generations]
    for step in all_steps[state.generation if state else 0 :]:
        folder.append(step)
    if generations == 5:
        folder.finish(finished(folder, all_steps[-1], validation), archive(all_steps[-1]))
    folder.close()
    return folder


def archive(last: Step) -> ArchiveFile:
    """The archive of the last generation."""
    plan = composed_plan(*SMALL)
    axes, floor = plan.archive.axes(plan.classes), plan.archive.floor
    counts = archive_record(last.archive, axes, floor=floor)
    figures = counts.coverage, counts.qd_score
    return ArchiveFile(plan.vocabulary.domain, dict(axes), floor, *figures, last.archive)


def finished(folder: RunFolder, last: Step, validation: Validation | None = None) -> RunSummary:
    """The summary of a run; without a validation it chose its champion in no other worlds."""
    best = best_of(last.champion, validation)
    return summary_of(folder, last, best)


def summary_of(folder: RunFolder, last: Step, best: Best) -> RunSummary:
    """The summary of a run with the settings of these tests."""
    settings = composed(*SMALL)
    return summary(settings, read_history(folder), last, best, ())


def place(home: Path, experiment: str = "islandgp") -> TrackingStore:
    """The default store of a folder in which a command was given."""
    settings = MLflowSettings(
        uri="sqlite:///mlflow.db", artifacts="mlartifacts", experiment=experiment, patience=0
    )
    return TrackingStore.of(settings, home)


def history(store: Store, run: str, name: str = "fitness_max") -> list[tuple[int, float]]:
    """The points of a metric, every one of them."""
    return [(m.step, m.value) for m in store.client.get_metric_history(run, name)]
