"""Numbers of the paper that the sweeps stand beside: harmonic mean of seen and unseen overlap F on TOD-Z, per cent.

Source: E. P. Örnek et al., "SupeRGB-D", IEEE RA-L 8(6), 2023, arXiv:2212.11922. Rows that the paper has and the sweep
has not (DINO features) are named, so that nobody takes the sweep for the whole table.
"""

PAPER_HM_OVERLAP_F: dict[str, dict[str, float]] = {
    "ablate_features": {
        "rgb": 69.51,
        "depth": 48.26,
        "rgb_depth": 76.33,
        "paper": 76.48,
    },
    "ablate_sampling": {"null": 51.25, "0.5": 59.55, "0.25": 78.43, "0.1": 73.64},
    "ablate_patches": {"32": 66.03, "64": 78.43, "128": 78.46, "256": 80.31},
}

NOT_RUN: dict[str, str] = {
    "ablate_features": "Rows of the paper's table that need DINO attention maps (78.43 with all features, 65.47 alone) "
    "are not run: the features are not part of the package yet.",
}
