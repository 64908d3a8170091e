"""The paper's figures and more, for any chain; each function returns a Figure.

Only these modules use matplotlib and corner, which take seconds to import: the package
imports them when they are first asked for. pyplot holds the figures, so that
``plt.show()`` shows them; a script that draws many closes each with
``plt.close(figure)``, a notebook need not.
"""

from ..extensions.comparison.figure import plot_comparison as plot_comparison
from ..extensions.comparison.figure import (
    plot_model_comparison as plot_model_comparison,
)
from ..extensions.population.figure import plot_population as plot_population
from .modal_assurance import plot_mac as plot_mac
from .mode_shapes import plot_shapes as plot_shapes
from .parameters import plot_correlation as plot_correlation
from .parameters import plot_scatter as plot_scatter
from .predictive import plot_predictive as plot_predictive
from .prior_posterior import plot_prior_posterior as plot_prior_posterior
from .total_average_error import plot_tae as plot_tae
