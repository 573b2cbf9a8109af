"""Files that are written whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO


@contextmanager
def whole_file(path: str | Path) -> Iterator[IO[bytes]]:
    """Give a file to write; it appears when it is complete, and if it cannot be written, an older one stays.

    Raises OSError, with the name that the caller knows, where it cannot be written.
    """
    path = Path(path)
    file = Path(os.path.realpath(path)) if path.is_symlink() else path  # a link stays one
    part = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        if file.exists() and not file.is_file():  # a pipe or a device cannot be replaced
            with file.open("wb") as raw:
                yield raw
        else:
            with part.open("xb") as raw:
                yield raw
            part.replace(file)
    except OSError as error:
        part.unlink(missing_ok=True)
        if error.errno is None:  # not of the system, but of what is written
            raise
        raise type(error)(error.errno, error.strerror, str(path)) from error
    except BaseException:
        part.unlink(missing_ok=True)
        raise
