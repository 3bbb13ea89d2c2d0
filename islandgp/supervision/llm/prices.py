"""What tokens cost: the dated price table of `conf/prices`."""

from __future__ import annotations

from typing import Final

from pydantic import BaseModel, Field

from islandgp.supervision.llm.message import Request, Usage

PER: Final = 1e6  # tokens that a price is for


class Price(BaseModel, frozen=True, extra="forbid"):
    """US dollars for a million tokens of one model."""

    input: float = Field(ge=0)
    output: float = Field(ge=0)
    cache_read: float = Field(ge=0)
    cache_write: float = Field(ge=0)  # kept for 5 minutes


class Prices(BaseModel, frozen=True, extra="forbid"):
    """The prices of one day."""

    date: str = Field(pattern=r"^\d{4}-\d\d-\d\d$")  # when they were read
    source: str
    models: dict[str, Price]
    think: tuple[str, ...] = ()  # models that think before each answer if nothing else is said


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
