"""How Metropolis-Hastings and DE-MC propose."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ..interfaces import Floats
from .style import BLUE, GREY, RED, Style, finish, subplots


def plot_proposals() -> Figure:
    """Draw how M-H and DE-MC make a proposal, on a 2-D Gaussian (Fig. 3.1).

    Returns:
        The matplotlib Figure.

    Examples:
        >>> import emcee_femu as ef
        >>> figure = ef.figures.plot_proposals()
        >>> [axes.get_title().split(":")[0] for axes in figure.axes]
        ['Metropolis-Hastings', 'DE-MC']
    """
    covariance = np.array([[1.0, 0.8], [0.8, 1.0]])
    current, a, b = np.array([[-1.3, -0.9], [1.4, 1.0], [0.3, -0.4]])
    others = [(-0.6, -1.1), (-0.3, 0.5), (0.9, 1.5), (-1.6, -1.9), (0.6, 0.5)]
    figure, panels = subplots(2, 2, (9.6, 4.9), sharex=True, sharey=True)
    grid = np.linspace(-2.6, 2.6, 121)
    x, y = np.meshgrid(grid, grid)
    points = np.stack([x, y], axis=-1)
    square = np.einsum("...i,ij,...j", points, np.linalg.inv(covariance), points)
    for axes in panels:
        axes.contour(x, y, square, [0.5, 2, 4.5], colors=GREY, linewidths=0.8)
        axes.set(aspect="equal", xlabel=r"$\theta_1$", ylabel=r"$\theta_2$")

    def arrow(axes: Axes, start: Floats, end: Floats, color: str) -> None:
        style: Style = {"arrowstyle": "-|>", "color": color, "lw": 1.8}
        axes.annotate("", tuple(end), tuple(start), arrowprops=style)

    def point(axes: Axes, at: Floats, label: str, color: str, above: int = 8) -> None:
        axes.plot(*at, "o", color=color, ms=7)
        style: Style = {"textcoords": "offset points", "color": color, "fontsize": 14}
        axes.annotate(label, tuple(at), (6, above), **style)

    left, right = panels
    proposed = current + np.array([0.55, 0.25])
    left.set_title("Metropolis-Hastings: a step of fixed distribution")
    left.add_patch(Circle(tuple(current), 1.0, color=BLUE, alpha=0.12))
    arrow(left, current, proposed, RED)
    point(left, current, r"$\theta_{t-1}$", "black", -20)
    point(left, proposed, r"$\theta^*$", RED)

    gamma, noise = 2.38 / math.sqrt(2 * 2), np.array([0.06, -0.12])
    proposed = current + gamma * (a - b) + noise
    right.set_title(
        r"DE-MC: $\theta^* = \theta_i + \gamma(\theta_a - \theta_b) + \varepsilon$"
    )
    right.plot(*np.transpose(others), "o", color=GREY, ms=5)
    arrow(right, b, a, BLUE)
    arrow(right, current, proposed, RED)
    point(right, a, r"$\theta_a$", BLUE)
    point(right, b, r"$\theta_b$", BLUE, -20)
    point(right, current, r"$\theta_i$", "black", -20)
    point(right, proposed, r"$\theta^*$", RED)
    figure.draw_without_rendering()  # the layout of square axes settles in two passes
    return finish(figure)
