"""Sensors along a node's own axes: turned back, they show the global motion."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from support.universal_file import NODES, F, a_mode

import emcee_femu as ef

pyuff = pytest.importorskip("pyuff", reason='pip install "emcee_femu[uff]"')
RNG = np.random.default_rng(8)
PLACES = np.array([[1.0, 2.0, 0.5], [-0.4, 1.0, 2.0], [3.0, -2.0, 1.0]])
GLOBAL = RNG.normal(size=(3, 3, 3))  # node, axis, mode
MODEL = {4: 0, 12: 1, 7: "top"}
AXES = Rotation.random(2, rng=RNG).as_matrix()
ORIGIN = np.array([0.3, -0.2, 0.7])


def cylinder(axes, place):
    """Return the radial, the circumferential and the axial direction at a place."""
    out = (place - ORIGIN) - axes[2] * ((place - ORIGIN) @ axes[2])
    out /= np.linalg.norm(out)
    return np.array([out, np.cross(axes[2], out), axes[2]])


def by_matrix(*kinds):
    matrices = [np.vstack([axes, ORIGIN]) for axes in AXES]
    return pyuff.prepare_2420(
        Part_UID=1, Part_Name="part", CS_sys_labels=[5, 6], CS_types=[*kinds],
        CS_colors=[8, 8], CS_names=["CS5", "CS6"], CS_matrices=matrices,
    )  # fmt: skip


def by_points(*kinds):
    """The second is defined in the first."""
    points = ORIGIN, ORIGIN + 2 * AXES[0, 0], ORIGIN + AXES[0, 2] - 3 * AXES[0, 0]
    inner = AXES[1] @ AXES[0].T
    inside = np.zeros(3), inner[0], inner[2] + inner[0]
    return pyuff.prepare_18(
        cs_num=[5, 6], cs_type=[*kinds], ref_cs_num=[0, 5], color=[1, 1],
        method=[1, 1], cs_name=["a", ""],
        **dict(zip(("ref_o", "x_point", "xz_point"), zip(points, inside, strict=True),
                   strict=True)),
    )  # fmt: skip


def nodes_of(kind, systems, own=0):
    write = pyuff.prepare_15 if kind == 15 else pyuff.prepare_2411
    return write(
        node_nums=np.array(NODES), def_cs=np.full(3, own), disp_cs=np.array(systems),
        color=np.ones(3, dtype=int), **dict(zip("xyz", PLACES.T, strict=True)),
    )  # fmt: skip


def write(path, *sets):
    pyuff.UFF(str(path)).write_sets([*sets], "overwrite")
    return path


def modes_along(axes):
    """Return data sets of modes as sensors along these axes see them."""
    seen = np.einsum("nij,njm->nim", axes, GLOBAL)
    return [
        a_mode(pyuff, m, **{f"r{i + 1}": seen[:, i, m - 1] for i in range(3)})
        for m in (1, 2, 3)
    ]


@pytest.mark.parametrize("kind", [15, 2411])
@pytest.mark.parametrize("define", [by_matrix, by_points])
def test_sensors_along_own_axes_measure_the_global_motion(kind, define, tmp_path):
    own = [AXES[0], np.eye(3), cylinder(AXES[1], PLACES[2])]
    path = write(
        tmp_path / "a.uff",
        define(0, 1),
        nodes_of(kind, [5, 1, 6]),
        *modes_along(own),
    )
    with pytest.warns(UserWarning, match=r"own for the nodes of \['4:x'.*'7:z'\]"):
        plain = ef.Measurements.from_uff(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        test = ef.Measurements.from_uff(path, nodes=MODEL, axes="own")
        dofs = test.dofs.tolist()
        assert ef.Measurements.from_uff(path, dofs=dofs).dofs.tolist() == dofs
    assert test.sensors == plain.sensors and dofs[3:6] == ["1:ux", "1:uy", "1:uz"]
    labels = [f"{node}:u{axis}" for node in MODEL.values() for axis in "xyz"]
    sensors, missing = ef.models.sensors.match_sensors(dofs, labels)
    assert not missing
    assert_allclose(sensors.of(GLOBAL.reshape(9, 3)), test.shapes, atol=3e-5)


def test_an_axis_that_is_turned_round_turns_the_sign(tmp_path):
    """A sensor on its head: -x, and y as it was."""
    head = np.diag([-1.0, 1.0, -1.0])
    system = by_matrix(0, 0) | {"CS_matrices": [np.vstack([head, ORIGIN])] * 2}
    path = write(tmp_path / "a.uff", system, nodes_of(15, [5, 0, 0]), *modes_along(
        [head, np.eye(3), np.eye(3)]))  # fmt: skip
    test = ef.Measurements.from_uff(
        path, nodes={4: 8}, axes="own", sensors=["4:y", "4:x"]
    )
    assert test.dofs.tolist() == ["8:uy", "8:ux"]
    assert_allclose(test.shapes, GLOBAL[0, [1, 0]], atol=1e-5)


def test_places_in_cylindrical_coordinates(tmp_path):
    """A node at r, phi, z of a cylinder moves along axes that phi turns."""
    polar = np.array([[2.0, 30.0, 1.0]] * 3)
    turned = Rotation.from_euler("z", -30, degrees=True).as_matrix() @ AXES[0]
    places = nodes_of(15, [5, 5, 5], own=5) | dict(zip("xyz", polar.T, strict=True))
    path = write(
        tmp_path / "a.uff", by_matrix(1, 0), places, *modes_along([turned] * 3)
    )
    test = ef.Measurements.from_uff(path, nodes={4: 0}, axes="own", sensors=["4:x"])
    labels = [f"0:u{axis}" for axis in "xyz"]
    found, _ = ef.models.sensors.match_sensors(test.dofs.tolist(), labels)
    assert_allclose(found.of(GLOBAL[0]), test.shapes, atol=3e-5)


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ({}, {"nodes": {4: 0, 5: 1}}, r"nodes: .*nothing at \[5\], only at \[4, 12"),
        ({}, {"nodes": {4: 0}, "sensors": ["7:x"]}, r"sensors: .*\['7:x'\] at these"),
        ({}, {"nodes": [4]}, r"nodes: .*\{node of the file"),
        ({}, {"nodes": MODEL, "dofs": range(9)}, "dofs, nodes: expected one"),
        ({"kinds": (2, 0)}, {"nodes": MODEL}, "'4:x' .*system 5, which is spherical"),
        ({"systems": [9, 0, 0]}, {"nodes": MODEL}, "system 9, which .* not define"),
        ({"own": 9, "kinds": (1, 1)}, {"nodes": MODEL}, "system 9, which .* not def"),
        ({}, {"nodes": MODEL, "axes": None}, r"axes: .*\['4:x'.*'own', or axes='glob"),
        ({}, {"axes": "node"}, "axes: expected one of"),
        ({"bad": True}, {}, r"data set 1: the axes of coordinate system 5 are not"),
    ],
)
def test_axes_that_are_not_known_are_refused(changes, options, message, tmp_path):
    systems = by_matrix(*changes.get("kinds", (0, 0)))
    if "bad" in changes:
        systems["CS_matrices"][0] *= 0.5
    places = nodes_of(15, changes.get("systems", [5, 5, 5]), changes.get("own", 0))
    path = write(tmp_path / "a.uff", systems, places, *modes_along([AXES[0]] * 3))
    with pytest.raises((TypeError, ValueError), match=message):
        ef.Measurements.from_uff(path, **{"axes": "own"} | options)


def test_lines_that_are_missing_are_refused_by_their_data_set(tmp_path):
    path = write(tmp_path / "a.uff", by_matrix(0, 0), nodes_of(2411, [5, 5, 5]),
                 *modes_along([AXES[0]] * 3))  # fmt: skip
    lines = path.read_text().splitlines()
    for cut, message in (
        (9, "data set 1: expected 6 lines"),
        (-1, "data set 2: .*7 num"),
    ):
        end = lines.index("  2411" + 74 * " ") + 2 if cut < 0 else cut
        path.write_text("\n".join([*lines[:end], *lines[end + 1 :], ""]))
        with pytest.raises(ValueError, match=message):
            ef.Measurements.from_uff(path, nodes=MODEL, axes="own")


def test_values_along_global_axes_are_left_as_they_are(tmp_path):
    systems, places = by_matrix(0, 0), nodes_of(2411, [5, 6, 5])
    path = write(tmp_path / "a.uff", systems, places, *modes_along([np.eye(3)] * 3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plain = ef.Measurements.from_uff(path, axes="global")
    test = ef.Measurements.from_uff(path, nodes=MODEL, axes="global")
    assert_allclose(test.shapes, plain.shapes)
    assert test.dofs.tolist()[:3] == ["0:ux", "0:uy", "0:uz"]


def test_a_file_without_own_axes_needs_no_turning(tmp_path):
    path = write(
        tmp_path / "a.uff", nodes_of(2411, [1, 0, 1]), *modes_along([np.eye(3)] * 3)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plain = ef.Measurements.from_uff(path)
    test = ef.Measurements.from_uff(path, nodes=MODEL)
    assert_allclose(test.frequencies, F, rtol=1e-5)
    assert_allclose(test.shapes, plain.shapes)
    assert test.dofs.tolist()[-1] == "top:uz"


def test_channels_of_frfs_along_own_axes(tmp_path):
    """The FRF of a frame between skew sensors, one of them turned round."""
    bar = ef.Section(E=(1.0, "E"), GJ=1.0, rho=1.0, A=1.0, Iy=1.0, Iz=2.0)
    frame = ([[0, 0, 0], [1, 0, 0], [2, 1, 0]], [(0, 1, "b"), (1, 2, "b")], {"b": bar})
    lines, E = np.array([0.02, 0.05, 0.1]), {"E": np.ones(1)}

    def frf(channels, shapes):
        model = ef.FrameModel(*frame, {0: "all"}, n_modes=12, shapes=shapes)
        one = ef.frf.FRFModel(model, lines, channels, damping=0.02)
        return one(E)["receptance"][0] @ [1, 1j]

    labels = [f"{node}:u{axis}" for node in (1, 2) for axis in "xyz"]
    pairs = [(a, b) for a in labels for b in labels]
    full = frf(pairs, labels).reshape(6, 6, -1)
    skew = full[:3, 3:]  # from forces at node 2 to motions at node 1
    seen = np.einsum("ai,ijl,bj->abl", AXES[0], skew, AXES[1])
    sets = [by_matrix(0, 0), nodes_of(15, [5, 6, 0])]
    for a, b, sign in ((0, 2, 1), (1, 1, -1)):
        sets.append(pyuff.prepare_58(
            binary=0, func_type=4, rsp_node=4, rsp_dir=sign * (a + 1), ref_node=12,
            ref_dir=b + 1, x=lines, data=sign * seen[a, b], abscissa_spacing=1,
            ordinate_spec_data_type=8, orddenom_spec_data_type=13,
        ))  # fmt: skip
    path = tmp_path / "frf.uff"
    pyuff.UFF(str(path)).write_sets(sets, "add")
    with pytest.warns(UserWarning, match=r"\['4:x', '12:z', '4:y', '12:y'\]"):
        ef.frf.FRFMeasurements.from_uff(path)
    test = ef.frf.FRFMeasurements.from_uff(path, nodes={4: 1, 12: 2}, axes="own")
    assert len(test.dofs) == 4
    assert_allclose(frf(test.channels, test.dofs), test.values, atol=1e-4)
    with pytest.raises(ValueError, match=r"no channel .* at \[4\]; it has 4:x/12:z"):
        ef.frf.FRFMeasurements.from_uff(path, nodes={4: 1}, axes="own")
    scalar = sets[:2] + [sets[2] | {"rsp_dir": 0}]
    path.unlink()
    pyuff.UFF(str(path)).write_sets(scalar, "add")
    with pytest.raises(ValueError, match="'4' of .* does not state"):
        ef.frf.FRFMeasurements.from_uff(path, nodes={4: 1, 12: 2}, axes="own")
