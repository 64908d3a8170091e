"""One table as text, HTML and a frame: each shows the same cells."""

import html
import re

import numpy as np

import emcee_femu as ef

Table = ef.table.Table

MIXED = Table.from_columns(
    "Of all <kinds> & more",
    [
        ("parameter", "", ["k_1", "x|y & 100 %", "<E>"]),
        ("mean", ".3f", np.array([-1234.5678, np.nan, 2e-9])),
        ("mean", ".2g", [1 / 3, 2, np.nan]),  # a title may occur twice
        ("wrong", "", ["yes", "", "no"]),
    ],
)
SHOWN = [
    ["k_1", "-1234.568", "0.33", "yes"],
    ["x|y & 100 %", "", "2", ""],
    ["<E>", "0.000", "", "no"],
]


def test_text_is_aligned_and_shows_every_cell():
    title, *lines = str(MIXED).splitlines()
    assert title == MIXED.title
    assert len({len(line) for line in lines}) == 1
    assert lines[0] == lines[2] == lines[-1] == "-" * len(lines[0])
    for line, cells in zip(lines[3:-1], SHOWN, strict=True):
        assert line.split() == " ".join(cells).split()
    for before, title in zip(MIXED.columns, MIXED.columns[1:], strict=False):
        end = lines[1].index(title, lines[1].index(before) + len(before)) + len(title)
        assert {line[end : end + 2].strip() for line in lines[3:-1]} == {""}


def test_html_is_escaped_and_has_the_same_cells():
    text = MIXED._repr_html_()
    caption = re.findall("<caption.*>(.*)</caption>", text)
    assert caption == [html.escape(MIXED.title)]
    lines = [line for line in text.splitlines() if "<tr>" in line]
    cells = [re.findall("<t[hd](?: .*?)?>(.*?)</t[hd]>", line) for line in lines]
    rows = [[*map(html.unescape, row)] for row in cells]
    assert rows == [[*MIXED.columns], *SHOWN]
    assert "<E>" not in text and "<kinds>" not in text


def test_html_of_a_report_has_tables_and_escaped_sentences():
    class Found(ef.table.Report):
        def _parts(self):
            return MIXED, "a < b\nc"

    assert str(Found()) == f"{MIXED}\na < b\nc"
    assert Found()._repr_html_() == f"{MIXED._repr_html_()}\n<p>a &lt; b</p>\n<p>c</p>"


def test_a_prompt_shows_what_print_shows():
    posterior = ef.paper.mass_spring().posterior
    for shown in (MIXED, posterior, ef.find_map(posterior, 1, seed=1, check=0)):
        assert repr(shown) == str(shown)


def test_a_frame_keeps_every_digit():
    frame = MIXED.to_frame()
    assert tuple(frame.columns) == MIXED.columns
    for cells, framed in zip(MIXED.rows, frame.itertuples(index=False), strict=True):
        for cell, value in zip(cells, framed, strict=True):
            assert cell == value or (np.isnan(cell) and np.isnan(value))


def test_a_wide_table_is_printed_in_blocks_with_the_names_of_the_rows():
    columns = [(f"quantity {i}", ".3f", [i + 0.125, i + 0.25]) for i in range(12)]
    table = Table.from_columns("Wide", [("name", "", ["first", "second"]), *columns])
    title, *lines = str(table).splitlines()
    assert title == "Wide" and max(map(len, lines)) <= 80
    cells = [line.split() for line in lines if not line.startswith("-")]
    for name, shift in (("first", 0.125), ("second", 0.25)):
        values = [cell for row in cells if row[0] == name for cell in row[1:]]
        assert values == [f"{i + shift:.3f}" for i in range(12)]
        rows = re.findall(rf"<tr><td [^>]*>{name}</td>(.*?)</tr>", table._repr_html_())
        assert len(rows) > 1
        assert re.findall("<td>(.*?)</td>", "".join(rows)) == values
