"""Results of a sweep over its seeds: tables by arm.

An arm is a group of jobs that differ only in seed. This module has means and standard deviations;
statistical tests are in `islandgp.compare`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from math import inf, pi, sqrt
from pathlib import Path
from statistics import fmean, median, stdev
from textwrap import indent
from typing import Any, Final

from islandgp.records.folder import Status
from islandgp.records.parameters import TASK
from islandgp.records.sweep import SweepFile, SweepFolder, SweepJob
from islandgp.records.values import fallback_words, validation_mean
from islandgp.text import in_points, title

LEAST_PAIRS: Final = 6  # with fewer, no signed-rank test has p < 0.05


@dataclass(frozen=True, slots=True)
class ArmSummary:
    """One arm of a sweep."""

    name: str
    jobs: tuple[SweepJob, ...]
    finished: tuple[SweepJob, ...]
    summaries: tuple[dict[str, Any], ...]  # of the finished ones
    own_scale: bool  # True: other arms have other rewards, worlds or curricula


def arms(sweep: SweepFolder, file: SweepFile) -> list[ArmSummary]:
    """The arms with the summaries of their finished runs. Raises RunError if one is damaged."""
    own_scale = any(key.partition(".")[0] in TASK for key in file.studied_keys())
    summaries = []
    for name, jobs in file.arms().items():
        finished = tuple(job for job in jobs if sweep.run(job).finished())
        results = tuple(sweep.run(job).summary() for job in finished)
        summaries.append(ArmSummary(name, tuple(jobs), finished, results, own_scale))
    return summaries


def power_line(file: SweepFile) -> str:
    """What a paired test of two arms can show with the seeds of a sweep; "" for a single arm.

    The smallest difference that Wilcoxon's signed-rank test finds with 80 % power at 0.05 is
    (1.96 + 0.84) / sqrt((n - 3) 3 / pi) standard deviations of the pairs' differences: the normal
    approximation with the test's efficiency. It is within 8 % of simulations for 6 to 60 pairs.
    """
    seeds = [len({job.seed for job in jobs}) for jobs in file.arms().values()]
    if len(seeds) < 2:
        return ""
    if (n := min(seeds)) < LEAST_PAIRS:
        return (
            f"Seeds: {n} an arm, with which no paired test can show a difference (least p"
            f" {min(1, 2 / 2**n):.2g}); {LEAST_PAIRS} can."
        )
    return (
        f"Seeds: {n} an arm; a paired test finds a difference of about"
        f" {2.8 / sqrt((n - 3) * 3 / pi):.2g} standard deviations of the pairs' differences with"
        " 80 % power."
    )


def arm_table(arms: Sequence[ArmSummary]) -> str:
    """A head and one line per arm.

    Columns: the validation mean with its standard deviation, the median generation of the first
    robot of each milestone over all runs, the mean diversity, and the share of the fallback's
    answers. Validation means under different tasks are marked.
    """
    tiers = tuple(dict.fromkeys(t for arm in arms for s in arm.summaries for t in s["first"]))
    points = "validation mean" + ", own scale" * any(arm.own_scale for arm in arms)
    head = ("arm", "finished", points, *map(title, tiers), "diversity", "fallback's answers")
    columns = zip(head, *(_row(arm, tiers) for arm in arms), strict=True)
    full = [cells for cells in columns if any(cells[1:]) or cells[0] != head[-1]]
    widths = [max(map(len, cells)) for cells in full]
    lines = zip(*full, strict=True)
    return "\n".join(
        "  ".join(f"{cell:<{w}}" for cell, w in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def _row(arm: ArmSummary, tiers: Sequence[str]) -> tuple[str, ...]:
    means = [mean for s in arm.summaries if (mean := validation_mean(s)) is not None]
    spread = f" ± {in_points(stdev(means))}" if len(means) > 1 else ""
    diversities = [s["mean_diversity"] for s in arm.summaries]
    return (
        " ".join(arm.name.split()),  # a quoted text may hold line breaks
        f"{len(arm.finished)} of {len(arm.jobs)}",
        f"{in_points(fmean(means))}{spread}" if means else "",
        *(_emergence(arm, tier) for tier in tiers),
        f"{fmean(diversities):.3f}" if diversities else "",
        fallback_words(arm.summaries),
    )


def _emergence(arm: ArmSummary, tier: str) -> str:
    """The median over all finished runs, and the number of runs with one; others are censored."""
    firsts = [s["first"][tier] for s in arm.summaries if tier in s["first"]]
    if not firsts:  # it is another experiment's, in the same sweep
        return ""
    reached, n = sum(g is not None for g in firsts), len(firsts)
    middle = median(inf if g is None else g for g in firsts)
    text = f"{middle:g}" if middle < inf else "not reached" if reached else "never"
    return f"{text} ({reached} of {n})"


def identical_arms(sweep: SweepFolder, arms: Sequence[ArmSummary]) -> list[tuple[str, ...]]:
    """The names of arms whose finished runs have the same individuals and best trees, by group."""
    groups: dict[Any, list[str]] = {}
    for arm in arms:
        runs = sorted((job.seed, _digest(sweep.run(job).path)) for job in arm.finished)
        groups.setdefault(tuple(runs), []).append(" ".join(arm.name.split()))
    return [tuple(names) for runs, names in groups.items() if runs and len(names) > 1]


def _digest(run: Path) -> str:
    contents = ((run / name).read_bytes() for name in ("lineage.csv", "best.bt"))
    return sha256(b"\0".join(contents)).hexdigest()


def sweep_note(
    sweep: SweepFolder, file: SweepFile, arms: Sequence[ArmSummary], status: Status
) -> str:
    """The sweep's description in MLflow, in Markdown."""
    seeds = sorted({job.seed for job in file.jobs})
    lines = [
        indent(arm_table(arms), "    "),
        "",
        f"{len(file.jobs)} runs, {status.value.lower()}: {len(arms)} arm{'s' * (len(arms) != 1)},"
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
