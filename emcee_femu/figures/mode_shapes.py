"""Measured and predicted mode shapes on the structure."""

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from .. import checks
from ..contracts import Floats, read_declared
from ..measurements.directions import is_rotation, read_combination
from ..models.geometry import Geometry
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior
from ..results.arviz_objects import samples
from ..results.shapes import ModeShapes, choose_experiments, solve_shapes
from ..results.to_arviz import read_samples_and_model
from .style import (
    BELOW,
    BLUE,
    GREY,
    RED,
    Size,
    Style,
    add_panels,
    finish,
    show_mac,
    stack_parts,
)

Moves: TypeAlias = dict[Hashable, Floats]  # displacements (3,) by node

SHAPE_COLUMNS, SHAPE_PANEL = 3, 2.33  # panels beside each other; inches of each
TITLE_LINE, LEGEND_LINE = 0.16, 0.2  # inches
PADDING = 0.1  # inches around a panel, and around the legend
STEEPEST = 1.6  # height of a panel by its width, at most
LARGEST_DRAWN = 0.15  # displacement drawn, of the size of the structure
MOST_NAMED = 12  # sensors beside each other whose names can be read
SHAPE_MARGIN = 0.17  # around the structure, of its size
# A view in space: from how far to the side, and from how far above.
SIDE, ABOVE = math.radians(30), math.radians(22)
NO_EXTENT = 1e-9
BENT_POINTS = 13  # of a line that bends


def plot_shapes(
    idata: object,
    posterior: LogPosterior | None = None,
    *,
    geometry: Geometry | None = None,
    modes: int | Sequence[int] | None = None,
    experiment: str | None = None,
    structure: bool = False,
) -> Figure:
    """Draw the structure with measured mode shapes and those of the updated model.

    There is one panel per mode. The structure at rest is grey. The model at the
    posterior mean (one solve) is blue; a blue circle is the model at a sensor, in the
    direction of the sensor. Red lines that end in dots are the measurements, on the
    model's scale. Blue lines follow their nodes; where the model returns all rotations
    too, they bend as beams do, by the cubics of their elements. A node without DOFs
    does not move if it is one of the geometry's supports, or if the model returns
    shapes at all its DOFs (``shapes=True``); otherwise its lines are left out. Without
    measured shapes, the model's shapes are drawn alone.

    The shapes of close modes can be any combination of one another. For modes closer
    than ``min_gap`` of the :class:`PairedModel`, the combination closest to the
    measured shape is drawn, and the title names the modes in it: the MAC is that of the
    measured shape with their subspace. It is drawn at the sensors only if their shapes
    are too much alike there to tell how they are combined.

    A plane structure whose modes stay in the plane is drawn in that plane, any other in
    space, with z upwards.

    Args:
        idata: The result of :func:`run` or :func:`to_inference_data`.
        posterior: The sampled posterior, if idata is an ArviZ object.
        geometry: Nodes, lines and sensors; the model's own by default.
        modes: The mode or modes to draw, 1 = the first measured one; None for all.
        experiment: Name of one experiment of a joint posterior; None for all whose
            shapes can be drawn, below each other.
        structure: Whether a first panel shows the structure at rest with its sensors.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If posterior is not a LogPosterior or is missing, or geometry is not
            a Geometry.
        ValueError: If no geometry is given, or it contains no DOF of the shapes; the
            model returns no shapes; posterior has other parameters; or there is no such
            mode or experiment.

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
        >>> tower = ef.Geometry({0: (0, 0), 1: (0, 1), 2: (0, 2)}, [(0, 1), (1, 2)],
        ...                     {0: (1, "ux"), 1: (2, "ux")})
        >>> figure = ef.figures.plot_shapes(run, geometry=tower)
        >>> figure.axes[0].get_title().splitlines()[0]
        'mode 1: 0.27 Hz measured,'
    """
    idata, posterior = read_samples_and_model(idata, posterior)

    def can_be_drawn(test: Experiment) -> bool:
        """Return whether it has shapes at known places."""
        placed = (geometry or read_declared(test.model, "geometry")) is not None
        shapes = (read_declared(test.model, "variables") or {}).get("shapes")
        return placed and bool(test.paired or (shapes and shapes.coords.get("dof")))

    tests = choose_experiments(posterior, experiment, can_be_drawn)
    theta = samples(idata)[1].mean(axis=(0, 1))
    each = [
        _lay_out(posterior, test, theta, geometry, modes, structure) for test in tests
    ]
    sizes = {test.name: laid.size for test, laid in zip(tests, each, strict=True)}
    figure, parts = stack_parts(sizes)
    for part, laid in zip(parts, each, strict=True):
        panels = add_panels(part, len(laid.numbers) + structure, laid.columns)
        _draw_modes(panels, laid, structure)
        below = BELOW | {"ncols": 4 if laid.columns == SHAPE_COLUMNS else 2}
        handles = panels[0].get_legend_handles_labels()[0]
        part.legend(handles=handles, **below | {"fontsize": 8})
    figure.draw_without_rendering()  # the layout of such axes settles in two passes
    return finish(figure, idata, tests[0].name if len(tests) == 1 else "")


