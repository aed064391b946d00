"""The error for resources that a machine lacks: it is not a failure, because the same job runs on another machine."""

from __future__ import annotations


class NotAvailableError(RuntimeError):
    """A job needs something that this machine lacks, such as weights that must be downloaded.

    In a sweep such a job is reported as not run, and the sweep goes on.
    """
