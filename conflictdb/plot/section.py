"""What a report is made of, whatever it is written as."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from conflictdb.plot.style import styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI: Final = 170


@dataclass(frozen=True, slots=True)
class Section:
    """A heading with text, a table and figures below it; the warning stands out."""

    heading: str
    text: str = ""
    header: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    figures: Sequence[tuple[str, "Figure"]] = ()


def drawn(figure: "Figure", form: str) -> bytes:
    """Return the file of a figure: svg or png."""
    file = io.BytesIO()
    # The PDF unpacks pictures and compresses them itself.
    more = {"metadata": {"Date": None}} if form == "svg" else {"pil_kwargs": {"compress_level": 1}}
    with styled():
        figure.savefig(file, format=form, dpi=_DPI, facecolor="white", **more)
    return file.getvalue()
