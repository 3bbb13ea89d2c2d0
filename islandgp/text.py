"""Formats names and numbers for display."""

from __future__ import annotations


def rounded(value: float) -> float:
    """A whole number from 100 on, else three digits; never a negative zero."""
    number = float(round(value)) if abs(value) >= 100 else float(f"{value:.3g}")
    return int(number) if number == int(number) else number


def in_points(value: float, sign: str = "") -> str:
    """Points for display: rounded, as in `4,000`; with a sign if `sign` is "+"."""
    return format(rounded(value), f"{sign},")


def in_interval(mean: float, low: float | None, high: float | None) -> str:
    """A difference in points with its interval, as in `+4,000 [+3,100, +4,900]`.

    Without `low` and `high`, as for a single world, there is no interval.
    """
    ends = (
        "" if low is None or high is None else f" [{in_points(low, '+')}, {in_points(high, '+')}]"
    )
    return in_points(mean, "+") + ends


def title(name: str) -> str:
    """A name for display: "Full Service" for `full_service`."""
    return name.replace("_", " ").title()


def in_its_domain(domain: str, tree: str) -> str:
    """The text of a file: a tree's text after the line with its domain; "" is no domain."""
    return f"domain {domain}\n\n{tree}" if domain else tree
