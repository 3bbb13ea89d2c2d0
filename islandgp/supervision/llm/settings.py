"""The settings of supervision by a language model (sections 2.4.5 and 2.4.6)."""

from __future__ import annotations

import json
import os
import re
from typing import Annotated, Any, Final, Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, Field, SecretStr, field_validator, model_validator

from islandgp.plugin import ComponentConfig
from islandgp.supervision.base import SUPERVISES, Phase, check_ranges

DAY: Final = 86_400  # s
KEPT: Final = 20  # injected trees and decisions that are remembered
CHARACTERS: Final = 3.8  # of a token, as measured: docs/llm/cost.md
DATE: Final = r"^\d{4}-\d\d-\d\d$"
THINKING_TOKENS: Final = 14_000  # room for what a model thinks before an answer
THINKING_SPEED: Final = 50  # tokens a second that a model thinks at least


OWN_FIELDS: Final = frozenset(
    {
        "max_tokens",
        "messages",
        "model",
        "output_config",
        "stream",
        "system",
        "temperature",
        "thinking",
    }
)
"""Fields of a request's body that are made from other settings; `stream` is not supported."""


_REQUESTS: Final = re.compile(r"(/v1)?/(messages|responses|(chat/)?completions)/*$")


def check_address(url: str) -> None:
    """Raises ValueError unless a server's address can be one, without the path of a request."""
    parts = urlsplit(url)
    try:
        whole = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:  # a port that is none
        whole = False
    if not whole or not url.isprintable() or " " in url:
        raise ValueError("expected an address such as http://localhost:11434")
    if "@" in parts.netloc:
        raise ValueError("expected no user name and password; set ANTHROPIC_API_KEY instead")
    if found := _REQUESTS.search(parts.path):
        address = f"{parts.scheme}://{parts.netloc}{parts.path[: found.start()]}"
        raise ValueError(
            f"expected an address without the path of a request, such as {address}, found"
            f" {found[0]} at its end; the client adds /v1/messages. A server that speaks only"
            " OpenAI's language needs LiteLLM's proxy before it, see docs/llm.md, Any model"
        )


class RetrySettings(BaseModel, frozen=True, extra="forbid"):
    """Section 2.4.5: 30 s an attempt, exponential backoff, up to three attempts."""

    attempts: int = Field(ge=1, le=20)  # of a call, the first included
    deadline: float = Field(gt=0, le=DAY)  # s for a whole attempt, however the answer trickles in
    first_wait: float = Field(ge=0, le=DAY)  # s before the second attempt; doubles each time
    longest_wait: float = Field(ge=0, le=DAY)  # s
    retry_after_most: float = Field(ge=0, le=DAY)  # s; who asks for more is not asked again


