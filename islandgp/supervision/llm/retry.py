"""The one retry layer: how many attempts, and how long to wait between them (section 2.4.5)."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, Field

from islandgp.supervision.llm.message import TRANSIENT, Failure, Reply


class RetrySettings(BaseModel, frozen=True, extra="forbid"):
    """Section 2.4.5: 30 s an attempt, exponential backoff, up to three attempts."""

    attempts: int = Field(ge=1, le=20)  # of a call, the first included
    deadline: float = Field(gt=0)  # s for a whole attempt, however the answer trickles in
    first_wait: float = Field(ge=0)  # s before the second attempt; doubles each time
    longest_wait: float = Field(ge=0)  # s
    retry_after_most: float = Field(ge=0)  # s; a server that asks for more is not asked again


def final(answer: Reply | Failure, attempt: int, how: RetrySettings) -> bool:
    """Whether a call ends with the answer to attempt number `attempt` (from 1)."""
    if isinstance(answer, Reply) or attempt >= how.attempts or not _may_help(answer):
        return True
    return answer.retry_after is not None and answer.retry_after > how.retry_after_most


def _may_help(failure: Failure) -> bool:
    """Whether another attempt may: as the server says, else by the kind of the failure."""
    told = failure.should_retry
    return failure.kind in TRANSIENT if told is None else told


def wait(failure: Failure, attempt: int, how: RetrySettings, rng: np.random.Generator) -> float:
    """Seconds to wait after the failed attempt number `attempt`.

    What the server asks for, else half to all of an exponentially growing time:
    runs of a sweep that fail together do not come back together.
    """
    backoff = min(how.longest_wait, how.first_wait * 2.0 ** (attempt - 1))
    return max(failure.retry_after or 0.0, backoff * float(rng.uniform(0.5, 1)))
