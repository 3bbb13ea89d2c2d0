"""A domain with another vocabulary; it runs nothing."""

from __future__ import annotations

from typing import ClassVar

from islandgp.bt.core.vocabulary import Action, Vocabulary, flag
from islandgp.domain import Event, Schema, SimulatorDomain
from islandgp.domains.island import Island


class Other(SimulatorDomain):
    """As `check` sees it: only the vocabulary counts."""

    World = Island.World

    schema: ClassVar[Schema] = Schema(
        vocabulary=Vocabulary(
            "other", {"Work": Action("works"), "Rest": Action("rests")}, {"tired": flag("is tired")}
        ),
        components={"work": "work done"},
        events={"done": Event("work is done")},
        task="A robot works and rests.",
    )
