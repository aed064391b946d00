"""Draw reliability diagrams: the share of correct objects as a function of their score."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sgbd.calibration import expected_calibration_error


def reliability_figure(scores: npt.NDArray[np.floating], right: npt.NDArray[np.bool_], bins: int = 10) -> Figure:
    """Draw the share of correct objects over their score, with a histogram of the scores.

    A. Niculescu-Mizil, R. Caruana, "Predicting good probabilities with supervised learning", ICML 2005.

    Args:
        scores: float [K], score of each object, 0 to 1.
        right: bool [K], whether the object is correct.
        bins: Number of bins of equal width.

    Returns:
        A figure of two panels; perfectly calibrated scores lie on the diagonal.
    """
    bin_index = np.minimum((np.asarray(scores, dtype=np.float64) * bins).astype(np.int64), bins - 1)
    count = np.bincount(bin_index, minlength=bins)
    filled = count > 0
    mean_score = np.bincount(bin_index, scores, bins)[filled] / count[filled]
    share = np.bincount(bin_index, right, bins)[filled] / count[filled]
    # Standard error of a share (binomial distribution).
    error = np.sqrt(share * (1 - share) / count[filled])
    figure = Figure(figsize=(5, 6), layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    upper.plot([0, 1], [0, 1], color="grey", linestyle="--", linewidth=1, label="perfect")
    upper.errorbar(mean_score, share, yerr=error, marker="o", markersize=4, capsize=2, label="objects")
    upper.set_ylabel("share that is right (IoU > 0.75)")
    upper.set_ylim(-0.02, 1.02)
    upper.legend(loc="upper left")
    upper.grid(alpha=0.3)
    lower.bar((np.arange(bins) + 0.5) / bins, count, width=0.9 / bins)
    lower.set_ylabel("objects")
    lower.set_xlabel("score")
    lower.set_xlim(0, 1)
    error_of_all = expected_calibration_error(scores, right, bins)
    figure.suptitle(f"{len(scores)} objects, expected calibration error {error_of_all:.3f}")
    return figure
