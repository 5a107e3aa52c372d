"""Exceptions that nobody foresaw: told in one line, with the whole in a log for whoever mends it."""

import logging
import os
import traceback
from pathlib import Path

from sesa2.errors import shortened

_LOG = logging.getLogger('sesa2')


def fault_line(error: BaseException) -> str:
    """Type, message and place of an exception, in one line; its traceback goes to the log `sesa2`, level debug."""
    _LOG.debug('unforeseen', exc_info=error)
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first is of whoever caught it
    package = str(Path(__file__).parent)
    # Where it left our own code says more than where in a library it came up.
    own = [frame for frame in frames if frame.filename.startswith(package)] or frames[-1:]
    place = f' ({Path(own[-1].filename).name}, line {own[-1].lineno}, in {own[-1].name})' if own else ''
    return f'{type(error).__name__}: {shortened(str(error), 300)}{place}'


def log_tracebacks() -> None:
    """With SESA2_DEBUG=1 in the environment, show the log's tracebacks on standard error."""
    if os.environ.get('SESA2_DEBUG'):
        logging.basicConfig()
        _LOG.setLevel(logging.DEBUG)
