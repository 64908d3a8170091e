"""The MAC matrix of measured and model modes, before and after updating."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ..contracts import Floats
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import prior_centre
from ..results.arviz_objects import dataset, samples
from ..results.shapes import Pairing, choose_experiments, solve_shapes
from ..results.tables import summarize
from ..results.to_arviz import read_samples_and_model
from .style import RED, Style, add_panels, finish, show_mac, stack_parts

FEW_MODES = 3  # modes of the model up to which the two panels are beside each other
ROW = 0.4  # inches of a measured mode
LEAST_HEIGHT = 2.0  # inches, beside which the label of the colours has its place
COLUMN = 0.8  # inches of a mode of the model, at least


def plot_mac(
    idata: object, posterior: LogPosterior | None = None, experiment: str | None = None
) -> Figure:
    """Draw the MAC matrix of measured and model modes, before and after updating.

    "Before" is the model at the prior mean, left out if it cannot be solved; "after" is
    the model at the posterior mean. This takes two solves. Columns are the model modes
    among which pairs were searched; a red frame marks a pair. The 95 % interval of the
    pair's MAC over the samples stands below the number. Modes closer than ``min_gap``
    of the :class:`PairedModel` share a subspace: the MAC of a pair is with that of all
    modes named beside it, as in ".99 of 3, 4".

    Args:
        idata: The result of :func:`run` or :func:`to_inference_data`.
        posterior: The sampled posterior, with a :class:`PairedModel`, if idata is an
            ArviZ object.
        experiment: Name of one experiment of a joint posterior; None for all that pair
            modes, below each other.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If posterior is not a LogPosterior, or is missing.
        ValueError: If its model does not pair modes, it has other parameters, or there
            is no such experiment.

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
    idata, posterior = read_samples_and_model(idata, posterior)
    tests = choose_experiments(posterior, experiment, lambda test: test.paired)
    means = {"after: at the posterior mean": samples(idata)[1].mean(axis=(0, 1))}
    if np.isfinite(posterior.initial).all():
        means = {"before: at the prior mean": prior_centre(posterior.prior)} | means
    each = [_pair_at(posterior, test, means) for test in tests]
    sizes, columns = {}, []
    for test, solved in zip(tests, each, strict=True):
        m, q = [pairing.mac.shape for _, pairing in solved.values()][-1]
        columns.append(len(solved) if q <= FEW_MODES else 1)
        down = len(solved) // columns[-1]
        height = max(LEAST_HEIGHT, 0.3 + down * (1.0 + ROW * m))
        width = 1.0 + columns[-1] * (1.0 + COLUMN * q)
        sizes[test.name] = max(7.0, width), height
    figure, parts = stack_parts(sizes)
    for test, solved, part, across in zip(tests, each, parts, columns, strict=True):
        mac = dataset(idata, "response")[test.full_name("mac")].values
        ends = summarize(mac.reshape(-1, mac.shape[-1]))[1:]
        panels = add_panels(part, len(solved), across)
        for axes, (title, drawn) in zip(panels, solved.items(), strict=True):
            _draw_matrix(axes, *drawn, ends if axes is panels[-1] else None)
            axes.set_title(title, fontsize=10)
        part.colorbar(axes.images[0], ax=panels, label="MAC (1: same shape)")
    return finish(figure, idata, tests[0].name if len(tests) == 1 else "")


def _pair_at(
    posterior: LogPosterior, test: Experiment, means: Mapping[str, Floats]
) -> dict[str, tuple[Floats, Pairing]]:
    """Return frequencies and pairs of an experiment at each of some parameter sets."""
    solved = {}
    for title, theta in means.items():
        modes = solve_shapes(posterior, test, theta)
        if modes.pairing is None:
            raise ValueError(
                "posterior: its model pairs no modes; wrap the model in a PairedModel"
            )
        solved[title] = modes.frequencies, modes.pairing
    return solved


def _draw_matrix(
    axes: Axes, frequencies: Floats, pairing: Pairing, ends: Floats | None
) -> None:
    """Draw a matrix with its numbers, and the intervals of pairs if there are some."""
    m, q = pairing.mac.shape
    axes.imshow(pairing.mac, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), value in np.ndenumerate(pairing.mac):
        text, size = show_mac(value), 9.0
        if pairing.chosen[i] == j:
            modes = 1 + np.flatnonzero(pairing.combined[i])
            style: Style = {"fill": False, "ec": RED, "lw": 1.6}
            axes.add_patch(Rectangle((j - 0.47, i - 0.45), 0.94, 0.9, **style))
            if len(modes) > 1:
                text += f" of {', '.join(map(str, modes))}"
            if ends is not None:
                size = 8.0
                text += "\n" + "–".join(show_mac(end, 3) for end in ends[:, i])
        color = "white" if value > 0.6 else "black"
        axes.text(j, i, text, ha="center", va="center", color=color, fontsize=size)
    by_model = [f"{k}\n{f:.4g} Hz" for k, f in enumerate(frequencies[:q], 1)]
    by_test = [f"{k}: {f:.4g} Hz" for k, f in enumerate(pairing.hertz, 1)]
    axes.set_xticks(range(q), by_model)
    axes.set_yticks(range(m), by_test)
    axes.set(xlabel="the model's modes", ylabel="measured modes")
    axes.tick_params(labelsize=9, length=0)
