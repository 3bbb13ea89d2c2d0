"""Islands where everything lies where the test wants it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from islandgp.domains.island import state
from islandgp.domains.island.schedule import Circle, Schedule, schedule_of
from islandgp.domains.island.world import IslandWorld

Lay = Callable[..., None]


@pytest.fixture
def lay(monkeypatch: pytest.MonkeyPatch) -> Lay:
    """Puts a day written by hand in the place of the one that a seed decides."""

    def put(
        *,
        garbage: Sequence[complex] = (),
        humanoids: Sequence[tuple[float, float]] = (),
        spawns: Sequence[tuple[int, float, float]] = (),
        turns: Sequence[tuple[int, int, float, float]] = (),
        obstacles: Sequence[Circle] = (),
    ) -> None:
        """`garbage` lies at x + iy, `humanoids` are at (x, y)."""

        def laid_out(world: IslandWorld, _seed: int) -> Schedule:
            return schedule_of(
                world,
                obstacles=tuple(obstacles),
                garbage=[(at.real, at.imag) for at in garbage],
                humanoids=[(x, y, 0.0, 0.0) for x, y in humanoids],
                spawns=sorted(spawns),
                turns=sorted(turns),
            )

        monkeypatch.setattr(state, "draw_schedule", laid_out)

    return put
