"""The settings of supervision by a language model (sections 2.4.5 and 2.4.6)."""

from __future__ import annotations

import os
from typing import Annotated, ClassVar, Final, Literal

from pydantic import AfterValidator, AnyHttpUrl, BaseModel, Field, SecretStr, model_validator

from islandgp.plugin import ComponentConfig
from islandgp.supervision.base import SUPERVISES, PhaseRates, Rates
from islandgp.supervision.llm.message import INTERFACES

DAY: Final = 86_400  # s
CHARACTERS: Final = 3.8  # of a token, as measured: docs/llm.md
DATE: Final = r"^\d{4}-\d\d-\d\d$"
THINKING_TOKENS: Final = 14_000  # for thinking before an answer
THINKING_SPEED: Final = 50  # tokens per second, lower bound


def check_address(url: str) -> str:
    """The text. Raises ValueError unless it is a server's address."""
    try:
        parts = AnyHttpUrl(url)
    except ValueError:
        parts = None
    is_plain = url.isprintable() and " " not in url and "@" not in url
    if parts is None or parts.port == 0 or not is_plain:
        raise ValueError(
            "expected an address such as http://localhost:11434, without a name or password, which"
            " ANTHROPIC_API_KEY replaces"
        )
    return url


Address = Annotated[str, AfterValidator(check_address)]


class RetrySettings(BaseModel, frozen=True, extra="forbid"):
    """Section 2.4.5: 30 s per attempt, exponential backoff, up to three attempts."""

    attempts: int = Field(ge=1, le=20)  # of a call, including the first
    deadline: float = Field(gt=0, le=DAY)  # s for a whole attempt, from connecting to the last byte
    first_wait: float = Field(ge=0, le=DAY)  # s before the second attempt; doubles each time
    longest_wait: float = Field(ge=0, le=DAY)  # s
    retry_after_most: float = Field(ge=0, le=DAY)  # s; after a longer Retry-After the call ends


