"""The two structures of the paper, ready to sample, with the published results.

Sherri, Boulkaibet, Marwala and Friswell, "A Differential Evaluation Markov Chain Monte
Carlo algorithm for Bayesian Model Updating". The text does not include their drawings
of the two structures: topology and geometry were inferred from the printed tables, and
are the simplest that give the printed frequencies. beta_c and the prior of the first
problem are not printed either; they follow from the printed c.o.v.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...contracts import Floats, Model
from ...likelihoods.frequency import FrequencyTerm
from ...models.mass_spring import MassSpringModel
from ...posterior.log_posterior import LogPosterior
from ...posterior.priors import GaussianPrior
from ...table import Column, Parts, Report, Table
from .frame import FrameModel
from .sections import Section


@dataclass(frozen=True)
class Published:
    """The printed results, as columns for the tables.

    Attributes:
        parameters: ``{title: {parameter: value}}``.
        frequencies: ``{title: one number per mode, then the TAE where printed}``.

    Examples:
        >>> from emcee_femu import paper
        >>> paper.mass_spring().published.parameters["paper mean"]["k1"]
        4004.4
    """

    parameters: Mapping[str, Mapping[str, float]]
    frequencies: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True, eq=False, repr=False)
class Problem(Report):
    """An updating problem of the paper.

    Attributes:
        posterior: The posterior, ready to sample.
        model: The FE model.
        measured: Measured natural frequencies in Hz, ``(5,)``.
        initial: Starting parameters theta_0, by name.
        published: The printed results.
        units: Units by parameter name.
        nominal: The printed nominal parameters, by name; None if unknown.
        target: The parameters that reproduce the measured frequencies; None if unknown.

    Examples:
        >>> from emcee_femu import paper
        >>> problem = paper.mass_spring()
        >>> problem.target["k1"], problem.nominal["k1"], problem.units["k1"]
        (4000.0, 4010.0, 'N/m')
    """

    posterior: LogPosterior
    model: Model
    measured: Floats
    initial: Mapping[str, float]
    published: Published
    units: Mapping[str, str]
    nominal: Mapping[str, float] | None = None
    target: Mapping[str, float] | None = None

    def _parts(self) -> Parts:
        names = [*self.initial]
        columns: list[Column] = [
            ("parameter", "", names),
            ("unit", "", [self.units.get(name, "") for name in names]),
        ]
        sets = {"initial": self.initial, "nominal": self.nominal, "target": self.target}
        columns += [(k, ".5g", [v[n] for n in names]) for k, v in sets.items() if v]
        yield Table.from_columns("Updating problem of the paper", columns)
        yield f"Measured, in Hz: {', '.join(f'{f:g}' for f in self.measured)}"


def mass_spring(beta: float = 6.8e5) -> Problem:
    """Return Application 1: five masses, ten springs, five unknown stiffnesses.

    With two corrections to the printed text, exactly one topology agrees with every row
    of Table 4.2: spring k7 follows k2, and the measured frequencies belong to the round
    ``target`` values, not to the printed ``nominal`` values.

    Args:
        beta: Precision of the relative frequency error; the default reproduces the
            printed c.o.v. of the frequencies.

    Returns:
        The problem, ready to sample.

    Raises:
        TypeError, ValueError: If beta is not a positive number.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import paper
        >>> problem = paper.mass_spring()
        >>> target = {name: np.array([value]) for name, value in problem.target.items()}
        >>> problem.model(target).frequencies.round(2).tolist()
        [[3.51, 5.15, 7.08, 8.89, 9.43]]
    """
    names = ("k1", "k2", "k4", "k6", "k8")  # theta_1 .. theta_5
    by_name = partial(_by_name, names)
    initial = (4600.0, 2580.0, 1680.0, 3100.0, 2350.0)
    model = MassSpringModel(
        masses=[2.7, 1.7, 6.1, 5.3, 2.9],
        springs={
            "k1": (0, 4, 4600.0),
            "k2": (0, 1, 2580.0),
            "k3": (1, 4, 3200.0),
            "k4": (1, 3, 1680.0),
            "k5": (3, 4, 1840.0),
            "k6": (0, 3, 3100.0),
            "k7": (0, 2, "k2"),
            "k8": (2, 3, 2350.0),
            "k9": (0, 3, 2800.0),
            "k10": (3, 5, 2000.0),
        },
    )
    measured = np.array([3.507, 5.149, 7.083, 8.892, 9.426])
    low = (3200.0, 1800.0, 1600.0, 1800.0, 2050.0)
    high = (4800.0, 2600.0, 2670.0, 3400.0, 2750.0)
    prior = GaussianPrior(names, initial, 1000.0, np.column_stack([low, high]))
    units = dict.fromkeys(names, "N/m")
    return Problem(
        posterior=LogPosterior(model, FrequencyTerm(measured, beta=beta), prior, units),
        model=model,
        measured=measured,
        initial=by_name(initial),
        nominal=by_name((4010.0, 2210.0, 2130.0, 2595.0, 2398.0)),
        target=by_name((4000.0, 2200.0, 2120.0, 2600.0, 2400.0)),
        published=Published(
            parameters={
                "paper mean": by_name((4004.4, 2197.6, 2109.4, 2600.9, 2410.4)),
                "paper c.o.v. %": by_name((1.03, 1.71, 2.07, 2.32, 1.77)),
            },
            frequencies={
                "paper Hz": (3.507, 5.149, 7.082, 8.894, 9.426),
                "paper c.o.v. %": (0.118, 0.126, 0.119, 0.140, 0.117),
                "paper error %": (0.00, 0.00, 0.02, 0.03, 0.00, 0.012),
            },
        ),
        units=units,
    )


def h_frame(modes: Sequence[int] = (1, 2, 4, 5, 7), shapes: bool = False) -> FrameModel:
    """Return the model of Application 2, a free-free 3-D frame of 12 elements.

    Args:
        modes: The elastic modes to return; by default those in the paper's table, which
            omits others.
        shapes: Whether to return mode shapes, over 13 nodes of six DOFs.

    Returns:
        The model.

    Raises:
        TypeError, ValueError: If modes are not ascending whole numbers from 1.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import paper
        >>> start = paper.h_structure().initial
        >>> theta = {name: np.array([value]) for name, value in start.items()}
        >>> paper.h_frame(modes=[1, 2, 3])(theta).frequencies.shape
        (1, 3)
    """
    sections = {}
    tilts = {"left": 45.0, "middle": 30.0, "right": 45.0}  # out of the normal
    for i, (bar, tilt) in enumerate(tilts.items(), 1):
        sine, cosine = float(np.sin(np.radians(tilt))), float(np.cos(np.radians(tilt)))
        # The direction whose displacement Ix resists.
        across = (0.0, sine, cosine) if bar == "middle" else (sine, 0.0, cosine)
        sections[bar] = Section(
            E=7.2e10,
            GJ=720.0,
            rho=2785.0,
            A=f"A{i}",
            Iy=2.5255e-9,
            Iz=f"Ix{i}",
            orientation=across,
        )
    middle = [(x, 0.0, 0.0) for x in np.linspace(0.0, 0.690, 7)]
    left = [(0.0, y, 0.0) for y in (-0.210, -0.105, 0.095, 0.190)]
    right = [(0.690, y, 0.0) for y in (-0.105, 0.105)]
    elements = [(i, i + 1, "middle") for i in range(6)]
    elements += [(a, b, "left") for a, b in ((7, 8), (8, 0), (0, 9), (9, 10))]
    elements += [(a, b, "right") for a, b in ((11, 6), (6, 12))]
    return FrameModel(
        [*middle, *left, *right], elements, sections, modes=modes, skip=6, shapes=shapes
    )


def h_structure(beta: float = 10.0) -> Problem:
    """Return Application 2: the unsymmetrical H-shaped aluminium structure.

    It is a free-free 3-D frame of 12 elements; area and one second moment of area of
    each bar are unknown. The geometry was inferred from the sensitivities in the
    printed tables. A family of geometries fits equally well; this one has round
    numbers.

    Args:
        beta: Precision of the relative frequency error. The paper prints 10, but its
            DE-MC results need about 5e4.

    Returns:
        The problem, ready to sample.

    Raises:
        TypeError, ValueError: If beta is not a positive number.

    Examples:
        >>> from emcee_femu import paper
        >>> problem = paper.h_structure()
        >>> problem.posterior.names, problem.measured.tolist()
        (('Ix1', 'Ix2', 'Ix3', 'A1', 'A2', 'A3'), [53.9, 117.3, 208.4, 254.0, 445.0])
    """
    names = ("Ix1", "Ix2", "Ix3", "A1", "A2", "A3")
    by_name = partial(_by_name, names)
    initial = (2.7265e-8,) * 3 + (3.1556e-4,) * 3
    model = h_frame()
    measured = np.array([53.9, 117.3, 208.4, 254.0, 445.0])
    sd = (5e-8,) * 3 + (5e-4,) * 3
    bounds = [(0.73e-8, 4.73e-8)] * 3 + [(1.16e-4, 5.16e-4)] * 3
    prior = GaussianPrior(names, initial, sd, bounds)
    demc = (2.8965e-8, 2.9739e-8, 1.7676e-8, 3.8966e-4, 2.1584e-4, 2.9553e-4)
    mh = (2.31e-8, 2.68e-8, 2.17e-8, 2.85e-4, 2.83e-4, 2.77e-4)
    units = {name: "m^4" if name.startswith("Ix") else "m^2" for name in names}
    return Problem(
        posterior=LogPosterior(model, FrequencyTerm(measured, beta=beta), prior, units),
        model=model,
        measured=measured,
        initial=by_name(initial),
        published=Published(
            parameters={
                "paper DE-MC": by_name(demc),
                "c.o.v. % ": by_name((5.76, 1.91, 1.67, 0.65, 2.93, 0.026)),
                "paper M-H": by_name(mh),
                "c.o.v. %  ": by_name((22.59, 15.25, 13.96, 14.36, 14.36, 13.08)),
            },
            frequencies={
                "paper DE-MC": (52.56, 119.42, 210.46, 253.37, 435.71),
                "c.o.v. % ": (0.30, 0.35, 0.54, 0.41, 0.63),
                "error %  ": (2.49, 1.81, 0.99, 0.25, 2.09, 1.53),
                "paper M-H": (53.92, 122.05, 210.93, 258.94, 410.33),
                "c.o.v. %  ": (3.96, 4.28, 4.95, 4.81, 4.74),
                "error %   ": (0.04, 4.05, 1.22, 1.94, 7.79, 3.01),
            },
        ),
        units=units,
    )


def _by_name(names: Sequence[str], values: Sequence[float]) -> dict[str, float]:
    return dict(zip(names, values, strict=True))
