r"""The batched eigenproblem K phi = omega^2 M phi of dense matrices, with derivatives.

.. math:: \lambda_i' = \phi_i^T (K' - \lambda_i M') \phi_i, \qquad
    f_i' = \frac{\lambda_i'}{8 \pi^2 f_i}

of mass-normalised shapes that keep their signs. Derivatives of shapes are sums over
all modes, which a dense solver returns:

.. math:: \phi_i' = \sum_{k \ne i} \frac{\phi_k^T (K' - \lambda_i M') \phi_i}
    {\lambda_i - \lambda_k} \phi_k - \tfrac12 (\phi_i^T M' \phi_i) \phi_i

Modes coincide where their eigenvalues do, to 1e-10 or to rounding. If they stay
together as a parameter changes, their frequencies have a derivative; that of the shapes
is then without turning in the space that they span, in which they are any. If they
part, there is no derivative.

Source: Fox and Kapoor, AIAA J. 6 (1968) 2426, doi:10.2514/3.5008.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..contracts import Derivatives, Floats, ModalSolution, RepeatedModes
from .matrices import Matrix, Weights
from .parameter_sets import Where
from .sensors import Sensors

EPS = float(np.finfo(float).eps)
RIGID_RATIO = 1e-4  # a rigid-body eigenvalue is below this share of the next one
REPEATED = 1e-10  # relative gap of eigenvalues below which modes coincide
# Ratio of the largest K_ii / M_ii, all of which are between the eigenvalues, to the
# median: with 1e12 the lowest frequencies are off by 1e-4, and the error grows with it.
BLURRED = 1e9
PARTING = 1e-7  # share of a derivative's terms that may be left by rounding
# Why a mode is not elastic, in messages.
NOT_POSITIVE = (
    "the stiffness matrix is not positive there; give the prior bounds that keep "
    "stiffnesses and masses above zero"
)
A_MECHANISM = (
    "as of a rigid-body mode or a mechanism beyond skip={}: do the supports hold the "
    "structure, and each joint its bars? A free structure has skip=6, in a plane 3"
)

# How the coefficients of K (n, n_k), and those of M (n, n_m), change with a parameter;
# one row where that is the same for all parameter sets.
Slopes: TypeAlias = Mapping[str, tuple[Floats, ...]]
Modes: TypeAlias = tuple[ModalSolution, Derivatives]  # what a solve returns


class ModeRequest(NamedTuple):
    """The modes that are wanted of an eigenproblem.

    Attributes:
        modes: Which elastic modes, 1 = the lowest, ascending.
        skip: Number of rigid-body modes below them, checked at each solve.
        sensors: What is wanted of mass-normalised shapes.
    """

    modes: Sequence[int]
    skip: int
    sensors: Sensors


class Eigenproblem:
    r"""``K(a) = K0 + sum a_i K_i`` and ``M(b) = M0 + sum b_j M_j``, dense.

    .. math:: L L^T = M, \qquad A = L^{-1} K L^{-T}, \qquad A y = \omega^2 y,
        \qquad \phi = L^{-T} y, \qquad f = \omega / 2 \pi

    A constant M is folded into all K once, so that a batch is one
    ``numpy.linalg.eigvalsh``; otherwise the Cholesky factors are batched.

    Args:
        K: Stiffness matrices: K0, then those of unit coefficients, ``(1 + n_k, N, N)``.
        M: Mass matrices, likewise, ``(1 + n_m, N, N)``.
        wanted: The wanted modes.
        output: Maps mass-normalised shapes to what is returned of them, ``(n_out, N)``;
            without rows for frequencies alone.
        label: What M0 is called in a message.

    Attributes:
        stiffness: K as a function of its coefficients ``(n_k,)``.
        mass: M as a function of its coefficients ``(n_m,)``.

    Raises:
        ValueError: If the mass is constant and not positive definite.
    """

    def __init__(
        self,
        K: Floats,
        M: Floats,
        wanted: ModeRequest,
        output: Floats,
        label: str = "M0",
    ) -> None:
        self.skip, self.folded = wanted.skip, len(M) == 1
        self.selected = self.skip + np.array(wanted.modes) - 1
        self.K, self.M, self.output = K, M, output
        self.stiffness, self.mass = partial(combine_one, K), partial(combine_one, M)
        if self.folded:  # from here on y stands for the shapes
            try:
                inverse = np.linalg.inv(np.linalg.cholesky(M[0]))
            except np.linalg.LinAlgError:
                raise ValueError(
                    f"{label} is not positive definite: remove massless DOFs by static "
                    "condensation, or give scipy.sparse matrices; or are K0 and M0 "
                    "swapped?"
                ) from None
            self.K, self.output = inverse @ K @ inverse.T, output @ inverse.T

    def solve(self, weights: Weights, describe: Where, slopes: Slopes) -> Modes:
        """Solve for coefficients ``k (n, n_k)`` and ``m (n, n_m)``.

        ``describe(i)`` names parameter set i in an error message. ``slopes`` say how
        ``k`` and ``m`` change with each parameter, by which there are derivatives.

        Raises:
            ValueError: If there are no such modes; or if modes coincide that part as a
                parameter changes: which of them is the lower one changes there.
        """
        (k, m), selected = weights, self.selected
        shaped = len(self.output) > 0
        eigenvalues, every = self._decompose(k, m, describe, shaped or bool(slopes))
        wanted = every.take(selected, axis=2)
        solution = ModalSolution(
            np.sqrt(eigenvalues.take(selected, axis=1)) / (2 * np.pi),
            self.output @ wanted if shaped else None,
        )
        variables = ["frequency", "shapes"] if shaped else ["frequency"]
        derivatives: Derivatives = {name: {} for name in variables}
        if not slopes:
            return solution, derivatives
        squares = eigenvalues[:, None, selected]
        together = self._find_clusters(eigenvalues, every, slopes, describe)
        # Without shapes nothing but the diagonal of H is needed: of other modes none.
        count = np.arange(len(selected))
        left, diagonal = (every, selected) if shaped else (wanted, count)
        in_K, in_M = (
            np.array([left.swapaxes(1, 2) @ (A @ wanted) for A in part[1:]]).reshape(
                -1, len(k), left.shape[2], len(selected)
            )
            for part in (self.K, self.M)
        )
        gaps = squares - eigenvalues[:, :, None]
        inverse = np.where(together, 0.0, 1.0 / np.where(together, 1.0, gaps))
        scale = 8 * np.pi**2 * solution.frequencies
        for name, (by_k, by_m) in slopes.items():
            T = _weigh(in_M, by_m)
            H = _weigh(in_K, by_k) - squares * T
            derivatives["frequency"][name] = H[:, diagonal, count] / scale
            if shaped:
                turn = inverse * H - 0.5 * together * T
                derivatives["shapes"][name] = self.output @ (every @ turn)
        return solution, derivatives

    def _decompose(
        self, k: Floats, m: Floats, describe: Where, vectors: bool
    ) -> tuple[Floats, Floats]:
        """Return eigenvalues, and shapes, none unless ``vectors``."""
        A = combine(self.K, k)
        y = basis = self.K[:0]  # folded: the shapes are y
        if not self.folded:
            mass = combine(self.M, m)
            try:
                inverse = np.linalg.inv(np.linalg.cholesky(mass))
            except np.linalg.LinAlgError:
                bad = int(np.argmin(np.linalg.eigvalsh(mass)[:, 0]))
                raise ValueError(
                    f"the mass matrix is not positive definite at {describe(bad)}"
                ) from None
            basis = inverse.transpose(0, 2, 1)
            A = inverse @ A @ basis
        try:
            if vectors:
                eigenvalues, y = np.linalg.eigh(A)
            else:
                eigenvalues = np.linalg.eigvalsh(A)
        except np.linalg.LinAlgError:  # infinite or NaN entries
            bad = int(np.argmin(np.isfinite(A).all(axis=(1, 2))))
            raise ValueError(f"parameters: no eigenvalues at {describe(bad)}") from None
        # What a zero eigenvalue may come out as; grows like a random walk.
        rounding = 10 * EPS * math.sqrt(eigenvalues.shape[1]) * eigenvalues[:, -1]
        check_elastic(eigenvalues, rounding, self.skip, describe)
        return eigenvalues, y if self.folded or not vectors else basis @ y

    def _find_clusters(
        self, eigenvalues: Floats, shapes: Floats, slopes: Slopes, describe: Where
    ) -> NDArray[np.bool_]:
        """Return which modes coincide with each wanted one, ``(n, N, m)``."""
        rounding = EPS * np.sqrt(eigenvalues.shape[1]) * eigenvalues[:, -1:]
        least = np.maximum(REPEATED * eigenvalues[:, 1:], rounding)
        clusters = np.zeros(eigenvalues.shape, dtype=np.intp)
        clusters[:, 1:] = np.cumsum(np.diff(eigenvalues) > least, axis=1)
        together = np.equal(clusters[:, :, None], clusters[:, None, self.selected])
        units = [*self.K[1:], *self.M[1:]]
        for row, column in np.argwhere(together.sum(axis=1) > 1).tolist():
            members = np.flatnonzero(together[row, :, column])
            phi, value = shapes[row][:, members], float(eigenvalues[row, members[0]])
            first, at = int(members[0]) - self.skip + 1, at_row(slopes, row)
            check_differentiable(phi, value, first, units, at, describe(row))
        return np.asarray(together)


def _weigh(parts: Floats, weights: Floats) -> Floats:
    """Return the sum of ``parts (n_units, n, ..)`` by ``weights (n, n_units)``."""
    total = np.zeros((1, 1, 1))
    for unit in np.flatnonzero(weights.any(axis=0)):  # of few units
        total = total + weights[:, unit, None, None] * parts[unit]
    return total


def combine(terms: Floats, coefficients: Floats) -> Floats:
    """Return ``terms[0] + sum_i coefficients[:, i] terms[1 + i]``, ``(n, N, N)``."""
    # No BLAS: it rounds few rows otherwise than many, which a run that goes on after a
    # kill may see, for gradients of some walkers then are those of all now.
    total: Floats = np.einsum("np,pij->nij", coefficients, terms[1:])
    total += terms[0]
    return total


def combine_one(terms: Floats, coefficients: Floats) -> Floats:
    """Return the sum for the coefficients ``(n_units,)`` of one parameter set."""
    return np.asarray(combine(terms, coefficients[None])[0])


def join(results: Sequence[Modes]) -> Modes:
    """Return the results of parameter sets that were solved one after another."""
    solutions, slopes = zip(*results, strict=True)
    fields = zip(*solutions, strict=True)
    whole = (None if one[0] is None else np.concatenate(one) for one in fields)
    return ModalSolution._make(whole), {
        variable: {
            name: np.concatenate([each[variable][name] for each in slopes])
            for name in by
        }
        for variable, by in slopes[0].items()
    }


def find_ill_scaled(stiffness: Floats, mass: Floats) -> NDArray[np.bool_]:
    """Return where large stiffnesses round the lowest eigenvalues away, ``(n,)``.

    Args:
        stiffness: Diagonals of K, ``(n, N)``.
        mass: The same of M.
    """
    ratios = stiffness / np.where(mass > 0, mass, np.inf)  # others are refused
    if ratios.max() <= BLURRED * ratios.min():  # the median, which takes long, is above
        return np.zeros(len(ratios), dtype=bool)
    usual = np.median(ratios, axis=1)
    return np.asarray((usual > 0) & (ratios.max(axis=1) > BLURRED * usual))


def check_elastic(
    eigenvalues: Floats, rounding: Floats, skip: int, describe: Where
) -> None:
    """Raise ValueError unless exactly ``skip`` eigenvalues are zero, in each row.

    Args:
        eigenvalues: Ascending, ``(n, skip + 1)`` or more.
        rounding: What a zero eigenvalue may come out as, ``(n,)``.
        skip: The expected number of rigid-body modes.
        describe: Names row i in the message.
    """
    first = eigenvalues[:, skip]
    flexible = first > rounding
    if not flexible.all():
        i = int(np.argmin(flexible))
        why = NOT_POSITIVE
        if first[i] >= -rounding[i]:
            why = (
                f"it is zero but for rounding, {A_MECHANISM.format(skip)}; or it is "
                f"hidden by rounding {_compare(rounding[i], first[i])}"
            )
        raise ValueError(
            f"mode {skip + 1} is not elastic (omega^2 = {first[i]:.3g} (rad/s)^2) "
            f"at {describe(i)}: {why}"
        )
    if skip:
        rigid = np.abs(eigenvalues[:, skip - 1])
        is_rigid = rigid <= np.maximum(RIGID_RATIO * first, rounding)
        if not is_rigid.all():
            i = int(np.argmin(is_rigid))
            raise ValueError(
                f"skip={skip}, but mode {skip} is elastic: "
                f"{np.sqrt(rigid[i]) / (2 * np.pi):.4g} Hz at {describe(i)}; "
                "the structure has fewer rigid-body modes, or this is rounding "
                f"{_compare(rounding[i], rigid[i])}"
            )


def _compare(rounding: float, eigenvalue: float) -> str:
    """Return how much stiffer the stiffest part of a structure is than a mode."""
    stiffest = rounding / (10 * EPS)
    ratio = stiffest / max(abs(eigenvalue), rounding * EPS)
    return (
        f"beside the stiffest part ({stiffest:.0e} (rad/s)^2, a ratio of {ratio:.0e}): "
        "make rigid links softer, or export the matrices with more digits"
    )


def at_row(slopes: Slopes, row: int) -> Slopes:
    """Return the slopes of one parameter set, ``(1, n_k)`` and ``(1, n_m)``."""
    return {
        name: tuple(part[[row % len(part)]] for part in parts)
        for name, parts in slopes.items()
    }


def check_differentiable(
    phi: Floats,
    eigenvalue: float,
    first: int,
    units: Sequence[Matrix],
    slopes: Slopes,
    where: str,
) -> None:
    """Raise RepeatedModes unless coinciding modes change alike, with every parameter.

    Args:
        phi: Their shapes, ``(N, c)``.
        eigenvalue: That of all of them.
        first: The number of the first of them, 1 = the lowest elastic one.
        units: What the coefficients multiply, those of K and then those of M.
        slopes: How these change here.
        where: Names the parameters.
    """
    c, size = phi.shape[1], np.abs(phi)
    parts = np.array([phi.T @ (A @ phi) for A in units]).reshape(-1, c, c)
    sizes = np.array([(size * (abs(A) @ size)).sum() for A in units])
    for name, (by_k, by_m) in slopes.items():
        weights = np.append(by_k, -eigenvalue * by_m)
        H = np.tensordot(weights, parts, 1)
        gap = H - np.trace(H) / c * np.eye(c)
        if np.abs(gap).max() > PARTING * np.abs(weights) @ sizes:
            raise RepeatedModes(
                f"modes {first} and {first + c - 1} coincide "
                f"({np.sqrt(eigenvalue) / (2 * np.pi):.6g} Hz) at {where} and separate "
                f"as {name!r} changes: they change places there, and so have no "
                "derivatives; move the parameters by 1e-6 of their values, or "
                "replace those that make the two modes equal by one parameter"
            )
