"""The paper's claims beside our results: `python -m studies.paper.claims`.

    python -m studies.paper.claims [FOLDER]

Reads tests.csv of a comparison (default: results/) and the paper's figures (published.yaml), and
writes FOLDER/claims.md. The comparison's first arm corresponds to the paper's proposed system, the
second to its baseline.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pandas as pd  # type: ignore[import-untyped] # its stubs are a package apart
import yaml

HERE: Final = Path(__file__).parent
LEVEL: Final = 0.05
HIGHER, LOWER, EQUAL = 1, -1, 0

Row = Mapping[str, Any]


def published() -> dict[str, Any]:
    """The paper's figures: Tables 9 to 14, sections 3.2 to 3.10, and its claims."""
    text = (HERE / "published.yaml").read_text(encoding="utf-8")
    figures: dict[str, Any] = yaml.safe_load(text)
    return figures


def first_pair(folder: Path) -> pd.DataFrame:
    """The tests of the first two arms, by measure."""
    tests = pd.read_csv(folder / "tests.csv")
    arms = tests.loc[0, ["first", "second"]]
    pair = tests[(tests["first"] == arms["first"]) & (tests["second"] == arms["second"])]
    return pair.set_index("measure")


def adjusted_p(row: Row) -> float:
    """The adjusted p of the difference: of the paired test if the arms share seeds."""
    return float(row["p_bh"] if pd.isna(row["paired_p_bh"]) else row["paired_p_bh"])


def verdict(direction: int, row: Row) -> str:
    """The verdict on a claim: the first arm's values are higher (1), lower (-1) or equal (0)."""
    if pd.isna(row["difference"]):
        return "never in either arm"
    side = HIGHER if row["difference"] > 0 else LOWER
    if not adjusted_p(row) < LEVEL:
        return "not shown" if direction else "no difference shown (no evidence either way)"
    if direction == EQUAL:
        return f"differs: {'higher' if side == HIGHER else 'lower'}, shown"
    return "agrees, shown" if side == direction else "opposite, shown"


def lines(folder: Path) -> Iterator[str]:
    """The page, line by line."""
    figures, tests = published(), first_pair(folder)
    first, second = tests.iloc[0][["first", "second"]]
    yield f"# The paper's claims: {first} minus {second}"
    yield ""
    yield "| claim | unit | difference [95 %] | p BH | paper: difference | paper: p BH | verdict |"
    yield "|---|---|---:|---:|---:|---:|---|"
    for claim in figures["claims"]:
        row = tests.loc[claim["measure"]]
        is_first = claim["measure"].startswith("first.")
        unit = "generations without one" if is_first else row["unit"]
        share = claim.get("difference")
        cells = (
            claim["text"],
            unit,
            f"{_number(row['difference'])} [{_number(row['difference_low'])},"
            f" {_number(row['difference_high'])}]",
            f"{adjusted_p(row):.2g}",
            "" if share is None else f"{share:+.1%}",
            "" if claim.get("p_bh") is None else f"{claim['p_bh']:.3f}",
            verdict(claim["direction"], row),
        )
        yield f"| {' | '.join(cells)} |"
    yield ""
    yield (
        f"Shown: p BH below {LEVEL:g}, over the family of the first two arms. 'Not shown' is not"
        " evidence of no difference."
    )
    yield ""
    yield f"## Means of both arms beside the paper's\n\n{figures['note'].strip()}"
    yield ""
    yield f"| measure | {first} | {second} | paper: proposed | paper: baseline |"
    yield "|---|---:|---:|---:|---:|"
    for key, row in [*figures["fitness"].items(), *figures["diversity"].items()]:
        means = (tests.loc[key, f"mean_{arm}"] for arm in ("first", "second"))
        printed = (row[arm] for arm in ("proposed", "baseline"))
        theirs = (value[0] if isinstance(value, list) else value for value in printed)
        yield f"| {key} | {' | '.join(map(_number, (*means, *theirs)))} |"


def _number(x: float) -> str:
    """A number with the decimals that its size needs."""
    digits = 0 if abs(x) >= 100 else 1 if abs(x) >= 1 else 3
    return f"{x:,.{digits}f}"


def main(arguments: list[str]) -> None:
    """Write claims.md into the folder of a comparison."""
    folder = Path(arguments[0]) if arguments else HERE / "results"
    (folder / "claims.md").write_text("\n".join(lines(folder)) + "\n", encoding="utf-8")
    print(folder / "claims.md")


if __name__ == "__main__":
    main(sys.argv[1:])
