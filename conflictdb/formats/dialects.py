"""Recognise the dialects of JSON and XML by their content: one row each."""

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol, TypeAlias

from conflictdb.errors import InvalidInput
from conflictdb.formats import aixm, gpx, operational_intents, rtz, s124, s421, uas_zones
from conflictdb.formats.contents import Contents
from conflictdb.formats.standards import Standard
from conflictdb.formats.xml_text import Element, parsed


class ReadJson(Protocol):
    """A reader of a JSON document."""

    def __call__(self, document: Any, source: str, *, stem: str, skip_invalid: bool) -> Contents:
        """Return the contents; raises InvalidInput."""


class ReadXml(Protocol):
    """A reader of an XML document."""

    def __call__(
        self, root: Element, source: str, *, stem: str, max_speed_kn: float, layers: Sequence[str], skip_invalid: bool
    ) -> Contents:
        """Return the contents; raises InvalidInput."""


IsDialect: TypeAlias = Callable[[Any], bool]

_JSON: Final[tuple[tuple[IsDialect, ReadJson, Standard], ...]] = (
    (uas_zones.is_ed318, uas_zones.read_ed318, uas_zones.ED318),
    (uas_zones.is_ed269, uas_zones.read_ed269, uas_zones.ED269),
    (operational_intents.is_intent, operational_intents.read_intents, operational_intents.STANDARD),
)
_XML: Final[tuple[tuple[Callable[[Element], bool], ReadXml, Standard], ...]] = (
    (rtz.is_rtz, rtz.read_rtz, rtz.STANDARD),
    (s421.is_s421, s421.read_s421, s421.STANDARD),
    (s124.is_s124, s124.read_s124, s124.STANDARD),
    (aixm.is_aixm, aixm.read_aixm, aixm.STANDARD),
    (gpx.is_gpx, gpx.read_gpx, gpx.STANDARD),
)
_NAMES: Final = ("RTZ and S-421 routes", "S-124 warnings", "AIXM 5.1 messages", "GPX")


def read_json(document: Any, source: str, *, stem: str, skip_invalid: bool) -> Contents | None:
    """Return the contents of a JSON document of another program, None for a scene file or an unknown one."""
    for is_dialect, read, standard in _JSON:
        if is_dialect(document):
            contents = read(document, source, stem=stem, skip_invalid=skip_invalid)
            contents.remarks = [*contents.remarks, *standard.remarks(source, standard.of_json(document))]
            return contents
    return None


def read_xml(
    text: str, source: str, *, stem: str, max_speed_kn: float, layers: Sequence[str], skip_invalid: bool
) -> Contents:
    """Return the contents of an XML document; raises InvalidInput for a format that is not known."""
    root = parsed(text)
    for is_dialect, read, standard in _XML:
        if is_dialect(root):
            contents = read(
                root, source, stem=stem, max_speed_kn=max_speed_kn, layers=layers, skip_invalid=skip_invalid
            )
            contents.remarks = [*contents.remarks, *standard.remarks(source, standard.of_xml(root))]
            return contents
    of = f"its root is {root.name!r:.60}, of the namespace {root.namespace!r:.100}"
    raise InvalidInput("file", "", f"is XML of a format that is not read: {of}; read are {', '.join(_NAMES)}")
