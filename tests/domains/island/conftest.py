"""Islands where everything lies where the test wants it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from islandgp.domains.island import state
from islandgp.domains.island.schedule import Circle, Schedule, Spawn, Turn
from islandgp.domains.island.world import FAR

Lay = Callable[..., None]


@pytest.fixture
def lay(monkeypatch: pytest.MonkeyPatch) -> Lay:
    """Puts a day written by hand in the place of the one that a seed decides."""

    def put(
        *,
        garbage: Sequence[complex] = (),
        humanoids: Sequence[tuple[float, float]] = (),
        spawns: Sequence[Spawn] = (),
        turns: Sequence[Turn] = (),
        obstacles: Sequence[Circle] = (),
    ) -> None:
        """`garbage` lies at x + iy, `humanoids` are at (x, y)."""
        schedule = Schedule(
            obstacles=tuple(obstacles),
            garbage=tuple(garbage),
            humanoids=tuple((x, y, 0.0, 0.0) for x, y in humanoids),
            spawns=(*sorted(spawns), (FAR, 0.0, 0.0)),
            turns=(*sorted(turns), (FAR, 0, 0.0, 0.0)),
        )
        monkeypatch.setattr(state, "draw_schedule", lambda _world, _seed: schedule)

    return put