class Price(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Prices of one model."""

    input: float = Field(ge=0)  # USD per million tokens
    output: float = Field(ge=0)  # USD per million tokens
    cache_read: float = Field(ge=0)  # USD per million tokens
    cache_write: float = Field(ge=0)  # USD per million tokens, for a cache of 5 minutes


class Facts(BaseModel, frozen=True, extra="forbid"):
    """Other properties of one model."""

    thinks: bool = False  # thinks before each answer by default
    characters: float = Field(default=CHARACTERS, gt=0)  # per token, approximately


class Prices(BaseModel, frozen=True, extra="forbid"):
    """The prices of one day."""

    date: str = Field(pattern=DATE)  # when they were read
    source: str  # where they were read
    models: dict[str, Price]
    unknown: tuple[str, ...] = ()  # models without a published price on that day
    aliases: dict[str, str] = Field(default_factory=dict)  # short name: the server's model name
    facts: dict[str, Facts] = Field(default_factory=dict)


class Caps(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Caps on one run; None: no cap."""

    requests: int | None = Field(default=None, ge=0)  # sent, including retries and repairs
    input_tokens: int | None = Field(default=None, ge=0)  # including cache reads and writes
    output_tokens: int | None = Field(default=None, ge=0)  # in all answers
    usd: float | None = Field(default=None, ge=0)  # at the prices of `prices`
    seconds: float | None = Field(ge=0)  # of attempts and of waiting between them


class PerMinute(BaseModel, frozen=True, extra="forbid"):
    """Limits of an account, shared by all runs of a user on this machine; None: no limit."""

    requests: float | None = Field(default=None, gt=0)  # of all runs together
    input_tokens: float | None = Field(default=None, gt=0)  # estimated from the prompts' characters


class TreeSize(BaseModel, frozen=True, extra="forbid"):
    """Requested size of a tree; the run's limits are accepted."""

    depth: int = Field(ge=1)  # levels
    nodes: str  # approximate number


Outage = Literal["fallback", "stop"]
"""Reaction to a server that does not answer: use the fallback, or stop the run."""


ClientFactory = Annotated[str, Field(pattern=r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*$")]
"""The path of a class or function, "module:name"; see `client.sdk_client`."""


class Fallback(ComponentConfig, frozen=True, extra="ignore"):
    """The supervisor to use without a usable answer; its switches are ignored."""

    needs = SUPERVISES


READS: Final = (
    *("supervisor.policy", "library", "gp.state", "gp.crisis"),
    *("gp.mutation_rate", "gp.crossover_rate", "gp.mutate_elites", "curriculum"),
)
"""The keys that prompts and the fallback depend on."""


class LLMSettings(BaseModel, frozen=True, extra="forbid", hide_input_in_errors=True):
    """Settings of the model, its requests and the checks of its answers."""

    client_factory: ClientFactory | None = None  # makes the SDK's client; None: the Anthropic API's
    interface: Literal["anthropic", "chat", "local"] = "anthropic"  # of the server; local: none
    model: str = Field(min_length=1)  # name or alias; local: or the path of a GGUF file
    base_url: Address | None  # None: ANTHROPIC_BASE_URL, or else that of the client
    api_key: SecretStr | None = None  # None: ANTHROPIC_API_KEY; never written to files
    max_tokens: int = Field(ge=64, le=200_000)  # of an answer
    temperature: float | None = Field(ge=0, le=2)  # sent if the model accepts one
    output: Literal["auto", "grammar", "structured", "text"]  # auto: the first that is taken
    retry: RetrySettings
    repairs: int = Field(ge=0, le=5)  # further turns after a rejected answer
    rates: Rates  # lowest and highest accepted mutation rate
    phases: PhaseRates  # Table 8
    explore: TreeSize  # section 2.4.6, phase 1
    exploit: TreeSize  # phase 2
    parents: int = Field(default=2, ge=1, le=10)  # trees in the question for edits
    rare: float = Field(ge=0, le=1)  # share of the population below which a behaviour is rare
    on_outage: Outage = "fallback"  # reaction to a server that does not answer
    useless: int = Field(default=10, ge=1)
    """Questions in a row without a usable answer before the model is no longer asked."""
    most_fallback: float | None = Field(default=None, ge=0, le=1)  # share; None: any
    caps: Caps
    per_minute: PerMinute = PerMinute()
    prices: Prices
    prompts: str  # paper, informed, or a folder
    fallback: Fallback
    reads: ClassVar = dict.fromkeys(("rate", "tree", "edits"), READS)

    @model_validator(mode="after")
    def _whole(self) -> LLMSettings:
        if self.caps.usd is not None and self.price is None:
            raise ValueError(
                f"caps.usd: expected a model with a known price, found {self.model_name!r}; the"
                f" prices of {self.prices.date} know {', '.join(self.prices.models)}. Add the"
                " model to prices.models, or set caps.usd=null"
            )
        return self

    @property
    def reply_tokens(self) -> int:
        """Most tokens of a reply: of the answer and of thinking before it."""
        return self.max_tokens + THINKING_TOKENS * self.facts.thinks

    @property
    def deadline(self) -> float:
        """Deadline of an attempt in s: for the answer and for thinking before it."""
        return self.retry.deadline + (self.reply_tokens - self.max_tokens) / THINKING_SPEED

    @property
    def key(self) -> str | None:
        """The API key or token, without surrounding white space; None if there is none."""
        own = self.api_key.get_secret_value() if self.api_key is not None else ""
        keys = (own, *(os.environ.get(name, "") for name in INTERFACES[self.interface].keys))
        return next((key.strip() for key in keys if key.strip()), None)

    @property
    def address(self) -> str | None:
        """The server's address; None for that of the client."""
        variable = "" if self.client_factory is not None else INTERFACES[self.interface].address
        return self.base_url or os.environ.get(variable) or None

    @property
    def place(self) -> str:
        """The server's address or the client, for messages."""
        return self.address or self.client_factory or INTERFACES[self.interface].server

    @property
    def price(self) -> Price | None:
        """The model's price; None if it is unknown."""
        return self.prices.models.get(self.model_name)

    @property
    def model_name(self) -> str:
        """The server's name of the model, with aliases resolved."""
        return self.prices.aliases.get(self.model, self.model)

    @property
    def rate_words(self) -> dict[str, str]:
        """Table 8 as values for prompts, by phase, and the limits."""
        ranges = {p.value: f"{low:.2f} to {high:.2f}" for p, (low, high) in self.phases.items()}
        least, most = self.rates
        return {**ranges, "least": f"{least:g}", "most": f"{most:g}"}

    @property
    def sends_grammar(self) -> bool:
        """True if a grammar of the answer is sent; the Messages API has none."""
        return self.interface != "anthropic" and self.output in ("auto", "grammar")

    @property
    def sends_schema(self) -> bool:
        """True if a schema of the answer is sent, for a server that takes no grammar."""
        return self.output in ("auto", "structured")

    @property
    def facts(self) -> Facts:
        """Other properties of the model; defaults if unknown."""
        return self.prices.facts.get(self.model_name, Facts())
