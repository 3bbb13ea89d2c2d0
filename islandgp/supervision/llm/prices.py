"""What is known of models and what their tokens cost: the dated table of `conf/prices`."""

from __future__ import annotations

from typing import Final

from pydantic import BaseModel, Field

from islandgp.supervision.llm.message import Request, Usage

PER: Final = 1e6  # tokens that a price is for
CHARACTERS: Final = 3.8  # of a token, as measured: docs/llm.md, "What it will cost"
DATE: Final = r"^\d{4}-\d\d-\d\d$"


class Price(BaseModel, frozen=True, extra="forbid"):
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


def cost(usage: Usage, price: Price) -> float:
    """US dollars."""
    return (
        usage.input * price.input
        + usage.output * price.output
        + usage.cache_read * price.cache_read
        + usage.cache_write * price.cache_write
    ) / PER


def most_tokens(request: Request, *, longer: int = 0) -> Usage:
    """More tokens than a request can take, also when it grows by `longer` characters.

    English text and JSON have three to four bytes a token, here it is two; the
    schema and the frame of the message are in the constant.
    """
    size = longer + sum(len(text.encode()) for text in (request.system, *request.turns))
    return Usage(input=size // 2 + 500, output=request.max_tokens)
