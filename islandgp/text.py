"""Names and numbers in texts for people."""

from __future__ import annotations


def rounded(value: float) -> float:
    """A whole number from 100 on, else three digits; never a negative zero."""
    number = float(round(value)) if abs(value) >= 100 else float(f"{value:.3g}")
    return int(number) if number == int(number) else number


def in_points(value: float, sign: str = "") -> str:
    """Points in a text for people: rounded, as in `4,000`; with a sign where `sign` is "+"."""
    return format(rounded(value), f"{sign},")


def title(name: str) -> str:
    """A name for people: `full_service` is Full Service."""
    return name.replace("_", " ").title()
