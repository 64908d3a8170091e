r"""Derivatives of a few modes of sparse matrices, one parameter set at a time.

.. math:: (K - \lambda_i M) x = -(K' - \lambda_i M' - \lambda_i' M) \phi_i, \qquad
    \phi_i' = x - (\phi_i^T M x + \tfrac12 \phi_i^T M' \phi_i) \phi_i

The matrix is singular along the mode; with one DOF of x held it is not, where the mode
is large. That needs no other mode, so that it is exact however few are known. Modes
that coincide are held together, at as many DOFs.

Source: Nelson, AIAA J. 14 (1976) 1201, doi:10.2514/3.7211.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from ...interfaces import Floats
from .blocks import Weight
from .sensitivity import EPS, PARTING, REPEATED, Slope, parting_error

# Rows of a unit matrix that are not zero, and what is in them, (s, N).
Unit: TypeAlias = tuple[NDArray[np.intp], csr_array]


class Pairs(NamedTuple):
    """The elastic modes of one parameter set.

    Attributes:
        K: Stiffness ``(N, N)``.
        M: Mass ``(N, N)``.
        eigenvalues: Ascending, ``(m,)``.
        shapes: Mass-normalised, ``(N, m)``.
        where: Names the parameters in an error message.
    """

    K: csc_array
    M: csc_array
    eigenvalues: Floats
    shapes: Floats
    where: str


def collect_sparse(matrices: Iterable[csc_array]) -> list[Unit]:
    """Return symmetric matrices without their rows of zeros."""
    every = ((np.flatnonzero(np.diff(unit.indptr)), unit) for unit in matrices)
    return [(rows, csr_array(csr_array(unit)[rows])) for rows, unit in every]


def differentiate_pairs(
    pairs: Pairs,
    units: tuple[Sequence[Unit], Sequence[Unit]],
    slopes: Mapping[str, Slope],
    dofs: NDArray[np.intp],
) -> tuple[Floats, Floats]:
    """Return eigenvalue derivatives ``(d, m)`` and those of shapes ``(d, n_dofs, m)``.

    Raises:
        ValueError: If modes coincide that part as a parameter changes, or shapes are
            wanted and the last mode coincides with one above it.
    """
    # K_j phi and M_j phi, where they are not zero.
    forces = [[(rows, unit @ pairs.shapes) for rows, unit in of] for of in units]
    by_part = [[slope[i] for slope in slopes.values()] for i in (0, 1)]
    rounding = _rounding(pairs)
    changes = np.empty((len(slopes), len(pairs.eigenvalues)))
    turns = np.empty((len(slopes), len(dofs), len(pairs.eigenvalues)))
    for cluster in _find_clusters(pairs.eigenvalues, rounding):
        phi = pairs.shapes[:, cluster]
        eigenvalue = float(pairs.eigenvalues[cluster].mean())
        stiff, mass = (
            _add(own, weights, cluster, len(phi))
            for own, weights in zip(forces, by_part, strict=True)
        )
        stiff -= eigenvalue * mass
        H, T = phi.T @ stiff, phi.T @ mass  # (d, c, c)
        changes[:, cluster] = np.diagonal(H, axis1=1, axis2=2)
        if len(cluster) > 1:
            _refuse_parting(pairs, units, cluster, H, slopes)
        if len(dofs):
            least = max(REPEATED * eigenvalue, float(rounding[cluster].max()))
            x = _solve(pairs, cluster, eigenvalue, pairs.M @ phi @ H - stiff, least)
            turns[:, :, cluster] = x[:, dofs] - 0.5 * phi[dofs] @ T
    return changes, turns


def _rounding(pairs: Pairs) -> Floats:
    """Return what is left of equal eigenvalues by rounding, ``(m,)``."""
    size = np.abs(pairs.shapes)
    result: Floats = 10 * EPS * (size * (abs(pairs.K) @ size)).sum(axis=0)
    return result


def _find_clusters(eigenvalues: Floats, rounding: Floats) -> list[NDArray[np.intp]]:
    """Return the modes that coincide; one by itself is a cluster too."""
    least = np.maximum(REPEATED * eigenvalues, rounding)[1:]
    ends = np.flatnonzero(np.diff(eigenvalues) > least) + 1
    return np.split(np.arange(len(eigenvalues)), ends)


def _add(
    forces: Sequence[tuple[NDArray[np.intp], Floats]],
    by_parameter: Sequence[Mapping[int, Weight]],
    cluster: NDArray[np.intp],
    size: int,
) -> Floats:
    """Return the sum over the units of each parameter, ``(d, N, c)``."""
    total = np.zeros((len(by_parameter), size, len(cluster)))
    for own, weights in zip(total, by_parameter, strict=True):
        for number, weight in weights.items():
            rows, force = forces[number]
            own[rows] += weight * force[:, cluster]
    return total


def _solve(
    pairs: Pairs,
    cluster: NDArray[np.intp],
    eigenvalue: float,
    right: Floats,
    least: float,
) -> Floats:
    """Return ``x (d, N, c)`` of ``(K - lambda M) x = right``, M-orthogonal to modes."""
    phi = pairs.shapes[:, cluster]
    N, c = phi.shape
    scaled = phi * np.sqrt(np.abs(pairs.K.diagonal()))[:, None]  # free of DOFs' units
    held = qr(scaled.T, mode="r", pivoting=True)[1][:c]
    kept = np.delete(np.arange(N), held)
    A = csc_array(pairs.K - eigenvalue * pairs.M)[:, kept][kept].tocsc()
    probe = np.random.default_rng(0).normal(size=N)
    load = pairs.M @ probe
    b = np.column_stack([right.transpose(1, 0, 2).reshape(N, -1), load])[kept]
    try:
        factor = splu(
            A,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.01,
            options={"SymmetricMode": True},
        )
        x = np.zeros((N, b.shape[1]))
        x[kept] = factor.solve(b)
        x[kept] += factor.solve(b - A @ x[kept])
        answer = x[:, -1]
        # At least the distance of lambda to the eigenvalues with the DOFs held.
        gap = np.sqrt(probe @ load / (answer @ (pairs.M @ answer)))
    except RuntimeError:  # exactly singular
        gap = 0.0
    if not gap > np.sqrt(N) * least:
        last = int(cluster[-1]) + 1
        raise ValueError(
            f"mode {last} coincides with one above it, which was not asked for, at "
            f"{pairs.where}: its shape has no derivative by itself; ask for n_modes="
            f"{last + 1}"
        )
    by_parameter = x[:, :-1].reshape(N, len(right), c).transpose(1, 0, 2)
    result: Floats = by_parameter - phi @ ((pairs.M @ phi).T @ by_parameter)
    return result


def _refuse_parting(
    pairs: Pairs,
    units: tuple[Sequence[Unit], Sequence[Unit]],
    cluster: NDArray[np.intp],
    H: Floats,
    slopes: Mapping[str, Slope],
) -> None:
    """Raise ValueError unless coinciding modes change alike, with every parameter."""
    size = np.abs(pairs.shapes[:, cluster])
    eigenvalue = float(pairs.eigenvalues[cluster[0]])
    for name, own, slope in zip(slopes, H, slopes.values(), strict=True):
        terms = 0.0
        for of, weights, factor in zip(units, slope, (1.0, eigenvalue), strict=True):
            for number, weight in weights.items():
                rows, unit = of[number]
                part = size[rows] * (abs(unit) @ size)
                terms += factor * float(np.abs(weight)) * float(np.sum(part))
        mean = np.trace(own) / len(cluster)
        if np.abs(own - mean * np.eye(len(cluster))).max() > PARTING * terms:
            low, high = int(cluster[0]) + 1, int(cluster[-1]) + 1
            hertz = np.sqrt(eigenvalue) / (2 * np.pi)
            raise parting_error((low, high), hertz, name, pairs.where)
