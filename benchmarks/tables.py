"""Tables in Markdown, printed and put into documents, so that a document shows the last results of a benchmark."""

from collections.abc import Iterable, Sequence
from pathlib import Path


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table, one line per row."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def put_into(document: Path, name: str, text: str) -> None:
    """Replace the text between the two comments `benchmark NAME` and `end of NAME` of a document."""
    before, start, rest = document.read_text().partition(f"<!-- benchmark {name} -->\n")
    _, end, after = rest.partition(f"<!-- end of {name} -->")
    if not start or not end:
        raise ValueError(f"{document} has no place for {name}: put <!-- benchmark {name} --> and its end there")
    document.write_text(f"{before}{start}\n{text}\n\n{end}{after}")
