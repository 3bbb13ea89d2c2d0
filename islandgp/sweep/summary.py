"""Results of a sweep over its seeds: tables by arm.

An arm is a group of jobs that differ only in seed. This module has means and standard deviations;
statistical tests are in `islandgp.compare`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from math import inf, pi, sqrt
from pathlib import Path
from statistics import fmean, median, stdev
from typing import Any, Final

from islandgp.records.folder import Status
from islandgp.records.parameters import TASK
from islandgp.records.values import fallback_words, validation_mean
from islandgp.sweep.folder import SweepFile, SweepFolder, SweepJob
from islandgp.text import in_points, title


@dataclass(frozen=True, slots=True)
class ArmSummary:
    """One arm of a sweep."""

    name: str
    jobs: tuple[SweepJob, ...]
    finished: tuple[SweepJob, ...]
    summaries: tuple[dict[str, Any], ...]  # of the finished ones
    own_scale: bool = False  # True: other arms have other rewards, worlds or curricula


LEAST_PAIRS: Final = 6  # with fewer, no signed-rank test has p < 0.05


def power_line(file: SweepFile) -> str:
    """What a paired test of two arms can show with the seeds of a sweep; "" for a single arm.

    The smallest difference that Wilcoxon's signed-rank test finds with 80 % power at 0.05 is
    (1.96 + 0.84) / sqrt((n - 3) 3 / pi) standard deviations of the pairs' differences: the normal
    approximation with the test's efficiency. It is within 8 % of simulations for 6 to 60 pairs.
    """
    seeds = {name: {job.seed for job in jobs} for name, jobs in file.arms().items()}
    if len(seeds) < 2:
        return ""
    n = min(map(len, seeds.values()))
    if n < LEAST_PAIRS:
        return (
            f"Seeds: {n} an arm, with which no paired test can show a difference (least p"
            f" {min(1, 2 / 2**n):.2g}); {LEAST_PAIRS} can."
        )
    shift = 2.8 / sqrt((n - 3) * 3 / pi)
    return (
        f"Seeds: {n} an arm; a paired test finds a difference of about {shift:.2g} standard"
        " deviations of the pairs' differences with 80 % power."
    )


def arms(sweep: SweepFolder, file: SweepFile) -> list[ArmSummary]:
    """The arms with the summaries of their finished runs. Raises RunError if one is damaged."""
    own_scale = any(key.partition(".")[0] in TASK for key in file.studied_keys())
    summaries = (_arm(sweep, name, jobs) for name, jobs in file.arms().items())
    return [replace(arm, own_scale=own_scale) for arm in summaries]


def _arm(sweep: SweepFolder, name: str, jobs: list[SweepJob]) -> ArmSummary:
    finished = [job for job in jobs if sweep.run(job).finished()]
    summaries = tuple(sweep.run(job).summary() for job in finished)
    return ArmSummary(name, tuple(jobs), tuple(finished), summaries)


def milestones(summaries: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """The tiers whose first robots are in the summaries, the easiest first."""
    return tuple(dict.fromkeys(tier for s in summaries for tier in s["first"]))


FALLBACK: Final = "fallback's answers"  # head of a column if there are any


def arm_rows(arms: Sequence[ArmSummary]) -> list[tuple[str, ...]]:
    """A head and one row per arm.

    Columns: the validation mean with its standard deviation, the median generation of the first
    robot of each milestone over all runs, the mean diversity, and the share of the fallback's
    answers if there are any. Validation means under different tasks are marked.
    """
    tiers = milestones([s for arm in arms for s in arm.summaries])
    points = "validation mean" + ", own scale" * any(arm.own_scale for arm in arms)
    head = ("arm", "finished", points, *map(title, tiers), "diversity")
    rows = [head, *(_row(arm, tiers) for arm in arms)]
    fallback = [fallback_words(arm.summaries) for arm in arms]
    if not any(fallback):
        return rows
    return [(*row, cell) for row, cell in zip(rows, [FALLBACK, *fallback], strict=True)]


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


def arm_table(arms: Sequence[ArmSummary]) -> str:
    """The rows in Markdown."""
    rows = arm_rows(arms)
    lines = ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]) + "\n"


def arm_lines(arms: Sequence[ArmSummary]) -> str:
    """The rows for a terminal."""
    rows = arm_rows(arms)
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    lines = ["  ".join(f"{c:<{w}}" for c, w in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(line.rstrip() for line in lines)


def _row(arm: ArmSummary, tiers: Sequence[str]) -> tuple[str, ...]:
    name = " ".join(arm.name.split())  # a quoted text may hold line breaks
    finished = f"{len(arm.finished)} of {len(arm.jobs)}"
    if not arm.summaries:
        return (name, finished, "", *("" for _ in tiers), "")
    means = [mean for s in arm.summaries if (mean := validation_mean(s)) is not None]
    spread = f" ± {in_points(stdev(means))}" if len(means) > 1 else ""
    diversity = fmean(s["mean_diversity"] for s in arm.summaries)
    return (
        name,
        finished,
        f"{in_points(fmean(means))}{spread}" if means else "",
        *(_emergence(arm, tier) for tier in tiers),
        f"{diversity:.3f}",
    )


def _emergence(arm: ArmSummary, tier: str) -> str:
    """The median over all finished runs, and the number of runs with one; others are censored."""
    firsts = [s["first"][tier] for s in arm.summaries if tier in s["first"]]
    if not firsts:  # it is another experiment's, in the same sweep
        return ""
    came, n = sum(g is not None for g in firsts), len(firsts)
    middle = median(inf if g is None else g for g in firsts)
    text = f"{middle:g}" if middle < inf else "not reached" if came else "never"
    return f"{text} ({came} of {n})"


def sweep_note(
    sweep: SweepFolder, file: SweepFile, arms: Sequence[ArmSummary], status: Status
) -> str:
    """The sweep's description in MLflow, in Markdown."""
    seeds = sorted({job.seed for job in file.jobs})
    lines = [
        arm_table(arms),
        f"{len(file.jobs)} runs, {status.value.lower()}: {len(arms)} arm{'s' * (len(arms) != 1)},"
        f" seeds {', '.join(map(str, seeds))}. Validation mean: points of a run's best robot in"
        " validation worlds, mean ± standard deviation over runs. Tiers: median generation of the"
        " first such robot over all runs, one without it counted as later than any, and how many"
        " runs had one. Diversity: mean.",
        "",
        *(f"    {command}" for command in file.commands),
        "",
    ]
    if unfinished := [job for job in file.jobs if sweep.run(job).status() is not Status.FINISHED]:
        lines += ["## Not finished", ""]
        for job in unfinished:
            state = sweep.run(job).status().value.lower()
            lines.append(f"- {job.folder} ({state}): `{job.command}`")
    lines += ["", f"Records: `{sweep.path}`"]
    return "\n".join(lines) + "\n"
