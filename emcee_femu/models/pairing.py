"""MAC, one-to-one choices, and the clusters of modes that are too close to tell."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from .. import checks
from ..interfaces import Floats
from ..measurements.modes import scaled

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

    Example:
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
    first, second = scaled(first), scaled(second)
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
    if n_rows == n_sensors:
        every = np.arange(n_rows)
        if (
            dofs is not None
            and (np.sort(dofs) == every).all()
            and (dofs != every).any()
        ):
            raise ValueError(
                f"dofs: {n_rows} sensors at all {n_rows} rows of the model's shapes, "
                f"in another order ({dofs.tolist()}): are the rows DOFs, or sensors "
                "already? List the sensors in the order of the DOFs"
            )
        return shapes
    if dofs is None or dofs.max() >= n_rows:
        given = "None" if dofs is None else f"DOFs up to {dofs.max()}"
        raise ValueError(
            f"dofs: expected the rows of {n_sensors} sensors among the {n_rows} of the "
            f"model's shapes, got {given}"
        )
    return np.ascontiguousarray(shapes[:, dofs])


def one_to_one(score: Floats) -> NDArray[np.intp]:
    """Return the columns ``(n, p)`` of the best one-to-one choices of ``(n, p, q)``."""
    best: NDArray[np.intp] = score.argmax(axis=2)
    ordered = np.sort(best, axis=1)
    # Where the best ones differ they are the answer, and usually they do.
    repeated = ordered[:, 1:] == ordered[:, :-1]
    for row in np.flatnonzero(repeated.any(axis=1)):
        best[row] = linear_sum_assignment(score[row], maximize=True)[1]
    return best


def cluster_bases(shapes: Floats, close: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return orthonormal bases of the clusters, and who shares one, ``(n, q, q)``.

    Gram-Schmidt for all rows at once, twice for accuracy; a mode alone in its cluster
    is its own basis.
    """
    n, _, q = shapes.shape
    number = np.zeros((n, q), dtype=int)
    np.cumsum(~close, axis=1, out=number[:, 1:])
    together = (number[:, :, None] == number[:, None, :]).astype(float)
    basis = shapes.copy()
    for j in range(1, q):
        earlier, mask = basis[:, :, :j], together[:, :j, j, None]
        vector = basis[:, :, j, None]
        for _ in range(2):
            vector = vector - earlier @ (mask * (earlier.transpose(0, 2, 1) @ vector))
        length = np.linalg.norm(vector, axis=1, keepdims=True)
        basis[:, :, j, None] = np.divide(
            vector, length, out=np.zeros_like(vector), where=length > DEPENDENT
        )
    return basis, together
