"""A store whose n-th request fails, and the life of a run whose records are sent to it."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any

from islandgp.records.folder import RunFolder, Status
from islandgp.tracking.store import Store, TrackingStore
from islandgp.tracking.upload import RunUploader
from tests.tracking.folders import archive, begun, finished, steps


class Fault(Enum):
    """What becomes of a request whose sender gets no answer."""

    LOST = "it never arrives"
    UNANSWERED = "it is carried out"
    LATE = "it is carried out when its sender has sent others"


class Killed(BaseException):
    """The end of the sending process: no handler of errors may go on after it."""


class FaultyClient:
    """An MLflow client that numbers its requests from 0 and fails at one of them."""

    def __init__(self, client: Any, at: int, fault: Fault, *, error: BaseException) -> None:
        """The request `at` fails with `error`; a late one is carried out by `settle`."""
        self.client, self.at, self.fault, self.error = client, at, fault, error
        self.requests: list[str] = []
        self._late: list[Callable[[], object]] = []

    def __getattr__(self, name: str) -> Any:
        method = getattr(self.client, name)

        def request(*args: Any, **options: Any) -> Any:
            self.requests.append(name)
            if len(self.requests) - 1 != self.at:
                return method(*args, **options)
            if self.fault is Fault.UNANSWERED:
                method(*args, **options)
            if self.fault is Fault.LATE:
                self._late.append(lambda: method(*args, **options))
            raise self.error

        return request

    def settle(self) -> None:
        """Carries out what is late."""
        while self._late:
            self._late.pop()()


class Faulty(Store):
    """A store on the other side of a line that breaks once."""

    def __init__(self, place: TrackingStore, at: int, fault: Fault, error: BaseException) -> None:
        super().__init__(place)
        self.client: Any = FaultyClient(self.client, at, fault, error=error)


Stage = tuple[Path, Status]


def stages(home: Path) -> list[Stage]:
    """Copies of one run's folder as it grows, is stopped, goes on, and is finished."""
    folder, all_steps = begun(home / "grows/one", home), steps()
    copies: list[Stage] = []

    def stage(status: Status) -> None:
        copies.append((home / f"stage{len(copies)}", status))
        shutil.copytree(folder.path, copies[-1][0])

    stage(Status.RUNNING)
    for step in all_steps[:2]:
        folder.append(step)
    stage(Status.RUNNING)
    folder.fail(ValueError("a fault of the domain"))
    stage(Status.FAILED)
    (folder.path / "error.txt").unlink()
    for step in all_steps[2:4]:
        folder.append(step)
    stage(Status.RUNNING)
    folder.append(all_steps[4])
    folder.finish(finished(folder, all_steps[4]), archive(all_steps[4]))
    folder.close()
    stage(Status.FINISHED)
    return copies


def live(run: Path, run_stages: list[Stage], sender: Callable[[], Store]) -> None:
    """Sends each stage of a run from the folder `run`, as its processes would.

    After a request that failed the sending of the stage begins again, as the thread of a run
    does; after a kill the next stage is sent, by another process. `sender` opens the store.
    """
    for stage, status in run_stages:
        for file in stage.iterdir():
            shutil.copy2(file, run / file.name)  # the page has the time of the records
        if not (stage / "error.txt").exists():
            (run / "error.txt").unlink(missing_ok=True)
        for _ in range(2):
            try:
                RunUploader(RunFolder(run), sender()).send(status)
                break
            except ConnectionError:
                continue
            except Killed:
                break


def picture(store: Store) -> dict[str, object]:
    """All that people see of the runs of an experiment, by the runs' names."""
    return {name: dict(_facts(store, run)) for name, run in _runs(store)}


def _runs(store: Store) -> Iterator[tuple[str, Any]]:
    runs = store.client.search_runs([store.experiment])
    for i, run in enumerate(sorted(runs, key=lambda run: str(run.info.run_name))):
        yield f"{i} {run.info.run_name}", run


def _facts(store: Store, run: Any) -> Iterator[tuple[str, object]]:
    info, data = run.info, run.data
    yield "info", (info.status, info.start_time, info.end_time)
    yield "params", data.params
    # A parent's id differs from store to store, and so does the folder that a note names.
    home = str(Path(store.place.artifacts or "").parent)
    tags = {k: v.replace(home, "HOME") for k, v in data.tags.items()}
    yield "tags", {k: v for k, v in tags.items() if k != "mlflow.parentRunId"}
    for name in data.metrics:
        points = store.client.get_metric_history(info.run_id, name)
        yield name, sorted((point.step, point.timestamp, point.value) for point in points)
    for file in store.client.list_artifacts(info.run_id):
        artifacts = Path(store.place.artifacts or "") / info.run_id / "artifacts"
        content = (artifacts / file.path).read_bytes()
        yield file.path, re.sub(rb"[^ \"'<>]*/runs/", b"HOME/runs/", content)
