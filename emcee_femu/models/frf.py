"""Frequency response functions by modal superposition, with their derivatives."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import (
    Derivatives,
    Floats,
    Parameters,
    Variable,
    modal_variables,
    read,
    read_declared,
)
from ..measurements.frf import (
    KINDS,
    Channel,
    frf_variable,
    read_channels,
    read_kind,
    read_lines,
)
from .matrix import MatrixModel
from .static import StaticModel

AT_ONCE = 2**20  # numbers of an array (walkers, modes, lines)
PROPORTIONAL = ("mass", "stiffness")
STEP = 1e-4  # share of the narrowest resonance by which derivatives move modes

# Frequencies (n, modes), shapes (n, dofs, modes), and the flexibility of each channel
# (n, channels), zero where no residual was asked for.
Modes: TypeAlias = tuple[Floats, Floats, Floats]


class Damping(NamedTuple):
    r"""Ratios of each mode, or proportional damping.

    .. math:: \zeta_m = \zeta_m^0, \qquad \text{or} \qquad
        \zeta_m = \frac{a}{2 \omega_m} + \frac{b \omega_m}{2}

    Attributes:
        given: One per mode, or a and b: numbers, or names of parameters.
        proportional: Whether they are a and b.
    """

    given: tuple[float | str, ...]
    proportional: bool

    @classmethod
    def of(cls, damping: Any, n_modes: int) -> Self:
        """Return what a user gave.

        Raises:
            TypeError: If it is neither numbers nor names, nor a mapping of both.
            ValueError: If a number is negative, or there is not one per mode.
        """
        if isinstance(damping, Mapping):
            if not damping or {*damping} - {*PROPORTIONAL}:
                raise ValueError(
                    f"damping: expected {list(PROPORTIONAL)}, got {list(damping)}"
                )
            given = tuple(_read_damping(damping.get(key, 0.0)) for key in PROPORTIONAL)
            return cls(given, True)
        if isinstance(damping, str) or np.ndim(damping) == 0:
            return cls((_read_damping(damping),) * n_modes, False)
        if not isinstance(damping, Sequence | np.ndarray) or len(damping) != n_modes:
            raise ValueError(
                f"damping: expected one number or name, or one for each of {n_modes} "
                f"modes, or {{'mass': a, 'stiffness': b}}, got {damping!r}"
            )
        return cls(tuple(_read_damping(one) for one in damping), False)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters among them."""
        return tuple(dict.fromkeys(one for one in self.given if isinstance(one, str)))

    def __call__(self, parameters: Parameters, f: Floats) -> Floats:
        """Return the ratios ``(n, modes)`` of modes of frequencies f in Hz."""
        values = [
            parameters[one] if isinstance(one, str) else np.full(len(f), one)
            for one in self.given
        ]
        numbers = np.stack(values, axis=1)
        if not self.proportional:
            return numbers
        w = 2 * np.pi * f
        ratios: Floats = numbers[:, :1] / (2 * w) + numbers[:, 1:] * w / 2
        return ratios


def _read_damping(value: Any) -> float | str:
    """Return a ratio or factor, or the name of a parameter."""
    if isinstance(value, str):
        return checks.parameter_names("damping", [value])[0]
    return checks.real_number("damping", value, 0.0)


