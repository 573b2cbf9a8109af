"""Write files completely or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO


@contextmanager
def whole_file(path: str | Path) -> Iterator[IO[bytes]]:
    """Yield a file to write; it appears when it is complete, and if writing fails, an older file stays.

    Raises OSError, with the caller's name of the file, if it cannot be written.
    """
    path = Path(path)
    file = Path(os.path.realpath(path)) if path.is_symlink() else path  # keep a link
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
        if error.errno is None:  # not from the system, but from the writer
            raise
        raise type(error)(error.errno, error.strerror, str(path)) from error
    except BaseException:
        part.unlink(missing_ok=True)
        raise
