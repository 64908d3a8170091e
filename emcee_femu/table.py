"""Tables and reports, printed as text or HTML, or exported to pandas."""

import html
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Self, TypeAlias

import numpy as np

LEFT_ALIGNED = 'style="text-align: left"'
SPACE = "  "  # between printed columns
PAGE = 80  # columns of a terminal, at which printed sentences are wrapped
CAPTION = 'style="text-align: left; caption-side: top"'
# Title, format specification, and the cells.
Column: TypeAlias = tuple[str, str, Iterable[object]]


@dataclass(frozen=True, repr=False)
class Table:
    """A table that prints itself; missing cells are NaN or an empty string.

    Attributes:
        title: One line.
        columns: Column titles.
        formats: One format specification per column, such as ``".4g"``.
        rows: Numbers or strings.

    Examples:
        >>> from emcee_femu.table import Table
        >>> columns = [("mode", "d", [1]), ("f", ".2f", [3.128])]
        >>> print(Table.from_columns("Modes", columns))
        Modes
        ----------
        mode     f
        ----------
        1     3.13
        ----------
    """

    title: str
    columns: tuple[str, ...]
    formats: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]

    @classmethod
    def from_columns(cls, title: str, columns: Sequence[Column]) -> Self:
        """Return the table of ``(column title, format, list or array)`` triples.

        Args:
            title: One line.
            columns: A ``(column title, format, list or array)`` triple for each column;
                all have the same length.

        Returns:
            The table.

        Raises:
            ValueError: If columns differ in length.

        Examples:
            >>> from emcee_femu.table import Table
            >>> columns = [("mode", "d", [1]), ("f", ".2f", [3.128])]
            >>> table = Table.from_columns("Modes", columns)
            >>> table.rows
            ((1, 3.128),)
        """
        titles, formats, values = zip(*columns, strict=True)
        cells = [v.tolist() if isinstance(v, np.ndarray) else v for v in values]
        return cls(title, titles, formats, tuple(zip(*cells, strict=True)))

    def column(self, title: str) -> list[Any]:
        """Return the values of a column by its title."""
        return [row[self.columns.index(title)] for row in self.rows]

    def __str__(self) -> str:
        """Return aligned text; the columns of a wide table are printed in blocks."""
        cells, widths = [self.columns, *self._cells()], self._widths()
        blocks = [[0]]
        for number, width in enumerate(widths[1:], 1):
            if sum(widths[i] + len(SPACE) for i in blocks[-1]) + width > PAGE:
                blocks.append([0])  # each begins with the names of the rows
            blocks[-1].append(number)
        text = [self.title]
        for block in blocks:
            lines = [
                SPACE.join(
                    row[i].rjust(widths[i]) if i else row[i].ljust(widths[i])
                    for i in block
                )
                for row in cells
            ]
            rule = "-" * len(lines[0])
            text += [rule, lines[0], rule, *lines[1:], rule]
        return "\n".join(text)

    __repr__ = __str__  # at a prompt, too

    @property
    def width(self) -> int:
        """Number of characters in a line with all columns."""
        widths = self._widths()
        return sum(widths) + len(SPACE) * (len(widths) - 1)

    def to_frame(self) -> Any:
        """Return a ``pandas.DataFrame`` at full precision.

        Use it to export a table: ``to_csv``, ``to_latex``, ``to_markdown``.
        """
        import pandas

        return pandas.DataFrame(list(self.rows), columns=list(self.columns))

    def _repr_html_(self) -> str:
        """Return the table as HTML for notebooks, in the colours of their theme."""
        titles = "</th><th>".join(map(html.escape, self.columns))
        rows = ["</td><td>".join(map(html.escape, row)) for row in self._cells()]
        return "\n".join(
            [
                '<table class="dataframe" style="text-align: right">',
                f"<caption {CAPTION}>{html.escape(self.title)}</caption>",
                f"<thead><tr><th {LEFT_ALIGNED}>{titles}</th></tr></thead>",
                "<tbody>",
                *(f"<tr><td {LEFT_ALIGNED}>{row}</td></tr>" for row in rows),
                "</tbody></table>",
            ]
        )

    def _cells(self) -> list[tuple[str, ...]]:
        return [
            tuple(
                "" if x != x else x if isinstance(x, str) else format(x, spec)  # NaN
                for x, spec in zip(row, self.formats, strict=True)
            )
            for row in self.rows
        ]

    def _widths(self) -> list[int]:
        cells = [self.columns, *self._cells()]
        return [max(map(len, column)) for column in zip(*cells, strict=True)]


def unit_column(units: Iterable[str]) -> list[Column]:
    """Return the column of the parameters' units, none where no parameter has one."""
    cells = list(units)
    return [("unit", "", cells)] if any(cells) else []


Parts: TypeAlias = Iterable[Table | str]


class Report:
    """A result that prints tables and sentences, as text and in notebooks."""

    def _parts(self) -> Parts:
        """Return tables and sentences, in the order in which they are shown."""
        raise NotImplementedError

    @property
    def width(self) -> int:
        """Characters of the widest table's lines; 1 without a table."""
        tables = [part for part in self._parts() if isinstance(part, Table)]
        return max((table.width for table in tables), default=1)

    def __str__(self) -> str:
        """Return the tables and the sentences, one below the other."""
        return "\n".join(
            str(part) if isinstance(part, Table) else _wrap(part)
            for part in self._parts()
        )

    def __repr__(self) -> str:
        """Return the same text at a prompt."""
        return str(self)

    def _repr_html_(self) -> str:
        """Return the same as HTML for notebooks."""
        return "\n".join(
            part._repr_html_() if isinstance(part, Table) else _paragraphs(part)
            for part in self._parts()
        )


def _wrap(text: str) -> str:
    # A path or a name is never broken: it could not be copied.
    wrapper = textwrap.TextWrapper(
        PAGE, subsequent_indent=SPACE, break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(map(wrapper.fill, text.splitlines()))


def _paragraphs(text: str) -> str:
    return "\n".join(f"<p>{html.escape(line)}</p>" for line in text.splitlines())
