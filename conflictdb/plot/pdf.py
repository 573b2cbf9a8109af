"""A report as PDF, by fpdf2."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from unicodedata import bidirectional

from conflictdb.errors import ConflictDBError
from conflictdb.plot.section import Section, drawn
from conflictdb.plot.style import styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Millimetres of a page: room for a heading with its text; for a heading above a figure, or with the first rows of a
# table; for the page number; and around the text of a cell.
_HEADING_MM: Final = 24.0
_FIGURE_HEADING_MM: Final = 20.0
_TABLE_HEADING_MM: Final = 45.0
_NUMBER_MM: Final = 20.0
_PADDING_MM: Final = 2.5


def document(title: str, made: str, warning: str, sections: Sequence[Section]) -> bytes:
    """Return the file; raises ConflictDBError where there is no fpdf2."""
    try:
        from fpdf import FPDF
    except ImportError:
        raise ConflictDBError("fpdf2 is not installed: it makes PDF of reports; install conflictdb[plot]") from None

    class Page(FPDF):
        def footer(self) -> None:
            self.set_y(-12)
            self.set_font(size=7)
            self.set_text_color(91, 102, 112)
            said = f"{title}  ·  {made}"
            while self.get_string_width(_in_font(self, said)) > self.epw - _NUMBER_MM:
                said = said[:-2].rstrip() + "…"
            self.cell(0, 5, _in_font(self, said))
            self.set_y(-12)
            self.cell(0, 5, f"{self.page_no()} / {{nb}}", align="R")

    pdf = Page(format="A4")
    pdf.set_title(title)
    pdf.set_margins(16, 16)
    pdf.set_auto_page_break(auto=True, margin=18)
    with styled() as mpl:
        fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
    # It has the characters of most European languages; others are written as numbers (HTML has them all).
    pdf.add_font("DejaVu", "", fonts / "DejaVuSans.ttf")
    pdf.add_font("DejaVu", "B", fonts / "DejaVuSans-Bold.ttf")
    pdf.set_font("DejaVu", size=9)
    pdf.add_page()
    _paragraph(pdf, title, 15, bold=True)
    _paragraph(pdf, made, 8)
    if warning:
        pdf.set_text_color(190, 70, 0)
        _paragraph(pdf, warning, 10, bold=True)
        pdf.set_text_color(0, 0, 0)
    for section in sections:
        _add(pdf, section)
    return bytes(pdf.output())


def _add(pdf: Any, section: Section) -> None:
    pdf.ln(3)
    is_figure_first = bool(section.figures) and not section.rows
    below_mm = _size(pdf, section.figures[0][1])[1] + _FIGURE_HEADING_MM if is_figure_first else _TABLE_HEADING_MM
    if pdf.will_page_break(below_mm):  # no heading without its content
        pdf.add_page()
    _paragraph(pdf, section.heading, 11, bold=True)
    if section.text:
        _paragraph(pdf, section.text, 8.5)
    if section.rows:
        _table(pdf, section)
    for _, figure in section.figures:
        width, height = _size(pdf, figure)
        if pdf.will_page_break(height):
            pdf.add_page()
        pdf.image(io.BytesIO(drawn(figure, "png")), w=width)


def _table(pdf: Any, section: Section) -> None:
    pdf.set_font(style="", size=7)
    cells = [section.header, *section.rows] if section.header else section.rows
    rows = [[_in_font(pdf, cell) for cell in row] for row in cells]
    with pdf.table(
        borders_layout="HORIZONTAL_LINES",
        first_row_as_headings=bool(section.header),
        line_height=4.2,
        text_align="LEFT",
        col_widths=_widths(pdf, rows),
        padding=0.6,
    ) as table:
        for row in rows:
            table.row(row)


def _paragraph(pdf: Any, text: str, size: float, *, bold: bool = False) -> None:
    pdf.set_font(style="B" if bold else "", size=size)
    pdf.multi_cell(0, 0.55 * size, _in_font(pdf, text), align="L", new_x="LMARGIN", new_y="NEXT")
    pdf.ln(1)


def _in_font(pdf: Any, text: str) -> str:
    """Return a text with the numbers of the characters that the font has not."""
    known = pdf.current_font.cmap
    text = "".join(c if c == "\n" or ord(c) in known else f"U+{ord(c):04X} " for c in text)
    return "\n".join(map(_as_seen, text.split("\n")))


def _as_seen(line: str) -> str:
    """Return a line in the order in which it is seen, from the left."""
    if not any(bidirectional(sign) in ("R", "AL") for sign in line):
        return line
    from fpdf.bidi import BidiParagraph
    from fpdf.enums import TextDirection

    return str(BidiParagraph(line, TextDirection.LTR).get_reordered_string())


def _size(pdf: Any, figure: "Figure") -> tuple[float, float]:
    """Return width and height of a figure on a page, below its heading, millimetres."""
    across, up = figure.get_size_inches()
    width = min(pdf.epw, (pdf.eph - _HEADING_MM) * across / up)
    return width, width * up / across


def _widths(pdf: Any, rows: Sequence[Sequence[str]]) -> tuple[float, ...]:
    """Return widths of columns by their contents; the widest ones share the remaining width."""
    wanted = [
        1.1 * max(pdf.get_string_width(line) for cell in column for line in cell.split("\n")) + _PADDING_MM
        for column in zip(*rows, strict=True)
    ]
    room, most = float(pdf.epw), max(wanted)
    for nth, width in enumerate(sorted(wanted)):
        share = room / (len(wanted) - nth)
        if width > share:
            most = share
            break
        room -= width
    return tuple(min(width, most) for width in wanted)
