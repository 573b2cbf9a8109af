"""Read files of observed positions such as AIS (CSV, one row per fix, any order): one track per vessel or aircraft.

docs/reference/files.md lists the columns; the names that AIS archives use are accepted too. Other columns whose value
never changes for an object become its properties. Without any size column every object is a point; with length and
width it is a rectangle centred on the reported position.

Unusable data are left out and reported by name (`Skipped`): rows without identity, time or position, rows at a time
that is already taken, fixes that cannot be reached at `max_speed_kn`, objects without a size, and objects with a single
fix. A file that is no position file is refused (InvalidInput).
"""

import csv
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence, Set
from decimal import Decimal
from io import StringIO
from typing import Final

import numpy as np

from conflictdb.errors import InvalidInput
from conflictdb.formats.contents import NO_SIZES, Contents, FileRefusals, Remark, check_columns
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.file_objects import TOLERANCES, WORDS
from conflictdb.formats.fixes import LENGTH_WIDTH, SIDES, Fixes, tracks_of, without_size
from conflictdb.formats.hints import given_haven, renamed
from conflictdb.formats.instants import parse_instant
from conflictdb.formats.json_text import check_text
from conflictdb.formats.names import RENAME_COLUMN, SETTING_RULE, SETTINGS, misnamed
from conflictdb.formats.standards import Standard
from conflictdb.model.speed_limits import AIS_MAX_SPEED_KN, MAX_SPEED_KN

# Column of this package -> accepted names, in lower case; the first is the package's own.
COLUMNS: Final = {
    "id": ("id", "mmsi", "key", "vessel_id", "icao24"),
    "time": ("time", "datetime", "basedatetime", "base_date_time", "timestamp", "date_time_utc", "# timestamp"),
    "lon": ("lon", "longitude", "long"),
    "lat": ("lat", "latitude"),
    "name": ("name", "vesselname", "vessel_name", "shipname"),
    "length_m": ("length_m", "length"),
    "width_m": ("width_m", "width", "beam"),
    "fore_m": ("fore_m", "to_bow", "a"),
    "aft_m": ("aft_m", "to_stern", "b"),
    "port_m": ("port_m", "to_port", "c"),
    "starboard_m": ("starboard_m", "to_starboard", "d"),
    "floor_m": ("floor_m",),
    "ceiling_m": ("ceiling_m",),
    **{name: (name,) for name in WORDS},
}
STANDARD: Final = Standard(
    "CSV, as of AIS",
    read={
        " ".join(name for name in COLUMNS["time"] if " " not in name): "times",
        "floor_m ceiling_m": "heights",
        " ".join(name for one in (*LENGTH_WIDTH, *SIDES) for name in COLUMNS[one]): "sizes",
    },
    unread={"sog speed": "speeds", "draught draft altitude": "heights and depths", "eta": "times of arrival"},
)
REQUIRED: Final = ("id", "time", "lon", "lat")
# Names that no other column may resemble; names without influence on conflicts are not checked.
_GUARDED: Final = ("lon", "lat", *LENGTH_WIDTH, *SIDES, "floor_m", "ceiling_m")
_ELSEWHERE: dict[str, str] = dict.fromkeys(SETTINGS, SETTING_RULE) | dict.fromkeys(
    ("grow_mps", "outline_m", "outlines_m"),
    "is read from scene files only: positions have a size, as length or as sides",
)
_ELSEWHERE |= dict.fromkeys(
    ("schedule", "departures", *TOLERANCES),
    "is read from scene files only: positions are those of one voyage, as sailed",
)
_SIZES: Final = "length_m and width_m, or fore_m, aft_m, port_m and starboard_m"
_HEIGHTS: Final = {"floor_m": "floor", "ceiling_m": "ceiling"}
# Objects that a remark lists by name.
_MOST_NAMED: Final = 10
MAX_OBJECTS: Final = 1_000_000
MISSING: Final = frozenset({"", "na", "nan", "null", "none", r"\n"})

