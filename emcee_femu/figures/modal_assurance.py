"""How alike the measured and the model's mode shapes are, before and after updating."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from .. import checks
from ..contracts import Floats
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import prior_centre
from ..results.arviz_objects import dataset, samples
from ..results.shapes import PairedShapes, choose_experiment, solve_shapes
from ..results.tables import summarize
from ..results.to_arviz import read_samples
from .style import RED, Style, finish, subplots

FEW_MODES = 3  # modes of the model up to which the two panels are beside each other
ROW, COLUMN = 0.42, 0.66  # inches of a measured mode, and at least of the model's


def plot_mac(
    idata: object, posterior: LogPosterior | None = None, experiment: str | None = None
) -> Figure:
    """Draw the MAC of measured and model modes, before and after updating.

    Before is the model at the prior mean, left out where it cannot be solved; after, at
    the posterior mean: two solves. Columns are those of the model's modes among which
    pairs were sought; a red frame is a pair. Below its number stands the 95 % interval
    of the pair's MAC over the samples.

    Args:
        idata: What :func:`run` or :func:`to_inference_data` returns.
        posterior: The sampled posterior, with a :class:`PairedModel`; known of a run.
        experiment: Name of one experiment of a joint posterior.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If posterior is not a LogPosterior, or needed.
        ValueError: If its model pairs no modes, it has other parameters, or there is no
            such experiment.

    Examples:
        >>> import emcee_femu as ef
        >>> springs = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
        >>> model = ef.MassSpringModel([1.0, 1.0], springs, shapes=True)
        >>> test = ef.Measurements([0.27, 0.66], shapes=[[1.0, 1.9], [1.6, -1.0]])
        >>> term = ef.FrequencyTerm(test, relative_sd=0.01)
        >>> bounds = [(5.0, 15.0), (2.0, 8.0)]
        >>> prior = ef.GaussianPrior(["k1", "k2"], [10.0, 5.0], 1.0, bounds)
        >>> paired = ef.PairedModel(model, test, candidates=2)
        >>> posterior = ef.LogPosterior(paired, term, prior)
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 50, ensembles=1, seed=1)
        >>> [axes.get_title() for axes in ef.figures.plot_mac(run).axes[:2]]
        ['before: at the prior mean', 'after: at the posterior mean']
    """
    idata, posterior = read_samples(idata, posterior)
    posterior = checks.instance("posterior", posterior, LogPosterior)
    test = choose_experiment(posterior, experiment)
    means = {"after: at the posterior mean": samples(idata)[1].mean(axis=(0, 1))}
    if np.isfinite(posterior.initial).all():
        means = {"before: at the prior mean": prior_centre(posterior.prior)} | means
    solved: dict[str, PairedShapes] = {}
    for title, theta in means.items():
        modes = solve_shapes(posterior, test, theta)
        if not isinstance(modes, PairedShapes):
            raise ValueError(
                "posterior: its model pairs no modes; wrap the model in a PairedModel"
            )
        solved[title] = after = modes
    mac = dataset(idata, "response")[test.full_name("mac")].values
    ends = summarize(mac.reshape(-1, mac.shape[-1]))[1:]
    m, q = after.mac.shape
    across = len(solved) if q <= FEW_MODES else 1
    down = len(solved) // across
    size = max(7.0, 1.8 + COLUMN * q), 0.3 + down * (1.1 + ROW * m)
    figure, panels = subplots(len(solved), across, size)
    for axes, (title, modes) in zip(panels, solved.items(), strict=True):
        _draw_matrix(axes, modes, ends if modes is after else None)
        axes.set_title(title, fontsize=10)
    figure.colorbar(axes.images[0], ax=panels, label="MAC (1: same shape)")
    return finish(figure, idata)


def _draw_matrix(axes: Axes, modes: PairedShapes, ends: Floats | None) -> None:
    """Draw a matrix with its numbers, and the intervals of pairs if there are some."""
    m, q = modes.mac.shape
    axes.imshow(modes.mac, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), value in np.ndenumerate(modes.mac):
        text, size = _short(value), 7.0
        if modes.chosen[i] == j:
            style: Style = {"fill": False, "ec": RED, "lw": 1.6}
            axes.add_patch(Rectangle((j - 0.47, i - 0.45), 0.94, 0.9, **style))
            if ends is not None:
                size = 6.5
                text += "\n" + "–".join(_short(end, 3) for end in ends[:, i])
        color = "white" if value > 0.6 else "black"
        axes.text(j, i, text, ha="center", va="center", color=color, fontsize=size)
    by_model = [f"{k}\n{f:.4g} Hz" for k, f in enumerate(modes.frequencies[:q], 1)]
    by_test = [f"{k}: {f:.4g} Hz" for k, f in enumerate(modes.hertz, 1)]
    axes.set_xticks(range(q), by_model)
    axes.set_yticks(range(m), by_test)
    axes.set(xlabel="the model's modes", ylabel="measured modes")
    axes.tick_params(labelsize=8, length=0)


def _short(value: float, digits: int = 2) -> str:
    """Return a MAC as 1.00 or .98."""
    return f"{value:.{digits}f}".removeprefix("0")
