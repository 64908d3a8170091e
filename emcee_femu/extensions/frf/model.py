"""Frequency response functions by modal superposition, with their derivatives."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ... import checks
from ...contracts import (
    Derivatives,
    Floats,
    Parameters,
    Variable,
    modal_variables,
    read,
    read_declared,
    show_declared,
)
from ...models.inputs import derive_along
from ...models.matrix import AffineModel, StaticModel
from .measurements import FRF_KINDS, frf_variable, read_channels, read_kind, read_lines

AT_ONCE = 2**20  # numbers of an array (walkers, modes, lines)
PROPORTIONAL = ("mass", "stiffness")
# Share of the narrowest resonance by which derivatives move modes.
RESONANCE_STEP = 1e-4

Arrays: TypeAlias = dict[str, Floats]
# A model of the flexibility, and each channel's load case and point.
Static: TypeAlias = tuple[StaticModel, list[int], list[int]]


class FRFModel:
    r"""Frequency response functions (FRFs) of a modal model with damping.

    .. math:: H_{rs}(\omega) = (i \omega)^p \Big[ \sum_m
        \frac{\phi_{rm} \phi_{sm}}{\omega_m^2 - \omega^2 + 2 i \zeta_m \omega_m \omega}
        + R_{rs} \Big], \qquad
        R_{rs} = (K^{-1})_{rs} - \sum_m \frac{\phi_{rm} \phi_{sm}}{\omega_m^2}

    with p = 0, 1, 2 for receptance (displacement over force), mobility (velocity) and
    accelerance (acceleration). The residual R is the contribution of the omitted modes
    well below their frequencies. Use the model with an :class:`FRFTerm`; a parameter
    set costs one solve of the modal model. The response is a mapping with the FRF under
    the name of its kind, ``(n, channels, lines, 2)`` for real and imaginary part, and
    with the natural frequencies and damping ratios of the modes.

    Args:
        model: A model with mass-normalised shapes at the DOFs of all channels, such as
            ``MatrixModel(..., shapes=True)`` or its reduction.
        lines: The lines in Hz, ``(n_lines,)``, positive.
        channels: Pairs ``(response DOF, excitation DOF)``. A direction against an axis,
            ``"2:-ux"``, is computed along the axis and renamed, as in
            :class:`FRFMeasurements`.
        damping: Damping ratios: one number, or the name of a parameter, for all modes;
            a sequence of these, one per mode; or ``{"mass": a, "stiffness": b}``, with
            numbers or names, for proportional damping
            :math:`\zeta = a / 2 \omega + b \omega / 2`.
        kind: "receptance", "mobility" or "accelerance".
        residual: Whether to add R; the model must then be a :class:`MatrixModel`
            without rigid-body modes.
        unit: Unit of the FRF, if it is not SI.
        stored: Whether FRFs are stored with each sample, 16 bytes per channel and line;
            :func:`plot_frf` does not need them.

    Raises:
        TypeError: If damping, channels or model have the wrong type, or there are no
            shapes.
        ValueError: If a number is out of range, or a DOF or kind is unknown.

    Source: Ewins, Modal Testing: Theory, Practice and Application, 2nd ed. (2000).

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import MatrixModel
        >>> from emcee_femu.extensions.frf import FRFModel
        >>> one = MatrixModel(np.zeros((1, 1)), np.eye(1), {"k": np.eye(1)}, n_modes=1,
        ...                   shapes=True)
        >>> frf = FRFModel(one, [0.5 / np.pi], [(0, 0)], damping=0.05)
        >>> frf({"k": np.array([4.0])})["receptance"].round(4).tolist()
        [[[[0.3319, -0.0221]]]]
    """

    def __init__(
        self,
        model: Any,
        lines: ArrayLike,
        channels: Sequence[tuple[Hashable, Hashable]],
        *,
        damping: Any,
        kind: str = "receptance",
        residual: bool = False,
        unit: str | None = None,
        stored: bool = False,
    ) -> None:
        if not callable(model):
            raise TypeError(f"model: expected a callable, got {model!r}")
        self.model, self.kind = model, read_kind(kind)
        self.channels, self.lines = read_channels(channels)[0], read_lines(lines)
        declared = read_declared(model, "variables") or {}
        shapes = declared.get("shapes")
        dofs = [] if shapes is None else [*shapes.coords.get("dof", ())]
        if not dofs:
            raise TypeError(
                "model: expected mode shapes at named DOFs; ask it for shapes "
                "(shapes=True)"
            )
        unknown = [dof for pair in self.channels for dof in pair if dof not in dofs]
        if unknown:
            raise ValueError(f"channels: no shapes at {unknown[0]!r}, only at {dofs}")
        sides = zip(*self.channels, strict=True)
        self._rows, self._columns = ([*map(dofs.index, side)] for side in sides)
        modal = modal_variables(declared["frequency"].size)
        stored = checks.flag("stored", stored)
        self.variables = {
            "frequency": modal["frequency"],
            "damping_ratio": Variable(modal["frequency"].coords),
            self.kind: frf_variable(self.channels, self.lines, self.kind, unit, stored),
        }
        self._proportional = isinstance(damping, Mapping)
        self._damping = _read_damping(damping, declared["frequency"].size)
        self._inferred = [x for x in self._damping if isinstance(x, str)]
        names = read_declared(model, "names")
        self.names = (
            None if names is None else tuple(dict.fromkeys([*names, *self._inferred]))
        )
        bounds = dict(read_declared(model, "bounds") or {})
        self.bounds = bounds | dict.fromkeys(self._inferred, (0.0, np.inf))
        self._static: Static | None = None
        if checks.flag("residual", residual):
            self._static = _build_static(model, self._rows, self._columns)

    @property
    def jacobian(self) -> Callable[[Parameters], tuple[Arrays, Derivatives]] | None:
        """Response and derivatives; None if the modal model has no ``jacobian``."""
        derivable = read_declared(self.model, "jacobian") is not None
        return self._differentiate if derivable else None

    __repr__ = show_declared

    def __call__(self, parameters: Parameters) -> Arrays:
        """Return FRFs ``(n, channels, lines, 2)``, frequencies and damping ratios."""
        modes = self.model(parameters)
        flexibility = np.zeros((1, 1))
        if self._static is not None:
            static, cases, points = self._static
            flexibility = static(parameters)["displacement"][:, cases, points]
        f, shapes = read(modes, "frequency"), read(modes, "shapes")
        damping = self._numbers(parameters, len(f))
        return self._superpose(f, shapes, flexibility, damping)

    def _differentiate(self, parameters: Parameters) -> tuple[Arrays, Derivatives]:
        """Return the response and its derivatives, ``jacobian`` of a model.

        Differences along those of the modes, which cost no solve.
        """
        modes, by_model = self.model.jacobian(parameters)
        f, shapes = read(modes, "frequency"), read(modes, "shapes")
        flexibility, by_static = np.zeros((len(f), 1)), {}
        if self._static is not None:
            static, cases, points = self._static
            response, slopes = static.jacobian(parameters)
            flexibility = response["displacement"][:, cases, points]
            of_u = slopes["displacement"].items()
            by_static = {name: slope[:, cases, points] for name, slope in of_u}
        damping = self._numbers(parameters, len(f))
        by_damping = {
            name: np.ones_like(damping) * [name == x for x in self._damping]
            for name in self._inferred
        }
        of_model = (name for by_name in by_model.values() for name in by_name)
        names = dict.fromkeys([*of_model, *by_damping])
        values = f, shapes, flexibility, damping
        parts = by_model["frequency"], by_model["shapes"], by_static, by_damping
        tangents = [
            np.array([part.get(name, np.zeros_like(value)) for name in names])
            for part, value in zip(parts, values, strict=True)
        ]
        result = self._superpose(*values)
        # Of shapes and flexibilities a difference is exact with any step.
        size = np.abs([parameters[name] for name in names])
        speed = (np.abs(tangents[0]) / f).max(axis=2)
        speed = np.maximum(speed, 1 / np.maximum(size, RESONANCE_STEP))
        narrowest = np.maximum(result["damping_ratio"].min(axis=1), RESONANCE_STEP)
        steps = RESONANCE_STEP * narrowest / speed
        return result, derive_along(self._superpose, values, tangents, steps, names)

    def _numbers(self, parameters: Parameters, n: int) -> Floats:
        """Return the damping of each mode, or a and b, ``(n, n_modes or 2)``."""
        columns = [
            parameters[x] if isinstance(x, str) else np.full(n, x)
            for x in self._damping
        ]
        return np.stack(columns, axis=1)

    def _superpose(
        self, f: Floats, shapes: Floats, flexibility: Floats, damping: Floats
    ) -> Arrays:
        """Return the response of modes.

        Args:
            f: Frequencies in Hz ``(n, n_modes)``.
            shapes: ``(n, n_dofs, n_modes)``.
            flexibility: Of each channel ``(n, channels)``, for the residual.
            damping: Ratios ``(n, n_modes)``; or a and b, ``(n, 2)``.
        """
        w, W = 2 * np.pi * f, 2 * np.pi * self.lines
        zeta = damping
        if self._proportional:
            zeta = damping[:, :1] / (2 * w) + damping[:, 1:] * w / 2
        residues = shapes[:, self._rows] * shapes[:, self._columns]
        H = np.empty((len(f), len(self._rows), len(W), 2))
        size = max(1, AT_ONCE // (f.shape[1] * len(W)))
        for start in range(0, len(f), size):  # so that arrays are not too large
            part = slice(start, start + size)
            wm, ratio = w[part, :, None], zeta[part, :, None]
            whole = residues[part] @ (1 / (wm * wm - W * W + 2j * ratio * wm * W))
            if self._static is not None:
                modal = (residues[part] / w[part, None] ** 2).sum(axis=2)
                whole += (flexibility[part] - modal)[:, :, None]
            whole = whole * (1j * W) ** FRF_KINDS[self.kind][0]
            H[part] = np.stack([whole.real, whole.imag], axis=-1)
        return {"frequency": f, "damping_ratio": zeta, self.kind: H}


def _read_damping(damping: Any, n_modes: int) -> tuple[float | str, ...]:
    """Return one for each mode, or a and b: numbers, or names of parameters."""
    if isinstance(damping, Mapping):
        if not damping or {*damping} - {*PROPORTIONAL}:
            raise ValueError(f"damping: expected {[*PROPORTIONAL]}, got {[*damping]}")
        values = [damping.get(key, 0.0) for key in PROPORTIONAL]
    elif np.ndim(damping) == 0:
        values = [damping] * n_modes
    else:
        values = list(damping)
        if len(values) != n_modes:
            raise ValueError(
                "damping: expected one number or name, or one for each of "
                f"{n_modes} modes, or {{'mass': a, 'stiffness': b}}, got {damping!r}"
            )
    return tuple(
        checks.parameter_names("damping", [x])[0]
        if isinstance(x, str)
        else checks.real_number("damping", x, 0.0)
        for x in values
    )


def _build_static(model: object, rows: list[int], columns: list[int]) -> Static:
    """Return a model of the flexibility, and each channel's load case and point."""
    if not isinstance(model, AffineModel) or model.skip:
        raise TypeError(
            "residual: expected a MatrixModel or FrameModel without rigid-body modes, "
            f"whose stiffness gives the flexibility, got {type(model).__name__}; take "
            "more modes instead"
        )
    dofs = model.rows
    responses, excitations = ([dofs[i] for i in side] for side in (rows, columns))
    loads = {str(dof): {dof: 1.0} for dof in excitations}
    points, functions = [*dict.fromkeys(responses)], model.coefficients.parts[0]
    K = {
        label: unit if function is None else (unit, function)
        for (label, unit), (_, function) in zip(
            model.K.items(), functions.values(), strict=True
        )
    }
    static = StaticModel(model.K0, loads, K, points=points)
    cases = [static.cases.index(str(dof)) for dof in excitations]
    return static, cases, [static.points.index(dof) for dof in responses]
