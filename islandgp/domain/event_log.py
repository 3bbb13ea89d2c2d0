"""The events of an episode of a stepped simulator, with their points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf

from islandgp.domain.checks import near_hint
from islandgp.domain.contract import Observer, Schema
from islandgp.domain.rewards import RewardTable, worth
from islandgp.errors import DomainError
from islandgp.leaves import is_number
from islandgp.plugin import short_repr


class EventLog:
    """Counts the events of an episode and adds up their points by component.

    `log("picked")` and `log("driven", 2.5)` record an event.
    """

    def __init__(
        self,
        rewards: RewardTable,
        schema: Schema,
        weights: Mapping[str, float],
        observer: Observer | None = None,
    ) -> None:
        self.counts = dict.fromkeys(schema.events, 0)
        self.components = dict.fromkeys(schema.components, 0.0)
        self.action = ""  # the leaf that is being called
        self._rewarded = rewards.events.keys()
        self._worth = worth(rewards, weights)
        self._observer = observer
        self._logged: Callable[[str], None] | None = getattr(observer, "logged", None)

    def matters(self, event: str) -> bool:
        """True if an event earns points or the episode has an observer.

        Args:
            event: of the schema.

        Returns:
            False if the event need not be recorded for its points.
        """
        return event in self._rewarded or self._observer is not None

    def __call__(self, event: str, amount: float = 1.0) -> None:
        """Records an event.

        Args:
            event: of the schema.
            amount: in the event's unit; finite.

        Raises:
            DomainError: the event is not in the schema, or the amount is not a finite number.
        """
        try:
            self.counts[event] += 1
        except KeyError:
            events, near = ", ".join(self.counts), near_hint(event, self.counts)
            raise DomainError(
                f"Expected an event of the schema ({events}), found {event!r}{near}."
            ) from None
        if not (type(amount) is float and -inf < amount < inf):
            if not is_number(amount):
                raise DomainError(
                    f"Expected a finite amount of the event {event!r}, found {short_repr(amount)}."
                )
            amount = float(amount)  # of NumPy's numbers, which records cannot hold
        if self._logged is not None:
            self._logged(event)
        if event not in self._rewarded:
            return
        component, points = self._worth(event, amount)
        if component:
            self.components[component] += points
            if self._observer is not None:
                self._observer.credit(component, points, event, self.action)
