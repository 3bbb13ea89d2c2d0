"""What a person sees while a run goes on: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from time import monotonic
from types import TracebackType
from typing import TYPE_CHECKING, Literal, Self

from islandgp.evolution.record import Step

if TYPE_CHECKING:
    from rich.live import Live  # imported only where it is used: it costs start-up time

COLUMNS = ("generation", "best", "mean", "diversity", "complete", "excellent", "rate", "left")


def row(step: Step, generations: int, seconds_left: float) -> tuple[str, ...]:
    """One generation in COLUMNS."""
    s = step.record.snapshot
    guidance = step.record.guidance
    rate = "" if guidance is None else f"{guidance.applied_rate:.2f}{'!' * bool(guidance.crisis)}"
    return (
        f"{s.generation}/{generations - 1}",
        f"{s.best:,.0f}",
        f"{s.mean:,.0f}",
        f"{s.diversity:.2f}",
        str(s.tiers["complete"]),
        str(s.tiers["excellent"]),
        rate,
        f"{seconds_left:.0f} s",
    )


class Progress:
    """Shows a run's generations as they come. A context manager."""

    def __init__(
        self, how: Literal["auto", "plain", "off"], generations: int, title: str, done: int = 0
    ) -> None:
        """`done` generations were there before, from an interrupted run."""
        self.how = how
        self.generations = generations
        self.title = title
        self.done = self.before = done
        self.began = monotonic()
        self.rows: list[tuple[str, ...]] = []
        self._live = self._make_live() if how == "auto" and sys.stderr.isatty() else None

    def _make_live(self) -> Live:
        from rich.console import Console
        from rich.live import Live

        return Live(console=Console(stderr=True), refresh_per_second=8, transient=False)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
            self._draw()
        elif self.how != "off":
            print(self.title, file=sys.stderr, flush=True)
            print("  ".join(f"{c:>10}" for c in COLUMNS), file=sys.stderr, flush=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, step: Step) -> None:
        """One generation more."""
        self.done += 1
        a_generation = (monotonic() - self.began) / (self.done - self.before)
        self.rows.append(row(step, self.generations, a_generation * (self.generations - self.done)))
        if self._live is not None:
            self._draw()
        elif self.how != "off":
            print("  ".join(f"{c:>10}" for c in self.rows[-1]), file=sys.stderr, flush=True)

    def _draw(self) -> None:
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table

        table = Table(title=self.title, title_justify="left", box=None, padding=(0, 1))
        for column in COLUMNS:
            table.add_column(column, justify="right")
        for cells in self.rows[-12:]:
            table.add_row(*cells)
        assert self._live is not None
        self._live.update(Group(table, ProgressBar(total=self.generations, completed=self.done)))