class Layout(NamedTuple):
    """The modes of an experiment, and how they are drawn."""

    geometry: Geometry
    names: Sequence[str]
    solved: ModeShapes
    numbers: Sequence[int]
    drawn: Sequence[Sequence[Moves]]
    view: Floats
    low: Floats
    high: Floats
    extent: float
    columns: int
    size: Size


def _lay_out(
    posterior: LogPosterior,
    test: Experiment,
    theta: Floats,
    geometry: Geometry | None,
    modes: int | Sequence[int] | None,
    structure: bool,
) -> Layout:
    """Return what is drawn of an experiment at ``theta (d,)``, by one solve."""
    if geometry is None:
        geometry = read_declared(test.model, "geometry")
    if geometry is None:
        raise ValueError(
            "geometry: the model has none; give geometry=Geometry(nodes, lines, "
            "sensors), {node: coordinates}, (node, node) each and {DOF: (node, "
            "direction)}, or set model.geometry to one before PairedModel(model, ...)"
        )
    checks.instance("geometry", geometry, Geometry)
    solved = solve_shapes(posterior, test, theta)
    named = solved.pairing.hertz if solved.pairing else solved.frequencies
    numbers = checks.chosen_numbers("modes", modes, len(named))
    drawn = [_displace(solved, geometry, number - 1) for number in numbers]
    nodes = np.array([*geometry.nodes.values()])
    view = _choose_view(
        nodes, [x for m in drawn for part in m[:3] for x in part.values()]
    )
    low, high = (nodes @ view.T).min(axis=0), (nodes @ view.T).max(axis=0)
    size = float(np.linalg.norm(high - low)) or 1.0
    low, high = low - SHAPE_MARGIN * size, high + SHAPE_MARGIN * size
    count = len(numbers) + structure
    rows = -(-count // SHAPE_COLUMNS)
    columns = -(-count // rows)
    slope = min(float(np.divide(*(high - low)[::-1])), STEEPEST)
    above = TITLE_LINE * max(1 + _title(solved, n - 1).count("\n") for n in numbers)
    below = PADDING + LEGEND_LINE * (1 if columns == SHAPE_COLUMNS else 2)
    height = below + rows * (above + PADDING + (SHAPE_PANEL - PADDING) * slope)
    inches = max(SHAPE_PANEL * columns, 3.6), height
    box = low, high, size
    sensors = solved.pairing.sensors if solved.pairing else ()
    names = test.paired.measurements.sensors if test.paired else [*map(str, sensors)]
    shown = geometry, names, solved, numbers, drawn, view
    return Layout(*shown, *box, columns, inches)


def _draw_modes(panels: list[Axes], laid: Layout, structure: bool) -> None:
    """Draw each mode in its panel, after the structure if that is asked for."""
    (geometry, _, solved, numbers, drawn, view, low, high, extent, *_) = laid
    for axes in panels:
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.set(xticks=[], yticks=[], frame_on=False)
    if structure:
        sensors = solved.pairing.sensors if solved.pairing else ()
        length = LARGEST_DRAWN * extent
        _draw_sensors(panels.pop(0), geometry, view, sensors, laid.names, length)
    for axes, number, mode in zip(panels, numbers, drawn, strict=True):
        bent = _bend_lines(geometry, mode)
        moves = [moved for _, moved in bent]
        moves += [x[None] for part in mode[:3] for x in part.values()]
        largest = np.linalg.norm(np.concatenate(moves), axis=1).max()
        factor = LARGEST_DRAWN * extent / max(float(largest), np.finfo(float).tiny)
        _draw_mode(axes, geometry, view, mode, bent, factor)
        axes.set_title(_title(solved, number - 1), fontsize=9)
    _draw_directions(panels[0], view, low + 0.05 * extent, 0.12 * extent)


def _displace(modes: ModeShapes, geometry: Geometry, i: int) -> list[Moves]:
    """Return what moves in mode i: the structure; at the sensors, model and measured.

    The last are the rotations of the structure, none where not all are known.

    Raises:
        ValueError: If the geometry does not know a sensor, or no DOF at all.
    """
    sensors: Sequence[Hashable] = ()
    if (pairing := modes.pairing) is None:
        values = dict(zip(modes.dofs, modes.shapes[:, i], strict=True))
        paired = measured = np.empty(0)
    else:
        sensors, paired = pairing.sensors, pairing.paired[:, i]
        measured = pairing.measured[:, i]
        measured = measured * np.nansum(measured * paired) / np.nansum(measured**2)
        whole = zip(modes.dofs, pairing.everywhere[:, i], strict=True)
        values = {dof: value for dof, value in whole if np.isfinite(value)}
        values |= dict(zip(sensors, paired, strict=True))
    unknown = [
        dof
        for dof in values
        if geometry.locate(dof) is None
        # These move no node.
        and not (is_rotation(dof) or dof in geometry.undrawn or read_combination(dof))
    ]
    moves = _move_nodes(geometry, values)
    if not moves or {*unknown} & {*sensors}:
        missing = [dof for dof in unknown if dof in sensors] or unknown
        raise ValueError(
            f"geometry: it does not know the DOFs {missing}; give Geometry(nodes, "
            "lines, sensors={DOF: (node, direction)}), or name them 'node:ux'"
        )
    # What has no DOF where all are known is held; close modes have sensors only.
    known = modes.complete and not unknown and values.keys() >= {*modes.dofs}
    still = geometry.nodes if known else geometry.supports
    moves = dict.fromkeys(still, np.zeros(3)) | moves
    predicted, tested = (
        _move_nodes(geometry, dict(zip(sensors, shape, strict=True)))
        for shape in (paired, measured)
    )
    turns = _turn_nodes(geometry, values) if known else {}
    return [moves, predicted, tested, turns]


def _turn_nodes(geometry: Geometry, values: Mapping[Hashable, float]) -> Moves:
    """Return the rotations (3,) of nodes from those about the axes."""
    turns: Moves = {node: np.zeros(3) for node in geometry.nodes}
    by_text = {str(node): node for node in geometry.nodes}
    turning = {dof: value for dof, value in values.items() if is_rotation(dof)}
    for dof, value in turning.items():
        node, _, axis = str(dof).rpartition(":")
        turns[by_text[node]]["xyz".index(axis[-1])] += value
    return turns if turning else {}


def _bend(
    geometry: Geometry, line: Sequence[Hashable], moves: Moves, turns: Moves
) -> tuple[Floats, Floats]:
    """Return points ``(k, 3)`` of a line at rest, and how each moves."""
    first, last = line
    ends = geometry.nodes[first], geometry.nodes[last]
    s = np.linspace(0.0, 1.0, BENT_POINTS if turns else 2)[:, None]
    along = ends[1] - ends[0]
    straight = (1 - s) * moves[first] + s * moves[last]
    if not turns:
        return ends[0] + s * along, straight
    # Cubics of Hermite across the element, whose ends turn with their nodes.
    slopes = np.cross(turns[first], along), np.cross(turns[last], along)
    cubic = (1 - 3 * s**2 + 2 * s**3) * moves[first] + s * (1 - s) ** 2 * slopes[0]
    cubic += (3 * s**2 - 2 * s**3) * moves[last] - s**2 * (1 - s) * slopes[1]
    axis = along / np.linalg.norm(along)
    across = np.eye(3) - np.outer(axis, axis)
    return ends[0] + s * along, straight + (cubic - straight) @ across


def _bend_lines(
    geometry: Geometry, mode: Sequence[Moves]
) -> list[tuple[Floats, Floats]]:
    """Return the points of all lines whose ends are known, and how each moves."""
    structure, *_, turns = mode
    return [
        _bend(geometry, line, structure, turns)
        for line in geometry.lines
        if all(node in structure for node in line)
    ]


def _move_nodes(geometry: Geometry, values: Mapping[Hashable, float]) -> Moves:
    """Return the displacements of nodes from those along DOFs, zero across them."""
    by_node: dict[Hashable, list[tuple[Floats, float]]] = {}
    for dof, value in values.items():
        place = geometry.locate(dof)
        if place is not None and np.isfinite(value):  # a sensor may miss one mode
            by_node.setdefault(place[0], []).append((place[1], value))
    moves = {}
    for node, pairs in by_node.items():
        directions, along = zip(*pairs, strict=True)
        moves[node] = np.linalg.lstsq(np.array(directions), np.array(along))[0]
    return moves


def _choose_view(nodes: Floats, moves: Sequence[Floats]) -> Floats:
    """Return where the axes x, y, z lead on the page, ``(2, 3)``."""
    largest = np.abs(moves).max(axis=0)
    used = np.ptp(nodes, axis=0) > NO_EXTENT * np.ptp(nodes)
    used |= largest > NO_EXTENT * largest.max()
    if not used.all():
        axes = np.flatnonzero(used).tolist()
        spare = [axis for axis in range(3) if axis not in axes]
        return np.eye(3)[sorted((axes + spare)[:2])]
    right = np.array([math.cos(SIDE), math.sin(SIDE), 0.0])
    behind = np.array([-math.sin(SIDE), math.cos(SIDE), 0.0])
    up = math.sin(ABOVE) * behind + math.cos(ABOVE) * np.eye(3)[2]
    return np.array([right, up])


def _draw_mode(
    axes: Axes,
    geometry: Geometry,
    view: Floats,
    mode: Sequence[Moves],
    bent: Sequence[tuple[Floats, Floats]],
    factor: float,
) -> None:
    """Draw the structure at rest and moved by a factor, and what sensors say."""

    def place(node: Hashable, moves: Moves) -> Floats:
        return view @ (geometry.nodes[node] + factor * moves.get(node, np.zeros(3)))

    structure, predicted, measured, _ = mode
    rest: Style = {"colors": "0.75", "linewidths": 1.0, "label": "at rest"}
    lines = [[place(node, {}) for node in line] for line in geometry.lines]
    axes.add_collection(LineCollection(lines, **rest))
    moved = [(points + factor * moves) @ view.T for points, moves in bent]
    if moved:
        style: Style = {"colors": BLUE, "linewidths": 1.6, "label": "updated model"}
        axes.add_collection(LineCollection(moved, **style))
    nodes = predicted or ({} if moved else structure)
    if nodes:
        x, y = np.transpose([place(node, nodes) for node in nodes])
        label = "updated model at the sensors" if predicted else "updated model"
        axes.plot(x, y, "o", mfc="white", mec=BLUE, ms=5, label=label)
    if measured:
        ends = [[place(node, {}), place(node, measured)] for node in measured]
        axes.add_collection(LineCollection(ends, colors=RED, linewidths=1.2, zorder=3))
        x, y = np.transpose([end for _, end in ends])
        axes.plot(x, y, "o", color=RED, ms=3, zorder=3, label="measured")


def _draw_sensors(
    axes: Axes,
    geometry: Geometry,
    view: Floats,
    sensors: Sequence[Hashable],
    names: Sequence[str],
    length: float,
) -> None:
    """Draw the structure at rest, and an arrow along each sensor, with its name."""
    lines = [[view @ geometry.nodes[node] for node in line] for line in geometry.lines]
    axes.add_collection(LineCollection(lines, colors="0.4", linewidths=1.4))
    for sensor, name in zip(sensors, names, strict=True):
        if (place := geometry.locate(sensor)) is None:
            continue
        (x, y), (dx, dy) = view @ geometry.nodes[place[0]], length * view @ place[1]
        style: Style = {"arrowstyle": "-|>", "color": RED, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (x + dx, y + dy), (x, y), arrowprops=style)
        if len(names) <= MOST_NAMED:  # beyond the tip
            sides: Style = {"ha": "left" if dx > 0 else "right"}
            sides["va"] = "bottom" if dy > 0 else "top"
            axes.text(x + dx, y + dy, name, fontsize=6, color=RED, **sides)
    count = f", {len(sensors)} sensors" if sensors else ""
    axes.set_title(f"the structure{count}", fontsize=9)


def _title(modes: ModeShapes, i: int) -> str:
    """Return what stands above mode i."""
    if (pairing := modes.pairing) is None:
        return f"mode {i + 1}: {modes.frequencies[i]:.4g} Hz updated"
    k = pairing.chosen[i]
    *first, last = map(str, 1 + np.flatnonzero(pairing.combined[i]))
    known = np.isfinite(pairing.everywhere[:, i]).all()
    where = "combined" if known else "at the sensors only"
    several = f" of\nmodes {', '.join(first)} and {last}, {where}" if first else ""
    return (
        f"mode {i + 1}: {pairing.hertz[i]:.4g} Hz measured,\n{modes.frequencies[k]:.4g}"
        f" Hz updated, MAC {show_mac(pairing.mac[i, k], 3)}{several}"
    )


def _draw_directions(axes: Axes, view: Floats, at: Floats, length: float) -> None:
    """Draw where x, y and z lead, in the corner of a panel."""
    for name, direction in zip("xyz", view.T, strict=True):
        if direction.any():
            end = at + length * direction
            axes.plot(*np.transpose([at, end]), color=GREY, lw=0.9)
            middle: Style = {"ha": "center", "va": "center", "color": GREY}
            x, y = at + 1.4 * length * direction
            axes.text(x, y, name, fontsize=8, **middle)
