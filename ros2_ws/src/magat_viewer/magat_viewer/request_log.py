# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The log of the page's server: malformed requests are counted and shortened. Free of ROS."""

import logging
import sys

from aiohttp.http_exceptions import HttpProcessingError

from magat_node.text import Throttle, log_line, shortened

#: Most characters of an error in a log line.
_ERROR = 200


class RequestLog(logging.Handler):
    """Anyone who reaches the port can send malformed requests. aiohttp logs each with a traceback."""

    def __init__(self) -> None:
        """Start with no request."""
        super().__init__(logging.WARNING)
        self._throttle = Throttle()
        #: Requests that failed so far.
        self.failed = 0

    def logger(self) -> logging.Logger:
        """A logger that writes here only."""
        made = logging.Logger("page")
        made.addHandler(self)
        return made

    def emit(self, record: logging.LogRecord) -> None:
        """Count a request that failed, and log it, unless one was logged a moment ago."""
        self.failed += 1
        if not self._throttle.due():
            return
        error = record.exc_info[1] if record.exc_info else None
        why = f"{type(error).__name__}: {shortened(' '.join(str(error).split()), _ERROR)}" if error else ""
        text = f"{self.failed} requests to the page failed so far; the last one: {record.getMessage()} ({why})"
        print(log_line("WARN", "viewer", text), file=sys.stderr, flush=True)
        if error is not None and not isinstance(error, HttpProcessingError):  # a bug, not a malformed request
            sys.excepthook(type(error), error, error.__traceback__)