@dataclass(frozen=True, eq=False, init=False)
class FRFModel:
    r"""Frequency response functions of a modal model with damping.

    .. math:: H_{rs}(\omega) = (i \omega)^p \Big[ \sum_m
        \frac{\phi_{rm} \phi_{sm}}{\omega_m^2 - \omega^2 + 2 i \zeta_m \omega_m \omega}
        + R_{rs} \Big], \qquad
        R_{rs} = (K^{-1})_{rs} - \sum_m \frac{\phi_{rm} \phi_{sm}}{\omega_m^2}

    with p = 0, 1, 2 for receptance (displacement over force), mobility (velocity) and
    accelerance (acceleration). The residual R is what the modes that were left out add
    well below their frequencies. The response is a mapping: the FRF under the name of
    its kind, ``(n, channels, lines, 2)`` with real and imaginary part, and the natural
    frequencies and damping ratios of the modes.

    Args:
        model: A model with mass-normalised shapes at the DOFs of all channels, such as
            ``MatrixModel(..., shapes=True)`` or its reduction.
        lines: The lines in Hz, ``(n_lines,)``, above zero.
        channels: Pairs ``(response DOF, excitation DOF)``.
        damping: Ratios: one number, or the name of a parameter, for all modes; a
            sequence of these, one per mode; or ``{"mass": a, "stiffness": b}`` for
            proportional damping, :math:`\zeta = a / 2 \omega + b \omega / 2`, numbers
            or names.
        kind: "receptance", "mobility" or "accelerance".
        residual: Whether to add R; model is then a :class:`MatrixModel` without
            rigid-body modes.
        unit: Of the FRF, where it is not that of SI.
        stored: Whether FRFs are stored with each sample, 16 bytes per channel and
            line; :func:`plot_frf` computes what it shows anew.

    Raises:
        TypeError: If damping, channels or model are none, or there are no shapes.
        ValueError: If a number is out of range, a DOF unknown, or kind is none.

    Source: Ewins, Modal Testing: Theory, Practice and Application, 2nd ed. (2000).

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import MatrixModel
        >>> from emcee_femu.frf import FRFModel
        >>> one = MatrixModel(np.zeros((1, 1)), np.eye(1), {"k": np.eye(1)}, n_modes=1,
        ...                   shapes=True)
        >>> frf = FRFModel(one, [1 / np.pi], [(0, 0)], damping=0.05)
        >>> frf({"k": np.array([4.0])})["receptance"].round(4).tolist()
        [[[[0.0, -2.5]]]]
    """

    model: Any
    lines: Floats = field(repr=False)
    channels: tuple[Channel, ...]
    damping: Damping
    kind: str
    variables: Mapping[str, Variable] = field(repr=False)
    _rows: tuple[list[int], list[int]] = field(repr=False)
    _static: tuple[StaticModel, list[int], list[int]] | None = field(repr=False)

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
        kind, pairs, numbers = (
            read_kind(kind),
            read_channels(channels),
            read_lines(lines),
        )
        declared = read_declared(model, "variables") or {}
        shapes = declared.get("shapes")
        dofs = [] if shapes is None else [*shapes.coords.get("dof", ())]
        if not dofs:
            raise TypeError(
                "model: expected mode shapes at named DOFs; ask it for shapes "
                "(shapes=True)"
            )
        for channel in pairs:
            for dof in channel:
                if dof not in dofs:
                    raise ValueError(
                        f"channels: no shapes at the DOF {dof!r}; there are {dofs}"
                    )
        n_modes = declared["frequency"].size
        modal = modal_variables(n_modes)
        stored = checks.flag("stored", stored)
        static = None
        if checks.flag("residual", residual):
            static = _build_static(model, dofs, pairs)
        checks.set_fields(
            self,
            model=model,
            lines=numbers,
            channels=pairs,
            damping=Damping.of(damping, n_modes),
            kind=kind,
            variables={
                "frequency": modal["frequency"],
                "damping_ratio": Variable(modal["frequency"].coords),
                kind: frf_variable(pairs, numbers, kind, unit, stored),
            },
            _rows=(
                [dofs.index(c[0]) for c in pairs],
                [dofs.index(c[1]) for c in pairs],
            ),
            _static=static,
        )

    @property
    def n_modes(self) -> int:
        """The number of superposed modes."""
        return self.variables["frequency"].size

    @property
    def names(self) -> tuple[str, ...] | None:
        """The parameters that are read, None if the modal model does not say."""
        known = read_declared(self.model, "names")
        if known is None:
            return None
        return tuple(dict.fromkeys([*known, *self.damping.names]))

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Those of the modal model; damping stays above zero."""
        bounds = dict(read_declared(self.model, "bounds") or {})
        return bounds | dict.fromkeys(self.damping.names, (0.0, np.inf))

    @property
    def jacobian(self) -> Any:
        """Response and derivatives; None if the modal model has none."""
        derivable = read_declared(self.model, "jacobian") is not None
        return self._differentiate if derivable else None

    def __call__(self, parameters: Parameters) -> dict[str, Floats]:
        """Return FRFs ``(n, channels, lines, 2)``, frequencies and damping ratios."""
        modes = self.model(parameters)
        flexibility = np.zeros(1)
        if self._static is not None:
            solved = self._static[0](parameters)["displacement"]
            flexibility = self._flexibility(solved)
        shapes = read(modes, "shapes")
        return self._superpose(
            parameters, (read(modes, "frequency"), shapes, flexibility)
        )

    def _differentiate(
        self, parameters: Parameters
    ) -> tuple[dict[str, Floats], Derivatives]:
        """Return the response and its derivatives, ``jacobian`` of a model.

        Differences along those of the modes, which cost no solve.
        """
        solved, by_model = self.model.jacobian(parameters)
        f, shapes = read(solved, "frequency"), read(solved, "shapes")
        flexibility, by_static = np.zeros((len(f), 1)), {}
        if self._static is not None:
            static, slopes = self._static[0].jacobian(parameters)
            flexibility = self._flexibility(static["displacement"])
            by_static = {
                name: self._flexibility(slope)
                for name, slope in slopes["displacement"].items()
            }
        modes = f, shapes, flexibility
        response = self._superpose(parameters, modes)
        derivatives: Derivatives = {variable: {} for variable in response}
        narrowest = np.maximum(response["damping_ratio"].min(axis=1), STEP)
        of_model = (name for by_name in by_model.values() for name in by_name)
        for name in dict.fromkeys([*of_model, *self.damping.names]):
            tangents = (
                by_model["frequency"].get(name, np.zeros_like(f)),
                by_model["shapes"].get(name, np.zeros_like(shapes)),
                by_static.get(name, np.zeros_like(flexibility)),
            )
            # Of shapes and flexibilities a difference is exact with any step.
            speed = (np.abs(tangents[0]) / f).max(axis=1)
            speed = np.maximum(speed, 1 / np.maximum(np.abs(parameters[name]), STEP))
            step = STEP * narrowest / speed
            ahead, behind = (
                self._superpose(
                    {**parameters, name: parameters[name] + by},
                    tuple(
                        value + tangent * by.reshape(-1, *[1] * (value.ndim - 1))
                        for value, tangent in zip(modes, tangents, strict=True)
                    ),
                )
                for by in (step, -step)
            )
            for variable, value in ahead.items():
                width = 2 * step.reshape(-1, *[1] * (value.ndim - 1))
                derivatives[variable][name] = (value - behind[variable]) / width
        return response, derivatives

    def _superpose(self, parameters: Parameters, modes: Modes) -> dict[str, Floats]:
        """Return the response of modes."""
        f, shapes, flexibility = modes
        zeta = self.damping(parameters, f)
        rows, columns = self._rows
        residues = shapes[:, rows] * shapes[:, columns]
        w, W = 2 * np.pi * f, 2 * np.pi * self.lines
        H = np.empty((len(f), len(rows), len(W), 2))
        size = max(1, AT_ONCE // (self.n_modes * len(W)))
        for start in range(0, len(f), size):  # so that arrays are not too large
            part = slice(start, start + size)
            own, ratio = w[part, :, None], zeta[part, :, None]
            whole = residues[part] @ (1 / (own * own - W * W + 2j * ratio * own * W))
            if self._static is not None:
                modal = (residues[part] / w[part, None] ** 2).sum(axis=2)
                whole += (flexibility[part] - modal)[:, :, None]
            whole = whole * (1j * W) ** KINDS[self.kind][0]
            H[part] = np.stack([whole.real, whole.imag], axis=-1)
        return {"frequency": f, "damping_ratio": zeta, self.kind: H}

    def _flexibility(self, displacement: Floats) -> Floats:
        """Return that of each channel, ``(n, channels)``."""
        assert self._static is not None
        _, cases, points = self._static
        return displacement[:, cases, points]


def _build_static(
    model: object, dofs: list[Any], channels: Sequence[Channel]
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
