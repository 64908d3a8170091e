"""Stiffness and mass that scikit-fem assembled, by the DOFs of a basis."""

from collections import Counter
from collections.abc import Hashable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csc_array

from ...models.geometry import Geometry
from ...models.matrices import Matrix, read_matrix
from .exports import DOF_DIRECTIONS, Matrices

# Components of a displacement, as ElementVector names them.
COMPONENTS = {f"u^{i}": axis for i, axis in enumerate(DOF_DIRECTIONS[:3], 1)}
ACROSS = {1: ["uy"], 2: ["uz"]}  # where a deflection u of a beam or a plate points


def from_skfem(basis: Any, K: Matrix, M: Matrix, held: ArrayLike = ()) -> Matrices:
    """Return stiffness and mass from scikit-fem without held DOFs, with names of DOFs.

    Nodes are the vertices of the mesh, with their numbers, as
    ``mesh.nodes_satisfying(lambda x: ...)`` returns them; then one node for each facet,
    edge and element that has DOFs. Displacements of an ``ElementVector`` are named ux,
    uy, uz. Other DOFs have the element's names, such as u, u_x, u_y, u_xy of a plate.

    Args:
        basis: The ``Basis`` of all elements.
        K: The stiffness, ``(N, N)``, as ``form.assemble(basis)`` returns it.
        M: The mass, likewise. Use a consistent mass; with mass on deflections alone,
            other DOFs are massless.
        held: Supported DOFs, as ``basis.get_dofs("root")`` returns them, or
            ``basis.get_dofs("root").all(["u"])`` for those of one name.

    Returns:
        K, M, DOFs such as ``"12:ux"`` or ``"12:u_x"``, and the geometry, with the edges
        of the mesh as lines.

    Raises:
        TypeError: If basis is not a Basis.
        ValueError: If K or M does not match the basis or is not symmetric, held are not
            DOFs of the basis, or no DOF is free.

    Examples:
        >>> from emcee_femu import from_skfem
        >>> def rod():
        ...     from skfem import Basis, ElementLineP1, MeshLine
        ...     from skfem.models import laplace, mass
        ...     basis = Basis(MeshLine().refined(1), ElementLineP1())
        ...     K, M = laplace.assemble(basis), mass.assemble(basis)
        ...     return from_skfem(basis, K, M, held=[0])
        >>> rod().labels  # doctest: +SKIP
        ('1:u', '2:u')
    """
    if not hasattr(basis, "nodal_dofs"):
        raise TypeError(f"basis: expected a Basis, got {type(basis).__name__}")
    every, numbers = np.arange(basis.N), np.asarray(held)
    listed = numbers.ndim == 1 and (numbers.dtype.kind in "iu" or not numbers.size)
    if not listed or not np.isin(numbers, every).all():
        raise ValueError(
            f"held: expected DOFs of the basis, 0 to {basis.N - 1}, as "
            f"basis.get_dofs(...) returns them, got {held!r}"
        )
    free = np.setdiff1d(every, numbers)
    if not free.size:
        raise ValueError("held: no DOF is left free")
    matrices = {}
    for name, given in (("K", K), ("M", M)):
        matrix = read_matrix(name, given, sparse=True)
        if matrix.shape[0] != basis.N:
            raise ValueError(
                f"{name}: expected {basis.N} rows, the DOFs of the basis, got "
                f"{matrix.shape[0]}; take form.assemble(basis), no condensed one"
            )
        matrices[name] = csc_array(matrix[free][:, free])
    dofs, places = _name_dofs(basis)
    lines = getattr(basis.mesh, {1: "t", 2: "facets", 3: "edges"}[basis.mesh.dim()])
    across = ACROSS.get(basis.mesh.dim(), [])
    geometry = Geometry(
        places,
        [(a, b) for a, b in lines.T.tolist() if a in places and b in places],
        {f"{n}:u": (n, axis) for axis in across for n, name in dofs if name == "u"},
    )
    labels = np.array([(str(node), name) for node, name in dofs])[free]
    return Matrices(matrices, labels, "scikit-fem", geometry)


def _name_dofs(basis: Any) -> tuple[list[tuple[int, str]], dict[Hashable, ArrayLike]]:
    """Return node and name of every DOF, and the place of every node.

    DOFs of one name at one facet, as of cubic elements, are nodes of their own.
    """
    dofs = [(0, "")] * basis.N
    places: dict[Hashable, ArrayLike] = {}
    names, first = iter(basis.elem.dofnames), 0
    blocks = basis.nodal_dofs, basis.facet_dofs, basis.edge_dofs, basis.interior_dofs
    for block in blocks:
        times: Counter[str] = Counter()
        for numbers in block:
            name = next(names)
            start = first + times[name] * block.shape[1]
            times[name] += 1
            for node, dof in enumerate(numbers.tolist(), start):
                dofs[dof] = node, COMPONENTS.get(name, name)
                places[node] = np.append(basis.doflocs[:, dof], 0.0)[:3]
        first += block.shape[1] * max(times.values(), default=0)
    return dofs, places
