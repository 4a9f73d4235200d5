"""The service's log on standard error: for a person with a time, for journald with a priority."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Mapping

__all__ = ["setup"]

PRIORITY = {logging.CRITICAL: 2, logging.ERROR: 3, logging.WARNING: 4, logging.INFO: 6, logging.DEBUG: 7}
"""sd-daemon(3); other levels count as the next lower one"""


class JournalFormatter(logging.Formatter):
    """Puts ``<n>`` before every line; journald adds the time itself."""

    def format(self, record: logging.LogRecord) -> str:
        level = max((known for known in PRIORITY if known <= record.levelno), default=logging.DEBUG)
        return "\n".join(f"<{PRIORITY[level]}>{line}" for line in super().format(record).splitlines())


def setup(environment: Mapping[str, str] = os.environ) -> None:
    """Sends the log of all of lostmotion to standard error, instead of where it went before."""
    handler = logging.StreamHandler(sys.stderr)
    if "JOURNAL_STREAM" in environment or "INVOCATION_ID" in environment:
        handler.setFormatter(JournalFormatter("%(message)s"))
    else:
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
    logger = logging.getLogger()
    logger.handlers[:] = [handler]
    logger.setLevel(logging.INFO)
