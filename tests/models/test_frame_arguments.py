import numpy as np
import pytest

from emcee_femu.models.frame.model import FrameModel, Section

BAR = dict(E=7.1e10, GJ=700.0, rho=2750.0, A=3e-4, Iy=2e-9, Iz=9e-9)
TWO, BEAM = [(0, 0, 0), (1, 0, 0)], {"b": Section(**BAR)}


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"nodes": [(0, 0)]}, ValueError, r"nodes: .*\(n_nodes, 3\), got \(1, 2\)"),
        ({"nodes": [(0, 0, 0)] * 2}, ValueError, r"elements\[0\]: both nodes lie at"),
        ({"nodes": [(0, 0, 0), (0, 0, 2)]}, ValueError, r"elements\[0\]: .*parallel"),
        ({"elements": []}, TypeError, "elements: expected at least one"),
        ({"elements": [(0, 2, "b")]}, ValueError, r"\[0\]: no node 2; .* 0 to 1"),
        ({"elements": [(0, 1.0, "b")]}, TypeError, r"elements\[0\]: .*got 1.0"),
        ({"elements": [(0, 1, "c")]}, ValueError, r"\[0\]: no section 'c'; .*\['b'\]"),
        ({"sections": BEAM | {"c": BEAM["b"]}}, ValueError, r"no element uses \['c'\]"),
        ({"supports": {2: "all"}}, ValueError, "supports: no node 2; nodes are 0 to 1"),
        ({"supports": {"0": "all"}}, TypeError, "supports: expected a whole number"),
        ({"supports": {0: ("ux", "w")}}, ValueError, r"supports\[0\]: .*got 'w'"),
        ({"supports": {0: "all", 1: "all"}}, ValueError, "every DOF is held"),
        ({"n_modes": None}, TypeError, "exactly one of the two"),
        ({"modes": (1,)}, TypeError, "exactly one of the two"),
        ({"n_modes": 7}, ValueError, "mode 7 after 0 .* only 6 free DOFs"),
        ({"skip": 6}, ValueError, "mode 1 after 6 .* only 6 free DOFs"),
        ({"n_modes": None, "modes": (2, 2)}, ValueError, r"ascending.*\(2, 2\)"),
        ({"n_modes": None, "modes": ()}, ValueError, r"ascending.*\(\)"),
        ({"n_modes": None, "modes": (0, 1)}, ValueError, "modes: expected at least 1"),
    ],
)
def test_wrong_arguments_of_a_frame_are_refused_by_name(changed, error, message):
    arguments = {"nodes": TWO, "elements": [(0, 1, "b")], "sections": BEAM}
    arguments |= {"supports": {0: "all"}, "n_modes": 1} | changed
    with pytest.raises(error, match=message):
        FrameModel(**arguments)


@pytest.mark.parametrize("key", list(BAR))
@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        (0.0, ValueError, "above zero, got 0"),
        (np.inf, ValueError, "finite"),
        (None, TypeError, "real numbers"),
        ("", ValueError, "a parameter name, got ''"),
    ],
)
def test_a_wrong_section_property_is_refused_by_name(key, value, error, message):
    with pytest.raises(error, match=f"^{key}: expected .*{message}"):
        Section(**BAR | {key: value})


@pytest.mark.parametrize("orientation", [(0, 0, 0), (0, 1), [(0, 0, 1)]])
def test_a_wrong_orientation_is_refused(orientation):
    with pytest.raises(ValueError, match="^orientation: expected"):
        Section(**BAR, orientation=orientation)
