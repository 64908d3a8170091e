"""Notebooks made of cells, executed headless, and what their cells show."""

import os
from types import SimpleNamespace

import nbformat
from nbclient import NotebookClient


def execute(cells, folder, seconds=None):
    """Return what the cells show, by the names of the cells.

    Args:
        cells: ``{name: code}``, executed in this order by a new kernel.
        folder: Where the kernel works.
        seconds: ``{name: time}`` after which a cell is interrupted, as by the button.
    """
    notebook = nbformat.v4.new_notebook()
    notebook.cells = [nbformat.v4.new_code_cell(cell) for cell in cells.values()]
    stops = {cells[name]: time for name, time in (seconds or {}).items()}
    client = NotebookClient(
        notebook,
        timeout_func=lambda cell: stops.get(cell.source, 300),
        interrupt_on_timeout=True,
        allow_errors=True,
        resources={"metadata": {"path": str(folder)}},
    )
    # The kernel chooses its own backend of matplotlib.
    kept = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    client.execute(env=kept)
    return {
        name: _show(cell.outputs)
        for name, cell in zip(cells, notebook.cells, strict=True)
    }


def _show(outputs):
    """Return streams, the name and text of an error, and all else by MIME type."""
    text = {"stdout": "", "stderr": "", "error": ""}
    data = [one.data for one in outputs if "data" in one]
    for one in outputs:
        if one.output_type == "stream":
            text[one.name] += one.text
        elif one.output_type == "error":
            text["error"] += f"{one.ename}: {one.evalue}"
    return SimpleNamespace(
        **text,
        pictures=sum("image/png" in one for one in data),
        pages=[one["text/html"] for one in data if "text/html" in one],
        types=sorted(kind for one in data for kind in one),
    )


def assert_quiet(shown):
    """Check that no cell failed, or wrote a warning."""
    for name, cell in shown.items():
        assert (cell.error, cell.stderr) == ("", ""), name
