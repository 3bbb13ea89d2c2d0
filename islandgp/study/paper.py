"""The paper's own figures, Tables 9 to 14 and sections 3.4 to 3.9.

They come from another simulator (Unity at 10x speed) and from five runs an arm.
A report prints them beside its own so that the shape of a result can be
compared; their size cannot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MARK: Final = "paper*"
"""How a column with the paper's figures is headed."""

NOTE: Final = (
    "* The paper's figures come from another simulator (Unity) and five runs an arm; here they"
    " show the shape of its result, not a size to be met."
)


@dataclass(frozen=True, slots=True)
class Row:
    """One row of Table 9 or 10: mean and SD of both arms, and the tests."""

    proposed: tuple[float, float]
    baseline: tuple[float, float]
    u: float | None  # Table 10 does not print it
    p: float  # exact
    p_bh: float
    r: float


TABLE_9: Final = {
    "max_ever": Row((47_815, 3311), (48_161, 6653), 12.0, 1.000, 1.000, 0.04),
    "final_max": Row((39_322, 5108), (42_622, 4859), 8.0, 0.421, 0.541, 0.36),
    "mean_max": Row((36_889, 3369), (31_412, 3250), 21.0, 0.095, 0.143, -0.68),
    "final_mean": Row((14_699, 3260), (20_221, 1916), 1.0, 0.016, 0.036, 0.92),
}

TABLE_10: Final = {
    "stage_early": Row((31_723, 3415), (26_784, 780), None, 0.032, 0.057, -0.84),
    "stage_mid": Row((38_992, 3238), (27_811, 3902), None, 0.008, 0.036, -1.00),
    "stage_late": Row((38_565, 3807), (38_502, 5404), None, 0.548, 0.616, -0.28),
}

TABLE_11: Final = {
    "first_complete": ((6, 8, 5, 5, 15), (17, 27, 36, 30, 28)),
    "first_excellent": ((11, 10, 5, 5, 17), (17, 27, 36, 30, 28)),
}
"""Generation of the first one in runs 1 to 5: proposed, baseline."""

EMERGENCE: Final = {"first_complete": (0.717, 0.0358), "first_excellent": (0.652, None)}
"""Section 3.4: reduction, and p after Benjamini and Hochberg (section 1) where it is printed."""

TABLE_12: Final = {
    "diversity_early": (0.571, 0.420, 0.360),
    "diversity_mid": (0.664, 0.507, 0.310),
    "diversity_late": (0.690, 0.591, 0.168),
    "diversity_overall": (0.650, 0.508, 0.280),
}
"""Proposed, baseline, and the difference as a share."""

TABLE_13: Final = {
    "pickup": (12.2, 3.5, (3, 18)),
    "humanoid": (9.6, 3.8, (1, 18)),
    "charging": (8.7, 5.9, (0, 21)),
    "clearing": (5.6, 2.9, (1, 13)),
}
"""Mean count in a population of 30, SD and range, in the proposed system."""

TABLE_14: Final = {
    "calls": "40",
    "trees": "39.8 ± 0.4",
    "response": "120 s",
    "supervision": "80 min",
    "simulation": "10 h",
    "overhead": "13.3 %",
}

DECISIONS: Final = {"exploration": 0.263, "exploitation": 0.162, "crises": 1}
"""Section 3.7: shares of the decisions, and diversity crises over all runs."""
