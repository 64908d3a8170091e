"""The paper's figures and more, for any chain; each function returns a Figure.

Only these modules use matplotlib and corner, which take seconds to import: the package
imports them when they are first asked for. pyplot holds the figures, so that
``plt.show()`` shows them; a script that draws many closes each with
``plt.close(figure)``, a notebook need not.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .mac import plot_mac as plot_mac
from .mode_shapes import plot_shapes as plot_shapes
from .parameters import plot_correlation as plot_correlation
from .parameters import plot_prior_posterior as plot_prior_posterior
from .parameters import plot_scatter as plot_scatter
from .predictive import plot_predictive as plot_predictive
from .predictive import plot_tae as plot_tae

if TYPE_CHECKING:
    from ..extensions.comparison.figure import plot_comparison as plot_comparison
    from ..extensions.comparison.figure import (
        plot_model_comparison as plot_model_comparison,
    )
    from ..extensions.population.figure import plot_population as plot_population

FIGURES_LATER = {  # figures of extensions, and where they are
    "plot_comparison": "comparison",
    "plot_model_comparison": "comparison",
    "plot_population": "population",
}


def __getattr__(name: str) -> Any:
    """Import the figure of an extension when it is first asked for."""
    if name not in FIGURES_LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    where = f"..extensions.{FIGURES_LATER[name]}.figure"
    return getattr(import_module(where, __name__), name)


def __dir__() -> list[str]:
    """Return the public names, for completion also those of extensions."""
    return [n for n in (*globals(), *FIGURES_LATER) if n.startswith(("plot_", "__"))]
