"""Parse XML of unknown origin into a tree of elements.

The parser is the Expat of Python's standard library. It opens no file and no address. Documents with a document type,
the only place where entities can be declared, are refused: no format here has one. Depth and the number of elements
and attributes are limited.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final
from xml.parsers import expat

from conflictdb.errors import InvalidInput

MAX_DEPTH: Final = 100
# Elements and attributes of a file: 64 MB of honest files have fewer, and each takes some 300 bytes.
MAX_NODES: Final = 3_000_000
_NOT_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_BETWEEN: Final = "\n"  # of namespace and name; no namespace may contain it


@dataclass(slots=True)
class Element:
    """An element of XML.

    name : without its prefix
    namespace : its address, empty for none
    line : in the file, from 1
    attributes : by their names without prefixes
    text : all text before the first child, stripped
    """

    name: str
    namespace: str
    line: int
    attributes: dict[str, str]
    children: "list[Element]" = field(default_factory=list)
    text: str = ""

    def each(self, name: str) -> "Iterator[Element]":
        """Yield the children of a name, in any namespace."""
        return (child for child in self.children if child.name == name)

    def child(self, *path: str) -> "Element | None":
        """Return the first child of a name, its first child of the next name, and so on; None without one."""
        found: Element | None = self
        for name in path:
            found = None if found is None else next(found.each(name), None)
        return found

    def value(self, *path: str) -> str | None:
        """Return the text of a descendant by its path of names; None if there is none, or it is empty."""
        found = self.child(*path)
        return None if found is None else found.text or None

    def all(self, *names: str) -> "Iterator[Element]":
        """Yield all descendants that have one of some names, in the order of the file."""
        waiting = self.children[::-1]
        while waiting:
            one = waiting.pop()
            if one.name in names:
                yield one
            waiting += one.children[::-1]

    def get(self, name: str) -> str | None:
        """Return an attribute without surrounding space, None if it is missing or empty."""
        return self.attributes.get(name, "").strip() or None


class _Tree:
    """Build elements from the events of a parser."""

    def __init__(self, parser: "expat.XMLParserType") -> None:
        self.parser = parser
        self.root: Element | None = None
        self.open: list[Element] = []
        self.texts: list[list[str]] = []
        self.nodes = 0

    def start(self, name: str, attributes: list[str]) -> None:
        self.nodes += 1 + len(attributes) // 2
        line = self.parser.CurrentLineNumber
        if self.nodes > MAX_NODES:
            raise InvalidInput("XML", f"line {line}", f"has more than {MAX_NODES:,} elements and attributes: split it")
        if len(self.open) >= MAX_DEPTH:
            raise InvalidInput("XML", f"line {line}", f"is nested more than {MAX_DEPTH} deep")
        namespace, _, local = name.rpartition(_BETWEEN)
        named = {key.rpartition(_BETWEEN)[2]: one for key, one in zip(attributes[::2], attributes[1::2], strict=True)}
        element = Element(local, namespace, line, named)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)
        self.texts.append([])

    def end(self, _: str) -> None:
        self.open.pop().text = "".join(self.texts.pop()).strip()

    def characters(self, text: str) -> None:
        if not self.open[-1].children:
            self.texts[-1].append(text)

    def doctype(self, *_: object) -> None:
        line = self.parser.CurrentLineNumber
        raise InvalidInput("XML", f"line {line}", "declares a document type, which may hide entities: remove it")


def parsed(text: str) -> Element:
    """Return the root of an XML text; raises InvalidInput, with the line."""
    parser = expat.ParserCreate("utf-8", _BETWEEN)
    parser.ordered_attributes = True
    parser.buffer_text = True
    parser.SetParamEntityParsing(expat.XML_PARAM_ENTITY_PARSING_NEVER)
    tree = _Tree(parser)
    parser.StartElementHandler = tree.start
    parser.EndElementHandler = tree.end
    parser.CharacterDataHandler = tree.characters
    parser.StartDoctypeDeclHandler = tree.doctype
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        raise InvalidInput("XML", f"line {error.lineno}", expat.ErrorString(error.code)) from None
    except UnicodeEncodeError:
        raise InvalidInput("XML", "", "holds characters that are no text") from None
    assert tree.root is not None  # noqa: S101
    return tree.root


def writable(who: str, field: str, text: str) -> str:
    """Return a text unchanged; raises InvalidInput if it has characters that XML cannot hold."""
    found = _NOT_XML.search(text)
    if found is not None:
        raise InvalidInput(who, field, f"holds {found[0]!r}, a character that XML cannot hold: remove it, then export")
    return text


def written(name: str, attributes: Mapping[str, object] | None = None, *inside: str, text: str | None = None) -> str:
    """Return an element as XML.

    attributes : None leaves one out
    inside : its children, as XML
    """
    from xml.sax.saxutils import escape, quoteattr  # they import urllib and ssl, a quarter of the time of all imports

    given = {key: one for key, one in (attributes or {}).items() if one is not None}
    start = "".join([name, *(f" {key}={quoteattr(str(one))}" for key, one in given.items())])
    # A parser reads a bare carriage return as a line feed.
    content = escape(text, {"\r": "&#13;"}) if text is not None else "".join(inside)
    return f"<{start}>{content}</{name}>" if content else f"<{start}/>"