# As the Danish AIS archive writes times: 31/12/2025 23:59:59.
_DAY_FIRST: Final = re.compile(r"(\d\d)/(\d\d)/(\d{4})[ T]+(\d\d:\d\d.*)")
# An identity that a spreadsheet has rounded: 2.19E+08.
_ROUNDED: Final = re.compile(r"\d+([.,]\d+)?[eE]\+?\d+")
_NUMBER: Final = re.compile(r"[+-]?\d+(\.\d*)?")
# Behind the digits of an identity, as programs write whole numbers of a column with gaps: 219000001.0.
_WHOLE_FLOAT: Final = re.compile(r"(?<=\A\d{9})\.0\Z", re.ASCII)
# Numbers in this range are seconds since 1970 (1973 to 5138): dates in digits (20260301) and milliseconds lie outside.
EARLIEST_S: Final = 100_000_000
LATEST_S: Final = 100_000_000_000
AIS_NO_LATITUDE: Final = 91.0  # "not available", ITU-R M.1371
AIS_NO_LONGITUDE: Final = 181.0


def read_positions(
    text: str, source: str, *, max_speed_kn: float | None = None, max_objects: int = MAX_OBJECTS
) -> Contents:
    """Return the tracks of a file of positions, and the rows and objects left out.

    Parameters
    ----------
    text : str
        The whole file; the first line names the columns, separated by comma, semicolon or tab.
    source : str
        The file, for `Skipped`.
    max_speed_kn : float, optional
        A fix that can only be reached faster than this is an error; 102.2 for AIS (a column `mmsi`), else 2,000.
    max_objects : int
        More are refused; each takes a kilobyte, however short its rows.

    Raises
    ------
    InvalidInput
        A column is missing, a row has too few or too many cells, or a cell is neither a value nor missing.
    """
    reader = _Reader(text)
    reader.refusals.raise_found()
    if max_speed_kn is None:
        max_speed_kn = AIS_MAX_SPEED_KN if reader.has_mmsi else MAX_SPEED_KN
    fixes = reader.fixes(max_objects)
    reader.refusals.raise_found()
    tracks, skipped, notes = tracks_of(source, fixes.items(), reader.size_columns, max_speed_kn, reader.left_out)
    contents = Contents(None, [], tracks, skipped)
    texts = [] if reader.size_columns else [f"{NO_SIZES} ({_SIZES}): all are points"]
    texts += ["has dates with slashes: they are read as day/month/year"] if reader.is_day_first else []
    unsized = without_size(reader.left_out)
    if unsized:
        of = f"{len(unsized):,} of {len(fixes):,} objects have"
        texts.append(f"{of} no size and are left out, such as {unsized[0]!r:.60}: --haven gives them one")
    texts += notes
    flat = [key for key, rows in fixes.items() if reader.is_flat(rows)]
    if flat:
        of = f"{len(flat):,} of {len(fixes):,} objects have"
        texts.append(f"{of} a length and no width, or the reverse, such as {flat[0]!r:.60}: --haven gives them one")
    texts += _without_bound(fixes, {track.key for track in tracks})
    changing = Counter(
        name for rows in fixes.values() for name, value in rows.constant.items() if value is None and name != "name"
    )
    unread = Counter({name: count for name, count in changing.items() if STANDARD.is_unread(name.lower())})
    contents.remarks = [*(Remark(source, "file", text) for text in texts), *STANDARD.remarks(source, unread)]
    return contents


def read_fixes(text: str) -> tuple[dict[str, Fixes], dict[tuple[str, str], list[int]]]:
    """Return the fixes of a file of positions by id, and the lines that are left out; raises as `read_positions`."""
    reader = _Reader(text)
    reader.refusals.raise_found()
    fixes = reader.fixes(MAX_OBJECTS)
    reader.refusals.raise_found()
    return fixes, reader.left_out


