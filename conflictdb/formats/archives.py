"""Refuse archives: the OGR library reads one data set of several in silence, and unpacks without limits."""

import struct
import zipfile
from pathlib import Path
from typing import Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.contents import TOO_LARGE

_REMEDY: Final = "unpack it, and load the files in it"
# Endings of compressed files and archives that no reader opens.
_UNREAD: Final = frozenset({".gz", ".tgz", ".tar", ".7z", ".rar", ".bz2", ".xz", ".zst", ".rtzp"})
# OGR reads all Shapefiles of an archive.
_OF_SHAPEFILE: Final = (".shp", ".shx", ".dbf", ".prj", ".cpg", ".qpj", ".sbn", ".sbx", ".shp.xml")
# Longest list of contents of an archive, bytes: some 20,000 files.
_LONGEST_LIST: Final = 2_000_000
_END: Final = b"PK\x05\x06"
_END_BYTES: Final = 22 + 65_535  # with the longest comment


def check_archive(path: Path, max_file_mb: float) -> str | None:
    """Return the name of the KML file in an archive, None without one; raises InvalidInput for what is not read.

    A ZIP must hold one data set, or Shapefiles, and a KMZ one KML file.
    """
    suffix = path.suffix.lower()
    if suffix in _UNREAD:
        raise InvalidInput("file", "", f"is compressed, or an archive, of a kind that is not read: {_REMEDY}")
    if suffix not in (".kmz", ".zip"):
        return None
    files = [one for one in _listed(path) if not one.is_dir()]
    for one in files:
        parts = one.filename.replace("\\", "/").split("/")
        if ".." in parts or one.filename.startswith(("/", "\\")):
            raise InvalidInput("file", "", f"is an archive with a path outside of it, {one.filename!r:.60}")
        if one.flag_bits & 1:
            raise InvalidInput("file", "", f"is an archive with a password: {_REMEDY}")
    if suffix == ".kmz":
        files = [one for one in files if one.filename.lower().endswith(".kml")]
        if len(files) != 1:
            found = " and ".join(repr(one.filename[:60]) for one in files[:2])
            what = f"{len(files)} KML files, such as {found}" if files else "no KML file"
            raise InvalidInput("file", "", f"is a KMZ that holds {what}, and must hold one: {_REMEDY}")
    sets = sorted({_data_set(one.filename) for one in files})
    if len(sets) > 1 and not all(one.filename.lower().endswith(_OF_SHAPEFILE) for one in files):
        rule = f"is an archive of several data sets, such as {sets[0]!r:.60} and {sets[1]!r:.60}: {_REMEDY}"
        raise InvalidInput("file", "", rule)
    if sum(one.file_size for one in files) > max_file_mb * 1e6:
        raise InvalidInput("file", "", f"holds more than {max_file_mb:g} MB{TOO_LARGE}")
    return next((one.filename for one in files if one.filename.lower().endswith(".kml")), None)


def _listed(path: Path) -> list[zipfile.ZipInfo]:
    """Return the files of an archive; raises InvalidInput for too many of them."""
    try:
        with path.open("rb") as stream:
            stream.seek(max(0, path.stat().st_size - _END_BYTES))
            last = stream.read(_END_BYTES)
        at = last.rfind(_END)
        if at >= 0 and len(last) >= at + 22 and struct.unpack_from("<L", last, at + 12)[0] > _LONGEST_LIST:
            raise InvalidInput("file", "", f"is an archive of too many files: {_REMEDY}")
        with zipfile.ZipFile(path) as archive:
            return archive.infolist()
    except InvalidInput:
        raise
    except (OSError, zipfile.BadZipFile, NotImplementedError, ValueError) as error:
        raise InvalidInput("file", "", f"is no {path.suffix[1:].upper()} archive, or a broken one: {error}") from None


def _data_set(name: str) -> str:
    """Return the data set of a file: its folder if that is a file geodatabase, else its name without endings."""
    folders, _, file = name.rpartition("/")
    geodatabase = next((part for part in folders.split("/") if part.lower().endswith(".gdb")), None)
    return geodatabase or f"{folders}/{file.split('.')[0]}".lstrip("/")
