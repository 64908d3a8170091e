"""Frequency response functions by modal superposition, and their likelihood."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ... import checks
from ...contracts import (
    Derivatives,
    Floats,
    Model,
    Parameters,
    Response,
    Variable,
    gather_tangents,
    modal_variables,
    read,
    read_declared,
    show_declared,
)
from ...likelihoods.term import MODEL_ERROR, Deviations, Term, error_array
from ...measurements.modes import LARGE_DAMPING, doubt_percent
from ...models.differences import derive_along
from ...models.matrix import AffineModel, StaticModel
from ...models.sensors import Sensor
from .measurements import (
    FRF_KINDS,
    FRFMeasurements,
    frf_variable,
    read_channels,
    read_lines,
)

AT_ONCE = 2**20  # numbers of an array (walkers, modes, lines)
PROPORTIONAL = ("mass", "stiffness")
# In words and as a formula in HTML, for reports.
BY_AMPLITUDE = (
    "The deviations of the logarithms of the amplitudes from the measured ones are "
    "Gaussian, line by line. s is the standard deviation of the measurement.",
    "ln |<i>H<sub>l</sub></i>(θ)| − ln |<i>H<sub>l</sub></i><sup>m</sup>| ~ N(0, "
    "<i>s<sub>l</sub></i><sup>2</sup> / |<i>H<sub>l</sub></i><sup>m</sup>|"
    "<sup>2</sup> + σ<sub>d</sub><sup>2</sup>)",
)
BY_PARTS = (
    "The deviations of the frequency response from the measured one are Gaussian, line "
    "by line, in their real and imaginary parts. s is the standard deviation of the "
    "measurement.",
    "<i>H<sub>l</sub></i>(θ) − <i>H<sub>l</sub></i><sup>m</sup> ~ N(0, "
    "<i>s<sub>l</sub></i><sup>2</sup> + (σ<sub>d</sub> "
    "|<i>H<sub>l</sub></i><sup>m</sup>|)<sup>2</sup>)",
)
# Share of the narrowest resonance by which derivatives move modes.
RESONANCE_STEP = 1e-4

Arrays: TypeAlias = dict[str, Floats]
# A model of the flexibility, and each channel's load case and point.
Static: TypeAlias = tuple[StaticModel, list[int], list[int]]
# A number or a parameter for all modes, one for each, or a and b by their names.
Damping: TypeAlias = (
    float | str | Sequence[float | str] | Floats | Mapping[str, float | str]
)


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
            a sequence of these, one per mode, such as the ``damping`` of
            :class:`Measurements`; or ``{"mass": a, "stiffness": b}``, with
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
        model: Model,
        lines: ArrayLike,
        channels: Sequence[tuple[Hashable, Hashable]],
        *,
        damping: Damping,
        kind: str = "receptance",
        residual: bool = False,
        unit: str | None = None,
        stored: bool = False,
    ) -> None:
        checks.function("model", model)
        self.model, self.kind = model, checks.one_of("kind", kind, FRF_KINDS)
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
        if not self._proportional:
            stated = [x for x in self._damping if x not in self._inferred]
            ratios = np.array([0.0, *stated], dtype=float)
            doubt_percent("damping", ratios, LARGE_DAMPING, "the critical one")
        self.names = read_declared(model, "names")
        if self.names is not None:
            self.names = tuple(dict.fromkeys([*self.names, *self._inferred]))
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
        modes, by_model = read_declared(self.model, "jacobian")(parameters)
        of_model = (name for by_name in by_model.values() for name in by_name)
        names = [*dict.fromkeys([*of_model, *self._inferred])]
        needed = "frequency", "shapes"
        by_mode = gather_tangents("jacobian", modes, by_model, names, needed)
        f, shapes = (read(modes, name) for name in needed)
        flexibility, bent = np.zeros((len(f), 1)), np.zeros((1, 1, len(names)))
        if self._static is not None:
            static, cases, points = self._static
            response, slopes = static.jacobian(parameters)
            flexibility = response["displacement"][:, cases, points]
            slope = gather_tangents("residual", response, slopes, names)["displacement"]
            bent = slope[:, cases, points]
        values = f, shapes, flexibility, self._numbers(parameters, len(f))
        damped = np.array(
            [[[float(name == x) for name in names] for x in self._damping]]
        )
        every = by_mode["frequency"], by_mode["shapes"], bent, damped
        tangents = [np.moveaxis(part, -1, 0) for part in every]
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
    read = tuple(
        checks.parameter_names("damping", [x])[0]
        if isinstance(x, str)
        else checks.real_number("damping", x, 0.0)
        for x in values
    )
    return read


def _build_static(model: object, rows: list[int], columns: list[int]) -> Static:
    """Return a model of the flexibility, and each channel's load case and point."""
    if not isinstance(model, AffineModel) or model.skip:
        raise TypeError(
            "residual: expected a MatrixModel or FrameModel without rigid-body modes, "
            f"whose stiffness gives the flexibility, got {type(model).__name__}; take "
            "more modes instead"
        )
    named: dict[Hashable, Mapping[Hashable, float]] = {}
    for i in dict.fromkeys(rows + columns):
        parts = model.sensors.combination(i)
        named[str(i)] = {model.dofs[row]: factor for row, factor in parts.items()}
    loads = {str(i): named[str(i)] for i in columns}
    points: Mapping[Hashable, Sensor] = {str(i): named[str(i)] for i in rows}
    static = model.static(loads, points=points)
    cases = [static.cases.index(str(i)) for i in columns]
    return static, cases, [static.sensors.labels.index(str(i)) for i in rows]


