"""What a machine may lack: told apart from failures, because elsewhere the same job runs."""

from __future__ import annotations


class NotAvailableError(RuntimeError):
    """Something that a job needs and this machine lacks, such as weights that must be downloaded.

    In a sweep such a job is reported as not run, and the sweep goes on.
    """
