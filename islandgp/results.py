"""Runs as pandas data frames, with one row per run, generation, individual or elite.

    results = islandgp.load("runs/default")
    results.generations.groupby(["arm", "generation"])["fitness_max"].mean()

Column names with a dot belong to the domain or the experiment: `tiers.complete`,
`components.delivery`, `counters.deliveries`, `cell.deliveries`. What a sweep varies is in columns
such as `factor.gp.population`. With constraints, `constraints.violation` is 0 if all are met, and
`constraints.feasible` is the share of individuals or worlds that meet them. COLUMNS describes the
other columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import yaml

from islandgp.atomic_files import damaged, reading
from islandgp.errors import RunError
from islandgp.plain import flatten
from islandgp.records.folder import RunFolder, run_folders
from islandgp.records.sweep import arm_of, job_of
from islandgp.records.values import generation_values, individual_values, run_values
from islandgp.scoring.constraints import Constraints, recorded_constraints

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

COLUMNS: Final[dict[str, dict[str, tuple[str, str]]]] = yaml.safe_load(
    Path(__file__).with_name("columns.yaml").read_text(encoding="utf-8")
)
"""Dtype and meaning (with the unit) of each column, by frame and column name."""


@dataclass(frozen=True)
class Results:
    """The runs below a folder, as pandas frames."""

    path: Path
    folders: tuple[RunFolder, ...]  # in the order of their paths

    @cached_property
    def runs(self) -> DataFrame:
        """One row per run; `first.<milestone>` is the generation of its first such robot."""
        return _frame("runs", (self._run(folder) for folder in self.folders))

    @cached_property
    def generations(self) -> DataFrame:
        """One row per generation."""
        return _frame("generations", ({**ids, **generation_values(*r)} for ids, *r in self._rows()))

    @cached_property
    def individuals(self) -> DataFrame:
        """One row per individual."""
        rows = (
            {**ids, "generation": record["snapshot"]["generation"], **individual_values(i, limits)}
            for ids, record, _, limits in self._rows()
            for i in record["individuals"]
        )
        return _frame("individuals", rows)

    @cached_property
    def archive(self) -> DataFrame:
        """One row per elite of a finished run; `cell.<counter>` is the lower edge of its cell."""
        return _frame("archive", self._elites())

    def _elites(self) -> Iterator[dict[str, Any]]:
        for folder in self.folders:
            if not folder.finished():
                continue
            archive = folder.archive()
            for e in archive.elites:
                cell = zip(archive.cells.items(), e.cell, strict=True)
                yield {
                    **self._identity(folder),
                    **{name: getattr(e, name) for name in ("id", "stage", "episodes", "mean")},
                    "tree": e.tree,
                    **{f"cell.{name}": begins[place] for (name, begins), place in cell},
                }

    def _run(self, folder: RunFolder) -> dict[str, Any]:
        labels = {**self._labels(folder), "status": folder.status().value}
        row = {**labels, **_factors(folder)}
        if not folder.finished():
            return row
        summary = folder.summary()
        return {**row, "tree": summary["champion"]["tree"], **run_values(summary)}

    def _rows(self) -> Iterator[tuple[dict[str, Any], Any, Any, Constraints]]:
        """Identity of the run, record, costs and constraints of each generation."""
        for folder in self.folders:
            shared = self._identity(folder)
            constraints = recorded_constraints(folder.configuration())
            costs = chain(folder.costs(), repeat({}))  # a killed run may lack the last one
            for record, cost in zip(folder.records(), costs, strict=False):
                yield shared, record, cost, constraints

    def _identity(self, folder: RunFolder) -> dict[str, Any]:
        labels = self._labels(folder)
        return {name: labels[name] for name in ("run", "arm", "seed")}

    def _labels(self, folder: RunFolder) -> dict[str, Any]:
        config = folder.configuration()
        with reading("a run's configuration", folder.path / "config.yaml"):
            supervisor = str(config["supervisor"]["name"])
            return {
                "run": str(folder.path.relative_to(self.path)),
                "arm": arm_of(folder.path) or supervisor,
                "seed": int(config["seed"]),
                "name": str(config["name"]),
                "domain": str(config["domain"]["factory"]),
                "supervisor": supervisor,
            }


def _factors(folder: RunFolder) -> dict[str, Any]:
    """What a run's sweep varies, by key or group: the run's values; {} for a single run."""
    if (found := job_of(folder.path)) is None:
        return {}
    sweep, job = found
    recorded = flatten(folder.configuration())
    return {f"factor.{k}": recorded.get(k, value) for k, value in sweep.levels(job).items()}


def load(path: str | Path) -> Results:
    """Loads the runs in a folder and in all folders below it.

    Args:
        path: a run's folder, a sweep's, or any folder above them.

    Returns:
        The runs; their frames are read from disk when they are first used.

    Raises:
        RunError: the folder has no run, or a run is damaged.
    """
    top = Path(path).resolve()
    folders = tuple(folder for folder in run_folders(top) if folder.begun())
    if not folders:
        raise RunError(f"Expected runs in {top}, found none; give the folder that `runs` named.")
    for folder in folders:
        if folder.about() is None:
            raise damaged("a run", folder.path / "about.json", "missing")
    return Results(top, folders)


def _frame(kind: str, rows: Iterable[dict[str, Any]]) -> DataFrame:
    """A frame with the documented columns first, then those of the domain and the experiment."""
    from pandas import DataFrame

    frame = DataFrame(list(rows))
    declared = COLUMNS[kind]
    others = [name for name in frame.columns if name not in declared]
    frame = frame.reindex(columns=[*declared, *others])
    firsts = {name: "Int64" for name in others if name.startswith("first.")}
    return frame.astype({**{name: dtype for name, (dtype, _) in declared.items()}, **firsts})
