"""Tables and reports, printed as text or HTML, or exported to pandas."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .digits import choose_units, show

LEFT_ALIGNED = 'style="text-align: left"'
SPACE = "  "  # between printed columns
PAGE = 80  # columns of a terminal, at which printed sentences are wrapped
PRINTED = 104  # characters that A4 takes at 7 points
CAPTION = 'style="text-align: left; caption-side: top"'
# Columns that say how sure the one before them is: they stay beside it.
BESIDE = {"+-", "its +-", "2.5 %", "97.5 %", "sd", "c.o.v. %", "error %", "MAC 5 %"}
# A format specification for a column, or what is printed in each of its rows.
Format: TypeAlias = str | Sequence[str]
# Title, format and the cells.
Column: TypeAlias = tuple[str, Format, Iterable[object]]


@dataclass(frozen=True, repr=False)
class Table:
    """A table that prints itself; missing cells are NaN or an empty string.

    Attributes:
        title: One line.
        columns: Column titles.
        formats: One per column: a format specification, such as ``".4g"``, or what is
            printed in each row, where the digits differ from row to row.
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
    formats: tuple[Format, ...]
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
        columns = dict.fromkeys(c for table in tables.values() for c in table.columns)
        printed, rows = list[tuple[str, ...]](), list[tuple[object, ...]]()
        for label, table in tables.items():
            for shown, row in zip(
                zip(*table._print_cells(), strict=True), table.rows, strict=True
            ):
                for all_rows, cells in ((printed, shown), (rows, row)):
                    named = f"{label}, {cells[0]}", *cells[1:]
                    known = dict(zip(table.columns, named, strict=True))
                    all_rows.append(tuple(known.get(column, "") for column in columns))
        return cls(
            title, tuple(columns), tuple(zip(*printed, strict=True)), tuple(rows)
        )

    def column(self, title: str) -> list[Any]:
        """Return the values of a column by its title."""
        return [row[self.columns.index(title)] for row in self.rows]

    def __str__(self) -> str:
        """Return aligned text; the columns of a wide table are printed in blocks."""
        text = [_wrap(self.title)]
        for rows, (first, *widths) in self._blocks(PAGE):
            lines = [
                SPACE.join([label.ljust(first), *map(str.rjust, cells, widths)])
                for label, *cells in rows
            ]
            rule = "-" * len(lines[0])
            lines = [line.rstrip() for line in lines]
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

    def _print_cells(self) -> list[list[str]]:
        """Return what is printed in each row, by column."""
        by_column = list(zip(*self.rows, strict=True)) or [()] * len(self.columns)
        return [
            [
                "" if x != x else x if isinstance(x, str) else format(x, spec)  # NaN
                for x in column
            ]
            if isinstance(spec, str)
            else list(spec)
            for column, spec in zip(by_column, self.formats, strict=True)
        ]

    def _blocks(self, most: int) -> Iterator[tuple[list[list[str]], list[int]]]:
        """Yield titles and cells, row by row, of columns of at most so many characters.

        Each block begins with the names of the rows, and keeps a number beside its
        error. The widths of its columns stand beside it.
        """
        printed = zip(self.columns, self._print_cells(), strict=True)
        columns = [[title, *cells] for title, cells in printed]
        widths = [max(map(len, column)) for column in columns]
        groups: list[list[int]] = []
        for number, title in enumerate(self.columns[1:], 1):
            if groups and title.strip() in BESIDE:
                groups[-1].append(number)
            else:
                groups.append([number])
        blocks = [[0]]
        for group in groups:
            fits = _width(widths, [0, *group]) <= most
            for part in [group] if fits else [[number] for number in group]:
                if _width(widths, [*blocks[-1], *part]) > most and len(blocks[-1]) > 1:
                    blocks.append([0])
                blocks[-1] += part
        for block in blocks:
            rows = zip(*(columns[i] for i in block), strict=True)
            yield [[*row] for row in rows], [widths[i] for i in block]


def _width(widths: Sequence[int], columns: Sequence[int]) -> int:
    """Return how wide some columns are beside each other."""
    return sum(widths[i] + len(SPACE) for i in columns) - len(SPACE)


def unit_column(units: Iterable[str], shown: Sequence[str] = ()) -> list[Column]:
    """Return the column of the parameters' units, none where no parameter has one."""
    cells = list(units)
    return [("unit", shown or "", cells)] if any(cells) else []


def number_columns(
    units: Iterable[str],
    columns: Sequence[tuple[str, ArrayLike, ArrayLike]],
    prefixes: bool = True,
) -> tuple[list[Column], list[Column]]:
    """Return the column of units, and those of numbers to two digits of uncertainty.

    A unit is printed with the SI prefix that suits the largest number of its row. The
    cells keep their own unit.

    Args:
        units: One for each row.
        columns: A title, numbers ``(m,)`` and their standard deviations, for each.
        prefixes: Whether a unit may be printed with another prefix than its own.
    """
    units = list(units)
    values = np.array([np.broadcast_to(x, len(units)) for _, x, _ in columns], float)
    sizes = np.where(np.isfinite(values), np.abs(values), 0.0).max(axis=0)
    chosen = choose_units(units, sizes.tolist())
    if not prefixes:
        chosen = [(unit, 1.0) for unit in units]
    factors = np.array([factor for _, factor in chosen])
    numbers: list[Column] = [
        (title, show(row / factors, np.asarray(sd) / factors), row)
        for row, (title, _, sd) in zip(values, columns, strict=True)
    ]
    return unit_column(units, [unit for unit, _ in chosen]), numbers


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
