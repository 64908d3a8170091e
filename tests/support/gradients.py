"""Models whose response and derivatives are known, for tests of gradients."""

from dataclasses import dataclass, field

import numpy as np

import emcee_femu as ef

MEASURED = np.array([1.02, 1.43, 2.1])
RNG = np.random.default_rng(7)
SHAPES = RNG.standard_normal((4, 3))
SLOPES = 0.2 * RNG.standard_normal((4, 3, 2))  # of the shapes, by a and b
POWERS = np.array([[0.5, 0.0], [0.3, 0.2], [0.1, 0.6]])  # ln f = powers . ln(a, b)


def modes(a, b):
    """Return frequencies and shapes; a and b may be complex, ``(n,)``."""
    logs = np.log(np.stack([a, b], axis=1))
    shapes = SHAPES + np.einsum("smj,nj->nsm", SLOPES, np.stack([a - 1, b - 1], axis=1))
    return MEASURED * np.exp(logs @ POWERS.T), shapes


@dataclass
class Solver:
    """Modes of two parameters; ``solved`` has the size of every batch."""

    solved: list = field(default_factory=list)
    names = ("a", "b")
    variables = ef.modal_variables(3) | {"shapes": ef.Variable({}, stored=False)}

    def __call__(self, parameters):
        self.solved.append(len(parameters["a"]))
        return ef.ModalSolution(*modes(parameters["a"], parameters["b"]))


class Derived(Solver):
    """The same with derivatives."""

    def jacobian(self, parameters):
        solution = self(parameters)
        by_name = {"frequency": {}, "shapes": {}}
        for j, name in enumerate("ab"):
            relative = POWERS[:, j] / parameters[name][:, None]
            by_name["frequency"][name] = solution.frequencies * relative
            by_name["shapes"][name] = np.broadcast_to(
                SLOPES[:, :, j], solution.shapes.shape
            )
        return solution, by_name


PRIOR = ef.GaussianPrior(["a", "b"], [1.0, 1.0], 0.1, [(0.9, 1.4), (0.5, 1.05)])
TERM = ef.FrequencyTerm(MEASURED, relative_sd=0.05)


class Failing(Derived):
    """It cannot be solved in the middle of its posterior."""

    def __call__(self, parameters):
        if (np.abs(parameters["a"] - 1.1) < 0.02).any():
            raise ArithmeticError("no convergence")
        return super().__call__(parameters)


def numerical(function, theta, step=1e-5):
    """Return central differences ``(n, d)`` of a function of ``(n, d)``."""
    columns = []
    for unit in np.eye(theta.shape[1]):
        ahead, behind = function(theta + step * unit), function(theta - step * unit)
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=1)


class Crossing:
    """Two oscillators, each at its own sensor: modes of a and b that change places."""

    names = ("a", "b")
    variables = ef.modal_variables(2, range(2))

    def __call__(self, parameters):
        values = np.column_stack([parameters["a"], parameters["b"]])
        shapes = np.eye(2)[np.argsort(values, axis=1)].transpose(0, 2, 1)
        return ef.ModalSolution(np.sort(values, axis=1), shapes)


LINEAR = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, -0.7], [0.4, 0.0, 1.0], [1.0, 1.0, 1.0]])
DATA = np.array([0.3, -0.2, 0.5, 0.1])


class LinearModel:
    """A response y that is linear in three parameters."""

    names = ("a", "b", "c")
    variables = {"y": ef.Variable({"point": range(4)})}

    def __call__(self, parameters):
        return {"y": np.stack([parameters[n] for n in self.names], axis=1) @ LINEAR.T}


class LinearDerived(LinearModel):
    """The same with derivatives."""

    def jacobian(self, parameters):
        response = self(parameters)
        slopes = {
            name: np.broadcast_to(LINEAR[:, j], response["y"].shape)
            for j, name in enumerate(self.names)
        }
        return response, {"y": slopes}


@dataclass
class LinearTerm(ef.likelihoods.term.Term):
    """Independent Gaussian errors of some of the data."""

    first: int = 0
    last: int = 4
    sd: float = 0.2

    def deviations(self, parameters, response):
        points = slice(self.first, self.last)
        r = response["y"][:, points] - DATA[points]
        return r, np.full_like(r, self.sd)
