"""How far a computation is: a bar on a terminal, a line at each tenth elsewhere."""

import sys
import time
from importlib.util import find_spec
from typing import Any

from emcee.pbar import get_progress_bar

from .. import checks


def check_progress(progress: bool | str | None) -> bool | str:
    """Return True, False, or "notebook" where there is what shows that bar.

    None is for whether a terminal would show one.
    """
    if progress is None:
        return _on_terminal() and find_spec("tqdm") is not None
    if progress != "notebook":
        return checks.flag("progress", progress)
    if find_spec("ipywidgets") is None:
        raise ImportError(
            "progress: 'notebook' needs ipywidgets: pip install "
            "'emcee-femu[notebooks]'; or take progress=True, which needs none"
        )
    return progress


def progress_bar(progress: bool | str, total: int, text: str) -> Any:
    """Return what shows progress as is asked for, with emcee's interface of bars."""
    if progress is True and not _on_terminal():
        in_notebook = type(sys.stderr).__module__.startswith("ipykernel")
        if not (in_notebook and find_spec("ipywidgets")):
            return _Lines(total, text)
        progress = "notebook"
    return get_progress_bar(progress, total, desc=text)


def _on_terminal() -> bool:
    return sys.stderr is not None and sys.stderr.isatty()


class _Lines:
    """A line at each tenth of the total, for a file, a pipe or a log."""

    def __init__(self, total: int, text: str) -> None:
        self.total, self.text, self.count = max(total, 1), text, 0
        self.started = time.perf_counter()

    def __enter__(self) -> "_Lines":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def update(self, count: int) -> None:
        """Count on; print a line where the next tenth is reached."""
        tenth = 10 * self.count // self.total
        self.count += count
        if 10 * self.count // self.total > tenth:
            done = f"{100 * self.count // self.total}% {self.count}/{self.total}"
            seconds = time.perf_counter() - self.started
            print(f"{self.text}: {done}, {seconds:.0f} s", file=sys.stderr)
