"""Problems for posteriors in few solves: what is measured, and a model as a black box.

Every model is wrapped in a :class:`BlackBox`, as if a FE program were behind it: it
gives a response, no derivatives, and counts its solves itself. The problems are

    beck_au      2 parameters, 2 frequencies; two modes
    mass_spring  5 parameters, 5 frequencies of the paper's springs; a lobe at small k4
    h_500        6 parameters, 5 of 7 frequencies of the paper's H structure, whose
    h_50000      modes cross inside the bounds; shapes are not measured, but known
    shear        10 storeys, 5 frequencies and 25 shape ordinates, paired
    tower        16 columns of a 3-D frame, 6 frequencies and 96 shape ordinates,
                 paired; two pairs of modes about 1 % apart

References are long runs of the same posteriors by ``few_solves_references.py``.

Run it:  python examples/benchmarks/few_solves_problems.py
It prints, for each, parameters, data, milliseconds per solve and the bar.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from evidence import beck_au as beck_au_exactly

import emcee_femu as ef

Floats = np.ndarray


class BlackBox:
    """A model of which only the response is to be had; counts solves and seconds."""

    def __init__(self, model: Any) -> None:
        self.model, self.solves, self.seconds = model, 0, 0.0
        self.variables = ef.interfaces.declared_variables(model)
        self.n_modes = model.n_modes
        self.names = getattr(model, "names", None)
        self.required = getattr(model, "required", ())
        self.positive = getattr(model, "positive", ())

    def __call__(self, parameters: Any) -> Any:
        """Solve, count and clock."""
        begin = time.process_time()
        response = self.model(parameters)
        self.seconds += time.process_time() - begin
        self.solves += len(next(iter(parameters.values())))
        return response


@dataclass(frozen=True)
class RatioTerm:
    """Gaussian errors of (f / f_measured)^power - 1 of some of the model's modes."""

    measured: Sequence[float]
    sd: float
    modes: Sequence[int]  # from 0
    power: int = 1
    name: str = "frequency"
    reads: Mapping[str, Any] = field(default_factory=lambda: ef.modal_variables(1))

    def __call__(self, parameters: Any, response: Any) -> Floats:
        """Return the log-likelihood of every parameter set, without its constant."""
        r, sd = self.deviations(parameters, response)
        return -0.5 * ((r / sd) ** 2).sum(axis=1)

    def deviations(self, parameters: Any, response: Any) -> tuple[Floats, Floats]:
        """Return the deviations and their standard deviations (interfaces.py)."""
        f = ef.interfaces.read(response, "frequency")[:, list(self.modes)]
        r = (f / np.array(self.measured)) ** self.power - 1
        return r, np.full(r.shape, self.sd)


class Problem(NamedTuple):
    """A posterior and how many solves it may take.

    Attributes:
        posterior: The true one.
        box: Its black box, which counts.
        solves: The bar.
        first: Whether a draw ``(n, d)`` is in the first of two modes; None for one.
    """

    posterior: ef.LogPosterior
    box: BlackBox
    solves: int
    first: Callable[[Floats], Floats] | None = None


def below_one(theta: Floats) -> Floats:
    """Return whether x1 < 1."""
    return theta[:, 0] < 1


def below_1980(theta: Floats) -> Floats:
    """Return whether k4 < 1980, where the lobe is."""
    return theta[:, 2] < 1980


def beck_au() -> Problem:
    """Return Beck and Au's shear frame, with two modes."""
    exact = beck_au_exactly().posterior
    box = BlackBox(exact.model)
    term = RatioTerm((3.13, 9.83), 0.5**4, (0, 1), power=2)
    return Problem(ef.LogPosterior(box, term, exact.prior), box, 30, below_one)


def mass_spring() -> Problem:
    """Return the paper's five masses and ten springs."""
    given = ef.paper.mass_spring().posterior
    box = BlackBox(given.model)
    posterior = ef.LogPosterior(box, given.terms, given.prior)
    return Problem(posterior, box, 45, below_1980)


def h_structure(beta: float) -> Problem:
    """Return the paper's H structure.

    A FE program gives the modes in ascending order, with their shapes; here the seven
    lowest, at the three translations of all nodes. The paper compares five of them.
    The next two cross modes above them inside the bounds: returned without those they
    would only hurt (examples/how_to/emulated_crossing_modes.py).
    """
    given = ef.paper.h_structure(beta)
    rows = [f"{node}:u{axis}" for node in range(13) for axis in "xyz"]
    frame = ef.paper.h_frame(modes=range(1, 8), shapes=rows)
    box = BlackBox(frame)
    wanted = [mode - 1 for mode in given.model.modes]
    term = RatioTerm(tuple(given.measured), beta**-0.5, wanted)
    return Problem(ef.LogPosterior(box, term, given.posterior.prior), box, 90)


STOREYS, FLOORS = 10, (0, 2, 4, 7, 9)  # all, and those with a sensor
SPREAD, RELATIVE_SD, DELTA = 0.2, 0.005, 0.02


