"""Stiffness and mass of the current OpenSees model."""

from itertools import pairwise
from types import ModuleType

import numpy as np
from scipy.sparse import csc_array

from ... import checks
from ...contracts import Floats
from ...models.geometry import Geometry
from .exports import Matrices

OUTLINE_NODES = 4  # most nodes of an element whose outline is drawn
# Directions of DOFs beyond the translations, by dimensions and DOFs of a node; others
# than these, such as a pressure, keep a number from 7 on.
OPENSEES_ROTATIONS = {(2, 3): [6], (3, 6): [4, 5, 6]}


def from_opensees(ops: ModuleType) -> Matrices:
    """Read stiffness and mass of the current OpenSees model.

    The integrator GimmeMCK returns M and the tangent K in the present state. The
    constraint handler Transformation removes supports, and DOFs tied by equalDOF,
    rigidDiaphragm or rigidLink, which move with the row of their master. Model and
    state are unchanged, but the current analysis is wiped. OpenSees returns full
    matrices, whose memory grows with the square of the DOFs.

    Args:
        ops: The module: ``import openseespy.opensees as ops``. If its import finds no
            BLAS, see the how-to page on OpenSees.

    Returns:
        K, M, DOFs such as ``"12:ux"`` named by node tags, and the geometry, with
        elements of two to four nodes as lines.

    Raises:
        TypeError: If ops is not this module.
        ValueError: If there is no node, no free DOF or no mass, or if a node is tied
            twice or to a node that is tied itself, which OpenSees handles incorrectly.

    Examples:
        >>> from emcee_femu import from_opensees
        >>> def bar():
        ...     import openseespy.opensees as ops
        ...     ops.wipe()
        ...     ops.model("basic", "-ndm", 2, "-ndf", 3)
        ...     ops.node(1, 0.0, 0.0)
        ...     ops.node(2, 2.0, 0.0)
        ...     ops.fix(1, 1, 1, 1)
        ...     ops.mass(2, 5.0, 5.0, 0.1)
        ...     ops.geomTransf("Linear", 1)
        ...     ops.element("elasticBeamColumn", 1, 1, 2, 3e-3, 2e11, 1e-6, 1)
        ...     return from_opensees(ops)
        >>> bar().labels, round(bar().K[0, 0])  # doctest: +SKIP
        (('2:ux', '2:uy', '2:rz'), 300000000)
    """
    checks.instance("ops", ops, ModuleType)
    nodes = ops.getNodeTags()
    if not nodes:
        raise ValueError(
            "ops: OpenSees holds no model; build it first, with ops.node and "
            "ops.element, and read the matrices before ops.wipe()"
        )
    masters = {node: ops.getRetainedNodes(node) for node in ops.getConstrainedNodes()}
    for node, retained in masters.items():
        if chained := [master for master in retained if master in masters]:
            raise ValueError(
                f"ops: node {node} is tied to node {chained[0]}, which is tied itself; "
                "OpenSees then ties wrong DOFs: tie both to the same master"
            )
    untied, count = {}, 0  # DOFs of each node; those of them that are free
    for node in nodes:
        tied = ops.getConstrainedDOFs(node)
        directions = range(1, ops.getNDF(node)[0] + 1)
        untied[node] = [direction for direction in directions if direction not in tied]
        count += len({*untied[node]} - {*ops.getFixedDOFs(node)})
    if not count:
        raise ValueError("ops: every DOF is held or tied; OpenSees has no equation")
    K, M = (_assemble(ops, *factors) for factors in ((0.0, 1.0), (1.0, 0.0)))
    if len(K) != count:
        raise ValueError(
            f"ops: {count} DOFs are free, but OpenSees has {len(K)} equations: of "
            "several ties of one node it keeps the first; tie all in one equalDOF"
        )
    if not M.any():
        raise ValueError(
            "ops: the model has no mass; give it to nodes, ops.mass(node, ...), or to "
            "elements, '-mass' or '-rho'"
        )
    dofs = {}
    for node, kept in untied.items():
        dimensions, size = len(ops.nodeCoord(node)), ops.getNDF(node)[0]
        others = OPENSEES_ROTATIONS.get((dimensions, size), range(7, 7 + size))
        names = [*range(1, min(dimensions, size) + 1), *others]
        # Rows of a master follow the node's own ones; zip leaves them out.
        for row, direction in zip(ops.nodeDOFs(node), kept, strict=False):
            dofs[row] = node, names[direction - 1]
    ops.wipeAnalysis()
    labels = np.array([dofs[row] for row in range(count)])
    matrices = {"K": csc_array(K), "M": csc_array(M)}
    return Matrices(matrices, labels, "OpenSees", _locate(ops, nodes))


def _assemble(ops: ModuleType, mass: float, stiffness: float) -> Floats:
    """Return the matrix that a step of GimmeMCK assembles."""
    ops.wipeAnalysis()
    ops.system("FullGeneral")  # the system that hands out its matrix
    ops.numberer("Plain")
    ops.constraints("Transformation")
    ops.algorithm("Linear")
    ops.integrator("GimmeMCK", mass, 0.0, stiffness)  # M, C, K
    ops.analysis("Transient")
    ops.analyze(1, 0.0)  # assembles; that M is singular does no harm
    size = ops.systemSize()
    return np.array(ops.printA("-ret")).reshape(size, size)


def _locate(ops: ModuleType, nodes: list[int]) -> Geometry:
    elements = [ops.eleNodes(element) for element in ops.getEleTags()]
    outlines = [
        e if len(e) == 2 else [*e, e[0]] for e in elements if len(e) <= OUTLINE_NODES
    ]
    return Geometry(
        {node: [*ops.nodeCoord(node), 0.0][:3] for node in nodes},
        [line for outline in outlines for line in pairwise(outline)],
    )
