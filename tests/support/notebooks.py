"""Notebooks made of cells, executed headless, and what their cells show."""

import os
from types import SimpleNamespace

import nbformat
from nbclient import NotebookClient


def execute(cells, folder, **environment):
    """Return what each cell shows, after a new kernel has run them one by one."""
    notebook = nbformat.v4.new_notebook()
    notebook.cells = [nbformat.v4.new_code_cell(cell) for cell in cells]
    env = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    client = NotebookClient(
        notebook, timeout=120, resources={"metadata": {"path": str(folder)}}
    )
    client.execute(env={**env, **environment})
    return [show(cell.outputs) for cell in notebook.cells]


def show(outputs):
    """Return the texts of a cell's streams, and its other outputs by MIME type."""
    text = {"stdout": "", "stderr": ""}
    data = [dict(one.data) for one in outputs if "data" in one]
    for one in outputs:
        if one.output_type == "stream":
            text[one.name] += one.text
    return SimpleNamespace(
        **text,
        pictures=sum("image/png" in one for one in data),
        pages=[one["text/html"] for one in data if "text/html" in one],
        plain=[one["text/plain"] for one in data if "text/plain" in one],
    )
