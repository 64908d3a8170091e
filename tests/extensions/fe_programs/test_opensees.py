"""OpenSees: matrices and names against its own static analysis and eigenvalues."""

import numpy as np
import pytest
from scipy.linalg import eigh
from support.examples import load

import emcee_femu as ef

THETA = {"lower columns": 0.7, "upper columns": 1.3, "beams": 0.8}
DIRECTIONS = {2: ("ux", "uy", "rz"), 3: ("ux", "uy", "uz", "rx", "ry", "rz")}


@pytest.fixture
def frame():
    """The page: a plane frame whose floors are tied by equalDOF."""
    return load("how_to/opensees")


@pytest.fixture
def ops(frame):
    try:
        program = frame.load_opensees()
    except ImportError as error:
        pytest.skip(str(error))
    yield program
    program.wipe()


def build_cantilever(ops, nodes=4, *, mass=True):
    """Bars along x in the plane, held at node 1."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("Linear", 1)
    for node in range(1, nodes + 1):
        ops.node(node, 2.0 * node, 0.0)
    ops.fix(1, 1, 1, 1)
    line_mass = ("-mass", 3.0, "-cMass") if mass else ()
    for bar in range(1, nodes):
        ops.element(
            "elasticBeamColumn", bar, bar, bar + 1, 2.0, 5.0, 7.0, 1, *line_mass
        )


def build_tower(ops):
    """A storey of four columns in space; a rigid diaphragm, of lumped masses."""
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    ops.geomTransf("Linear", 1, 1.0, 0.0, 0.0)
    for i, (x, y) in enumerate(((0, 0), (4, 0), (4, 3), (0, 3)), 1):
        ops.node(i, float(x), float(y), 0.0)
        ops.fix(i, *[1] * 6)
        ops.node(10 + i, float(x), float(y), 3.0)
        ops.mass(10 + i, 9.0, 9.0, 9.0, 0.5, 0.6, 0.7)
        inertia = 1e-4 * i
        section = (0.01, 2e9, 8e8, 2e-4, inertia, 2 * inertia)
        ops.element("elasticBeamColumn", i, i, 10 + i, *section, 1)
    ops.node(20, 1.8, 1.4, 3.0)
    ops.fix(20, 0, 0, 1, 1, 1, 0)
    ops.mass(20, 50.0, 50.0, 0.0, 0.0, 0.0, 80.0)
    ops.rigidDiaphragm(3, 20, 11, 12, 13, 14)


def check_eigenvalues(ops, base, count):
    """Compare with the eigenvalues of OpenSees, of the model that stands there."""
    ops.wipeAnalysis()
    ops.constraints("Transformation")
    ops.numberer("RCM")
    theirs = np.array(ops.eigen("-genBandArpack", count))
    squares = eigh(base.K.toarray(), base.M.toarray(), eigvals_only=True)[:count]
    np.testing.assert_allclose(np.sqrt(squares), np.sqrt(theirs), rtol=1e-7)


def check_rows(ops, build, base):
    """A unit load at each DOF moves the nodes by the column of the flexibility."""
    flexibility = np.linalg.inv(base.K.toarray())
    dofs = []
    for label in base.labels:
        node, direction = label.split(":")
        names = DIRECTIONS[len(ops.nodeCoord(int(node)))]
        dofs.append((int(node), names.index(direction) + 1))
    for column, (node, direction) in enumerate(dofs):
        build()
        values = np.zeros(ops.getNDF(node)[0])
        values[direction - 1] = 1e3
        ops.timeSeries("Linear", 1)
        ops.pattern("Plain", 1, 1)
        ops.load(node, *values.tolist())
        ops.system("BandGeneral")
        ops.numberer("RCM")
        ops.constraints("Transformation")
        ops.integrator("LoadControl", 1.0)
        ops.algorithm("Linear")
        ops.analysis("Static")
        assert ops.analyze(1) == 0
        moved = [ops.nodeDisp(*dof) for dof in dofs]
        expected = 1e3 * flexibility[:, column]
        scale = np.abs(expected).max()
        np.testing.assert_allclose(moved, expected, rtol=1e-8, atol=1e-10 * scale)


def test_a_frame_with_tied_floors(frame, ops):
    base = frame.assemble(ops, THETA)
    assert len(set(base.labels)) == base.size == 14
    assert not {"12:ux", "13:ux", "22:ux"} & {*base.labels}  # they move with 11 and 21
    check_eigenvalues(ops, base, 5)
    check_rows(ops, lambda: frame.build(ops, THETA), base)
    with pytest.raises(ValueError, match=r"'12:ux': node 12 has .*held or tied"):
        base.dofs("12:ux")


def test_a_rigid_diaphragm_in_space(ops):
    build_tower(ops)
    base = ef.from_opensees(ops)
    master = [label for label in base.labels if label.startswith("20:")]
    assert master == ["20:ux", "20:uy", "20:rz"] and base.size == 15
    check_eigenvalues(ops, base, 8)
    check_rows(ops, lambda: build_tower(ops), base)


def test_geometry_has_the_places_and_the_elements(frame, ops):
    geometry = frame.assemble(ops, THETA).geometry
    assert geometry.nodes[23].tolist() == [frame.BAY / 2, 2 * frame.STOREY, 0.0]
    assert len(geometry.lines) == 8 and (21, 23) in geometry.lines
    node, along = geometry.locate("21:ux")
    assert node == 21 and along.tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("mass", "spoil", "message"),
    [
        (True, lambda ops: ops.wipe(), r".*ops\.wipe"),
        (True, lambda ops: [ops.fix(i, 1, 1, 1) for i in (2, 3, 4)], "held or tied"),
        (False, lambda ops: None, r"no mass; .*ops\.mass"),
        # OpenSees ties 4:ux to 3:uy there
        (True, lambda ops: [ops.equalDOF(i, i + 1, 1) for i in (2, 3)], "4 is tied"),
        # OpenSees keeps one of them
        (True, lambda ops: [ops.equalDOF(2, 4, i) for i in (1, 2)], "7 DOFs are free"),
    ],
)
def test_what_cannot_be_read_is_refused(ops, mass, spoil, message):
    build_cantilever(ops, mass=mass)
    spoil(ops)
    with pytest.raises(ValueError, match=f"ops: .*{message}"):
        ef.from_opensees(ops)
