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
    assert max(map(len, lines)) == len(lines[0])
    assert all(line == line.rstrip() for line in lines)
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


def test_a_number_is_never_parted_from_its_error():
    pairs = [("mean", ".4f", [1.5]), ("+-", ".4f", [0.5]), ("ESS", "d", [900])]
    for width in range(1, 40):  # of the first column, which shifts all others
        table = Table.from_columns("Errors", [("n" * width, "", [""]), *5 * pairs])
        lines = [x for x in str(table).splitlines()[1:] if "mean" in x or "ESS" in x]
        titles = [line.split()[1:] for line in lines]
        assert [t for row in titles for t in row] == 5 * ["mean", "+-", "ESS"]
        assert all(row.count("mean") == row.count("+-") for row in titles)
        assert max(map(len, str(table).splitlines())) <= 80


def test_a_long_title_is_wrapped_and_a_table_without_rows_has_its_titles():
    table = Table.from_columns("of words " * 20, [("mode", "d", []), ("f", ".2f", [])])
    *title, rule, columns, _, _ = str(table).splitlines()
    assert " ".join(" ".join(title).split()) == table.title.strip()
    assert max(map(len, title)) <= 80
    assert columns == "mode  f" and rule == "-------"
