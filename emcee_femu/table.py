"""Tables and reports, printed as text or HTML, or exported to pandas."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self, TypeAlias

import numpy as np

LEFT_ALIGNED = 'style="text-align: left"'
SPACE = "  "  # between printed columns
PAGE = 80  # columns of a terminal, at which printed sentences are wrapped
PRINTED = 104  # characters that A4 takes at 7 points
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

    @classmethod
    def stack(cls, title: str, tables: Mapping[str, Table]) -> Self:
        """Return tables below each other; the labels of rows begin with their names.

        Args:
            title: One line.
            tables: By name. A column that one of them has not is empty there.

        Returns:
            The table.

        Raises:
            AttributeError: If tables is no mapping of tables.

        Examples:
            >>> from emcee_femu.table import Table
            >>> one = Table.from_columns("Modes", [("mode", "d", [1]), ("f", "g", [3])])
            >>> Table.stack("All modes", {"a": one, "b": one}).column("mode")
            ['a, 1', 'b, 1']
        """
        formats = {
            column: spec
            for table in tables.values()
            for column, spec in zip(table.columns, table.formats, strict=True)
        }
        rows = []
        for label, table in tables.items():
            for row in table.rows:
                named = f"{label}, {row[0]}", *row[1:]
                cells = dict(zip(table.columns, named, strict=True))
                rows.append(tuple(cells.get(column, "") for column in formats))
        return cls(title, tuple(formats), tuple(formats.values()), tuple(rows))

    def column(self, title: str) -> list[Any]:
        """Return the values of a column by its title."""
        return [row[self.columns.index(title)] for row in self.rows]

    def __str__(self) -> str:
        """Return aligned text; the columns of a wide table are printed in blocks."""
        text = [self.title]
        for rows, (first, *widths) in self._blocks(PAGE):
            lines = [
                SPACE.join([label.ljust(first), *map(str.rjust, cells, widths)])
                for label, *cells in rows
            ]
            rule = "-" * len(lines[0])
            text += [rule, lines[0], rule, *lines[1:], rule]
        return "\n".join(text)

    __repr__ = __str__  # at a prompt, too

    def to_frame(self) -> Any:
        """Return a ``pandas.DataFrame`` at full precision.

        Use it to export a table: ``to_csv``, ``to_latex``, ``to_markdown``.
        """
        import pandas

        return pandas.DataFrame(list(self.rows), columns=list(self.columns))

    def _repr_html_(self) -> str:
        """Return the table as notebooks show it, in the colours of their theme."""
        text: list[str] = []
        for rows, widths in self._blocks(PRINTED):
            titles, *cells = ([html.escape(cell) for cell in row] for row in rows)
            inside = ["</td><td>".join(row) for row in cells]
            size = sum(widths) + len(SPACE) * (len(widths) - 1)  # print fits it to A4
            style = f"text-align: right; --characters: {size}"
            title = f"<caption {CAPTION}>{html.escape(self.title)}</caption>"
            text += [
                f'<table class="dataframe" style="{style}">',
                "" if text else title,
                f"<thead><tr><th {LEFT_ALIGNED}>{'</th><th>'.join(titles)}</th></tr>",
                "</thead>",
                "<tbody>",
                *(f"<tr><td {LEFT_ALIGNED}>{row}</td></tr>" for row in inside),
                "</tbody></table>",
            ]
        return "\n".join(text)

    def _blocks(self, most: int) -> Iterator[tuple[list[list[str]], list[int]]]:
        """Yield titles and cells, row by row, of columns of at most so many characters.

        Each block begins with the names of the rows. The widths of its columns stand
        beside it.
        """
        cells = [list(self.columns)] + [
            [
                "" if x != x else x if isinstance(x, str) else format(x, spec)  # NaN
                for x, spec in zip(row, self.formats, strict=True)
            ]
            for row in self.rows
        ]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        blocks = [[0]]
        for number in range(1, len(widths)):
            line = [widths[i] + len(SPACE) for i in (*blocks[-1], number)]
            if sum(line) - len(SPACE) > most:
                blocks.append([0])
            blocks[-1].append(number)
        for block in blocks:
            yield [[row[i] for i in block] for row in cells], [widths[i] for i in block]


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
