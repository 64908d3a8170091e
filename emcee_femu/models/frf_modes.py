"""What an FRF takes of a modal model: its modes, DOFs and flexibility."""

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np

from ..interfaces import Floats, declared_variables
from ..measurements.frf_kinds import Channel
from .matrix import MatrixModel
from .static import StaticModel


def count_modes(model: Any) -> int:
    """Return how many modes a model has."""
    return (declared_variables(model) or {})["frequency"].size


def find_dofs(model: Any) -> list[Any]:
    """Return the DOFs at which a model has shapes."""
    variables = declared_variables(model) or {}
    dofs = [*variables["shapes"].coords.get("dof", ())] if "shapes" in variables else []
    if not dofs:
        raise TypeError(
            "model: expected mode shapes at named DOFs; ask it for shapes (shapes=True)"
        )
    return dofs


def find_dof(dofs: list[Any], dof: Hashable) -> int:
    """Return the place of a DOF among those of the shapes."""
    if dof not in dofs:
        raise ValueError(f"channels: no shapes at the DOF {dof!r}; there are {dofs}")
    return dofs.index(dof)


def build_static(
    model: Any, dofs: list[Any], channels: Sequence[Channel]
) -> tuple[StaticModel, list[int], list[int]]:
    """Return a model of the flexibility, and each channel's load case and point."""
    if not isinstance(model, MatrixModel) or model.skip:
        raise TypeError(
            "residual: expected a MatrixModel without rigid-body modes, whose "
            f"stiffness gives the flexibility, got {type(model).__name__}; take more "
            "modes instead"
        )
    places = dict(zip(dofs, model.shape_dofs, strict=True))
    loads = {str(c.excitation): {places[c.excitation]: 1.0} for c in channels}
    points = [*dict.fromkeys(places[c.response] for c in channels)]
    static = StaticModel(model.K0, loads, model.K, points=points)
    cases = [static.cases.index(str(c.excitation)) for c in channels]
    return static, cases, [points.index(places[c.response]) for c in channels]


def find_residual(flexibility: Floats, residues: Floats, f: Floats) -> Floats:
    """Return what the modes leave of the flexibility, ``(n, channels)``."""
    modal = residues / (2 * np.pi * f[:, None]) ** 2
    result: Floats = flexibility - modal.sum(axis=2)
    return result