def _without_bound(fixes: Mapping[str, Fixes], kept: Set[str]) -> Iterator[str]:
    """Yield remarks on tracks that are unbounded because some of their rows give no height."""
    for column, name in _HEIGHTS.items():
        keys = [key for key in fixes if key in kept and column in fixes[key].unbounded]
        keys = [key for key in keys if column in fixes[key].lowest or column in fixes[key].largest]
        if keys:
            named = ", ".join(repr(key) for key in keys[:_MOST_NAMED]) + (", …" if len(keys) > _MOST_NAMED else "")
            yield f"has rows without {column} of {len(keys)} tracks, whose {name} is then unbounded: {named:.400}"


class _Reader:
    """The rows of one file, cell by cell; `left_out` collects line numbers by object and reason."""

    def __init__(self, text: str) -> None:
        header_line = text.partition("\n")[0]
        separator = max(",;\t", key=header_line.count)
        self.rows = csv.reader(StringIO(text, newline=""), delimiter=separator, strict=True)
        self.refusals = FileRefusals()
        self.header = renamed([name.strip() for name in next(self._csv_rows(), [])])
        self.refusals.raise_found()
        check_columns("file", self.header)
        self.left_out: dict[tuple[str, str], list[int]] = defaultdict(list)
        lower = [name.lower() for name in self.header]
        self.is_day_first = False
        found = {column: [name for name in names if name in lower] for column, names in COLUMNS.items()}
        self.at = {column: lower.index(names[0]) for column, names in found.items() if names}
        for column, names in found.items():
            given = [self.header[i] for i, name in enumerate(lower) if name in names]
            if len(given) > 1 and column != "name":
                rule = f"gives the same as the column {given[0]}: leave one of them out, or rename it"
                self.refusals.extend([InvalidInput("file", f"column {given[1]}", rule)])
        for column in REQUIRED:
            with self.refusals:
                if column not in self.at:
                    rule = f"is missing: the first line must name the columns, {', '.join(REQUIRED)} among them"
                    raise InvalidInput("file", f"column {column}", f"{rule} (or {', '.join(COLUMNS[column][1:3])})")
        by_sides = all(column in self.at for column in SIDES)
        by_length = any(column in self.at for column in LENGTH_WIDTH)
        self.size_columns: Sequence[str] = (*(SIDES if by_sides else ()), *(LENGTH_WIDTH if by_length else ()))
        self._check_sides()
        self.others = [(i, name) for i, name in enumerate(self.header) if name and i not in self.at.values()]
        known = dict.fromkeys(self.at, "given")
        self.suspects = {
            i: name for i, name in self.others if any(misnamed("file", {**known, name: "0"}, _GUARDED, _ELSEWHERE))
        }

    def _check_sides(self) -> None:
        """Refuse an incomplete set of four sides."""
        if SIDES[0] in self.size_columns:
            return
        names = [self.header[self.at[column]] for column in SIDES if column in self.at]
        rule = f"needs the other sides beside it: {', '.join(SIDES)}"
        self.refusals.extend(InvalidInput("file", f"column {name}", rule) for name in names if len(name) > 1)

    def is_ais(self, column: str) -> bool:
        """Return whether a column has another name than the package's own."""
        return column in self.at and self.header[self.at[column]].lower() != COLUMNS[column][0]

    @property
    def has_mmsi(self) -> bool:
        """Whether objects are ships of AIS."""
        return "id" in self.at and self.header[self.at["id"]].lower() == "mmsi"

    def fixes(self, max_objects: int) -> dict[str, Fixes]:
        """Return the usable rows by object, in order of first appearance."""
        # AIS times are always UTC; the package's own column `time` needs an offset.
        naive_is_utc = self.is_ais("time")
        fixes: dict[str, Fixes] = {}
        for row in self._csv_rows():
            with self.refusals:
                if row:
                    self._add_fix(row, self.rows.line_num, fixes, naive_is_utc)
            if len(fixes) > max_objects:
                rule = f"names another object after {max_objects:,}, the most that a file may have: split the file"
                raise InvalidInput("file", f"line {self.rows.line_num}", rule)
        return fixes

    def _csv_rows(self) -> Iterator[list[str]]:
        """Yield the remaining rows, until one is not CSV; that error is added to the refusals."""
        try:
            yield from self.rows
        except csv.Error as error:
            rule = f"is not CSV: {error}"
            if "field limit" in str(error):
                rule = f"has a cell of more than {csv.field_size_limit():,} characters: is a quotation mark not closed?"
            with self.refusals:
                raise InvalidInput("file", f"line {self.rows.line_num}", rule) from None

    def _add_fix(self, row: list[str], line: int, fixes: dict[str, Fixes], naive_is_utc: bool) -> None:
        if len(row) != len(self.header):
            rule = f"has {len(row)} cells, but there are {len(self.header)} columns"
            raise InvalidInput("file", f"line {line}", rule)
        key = _cell(row[self.at["id"]])
        if key is None:
            self.left_out["(rows without id)", "no id"].append(line)
            return
        if _ROUNDED.fullmatch(key):
            rule = f"is a number in scientific notation, {key!r:.40}, as spreadsheets round long ones: two ships have"
            raise self._refusal("file", line, "id", f"{rule} one id; export the column as text")
        key = _WHOLE_FLOAT.sub("", key)
        who = f"track {checked_key('file', f'line {line}', key)!r}"
        check_text(who, f"line {line}", "".join(row))
        when = _cell(row[self.at["time"]])
        place = self._position(who, row, line)
        # An object exists from its first row on, even if the row is unusable.
        own = fixes.setdefault(key, Fixes())
        self._add_cells(who, own, row, line)
        if when is None or place is None:
            self.left_out[key, "no time" if when is None else "no position"].append(line)
            return
        try:
            own.times_us.append(_instant_us(when, naive_is_utc))
            self.is_day_first = self.is_day_first or "/" in when
        except ValueError as error:
            raise self._refusal(who, line, "time", str(error)) from None
        own.positions_deg.append(place)
        own.lines.append(line)
        own.unbounded.update(one for one in _HEIGHTS if one in self.at and _cell(row[self.at[one]]) is None)

    def _position(self, who: str, row: list[str], line: int) -> tuple[float, float] | None:
        lon, lat = (self._number(who, row, line, column) for column in ("lon", "lat"))
        if lon is None or lat is None or lat == AIS_NO_LATITUDE or lon == AIS_NO_LONGITUDE:
            return None
        for column, name, value, limit in (("lon", "longitude", lon, 360.0), ("lat", "latitude", lat, 90.0)):
            if abs(value) > limit:
                raise self._refusal(who, line, column, f"{name} must lie within +-{limit:g} degrees; got {value:g}")
        return lon, lat

    def _add_cells(self, who: str, own: Fixes, row: list[str], line: int) -> None:
        """Keep the largest sizes (never smaller than the object), the height band over all rows, and constants."""
        for column, size in self._sizes(who, row, line).items():
            own.largest[column] = max(size, own.largest.get(column, 0.0))
        for column, seen, widest in (("floor_m", own.lowest, min), ("ceiling_m", own.largest, max)):
            height = self._number(who, row, line, column)
            if height is not None:
                seen[column] = widest(height, seen.get(column, height))
        for column in WORDS:
            word = _cell(row[self.at[column]]) if column in self.at else None
            if word is not None and own.ruled.setdefault(column, word) != word:
                rule = f"must be the same in all rows of an object ({own.ruled[column]!r:.60}); got {word!r:.60}"
                raise self._refusal(who, line, column, rule)
        named = [(self.at["name"], "name")] if "name" in self.at else []
        for i, name in (*named, *self.others):
            value = _cell(row[i])
            if value is not None and i in self.suspects:
                self._check_name(i, value)
            if value is not None and own.constant.setdefault(name, value) != value:
                own.constant[name] = None  # it varies, so it is no property of the object

    def _sizes(self, who: str, row: list[str], line: int) -> dict[str, float]:
        """Return the sizes in a row, metres, without those that are "not available" in AIS (ITU-R M.1371)."""
        found: dict[str, float] = {}
        for column in self.size_columns:
            size = self._number(who, row, line, column)
            if size is not None and size < 0.0:
                raise self._refusal(who, line, column, f"must not be negative; got {size:g}")
            if size is not None and not (size == 0.0 and column in LENGTH_WIDTH and self.is_ais(column)):
                found[column] = size
        if not self.is_ais(SIDES[0]) or SIDES[0] not in self.size_columns:
            return found
        fore, aft, port, starboard = (found.get(side, 0.0) for side in SIDES)
        if fore == port == 0.0 and (aft > 0.0 or starboard > 0.0):
            # The size is known, and the place of the position on board is not: the ship may reach all of it either way.
            found |= {SIDES[i ^ 1]: found[SIDES[i]] for i in (1, 3) if SIDES[i] in found}
        for i in (0, 2):
            is_unknown = not any(found.get(side) for side in SIDES[i : i + 2])
            if is_unknown and (self._fills(i, found) or not any(found.get(side) for side in SIDES)):
                found = {column: size for column, size in found.items() if column not in SIDES[i : i + 2]}
        return found

    @staticmethod
    def _fills(side: int, found: Mapping[str, float]) -> bool:
        """Return whether the row or the hints give a length or width whose sides are both 0."""
        return given_haven() is not None or LENGTH_WIDTH[side // 2] in found

    def is_flat(self, rows: Fixes) -> bool:
        """Return whether an object of AIS has a length and no width, or the reverse."""
        fore, aft, port, starboard = (rows.largest.get(side, 0.0) for side in SIDES)
        is_whole = all(side in rows.largest for side in SIDES)
        return is_whole and self.is_ais(SIDES[0]) and (fore + aft > 0.0) != (port + starboard > 0.0)

    def _check_name(self, i: int, value: str) -> None:
        """Refuse a column whose name resembles a known one, once one of its cells has that one's type."""
        values = {**dict.fromkeys(self.at, "given"), self.suspects[i]: value}
        found = list(misnamed("file", values, _GUARDED, _ELSEWHERE, remedy=RENAME_COLUMN))
        self.refusals.extend(InvalidInput("file", f"column {refused.field}", refused.rule) for refused in found)
        if found:
            del self.suspects[i]

    def _number(self, who: str, row: list[str], line: int, column: str) -> float | None:
        value = _cell(row[self.at[column]]) if column in self.at else None
        if value is None:
            return None
        try:
            number = float(value)
        except ValueError:
            number = np.nan
        if not np.isfinite(number):
            raise self._refusal(who, line, column, f"must be a finite number, or empty; got {value!r:.60}")
        return number

    def _refusal(self, who: str, line: int, column: str, rule: str) -> InvalidInput:
        return InvalidInput(who, f"line {line}, {self.header[self.at[column]]}", rule)


def _instant_us(text: str, naive_is_utc: bool) -> int:
    """Return an instant, ISO 8601, day/month/year or seconds since 1970, in microseconds; raises ValueError."""
    if "/" in text and (match := _DAY_FIRST.fullmatch(text)):
        text = f"{match[3]}-{match[2]}-{match[1]}T{match[4]}"
    if text.endswith((" UTC", " utc")):
        text = f"{text[:-4]}Z"
    if not _NUMBER.fullmatch(text):
        return parse_instant(text, naive_is_utc=naive_is_utc)
    seconds = Decimal(text)
    if not EARLIEST_S <= seconds < LATEST_S:
        rule = f"a number is seconds since 1970, from {EARLIEST_S} to {LATEST_S}"
        raise ValueError(f"must be ISO 8601, such as 2026-03-01T06:00:00Z, or a number; {rule}; got {text!r:.60}")
    return int((seconds * 1_000_000).to_integral_value())


def _cell(text: str) -> str | None:
    """Return a cell without surrounding space, None if it means a missing value."""
    text = text.strip()
    return None if text.lower() in MISSING else text
