"""Human-readable output: score names, figures, the files of an evaluation, and HTML reports of runs and sweeps."""
