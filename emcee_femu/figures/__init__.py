"""The paper's figures and more, for any chain; each function returns a Figure.

Only these modules use matplotlib and corner, which take seconds to import: they are
imported where they are used. pyplot holds the figures, so that ``plt.show()`` shows
them; a script that draws many closes each with ``plt.close(figure)``, a notebook need
not.
"""

from .comparison import plot_comparison as plot_comparison
from .correlation import plot_correlation as plot_correlation
from .frf import plot_frf as plot_frf
from .model_classes import plot_model_comparison as plot_model_comparison
from .population import plot_population as plot_population
from .predictive import plot_predictive as plot_predictive
from .proposals import plot_proposals as plot_proposals
from .scatter import plot_scatter as plot_scatter
from .total_average_error import plot_tae as plot_tae
