"""The settings of supervision by a language model (sections 2.4.5 and 2.4.6)."""

from __future__ import annotations

import os
from typing import Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, Field, SecretStr, field_validator, model_validator

from islandgp.part import Part
from islandgp.supervision.base import SUPERVISES, Phase
from islandgp.supervision.llm.funnel import RateSettings
from islandgp.supervision.llm.ledger import Caps
from islandgp.supervision.llm.prices import Price, Prices
from islandgp.supervision.llm.retry import RetrySettings


class TreeSize(BaseModel, frozen=True, extra="forbid"):
    """How large a tree is asked for, and how large a one is taken."""

    depth: int = Field(ge=1)  # levels, asked for
    nodes: str  # about how many, asked for
    most_depth: int = Field(ge=1)  # taken; the run's own limits hold besides
    most_nodes: int = Field(ge=1)


class Fallback(Part, frozen=True, extra="ignore"):
    """The supervisor that answers where the model does not; its switches and lag do not count."""

    needs = SUPERVISES


class LLMSettings(BaseModel, frozen=True, extra="forbid", hide_input_in_errors=True):
    """One model, how it is asked, and what its answers may be."""

    model: str = Field(min_length=1)
    base_url: str | None  # None: ANTHROPIC_BASE_URL, else the Anthropic API
    api_key: SecretStr | None = None  # None: ANTHROPIC_API_KEY; never written anywhere
    max_tokens: int = Field(ge=64, le=200_000)  # of an answer
    temperature: float | None = Field(ge=0, le=2)  # sent where the model takes one
    output: Literal["auto", "structured", "text"]  # auto: as the probe at the start finds
    cache: bool  # ask the server to keep the system prompts
    retry: RetrySettings
    repairs: int = Field(ge=0, le=5)  # further turns after an answer that cannot be used
    rate: RateSettings
    phases: dict[Phase, tuple[float, float]]  # Table 8
    explore: TreeSize  # section 2.4.6, phase 1
    exploit: TreeSize  # phase 2
    exploit_from: str | None  # milestone whose first robot begins phase 2; None: the last one
    rare: float = Field(ge=0, le=1)  # share of the population below which a behaviour is rare
    caps: Caps
    prices: Prices
    prompts: str | None  # a folder of prompts; None: the project's own
    fallback: Fallback

    @field_validator("api_key", mode="before")
    @classmethod
    def _text(cls, key: object) -> object:
        # A key of digits is a number to a command line, and errors show wrong values.
        return str(key) if isinstance(key, int) else key

    @field_validator("base_url")
    @classmethod
    def _plain_url(cls, url: str | None) -> str | None:
        if url is None:
            return None
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise ValueError("expected an address such as http://localhost:11434")
        if "@" in parts.netloc:
            raise ValueError("expected no user name and password; set ANTHROPIC_API_KEY instead")
        return url

    @model_validator(mode="after")
    def _whole(self) -> LLMSettings:
        if missing := [phase.value for phase in Phase if phase not in self.phases]:
            raise ValueError(
                f"phases: expected a range for each phase, missing {', '.join(missing)}"
            )
        if self.caps.usd is not None and self.price is None:
            raise ValueError(
                f"caps.usd: expected a model with a known price, found {self.model!r}; the prices"
                f" of {self.prices.date} know {', '.join(self.prices.models)}. Add the model to"
                " prices.models, or set caps.usd=null"
            )
        return self

    @property
    def address(self) -> str | None:
        """Where requests go, None for the Anthropic API."""
        return self.base_url or os.environ.get("ANTHROPIC_BASE_URL") or None

    @property
    def price(self) -> Price | None:
        """The model's price, None where nobody knows it."""
        return self.prices.models.get(self.model)
