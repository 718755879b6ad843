"""Wrong input, in one line."""

import contextlib
import logging
from typing import Iterator

import dsdf


class Refused(dsdf.InputError):
    """Wrong input. The commands of nerfbaselines print its line, and no traceback."""

    def write_to_logger(self) -> None:
        logging.error(str(self))


@contextlib.contextmanager
def in_one_line() -> Iterator[None]:
    """Makes errors of dsdf about its input errors of one line of nerfbaselines."""
    try:
        yield
    except Refused:
        raise
    except dsdf.InputError as error:
        raise Refused(str(error)) from None
