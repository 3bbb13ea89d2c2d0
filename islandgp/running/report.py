"""The progress of a run, its summary, and a short report for the console."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from time import monotonic
from typing import Any, Final, Literal

import yaml

from islandgp.config.settings import Settings
from islandgp.domain import total
from islandgp.evolution.validation import Best
from islandgp.gp.record import Step
from islandgp.installed import conf_folders
from islandgp.plugin import imported
from islandgp.records.files import RunSummary
from islandgp.records.folder import RunFolder
from islandgp.records.values import (
    answers,
    best_robot,
    comparisons,
    constrained,
    fallback_share,
    fallback_words,
    in_lines,
    reached,
)
from islandgp.scoring.constraints import in_words
from islandgp.text import in_points, title
from islandgp.viewer.history import RunRecords, nothing_works


def duration(seconds: float) -> str:
    """A duration as text: `8 s`, `3 min 05 s`, `2 h 07 min`, `3 d 04 h`."""
    total = max(0, round(seconds))
    if total < 60:
        return f"{total} s"
    for unit, small, size, limit in (("min", "s", 60, 60), ("h", "min", 3600, 24)):
        if total < size * limit:
            return f"{total // size} {unit} {total % size * 60 // size:02d} {small}"
    return f"{total // 86400} d {total % 86400 // 3600:02d} h"


class Progress:
    """Shows the progress of a run on the error stream, unless `mode` is off.

    Each milestone has a column with the number of individuals in that tier. `mutation` is the
    mutation rate of the next generation, with a "!" if a crisis enforces it; only searches that use
    the rate have it. `time left` is estimated.
    """

    def __init__(
        self,
        mode: Literal["plain", "off"],
        left: Callable[[int, int], int],
        title: str,
        milestones: Sequence[str],
        *,
        rate: bool = True,
        done: int = 0,
        spent: int = 0,
    ) -> None:
        """Prints the title and the head of the table.

        Args:
            mode: plain: a line for each generation.
            left: as `Plan.left`: the search for a library may leave fewer generations.
            title: first line.
            milestones: tiers with a column.
            rate: the search uses the mutation rate, which then has a column.
            done: generations before a resumed run continues.
            spent: their episodes.
        """
        self.mode, self.left, self.milestones, self.spent = mode, left, milestones, spent
        self.rate, self.done, self._before = rate, done, done
        self._began = monotonic()
        columns = [("generation", 10), ("best", 9), ("mean", 9), ("diversity", 9), ("working", 7)]
        columns += [(name, max(4, len(name))) for name in milestones]
        columns += [*[("mutation", 8)] * rate, ("time left", 9)]
        self._widths = [width for _, width in columns]
        self._print(title + (f" (from generation {done})" if done else ""))
        self._print_cells(name for name, _ in columns)

    def show(self, step: Step) -> None:
        """Show a generation."""
        s, guidance = step.record.snapshot, step.record.guidance
        self.done += 1
        self.spent += step.cost.episodes
        left = max(0, self.left(self.done - 1, self.spent))
        rate = time_left = ""
        if guidance is not None:
            rate = f"{guidance.applied_rate:.2f}" + "!" * bool(guidance.crisis)
            time_left = duration((monotonic() - self._began) / (self.done - self._before) * left)
        self._print_cells(
            (
                f"{s.generation}/{self.done - 1 + left}",
                in_points(s.fitness_max),
                in_points(s.fitness_mean),
                f"{s.diversity:.2f}",
                f"{s.working:.2f}",
                *(str(s.tiers[name]) for name in self.milestones),
                *[rate] * self.rate,
                time_left,
            )
        )

    def _print_cells(self, cells: Iterable[str]) -> None:
        pairs = zip(cells, self._widths, strict=True)
        self._print("  ".join(f"{cell:>{width}}" for cell, width in pairs))

    def _print(self, line: str) -> None:
        if self.mode != "off":
            print(line.rstrip(), file=sys.stderr, flush=True)


MOSTLY_FALLBACK: Final = (
    "expected guidance by the language model, found that the fallback gave more of it than"
    " supervisor.policy.most_fallback allows. The reasons are in the notes of the records. Fix them"
    " and run again with resume=never, or raise most_fallback."
)


def summary(
    settings: Settings, history: RunRecords, last: Step, best: Best, learned: Sequence[str]
) -> RunSummary:
    """The summary of a run.

    Args:
        settings: of the run.
        history: of the run.
        last: the last generation.
        best: the best robot.
        learned: sentences on what the search has found out; () if it learns nothing.
    """
    sources, snapshots, classes = answers(history.decisions), history.snapshots, settings.classes
    limit = settings.supervisor.policy.get("most_fallback")  # None: there is no fallback
    return RunSummary(
        champion=best,
        fittest=last.champion,
        first={
            tier: next((s["generation"] for s in snapshots if s["tiers"][tier]), None)
            for tier in classes.milestones
        },
        answers=sources,
        mostly_fallback=limit is not None and fallback_share(sources) > limit,
        final_fitness_max=snapshots[-1]["fitness_max"],
        final_fitness_mean=snapshots[-1]["fitness_mean"],
        mean_diversity=total(s["diversity"] for s in snapshots) / len(snapshots),
        generations=len(snapshots),
        seconds=round(history.seconds, 3),
        constraints=in_words(settings.constraints) if settings.constraints else None,
        nothing_works=nothing_works(history, classes),
        learned=tuple(learned),
        stopped=last.stopped,
    )


def report(target: RunFolder, costs: Sequence[Mapping[str, Any]]) -> str:
    """A finished run in a few lines of text; `costs` are those of its generations."""
    s, agent = target.summary(), target.agent
    best = s["champion"]["record"]
    parts = sorted(best["components"].items(), key=lambda part: -abs(part[1]))
    by_component = ", ".join(f"{name} {in_points(points, '+')}" for name, points in parts if points)
    first = "; ".join(
        f"first {title(tier)} {agent}: {'never' if g is None else f'generation {g}'}"
        for tier, g in s["first"].items()
    )
    return "\n".join(
        (
            *filter(None, (s["nothing_works"],)),
            best_robot(s["champion"]),
            *reached(s["champion"]),
            *comparisons(s["champion"]),
            *constrained(s),
            f"Its fitness in training: {in_points(best['fitness'])} ({by_component})",
            f"Highest fitness in training: {in_points(s['fittest']['record']['fitness'])} in"
            f" generation {s['fittest']['generation']}",
            first[:1].upper() + first[1:],
            *_library(costs),
            *_supervision(costs[-1]["llm"] if costs else {}, s["answers"]),
            f"Results: {target.path}",
            "",
            s["champion"]["text"].rstrip(),
            *(["", *in_lines(s["learned"])] if s["learned"] else []),
            "",
        )
    )


def proposals(settings: Settings, summary: Mapping[str, Any]) -> Iterator[str]:
    """Lines that propose a tree to start from, or an installed search, for a finished run.

    A search that suits some domains has a static method `suits(vocabulary, stuck)`, which returns
    the reason, or "". `stuck` is True if nothing works or a milestone was never reached. After a
    run with such a search, no other search is proposed.
    """
    stuck = bool(summary["nothing_works"]) or None in summary["first"].values()
    if stuck and not settings.start:
        yield "Perhaps `start=FILE.bt`: your own tree in generation 0, which evolution improves."
    if hasattr(settings.search.factory, "suits"):
        return
    vocabulary = settings.make_domain().schema.vocabulary
    for file in (
        file for folder in conf_folders() for file in sorted(folder.glob("search/*.yaml"))
    ):
        with suppress(Exception):  # the run is finished: a broken plug-in has no say
            kind = imported(yaml.safe_load(file.read_text("utf-8"))["search"]["factory"])
            if reason := getattr(kind, "suits", lambda *_: "")(vocabulary, stuck):
                yield f"Perhaps `search={file.stem}`: {reason}."


def is_mostly_fallback(summary: Mapping[str, Any]) -> bool:
    """True if the fallback's share of a finished run exceeds `most_fallback`."""
    return bool(summary["mostly_fallback"])


def _library(costs: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """A line on the episodes of the search for a library, if there was one."""
    if episodes := sum(cost.get("library", 0) for cost in costs):
        yield f"Episodes of the search for a library, in place of training: {episodes:,}"


def _supervision(spent: Mapping[str, float], sources: Mapping[str, int]) -> Iterator[str]:
    """Lines on the sources of the guidance and what a language model has `spent`."""
    if share := fallback_words([{"answers": sources}]):
        yield f"Answers of the fallback: {share}"
    if spent.get("requests"):
        price = "at an unknown price"
        if "cost_usd" in spent:
            price = f"${spent['cost_usd']:,.4f}"
            if spent["uncounted_requests"]:
                price += f" (at most ${spent['cost_usd_at_most']:,.4f}: some answers were lost)"
        yield (
            f"Language model: {1 - fallback_share(sources):.0%} of the answers,"
            f" {spent['requests']:,.0f} requests, {spent['input_tokens']:,.0f} tokens in,"
            f" {spent['output_tokens']:,.0f} out, {price}"
        )
