"""Numbers of the paper for comparison: scores on TOD-Z in per cent, and costs.

Source: E. P. Örnek et al., "SupeRGB-D", IEEE RA-L 8(6), 2023, arXiv:2212.11922.
"""

PAPER_HM_OVERLAP_F: dict[str, dict[str, float]] = {
    "ablate_features": {
        "rgb": 69.51,
        "depth": 48.26,
        "rgb_depth": 76.33,
        "paper": 76.48,
        "paper_dino": 78.43,
        "dino": 65.47,
    },
    "ablate_sampling": {"null": 51.25, "0.5": 59.55, "0.25": 78.43, "0.1": 73.64},
    "ablate_patches": {"32": 66.03, "64": 78.43, "128": 78.46, "256": 80.31},
}

NOT_AT_HAND = "The paper's own numbers of this study are not at hand."
"""Note on the pages of the generalization studies, in place of a column with the paper's numbers."""

PAPER_SCORES: dict[str, dict[str, float]] = {
    "SupeRGB-D on TOD-Z (paper)": {
        "HM P": 89.67,
        "HM R": 74.44,
        "HM F": 76.48,
        "HM boundary F": 66.75,
    },
}
"""Rows of the comparison table: the paper's method on the paper's test frames, trained on 7118 frames."""

PAPER_COST: dict[str, dict[str, float]] = {
    "SupeRGB-D (paper)": {"parameters": 103682, "kilobytes": 400, "frame_ms": 1440},
}
"""Costs given in the paper; time measured on a 12-thread Intel i7-8700."""
