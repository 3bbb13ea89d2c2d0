"""Runs as pandas frames: one row a run, a generation, or an individual.

    results = islandgp.load("runs/default")
    results.generations.groupby(["arm", "generation"])["best"].mean()

Column names with a dot belong to the domain or the experiment: `tiers.complete`,
`components.delivery`, `counters.deliveries`. COLUMNS says what the others mean.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from islandgp.errors import RunError
from islandgp.evaluation.base import check_version
from islandgp.records.checkpoint import reading
from islandgp.records.files import values
from islandgp.records.folder import RunFolder
from islandgp.records.sweep_folder import arm_of

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

COLUMNS: Final[dict[str, dict[str, tuple[str, str]]]] = {
    "runs": {
        "run": ("string", "the run's folder, below the folder that was loaded"),
        "name": ("string", "what the run or its sweep is called"),
        "arm": ("string", "what the runs of a sweep share that differ in their seed only"),
        "domain": ("string", "the class of the world that its trees lived in"),
        "supervisor": ("string", "the supervisor's name"),
        "seed": ("int64", "of every draw of the run"),
        "status": ("string", "FINISHED, RUNNING, KILLED or FAILED"),
        "generations": ("Int64", "generations of a finished run"),
        "best": ("float64", "mean fitness of the best robot in validation worlds, points"),
        "trained": ("float64", "its fitness in training, points"),
        "final_best": ("float64", "highest fitness of the last generation, points"),
        "final_mean": ("float64", "mean fitness of the last generation, points"),
        "mean_diversity": ("float64", "Eq. (3), mean over the generations"),
        "seconds": ("float64", "spent in the generations, s"),
        "tree": ("string", "the best robot's text"),
    },
    "generations": {
        "run": ("string", "as in the runs"),
        "arm": ("string", "as in the runs"),
        "seed": ("int64", "as in the runs"),
        "generation": ("int64", "from 0, the initial population"),
        "epoch": ("int64", "of the curriculum, from 1"),
        "stage": ("int64", "of the curriculum, from 0"),
        "best": ("float64", "highest fitness, points under the stage's multipliers"),
        "mean": ("float64", "mean fitness, points"),
        "sd": ("float64", "its standard deviation over the population, points"),
        "diversity": ("float64", "Eq. (3), over exclusive classes"),
        "overlapping": ("float64", "Eq. (3), over behaviours, several of which one tree may show"),
        "working": ("float64", "Eq. (4), a share"),
        "size": ("float64", "mean nodes of a tree"),
        "rate": ("float64", "mutation rate that made the generation"),
        "source": ("string", "who gave the guidance for the next generation"),
        "phase": ("string", "row of Table 8 that it named"),
        "pattern": ("string", "row of Table 6 that it named"),
        "target": ("string", "what its tree was for (Table 7)"),
        "crisis": ("string", "why the emergency rate was enforced, or empty"),
        "injected": ("boolean", "whether its tree took a slot of the next population"),
    },
    "individuals": {
        "run": ("string", "as in the runs"),
        "arm": ("string", "as in the runs"),
        "seed": ("int64", "as in the runs"),
        "generation": ("int64", "as in the generations"),
        "id": ("string", "<generation>.<slot>"),
        "origin": ("string", "how it came into the population (Table 1)"),
        "parents": ("string", "ids, apart by spaces"),
        "mutation": ("string", "the operator that changed it, or empty"),
        "fitness": ("float64", "points, Eq. (1)"),
        "specialist": ("string", "its exclusive class (section 2.3.3)"),
        "best_tier": ("string", "the best row of Table 4 that it reaches, or empty"),
        "nodes": ("int64", "of its tree"),
        "depth": ("int64", "levels of its tree"),
        "ending": ("string", "why its episodes ended, apart by spaces"),
        "tree": ("string", "canonical text"),
    },
}
"""By frame and column: its dtype, and its meaning with the unit."""


@dataclass(frozen=True)
class Results:
    """Runs that were read from a folder."""

    path: Path
    folders: tuple[RunFolder, ...]  # in the order of their paths

    @cached_property
    def runs(self) -> DataFrame:
        """One row a run; `first.<milestone>` is the generation of its first such robot."""
        return _frame("runs", (self._run(folder) for folder in self.folders))

    @cached_property
    def generations(self) -> DataFrame:
        """One row a generation."""
        return _frame("generations", self._rows(_generation))

    @cached_property
    def individuals(self) -> DataFrame:
        """One row an individual."""
        return _frame("individuals", self._rows(_individuals))

    def _run(self, folder: RunFolder) -> dict[str, Any]:
        row = {**self._labels(folder), "status": folder.status().value}
        if not folder.finished():
            return row
        summary = folder.summary()
        return {**row, "tree": summary["champion"]["record"]["tree"], **values(summary)}

    def _rows(self, of: Any) -> Iterator[dict[str, Any]]:
        for folder in self.folders:
            labels = self._labels(folder)
            shared = {name: labels[name] for name in ("run", "arm", "seed")}
            for record in folder.checked_records():
                for row in of(record):
                    yield {**shared, **row}

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


def load(path: str | Path) -> Results:
    """The runs in a folder and in all folders below it.

    Raises:
        RunError: there is no run, one is damaged, or one is of a version before domains.
    """
    top = Path(path).resolve()
    folders = tuple(RunFolder(file.parent) for file in sorted(top.rglob("config.yaml")))
    folders = tuple(f for f in folders if (f.path / "about.json").exists())
    if not folders:
        raise RunError(f"Expected runs in {top}, found none; give the folder that `runs` named.")
    for folder in folders:
        check_version(folder.configuration())
    return Results(top, folders)


def _generation(record: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    s, guidance = record["snapshot"], record["guidance"] or {}
    plain = {name: value for name, value in s.items() if not isinstance(value, dict)}
    nested = {
        f"{group}.{name}": value
        for group in ("tiers", "specialists", "doing", "counters")
        for name, value in s[group].items()
    }
    kept = ("source", "phase", "pattern", "target", "crisis", "injected")
    yield {**plain, **{name: guidance.get(name) for name in kept}, **nested}


def _individuals(record: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for i in record["individuals"]:
        kept = ("id", "origin", "mutation", "fitness", "specialist", "nodes", "depth", "tree")
        yield {
            "generation": record["snapshot"]["generation"],
            **{name: i[name] for name in kept},
            "parents": " ".join(i["parents"]),
            "best_tier": i["tiers"][0] if i["tiers"] else "",
            "ending": " ".join(i["endings"]),
            **{f"components.{name}": points for name, points in i["components"].items()},
            **{f"counters.{name}": value for name, value in i["counters"].items()},
        }


def _frame(kind: str, rows: Iterator[dict[str, Any]]) -> DataFrame:
    """The documented columns with their dtypes, then those of domain and experiment."""
    from pandas import DataFrame

    frame = DataFrame(list(rows))
    declared = COLUMNS[kind]
    others = [name for name in frame.columns if name not in declared]
    frame = frame.reindex(columns=[*declared, *others])
    firsts = {name: "Int64" for name in others if name.startswith("first.")}
    return frame.astype({**{name: dtype for name, (dtype, _) in declared.items()}, **firsts})