class FRFTerm(Term):
    r"""Gaussian likelihood of frequency response functions (FRFs), line by line.

    .. math:: \ln p = \sum_{cl} \ln N(\mathrm{Re}\,\Delta_{cl}; 0, v_{cl})
        + \ln N(\mathrm{Im}\,\Delta_{cl}; 0, v_{cl}), \qquad
        v_{cl} = s_{cl}^2 + (\sigma_d |H_{cl}^m|)^2

    where :math:`\Delta = H - H^m`, for channel c at line l. With ``amplitude=True`` the
    logarithm of the amplitude is compared instead,

    .. math:: \ln p = \sum_{cl} \ln N\Big( \ln \frac{|H_{cl}|}{|H_{cl}^m|}; 0,
        \frac{s_{cl}^2}{|H_{cl}^m|^2} + \sigma_d^2 \Big)

    Use this if the phases are unreliable; antiresonances then count as much as
    resonances. The lines must be independent, as those of averaged FFTs without zero
    padding are.

    Args:
        measured: :class:`FRFMeasurements`.
        sd: s, the standard deviation of the real and of the imaginary part: one number,
            one per channel ``(n_channels, 1)``, or ``(n_channels, n_lines)``; computed
            from the coherence by default.
        amplitude: Whether to compare amplitudes only.
        discrepancy: Name of the parameter :math:`\sigma_d`, the discrepancy of the
            model relative to the amplitude; None for no discrepancy.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If measured is not FRFMeasurements.
        ValueError: If the error is unknown, sd is not positive or has another shape, or
            only magnitudes were measured and ``amplitude`` is False, or these are
            negative, as in dB.

    Source: Bendat and Piersol, Random Data, 4th ed. (2010), section 9.2.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu.extensions.frf import FRFMeasurements, FRFTerm
        >>> measured = FRFMeasurements([9.0], [[2j]], [("a", "b")], kind="receptance")
        >>> term = FRFTerm(measured, sd=0.1)
        >>> term({}, {"receptance": np.array([[[[0.0, 2.1]]]])}).round(4).tolist()
        [2.2673]
    """

    reads: Mapping[str, Variable]
    symbol = MODEL_ERROR

    def __init__(
        self,
        measured: FRFMeasurements,
        *,
        sd: ArrayLike | None = None,
        amplitude: bool = False,
        discrepancy: str | None = None,
        name: str = "frf",
    ) -> None:
        self.measured = checks.instance("measured", measured, FRFMeasurements)
        self.label(name, discrepancy)
        self.amplitude = checks.flag("amplitude", amplitude)
        self.statement, self.formula = BY_AMPLITUDE if self.amplitude else BY_PARTS
        real = not measured.values.imag.any()
        if real and not self.amplitude:
            raise ValueError(
                "measured: expected complex values with their phases, got only real "
                "ones; for magnitudes use FRFTerm(..., amplitude=True)"
            )
        if real and (measured.values.real < 0).all():
            raise ValueError(
                "measured: expected magnitudes above zero, got negative ones; are they "
                "in dB? Then give 10 ** (values / 20)"
            )
        shape, spread = measured.values.shape, measured.sd
        if (self.amplitude or sd is None) and not measured.values.all():
            i, j = np.argwhere(measured.values == 0)[0]
            raise ValueError(
                f"measured: {measured.channels[i].label} is 0 at {measured.lines[j]:g} "
                "Hz, which has no relative error and no logarithm; give sd without "
                "amplitude, or leave such lines out"
            )
        if sd is not None:
            spread = error_array("sd", sd, (shape[0], 1), shape)
        elif spread is None and discrepancy is None:
            raise ValueError("sd: measured has no coherence; give sd or discrepancy")
        # (n_channels, n_lines); zero if exact
        self.sd = np.broadcast_to(0.0 if spread is None else spread, shape)
        # By deviation: logarithms of amplitudes, or real and imaginary parts.
        size = np.abs(measured.values)
        errors = np.stack([self.sd, size], axis=0)
        by_part = errors / size if self.amplitude else errors.repeat(2, axis=-1)
        self.stated_sd, self.scale = by_part.reshape(2, -1)
        kind, unit = measured.kind, measured.unit
        self.reads = {kind: frf_variable(measured.channels, measured.lines, kind, unit)}

    def deviations(self, parameters: Parameters, response: Response) -> Deviations:
        """Return deviations and their standard deviations, ``(n, m)`` each.

        For amplitudes they are those of the logarithms.
        """
        channels, lines = self.measured.values.shape
        H = read(response, self.measured.kind)[:, :channels, :lines]
        size = np.abs(self.measured.values)
        if self.amplitude:
            with np.errstate(divide="ignore"):  # an FRF of 0 is impossible, not wrong
                r = 0.5 * np.log((H**2).sum(axis=-1)) - np.log(size)
        else:
            values = self.measured.values
            r = H - np.stack([values.real, values.imag], axis=-1)
        r = r.reshape(len(r), -1)
        return r, np.broadcast_to(self.standard_deviations(parameters), r.shape)
