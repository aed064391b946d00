"""Numbers of the paper that the sweeps stand beside: harmonic mean of seen and unseen overlap F on TOD-Z, per cent.

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
"""What the pages of the studies of generalization say instead of a column of the paper's."""
