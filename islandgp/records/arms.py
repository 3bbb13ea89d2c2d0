"""The table of a sweep's arms: means and standard deviations over their finished runs.

An arm is a group of jobs that differ only in seed; statistical tests are in `islandgp.compare`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import sha256
from math import inf
from statistics import fmean, median, stdev
from textwrap import indent
from typing import Any, Final

from islandgp.records.folder import Status
from islandgp.records.parameters import TASK
from islandgp.records.sweep import SweepFile, SweepFolder
from islandgp.records.values import fallback_words, run_values
from islandgp.statistics import detectable_shift, least_p
from islandgp.text import in_points, title

SAME: Final = ("lineage.csv", "best.bt")  # files that are equal in identical runs
LAST: Final = ("diversity", "fallback's answers")  # columns of the table, after those of tiers
LEAST_PAIRS: Final = 6  # with fewer, no signed-rank test has p < 0.05


def power_line(file: SweepFile) -> str:
    """What a paired test of two arms can show with the seeds of a sweep; "" for a single arm."""
    seeds = [len({job.seed for job in jobs}) for jobs in file.arms().values()]
    if len(seeds) < 2:
        return ""
    if (n := min(seeds)) < LEAST_PAIRS:
        return (
            f"Seeds: {n} an arm, with which no paired test can show a difference (least p"
            f" {least_p(n):.2g}); {LEAST_PAIRS} can."
        )
    return (
        f"Seeds: {n} an arm; a paired test finds a difference of about {detectable_shift(n):.2g}"
        " standard deviations of the pairs' differences with 80 % power."
    )


def arm_table(sweep: SweepFolder, file: SweepFile) -> str:
    """A head and one line per arm.

    Columns: the validation mean with its standard deviation, the median generation of the first
    robot of each milestone over all runs, the mean diversity, and the share of the fallback's
    answers. Validation means under different tasks are marked.

    Raises:
        RunError: a finished run is damaged.
    """
    own_scale = any(key.partition(".")[0] in TASK for key in file.studied_keys())
    rows = []
    for name, jobs in file.arms().items():
        runs = [run.summary() for job in jobs if (run := sweep.run(job)).finished()]
        values = [run_values(summary) for summary in runs]
        rows.append(
            {
                "arm": _one_line(name),
                "finished": f"{len(runs)} of {len(jobs)}",
                "validation mean" + ", own scale" * own_scale: _spread(values),
                **_emergence(values),
                "diversity": f"{fmean(v['mean_diversity'] for v in values):.3f}" if runs else "",
                "fallback's answers": fallback_words(runs),
            }
        )
    heads = sorted(dict.fromkeys(head for row in rows for head in row), key=LAST.__contains__)
    columns = [(head, *(row.get(head, "") for row in rows)) for head in heads]
    full = [cells for cells in columns if any(cells[1:]) or cells[0] != LAST[1]]
    padded = [[f"{cell:<{max(map(len, cells))}}" for cell in cells] for cells in full]
    return "\n".join("  ".join(line).rstrip() for line in zip(*padded, strict=True))


def _one_line(arm: str) -> str:
    """An arm's name, in which a quoted text may have line breaks."""
    return " ".join(arm.split())


def _spread(values: Sequence[Mapping[str, Any]]) -> str:
    means = [v["validation_mean"] for v in values if v["validation_mean"] is not None]
    deviation = f" ± {in_points(stdev(means))}" if len(means) > 1 else ""
    return f"{in_points(fmean(means))}{deviation}" if means else ""


def _emergence(values: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """The median over all runs, and the number of runs with one, by tier; others are censored."""
    cells = {}
    for key in dict.fromkeys(key for v in values for key in v if key.startswith("first.")):
        firsts = [inf if v[key] is None else v[key] for v in values if key in v]
        reached, middle = sum(first < inf for first in firsts), median(firsts)
        text = f"{middle:g}" if middle < inf else "not reached" if reached else "never"
        cells[title(key.removeprefix("first."))] = f"{text} ({reached} of {len(firsts)})"
    return cells


def identical_arms(sweep: SweepFolder, file: SweepFile) -> list[tuple[str, ...]]:
    """The names of arms whose finished runs have the same individuals and best trees, by group."""
    groups: dict[Any, list[str]] = {}
    for arm, jobs in file.arms().items():
        finished = {job.seed: run for job in jobs if (run := sweep.run(job)).finished()}
        runs = sorted(
            (seed, *(sha256((run.path / name).read_bytes()).digest() for name in SAME))
            for seed, run in finished.items()
        )
        groups.setdefault(tuple(runs), []).append(_one_line(arm))
    return [tuple(names) for runs, names in groups.items() if runs and len(names) > 1]


def sweep_note(sweep: SweepFolder, file: SweepFile, table: str, status: Status) -> str:
    """The sweep's description in MLflow, in Markdown."""
    seeds = sorted({job.seed for job in file.jobs})
    arms = len(file.arms())
    lines = [
        indent(table, "    "),
        "",
        f"{len(file.jobs)} runs, {status.value.lower()}: {arms} arm{'s' * (arms != 1)},"
        f" seeds {', '.join(map(str, seeds))}. Validation mean: points of a run's best robot in"
        " validation worlds, mean ± standard deviation over runs. Tiers: median generation of the"
        " first such robot over all runs, one without it counted as later than any, and how many"
        " runs had one. Diversity: mean.",
        "",
        *(f"    {command}" for command in file.commands),
        "",
    ]
    states = {job: sweep.run(job).status() for job in file.jobs}
    if unfinished := {job: s for job, s in states.items() if s is not Status.FINISHED}:
        lines += ["## Not finished", ""]
        lines += [f"- {j.folder} ({s.value.lower()}): `{j.command}`" for j, s in unfinished.items()]
    return "\n".join([*lines, "", f"Records: `{sweep.path}`", ""])