class Price(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """US dollars for a million tokens of one model."""

    input: float = Field(ge=0)  # USD a million tokens
    output: float = Field(ge=0)  # USD a million tokens
    cache_read: float = Field(ge=0)  # USD a million tokens
    cache_write: float = Field(ge=0)  # kept for 5 minutes


class Facts(BaseModel, frozen=True, extra="forbid"):
    """What else is known of one model."""

    thinks: bool = False  # before each answer, if nothing else is said
    caches_from: int | None = Field(default=None, ge=1)  # tokens of the shortest prompt it keeps
    characters: float = Field(default=CHARACTERS, gt=0)  # of a token, about
    retires: str | None = Field(default=None, pattern=DATE)  # None: no date is announced


class Prices(BaseModel, frozen=True, extra="forbid"):
    """The prices of one day."""

    date: str = Field(pattern=DATE)  # when they were read
    source: str  # where they were read
    models: dict[str, Price]
    unknown: tuple[str, ...] = ()  # models whose price was nowhere to be found on that day
    aliases: dict[str, str] = Field(default_factory=dict)  # a name of ours: the model
    facts: dict[str, Facts] = Field(default_factory=dict)


class SweepCaps(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """The most that all runs in a sweep's folder may take together; None: no cap."""

    requests: int | None = Field(default=None, ge=0)  # sent, retries and repairs included
    input_tokens: int | None = Field(default=None, ge=0)  # read from and written to a cache, too
    output_tokens: int | None = Field(default=None, ge=0)  # in all answers
    usd: float | None = Field(default=None, ge=0)  # at the prices of `prices`


class Caps(SweepCaps, frozen=True, extra="forbid", allow_inf_nan=False):
    """The most that one run may take; None: no cap."""

    seconds: float | None = Field(ge=0)  # spent on attempts and on waiting between them


class RateSettings(BaseModel, frozen=True, extra="forbid"):
    """Which rates are taken. One outside is never used as it is."""

    least: float = Field(ge=0, le=1)
    most: float = Field(ge=0, le=1)  # highest rate that is taken
    outside: Literal["repair", "clamp"]  # ask again and then refuse, or take the nearest limit

    @model_validator(mode="after")
    def _ordered(self) -> RateSettings:
        if self.least > self.most:
            raise ValueError(f"least: expected at most {self.most}, found {self.least}")
        return self


class InformedSettings(BaseModel, frozen=True, extra="forbid"):
    """The parts of informed prompts; each can be left out."""

    reasoning: bool = True  # the answer's reasons stand before its decision
    rewards: bool = True  # what events earn, and the thresholds of a crisis
    classes: bool = True  # what each class of the population earns
    injected: int = Field(default=5, ge=0, le=KEPT)  # the last injected trees with their fate
    traces: bool = True  # what the best and the most lacking tree did, in words
    decisions: int = Field(default=5, ge=0, le=KEPT)  # the last decisions and what followed
    differ: bool = True  # the instruction to differ from the examples


class TreeSize(BaseModel, frozen=True, extra="forbid"):
    """How large a tree is asked for, and how large a one is taken."""

    depth: int = Field(ge=1)  # levels, asked for
    nodes: str  # about how many, asked for
    most_depth: int = Field(ge=1)  # taken; the run's own limits hold besides
    most_nodes: int = Field(ge=1)  # taken

    @property
    def values(self) -> dict[str, str]:
        """Values for prompts."""
        return {name: str(value) for name, value in self.model_dump().items()}


class Thinking(BaseModel, frozen=True, extra="forbid"):
    """Whether a model thinks before it answers, as the Messages API takes it."""

    type: Literal["adaptive", "enabled", "disabled", "between_tools"]  # whether it thinks
    budget_tokens: int | None = Field(default=None, ge=1024)  # of "enabled"
    display: Literal["summarized", "omitted"] | None = None  # what of it comes back

    @model_validator(mode="after")
    def _budgeted(self) -> Thinking:
        if (self.type == "enabled") != (self.budget_tokens is not None):
            raise ValueError(
                f"budget_tokens: expected a number with type=enabled and with no other, found"
                f" {self.budget_tokens} with type={self.type}"
            )
        return self


Outage = Literal["fallback", "wait", "stop"]
"""What happens where no server answers: the fallback stands in, the run waits, or it stops."""


class Useless(BaseModel, frozen=True, extra="forbid"):
    """When a model whose answers cannot be used is not asked any more."""

    most: int = Field(ge=1)  # questions in a row, repairs included, without a usable answer
    then: Literal["fallback", "stop"]  # the fallback goes on, or the run ends


class Fallback(ComponentConfig, frozen=True, extra="ignore"):
    """The supervisor that answers where the model does not; its switches and lag do not count."""

    needs = SUPERVISES


class LLMSettings(BaseModel, frozen=True, extra="forbid", hide_input_in_errors=True):
    """One model, how it is asked, and what its answers may be."""

    model: str = Field(min_length=1)
    base_url: str | None  # None: ANTHROPIC_BASE_URL, else the Anthropic API
    api_key: SecretStr | None = None  # None: ANTHROPIC_API_KEY; never written anywhere
    max_tokens: int = Field(ge=64, le=200_000)  # of an answer
    thinking_tokens: Annotated[int, Field(ge=0, le=200_000)] | Literal["auto"] = 0  # before it
    thinking_seconds: Annotated[float, Field(ge=0, le=DAY)] | Literal["auto"] = 0  # s for it
    temperature: float | None = Field(ge=0, le=2)  # sent where the model takes one
    output: Literal["auto", "structured", "text"]  # auto: as the probe at the start finds
    thinking: Thinking | None = None  # None: as the model does by itself
    effort: Literal["low", "medium", "high", "xhigh", "max"] | None = None  # None: the model's own
    extra_body: dict[str, Any] | None = None  # more fields of each request's body
    cache: bool  # ask the server to keep the system prompts
    retry: RetrySettings
    repairs: int = Field(ge=0, le=5)  # further turns after an answer that cannot be used
    rate: RateSettings
    phases: dict[Phase, tuple[float, float]]  # Table 8
    explore: TreeSize  # section 2.4.6, phase 1
    exploit: TreeSize  # phase 2
    exploit_from: str | None  # milestone whose first robot begins phase 2; None: the last one
    candidates: int = Field(default=1, ge=1, le=10)  # trees of an answer; the best is injected
    refuse_copies: bool = False  # of examples and living trees, and trees that check warns of
    parents: int = Field(default=2, ge=1, le=10)  # trees that the question for edits shows
    samples: int = Field(default=1, ge=1, le=10)  # answers to it that are asked for at once
    models: dict[str, Annotated[float, Field(gt=0)]] | None = Field(default=None, min_length=1)
    """Models that answer it, by weight; None: `model` alone."""
    choice: Literal["weights", "bandit"] = "weights"  # bandit: by the share of edits that gained
    rare: float = Field(ge=0, le=1)  # share of the population below which a behaviour is rare
    on_outage: Outage = "fallback"  # where no server answers
    useless: Useless | None = None  # None: asked to the end, whatever the answers are
    most_fallback: float | None = Field(default=None, ge=0, le=1)  # share; None: any
    caps: Caps
    sweep_caps: SweepCaps = SweepCaps()  # of all runs in the folder of the run's sweep
    prices: Prices
    prompts: str | None  # paper, informed, or a folder; None (of older records): paper
    informed: InformedSettings = InformedSettings()  # the parts of informed prompts
    fallback: Fallback

    @field_validator("api_key", mode="before")
    @classmethod
    def _text(cls, key: object) -> object:
        # A key of digits is a number to a command line, and errors show wrong values.
        return str(key) if isinstance(key, int) else key

    @field_validator("extra_body")
    @classmethod
    def _more_fields(cls, extra: dict[str, Any] | None) -> dict[str, Any] | None:
        if taken := sorted(OWN_FIELDS.intersection(extra or {})):
            raise ValueError(
                f"expected other fields than {', '.join(sorted(OWN_FIELDS))}, which have settings"
                f" of their own or are not supported, found {', '.join(taken)}"
            )
        try:
            json.dumps(extra, allow_nan=False)
        except (ValueError, TypeError) as error:
            raise ValueError(f"expected JSON values ({error})") from None
        return extra

    @field_validator("base_url")
    @classmethod
    def _plain_url(cls, url: str | None) -> str | None:
        if url is not None:
            check_address(url)
        return url

    @model_validator(mode="after")
    def _whole(self) -> LLMSettings:
        check_ranges("phases", self.phases)
        capped = self.caps.usd is not None or self.sweep_caps.usd is not None
        names = (self.model_name, *self.edit_models)
        if capped and (unknown := [n for n in names if n not in self.prices.models]):
            raise ValueError(
                f"caps.usd: expected a model with a known price, found {unknown[0]!r}; the"
                f" prices of {self.prices.date} know {', '.join(self.prices.models)}. Add the"
                " model to prices.models, or set caps.usd=null"
            )
        return self

    @property
    def thinking_value(self) -> dict[str, Any] | None:
        """`thinking` as a request has it."""
        return None if self.thinking is None else self.thinking.model_dump(exclude_none=True)

    @property
    def reply_tokens(self) -> int:
        """The most tokens of a reply: of the answer, and of what the model thinks before it."""
        if self.thinking_tokens != "auto":
            return self.max_tokens + self.thinking_tokens
        if self.thinking is not None and self.thinking.budget_tokens is not None:
            return self.max_tokens + self.thinking.budget_tokens
        by_itself = self.thinking is None and self.facts.thinks
        thinks = by_itself or (self.thinking is not None and self.thinking.type == "adaptive")
        return self.max_tokens + (THINKING_TOKENS if thinks else 0)

    @property
    def deadline(self) -> float:
        """The s of a whole attempt: for the answer, and for what the model thinks before it."""
        if self.thinking_seconds != "auto":
            return self.retry.deadline + self.thinking_seconds
        return self.retry.deadline + (self.reply_tokens - self.max_tokens) / THINKING_SPEED

    @property
    def address(self) -> str | None:
        """Where requests go, None for the Anthropic API."""
        return self.base_url or os.environ.get("ANTHROPIC_BASE_URL") or None

    @property
    def price(self) -> Price | None:
        """The price of the model, of several the dearest of each sort; None if one is unknown."""
        found = [self.prices.models.get(n) for n in (self.model_name, *self.edit_models)]
        known = [price.model_dump() for price in found if price is not None]
        if len(known) < len(found):
            return None
        return Price(**{sort: max(price[sort] for price in known) for sort in known[0]})

    @property
    def model_name(self) -> str:
        """The name that the server knows the model by: aliases are resolved."""
        return self.prices.aliases.get(self.model, self.model)

    @property
    def rate_values(self) -> dict[str, str]:
        """Table 8 as values for prompts."""
        ranges = {f"rate.{p}": f"{low:.2f} to {high:.2f}" for p, (low, high) in self.phases.items()}
        how = self.rate
        return {**ranges, "rate.least": f"{how.least:g}", "rate.most": f"{how.most:g}"}

    @property
    def edit_models(self) -> dict[str, float]:
        """The weights of `models` by the names that the server knows."""
        return {self.prices.aliases.get(n, n): weight for n, weight in (self.models or {}).items()}

    @property
    def facts(self) -> Facts:
        """What is known of the model."""
        return self.prices.facts.get(self.model_name, Facts())
