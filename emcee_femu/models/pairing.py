"""MAC, one-to-one choices, and the clusters of modes that are too close to tell."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from .. import checks
from ..interfaces import Floats

DEPENDENT = 1e-8  # a shape that the others of its cluster span at the sensors


def mac(a: ArrayLike, b: ArrayLike) -> Floats:
    r"""Return the modal assurance criterion of every shape of a with every one of b.

    .. math:: MAC_{ij} = \frac{|a_i^H b_j|^2}{(a_i^H a_i) (b_j^H b_j)} \in [0, 1]

    Args:
        a: Shapes ``(..., n_sensors, p)``, real or complex, of any scale and sign.
        b: Shapes ``(..., n_sensors, q)``; leading axes broadcast.

    Returns:
        ``(..., p, q)``; 0 for a shape that is zero at all sensors.

    Raises:
        TypeError: If an array does not hold numbers.
        ValueError: If an array has fewer than two axes, a number is not finite, or the
            sensors differ in number.

    Source: Allemang and Brown (1982), A correlation coefficient for modal vector
    analysis, Proc. IMAC 1, 110-116.

    Examples:
        >>> mac([[1.0, 1.0], [1.0, -1.0]], [[2.0, 1.0], [2.0, 0.0]]).round(2).tolist()
        [[1.0, 0.5], [0.0, 0.5]]
    """
    first, second = checks.complex_array("a", a), checks.complex_array("b", b)
    if first.ndim < 2 or second.ndim < 2 or first.shape[-2] != second.shape[-2]:
        raise ValueError(
            "a, b: expected shapes (..., n_sensors, n_modes) of the same sensors, got "
            f"{first.shape} and {second.shape}"
        )
    for argument, shapes in (("a", first), ("b", second)):
        if not np.isfinite(shapes).all():
            raise ValueError(f"{argument}: expected finite shapes, got NaN or infinity")
    product = np.abs(np.swapaxes(first.conj(), -1, -2) @ second) ** 2
    squares = [(np.abs(shapes) ** 2).sum(axis=-2) for shapes in (first, second)]
    norms = squares[0][..., :, None] * squares[1][..., None, :]
    result: Floats = np.divide(
        product, norms, out=np.zeros(product.shape), where=norms > 0
    )
    return result


def at_sensors(shapes: Floats, dofs: NDArray[np.intp] | None, n_sensors: int) -> Floats:
    """Return the rows of a model's shapes that belong to the sensors, in their order.

    Args:
        shapes: ``(n, n_rows, n_modes)``, at all DOFs of the model or at the sensors.
        dofs: The sensors' rows among all DOFs; None if rows and sensors correspond.
        n_sensors: The number of sensors.

    Raises:
        ValueError: If the rows cannot be told: too few, or dofs that reorder as many
            rows as there are sensors.
    """
    n_rows = shapes.shape[1]
    numbers = None if dofs is None or dofs.dtype.kind == "U" else dofs
    if n_rows == n_sensors:
        every = np.arange(n_rows)
        if (
            numbers is not None
            and (np.sort(numbers) == every).all()
            and (numbers != every).any()
        ):
            raise ValueError(
                f"dofs: {n_rows} sensors at all {n_rows} rows of the model's shapes, "
                f"in another order ({numbers.tolist()}): are the rows DOFs, or sensors "
                "already? List the sensors in the order of the DOFs"
            )
        return shapes
    if numbers is None or numbers.max() >= n_rows:
        given = "None" if dofs is None else str(dofs.tolist())
        remedy = "; give Measurements(dofs=[...])" if dofs is None else ""
        raise ValueError(
            f"dofs: expected the rows of {n_sensors} sensors among the {n_rows} of the "
            f"model's shapes, got {given}{remedy}"
        )
    return np.ascontiguousarray(shapes[:, numbers])


def one_to_one(score: Floats) -> NDArray[np.intp]:
    """Return the columns ``(n, p)`` of the best one-to-one choices of ``(n, p, q)``."""
    best: NDArray[np.intp] = score.argmax(axis=2)
    ordered = np.sort(best, axis=1)
    # Where the best ones differ they are the answer, and usually they do.
    repeated = ordered[:, 1:] == ordered[:, :-1]
    for row in np.flatnonzero(repeated.any(axis=1)):
        best[row] = linear_sum_assignment(score[row], maximize=True)[1]
    return best


def couple_modes(frequencies: Floats, min_gap: float) -> Floats:
    """Return how far each mode shares its space with each other, ``(n, q, q)``.

    1 for neighbours nearer than half of ``min_gap``, 0 beyond it, a smooth passage
    between; along a row of close neighbours the weakest link counts.
    """
    with np.errstate(invalid="ignore"):  # infinite ones, which LogPosterior refuses
        gaps = np.diff(frequencies, axis=1) / (min_gap * frequencies[:, :-1])
    x = np.clip(2.0 * np.nan_to_num(gaps, nan=np.inf) - 1.0, 0.0, 1.0)
    links = 1.0 - x * x * (3.0 - 2.0 * x)  # (n, q - 1)
    n, q = frequencies.shape
    coupling = np.broadcast_to(np.eye(q), (n, q, q)).copy()
    for i in range(q - 1):
        weakest = np.minimum.accumulate(links[:, i:], axis=1)
        coupling[:, i, i + 1 :] = coupling[:, i + 1 :, i] = weakest
    return coupling


def share_shapes(
    measured: Floats, shapes: Floats, coupling: Floats
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], Floats, Floats]:
    r"""Return MAC and shape of the coupled modes, widened by those they are coupled to.

    .. math:: v = \sum_k c_k q_k q_k^T \phi^m, \qquad
        MAC = \frac{(\sum_k c_k t_k^2)^2}{\sum_k c_k^2 t_k^2}, \quad
        t_k = q_k^T \phi^m

    with the orthonormal :math:`q_k` of the mode itself and its neighbours, in the order
    of their coupling, so that one whose coupling fades takes nothing with it. Sums run
    term by term, so that a row rounds alike alone and among many.

    Args:
        measured: Unit shapes ``(n_sensors, p)``.
        shapes: Unit shapes of the model's modes, ``(n, n_sensors, q)``.
        coupling: ``(n, q, q)``.

    Returns:
        The rows and the modes that are coupled, ``m`` of them, their MAC ``(m, p)`` and
        shapes ``(m, n_sensors, p)``.
    """
    neighbours = (coupling > 0).sum(axis=2)
    rows, modes = np.nonzero(neighbours > 1)
    coupled = coupling[rows, modes]
    most = int(neighbours.max())
    order = np.argsort(-coupled, axis=1, kind="stable")[:, :most]  # itself first
    weights = np.take_along_axis(coupled, order, axis=1)
    basis = np.take_along_axis(shapes[rows], order[:, None], axis=2)
    first = second = np.zeros((len(rows), measured.shape[1]))
    shared = np.zeros((len(rows), *measured.shape))
    for k in range(most):
        vector = basis[:, :, k]
        for _ in range(2 if k else 0):  # Gram-Schmidt, twice for accuracy
            dots = (basis[:, :, :k] * vector[:, :, None]).sum(axis=1)
            for j in range(k):
                vector = vector - dots[:, j, None] * basis[:, :, j]
        if k:
            length = np.sqrt((vector.T**2).sum(axis=0))[:, None]
            vector = np.divide(
                vector, length, out=np.zeros_like(vector), where=length > DEPENDENT
            )
            basis[:, :, k] = vector
        along = (vector[:, :, None] * measured).sum(axis=1)
        weighted = weights[:, k, None] * along
        first = first + weighted * along
        second = second + weighted**2
        shared += vector[:, :, None] * weighted[:, None]
    mac = np.divide(first**2, second, out=np.zeros_like(first), where=second > 0)
    return (rows, modes), mac, shared