def measure(model: Any, truth: Mapping[str, float], n: int, seed: int) -> Any:
    """Return the lowest n modes of a simulated test, and the likelihood terms."""
    rng = np.random.default_rng(seed)
    modes = model({name: np.array([value]) for name, value in truth.items()})
    frequencies = modes.frequencies[0, :n]
    frequencies = frequencies * (1 + RELATIVE_SD * rng.standard_normal(n))
    shapes = modes.shapes[0, :, :n] / np.linalg.norm(modes.shapes[0, :, :n], axis=0)
    shapes = shapes + DELTA * rng.standard_normal(shapes.shape)
    order = np.argsort(frequencies)  # noise may exchange two close ones
    dofs = model.variables["shapes"].coords["dof"] if model.variables else None
    measured = ef.Measurements(frequencies[order], shapes=shapes[:, order], dofs=dofs)
    return measured, [
        ef.FrequencyTerm(measured, relative_sd=RELATIVE_SD),
        ef.ShapeTerm(measured, delta=DELTA),
    ]


def about_one(names: Sequence[str], low: float, high: float) -> ef.GaussianPrior:
    """Return the prior of stiffness factors."""
    ones = np.ones(len(names))
    return ef.GaussianPrior(names, ones, SPREAD * ones, np.outer(ones, [low, high]))


def shear() -> Problem:
    """Return a shear building of ten storeys, five of whose floors were measured."""
    names = [f"s{i}" for i in range(1, STOREYS + 1)]
    drift = np.eye(STOREYS) - np.eye(STOREYS, k=-1)
    model = ef.MatrixModel(
        np.zeros((STOREYS, STOREYS)),
        1e5 * np.eye(STOREYS),  # kg
        K={n: 2e8 * np.outer(b, b) for n, b in zip(names, drift, strict=True)},  # N/m
        n_modes=7,
        shapes=FLOORS,
    )
    prior = about_one(names, 0.1, 3.0)
    truth = prior.sample(np.random.default_rng(3), 1)[0]
    measured, terms = measure(model, dict(zip(names, truth, strict=True)), 5, seed=4)
    box = BlackBox(model)
    paired = ef.PairedModel(box, measured, candidates=7)
    return Problem(ef.LogPosterior(paired, terms, prior), box, 80)


class Tower:
    """A steel tower of four storeys on a square plan, 16 factors of its columns.

    Beams are rigid enough that the columns count. Bending in x and in y is alike but
    for the beams, so that modes come in pairs about 1 % apart.
    """

    corners = ((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0))  # m
    names = tuple(f"c{s}{i}" for s in range(1, 5) for i in range(1, 5))
    E = 210e9  # Pa

    def __init__(self) -> None:
        points = [(x, y, 3.0 * s) for s in range(5) for x, y in self.corners]
        steel = {"GJ": 8e5, "rho": 7850.0}
        column = {**steel, "A": 5e-3, "Iy": 2e-5, "Iz": 2e-5}
        sections = {
            n: ef.Section(E=n, **column, orientation=(1.0, 0.0, 0.0))
            for n in self.names
        }
        floor = {**steel, "E": self.E, "A": 2e-2, "rho": 40_000.0}  # with its load
        for axis, inertia in (("x", 8.4e-5), ("y", 7.8e-5)):
            sections[axis] = ef.Section(**floor, Iy=1e-4, Iz=inertia)
        elements = []
        for s in range(1, 5):
            for i in range(4):
                foot, top = 4 * (s - 1) + i, 4 * s + i
                elements.append((foot, top, f"c{s}{i + 1}"))
                elements.append((top, 4 * s + (i + 1) % 4, "xy"[i % 2]))
        supports = dict.fromkeys(range(4), "all")
        rows = [f"{4 * s + i}:u{a}" for s in range(1, 5) for i in (0, 2) for a in "xy"]
        self.frame = ef.FrameModel(
            points, elements, sections, supports, n_modes=8, shapes=rows
        )

    def __call__(self, factors: Mapping[str, float]) -> ef.ModalSolution:
        """Return eight modes at 16 sensors, for one set of factors."""
        modes = self.frame({n: np.array([self.E * factors[n]]) for n in self.names})
        return ef.ModalSolution(modes.frequencies[0], modes.shapes[0])


def tower() -> Problem:
    """Return the tower, a function as the engineer with a FE program has it."""
    box = BlackBox(ef.FunctionModel(Tower(), n_modes=8))
    prior = about_one(Tower.names, 0.3, 1.7)
    truth = prior.sample(np.random.default_rng(3), 1)[0]
    values = dict(zip(Tower.names, truth, strict=True))
    measured, terms = measure(ef.FunctionModel(Tower()), values, 6, seed=4)
    paired = ef.PairedModel(box, measured, candidates=8)
    return Problem(ef.LogPosterior(paired, terms, prior), box, 250)


def h_500() -> Problem:
    """Return the H structure with errors of 4.5 %."""
    return h_structure(500.0)


def h_50000() -> Problem:
    """Return the H structure with errors of 0.45 %."""
    return h_structure(5e4)


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "beck_au": beck_au,
    "mass_spring": mass_spring,
    "h_500": h_500,
    "h_50000": h_50000,
    "shear": shear,
    "tower": tower,
}


def main() -> None:
    """Print a line a problem."""
    for name, make in PROBLEMS.items():
        problem = make()
        d, data = problem.posterior.ndim, 0
        for term in problem.posterior.terms:
            data += np.size(term.measured)
        problem.posterior(problem.posterior.start(100, seed=1))
        each = 10 * problem.box.seconds
        print(f"{name}: {d} parameters, {data} data, {each:.3f} ms, {problem.solves}")


if __name__ == "__main__":
    main()
