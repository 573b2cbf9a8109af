"""Recognise the dialects of JSON and XML by their content: one row each."""

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

from conflictdb.errors import InvalidInput
from conflictdb.formats import gpx, rtz
from conflictdb.formats.contents import Contents
from conflictdb.formats.outside import of_exchange
from conflictdb.formats.standards import Standard
from conflictdb.formats.xml_text import Element, parsed


class ReadXml(Protocol):
    """A reader of an XML document."""

    def __call__(
        self, root: Element, source: str, *, stem: str, max_speed_kn: float, layers: Sequence[str], skip_invalid: bool
    ) -> Contents:
        """Return the contents; raises InvalidInput."""


# Modules of `exchange`, and of each its test of a document, its reader and its `Standard`.
_JSON: Final = (
    ("uas_zones", "is_ed318", "read_ed318", "ED318"),
    ("uas_zones", "is_ed269", "read_ed269", "ED269"),
    ("operational_intents", "is_intent", "read_intents", "STANDARD"),
)
_XML_OF_EXCHANGE: Final = (
    ("s421", "is_s421", "read_s421", "STANDARD"),
    ("s124", "is_s124", "read_s124", "STANDARD"),
    ("aixm", "is_aixm", "read_aixm", "STANDARD"),
)
_XML: Final[tuple[tuple[Callable[[Element], bool], ReadXml, Standard], ...]] = (
    (rtz.is_rtz, rtz.read_rtz, rtz.STANDARD),
    (gpx.is_gpx, gpx.read_gpx, gpx.STANDARD),
)
_NAMES: Final = ("RTZ and S-421 routes", "S-124 warnings", "AIXM 5.1 messages", "GPX")


def is_known(document: Any) -> bool:
    """Return whether a JSON document is of another program, by its first objects."""
    return "scene" not in document and _of_exchange(_JSON, document) is not None


def read_json(document: Any, source: str, *, stem: str, skip_invalid: bool) -> Contents | None:
    """Return the contents of a JSON document of another program, None for a scene file or an unknown one."""
    if isinstance(document, dict) and "scene" in document:
        return None
    found = _of_exchange(_JSON, document)
    if found is None:
        return None
    read, standard = found
    contents: Contents = read(document, source, stem=stem, skip_invalid=skip_invalid)
    contents.remarks = [*contents.remarks, *standard.remarks(source, standard.of_json(document))]
    return contents


def _of_exchange(dialects: Sequence[tuple[str, str, str, str]], document: Any) -> tuple[Any, Standard] | None:
    """Return the reader and the standard of the first dialect that a document has, None without any."""
    for module, is_dialect, read, standard in dialects:
        if of_exchange(module, is_dialect)(document):
            return of_exchange(module, read), of_exchange(module, standard)
    return None


def read_xml(
    text: str, source: str, *, stem: str, max_speed_kn: float, layers: Sequence[str], skip_invalid: bool
) -> Contents:
    """Return the contents of an XML document; raises InvalidInput for a format that is not known."""
    root = parsed(text)
    found: tuple[ReadXml, Standard] | None = next((row[1:] for row in _XML if row[0](root)), None)
    found = found or _of_exchange(_XML_OF_EXCHANGE, root)
    if found is not None:
        read, standard = found
        contents = read(root, source, stem=stem, max_speed_kn=max_speed_kn, layers=layers, skip_invalid=skip_invalid)
        contents.remarks = [*contents.remarks, *standard.remarks(source, standard.of_xml(root))]
        return contents
    of = f"its root is {root.name!r:.60}, of the namespace {root.namespace!r:.100}"
    raise InvalidInput("file", "", f"is XML of a format that is not read: {of}; read are {', '.join(_NAMES)}")
