"""Progress bars: of tqdm, of a notebook, or lines where there is neither."""

import os
import sys
import time
from importlib import import_module
from importlib.util import find_spec
from threading import RLock

from emcee.pbar import get_progress_bar

from .. import checks
from .evaluator import Bar


def check_progress(progress: bool | str | None) -> bool | str:
    """Return True, False, or "notebook" if ipywidgets can show that bar.

    None: whether there is a terminal or a notebook, unless tqdm's own variable
    TQDM_DISABLE is set.
    """
    if progress is None:
        disabled = os.environ.get("TQDM_DISABLE", "").lower() not in ("", "0", "false")
        return not disabled and (
            _in_notebook() or (_on_terminal() and find_spec("tqdm") is not None)
        )
    if progress != "notebook":
        return checks.flag("progress", progress)
    if find_spec("ipywidgets") is None:
        raise ImportError(
            "progress: 'notebook' needs ipywidgets: pip install ipywidgets tqdm; or "
            "take progress=True, which does not"
        )
    return progress


def progress_bar(progress: bool | str, total: int, text: str) -> Bar:
    """Return a progress bar with emcee's interface, as requested."""
    if progress is True and not _on_terminal():
        if not _in_notebook() or find_spec("ipywidgets") is None:
            return _Lines(total, text)
        progress = "notebook"
    if progress and find_spec("tqdm") is not None:
        # tqdm's own lock, of processes, would settle how processes are started.
        bars = import_module("tqdm").tqdm
        if not hasattr(bars, "_lock"):
            bars.set_lock(RLock())
    return get_progress_bar(progress, total, desc=text)


def caption(bar: Bar, text: str) -> None:
    """Write the state of a run beside its bar; emcee's empty bar cannot show it."""
    if show := getattr(bar, "set_description", None):
        show(text)


def complete(bar: Bar) -> None:
    """End a bar that is not full at its present value."""
    if total := getattr(bar, "n", None):  # of tqdm
        bar.total = total
        bar.refresh()


def _on_terminal() -> bool:
    return sys.stderr is not None and sys.stderr.isatty()


def _in_notebook() -> bool:
    return type(sys.stderr).__module__.startswith("ipykernel")


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
        """Count, and print a line at each tenth."""
        tenth = 10 * self.count // self.total
        self.count += count
        if 10 * self.count // self.total > tenth:
            done = f"{100 * self.count // self.total}% {self.count}/{self.total}"
            seconds = time.perf_counter() - self.started
            print(f"{self.text}: {done}, {seconds:.0f} s", file=sys.stderr)

    def set_description(self, text: str) -> None:
        """Print how far a run is."""
        seconds = time.perf_counter() - self.started
        print(f"{text}: {self.count:,} solves, {seconds:.0f} s", file=sys.stderr)
