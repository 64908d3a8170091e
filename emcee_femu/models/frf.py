"""Frequency response functions by modal superposition, with their derivatives."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import (
    Floats,
    Parameters,
    Variable,
    modal_variables,
    read,
)
from ..measurements.frf_kinds import (
    KINDS,
    Channel,
    frf_variable,
    read_channels,
    read_kind,
    read_lines,
)
from .damping import Damping
from .eigen.sensitivity import Derivatives
from .frf_modes import build_static, count_modes, find_dof, find_dofs, find_residual
from .static import StaticModel

AT_ONCE = 2**20  # numbers of an array (walkers, modes, lines)


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
        >>> from emcee_femu import FRFModel, MatrixModel
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
        kind = read_kind(kind)
        pairs = read_channels(channels)
        numbers = read_lines(lines)
        dofs = find_dofs(model)
        rows = [find_dof(dofs, c.response) for c in pairs]
        columns = [find_dof(dofs, c.excitation) for c in pairs]
        n_modes = count_modes(model)
        stored = checks.flag("stored", stored)
        law = Damping.of(damping, n_modes)
        modal = modal_variables(n_modes)
        static = None
        if checks.flag("residual", residual):
            static = build_static(model, dofs, pairs)
        checks.set_fields(
            self,
            model=model,
            lines=numbers,
            channels=pairs,
            damping=law,
            kind=kind,
            variables={
                "frequency": modal["frequency"],
                "damping_ratio": Variable(modal["frequency"].coords),
                kind: frf_variable(pairs, numbers, kind, unit, stored),
            },
            _rows=(rows, columns),
            _static=static,
        )

    @property
    def n_modes(self) -> int:
        """The number of superposed modes."""
        return count_modes(self.model)

    @property
    def names(self) -> tuple[str, ...] | None:
        """The parameters that are read, None if the modal model does not say."""
        known = getattr(self.model, "names", None)
        if known is None:
            return None
        return tuple(dict.fromkeys([*known, *self.damping.names]))

    @property
    def required(self) -> tuple[str, ...]:
        """The parameters without which there is no response."""
        own = getattr(self.model, "required", ())
        return tuple(dict.fromkeys([*own, *self.damping.names]))

    @property
    def positive(self) -> tuple[str, ...]:
        """The parameters that must stay above zero."""
        own = getattr(self.model, "positive", ())
        return tuple(dict.fromkeys([*own, *self.damping.names]))

    def __getattr__(self, attribute: str) -> Any:
        """Return what else the modal model says of itself (interfaces.py)."""
        if attribute == "jacobian" and hasattr(self.model, "jacobian"):
            return self._differentiate
        if attribute in ("bounds", "one_by_one"):
            return getattr(self.model, attribute)
        raise AttributeError(attribute)

    def __call__(self, parameters: Parameters) -> dict[str, Floats]:
        """Return FRFs ``(n, channels, lines, 2)``, frequencies and damping ratios."""
        f, left, right = self._read(self.model(parameters))
        zeta, static = self.damping(parameters, f), None
        if self._static is not None:
            static = self._static_part(self._static[0](parameters)["displacement"])
        H = np.empty((len(f), len(self.channels), len(self.lines), 2))
        for part in self._parts(len(f)):
            residues = left[part] * right[part]
            inverse = 1 / self._denominators(f[part], zeta[part])
            H[part] = self._superpose(residues, inverse, f, static, part)
        return {"frequency": f, "damping_ratio": zeta, self.kind: H}

    def _superpose(
        self, residues: Floats, inverse: Any, f: Floats, static: Any, part: slice
    ) -> Floats:
        """Return FRFs of some walkers, ``(n, channels, lines, 2)``."""
        H = residues @ inverse
        if static is not None:
            H += find_residual(static[part], residues, f[part])[:, :, None]
        return self._split(H)

    def _differentiate(
        self, parameters: Parameters
    ) -> tuple[dict[str, Floats], Derivatives]:
        """Return the response and its derivatives, ``jacobian`` of a model."""
        modes, by_model = self.model.jacobian(parameters)
        f, left, right = self._read(modes)
        zeta = self.damping(parameters, f)
        static, moved = None, {}
        if self._static is not None:
            solved, slopes = self._static[0].jacobian(parameters)
            static = self._static_part(solved["displacement"])
            for name, slope in slopes["displacement"].items():
                moved[name] = self._static_part(slope)
        of_model = (name for by_name in by_model.values() for name in by_name)
        names = dict.fromkeys([*of_model, *self.damping.names])
        df, d_zeta, d_residues = {}, {}, {}
        for name in names:
            df[name] = by_model["frequency"].get(name, np.zeros_like(f))
            d_zeta[name] = self.damping.slope(parameters, name, f, df[name])
            d_residues[name] = np.zeros_like(left)
            if (shapes := by_model["shapes"].get(name)) is not None:
                ends = [shapes[:, rows] for rows in self._rows]
                d_residues[name] = ends[0] * right + left * ends[1]
        size = len(f), len(self.channels), len(self.lines), 2
        H, dH = np.empty(size), {name: np.empty(size) for name in names}
        w, W = 2 * np.pi * f, 2 * np.pi * self.lines
        for part in self._parts(len(f)):
            residues = left[part] * right[part]
            inverse = 1 / self._denominators(f[part], zeta[part])
            H[part] = self._superpose(residues, inverse, f, static, part)
            square = inverse * inverse
            for name in names:
                dw = 2 * np.pi * df[name]
                stiff = residues * (2 * w * dw)[part, None]
                lossy = residues * (2j * (d_zeta[name] * w + zeta * dw))[part, None]
                own = d_residues[name][part] @ inverse
                own -= stiff @ square + (lossy @ square) * W
                if static is not None:
                    rest = d_residues[name][part] - 2 * residues * (dw / w)[part, None]
                    less = (rest / w[part, None] ** 2).sum(axis=2)
                    if name in moved:
                        less = less - moved[name][part]
                    own -= less[:, :, None]
                dH[name][part] = self._split(own)
        response = {"frequency": f, "damping_ratio": zeta, self.kind: H}
        return response, {"frequency": df, "damping_ratio": d_zeta, self.kind: dH}

    def _read(self, modes: Any) -> tuple[Floats, Floats, Floats]:
        """Return frequencies, and shapes of both ends ``(n, channels, modes)``."""
        shapes = read(modes, "shapes")
        rows, columns = self._rows
        return read(modes, "frequency"), shapes[:, rows], shapes[:, columns]

    def _denominators(self, f: Floats, zeta: Floats) -> Any:
        """Return them, complex, ``(n, modes, lines)``."""
        W, w = 2 * np.pi * self.lines, 2 * np.pi * f[:, :, None]
        return (w * w - W * W) + (2j * zeta[:, :, None] * w) * W

    def _split(self, H: Any) -> Floats:
        """Return real and imaginary part of what a receptance is turned into."""
        order = KINDS[self.kind][0]
        turned = H * (2j * np.pi * self.lines) ** order
        return np.stack([turned.real, turned.imag], axis=-1)

    def _static_part(self, displacement: Floats) -> Floats:
        """Return the flexibility of each channel, ``(n, channels)``."""
        if self._static is None:
            raise RuntimeError("no residual was asked for")
        _, cases, points = self._static
        return displacement[:, cases, points]

    def _parts(self, n: int) -> list[slice]:
        """Return slices of the walkers whose arrays are not too large."""
        size = max(1, AT_ONCE // (self.n_modes * len(self.lines)))
        return [slice(start, start + size) for start in range(0, n, size)]
