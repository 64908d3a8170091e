"""One mode, or a close pair, that broad-band forces excite."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from .. import checks
from ..interfaces import Derivatives, Floats, Parameters, Variable
from ..measurements.spectra import KINDS, Spectra
from .inputs import derive_along

Reference: TypeAlias = str | Sequence[str] | None  # of all modes, or of each
WIDEST_DAMPING = (1e-4, 0.2)
LARGEST_COMPONENT = 2.0  # of a shape, over the reference
STEP = 1e-5  # of a parameter, relative: no solve adds noise


class SpectrumModel:
    r"""Modes near one spectral peak, and what excites them, from parameters.

    For one mode the parameters are

    - ``f`` in Hz and ``zeta``, natural frequency and damping ratio;
    - ``ln_S``, the logarithm of the one-sided spectral density of the modal force per
      modal mass, with the shape scaled to unit length over the sensors;
    - ``ln_S_e``, that of the noise of every channel, modes far away included;
    - ``phi_<sensor>``, the shape at each sensor but the reference, where it is 1.

    For a pair they are ``f1``, ``f2``, ``zeta1``, ..., ``phi2_<sensor>`` with one
    ``ln_S_e``, and ``coherence_re`` and ``coherence_im`` of the two forces,

    .. math:: \chi = S_{12} / \sqrt{S_{11} S_{22}}, \qquad |\chi| < 1.

    The response is a mapping: ``frequency``, ``damping_ratio`` and ``shapes`` of unit
    length, which are stored, and ``force_psd`` and ``noise_psd``.

    Args:
        measured: :class:`Spectra`, whose sensors and levels count.
        n_modes: 1 or 2.
        reference: The sensor where the shape is 1 before it is scaled, or one for each
            mode; it must move in the mode. None for the one with the most power.

    Raises:
        TypeError: If measured is not Spectra.
        ValueError: If there are not 1 or 2 modes, or no such sensor.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu.spectra import Spectra, SpectrumModel
        >>> spectra = Spectra([0.9, 1.0], np.eye(2) + np.zeros((2, 2, 2)), averages=9)
        >>> model = SpectrumModel(spectra, reference="s2")
        >>> model.names
        ('f', 'zeta', 'ln_S', 'phi_s1', 'ln_S_e')
        >>> values = dict.fromkeys(model.names, np.array([0.75]))
        >>> model(values)["shapes"].round(3).tolist()
        [[[0.6], [0.8]]]
    """

    def __init__(
        self, measured: Spectra, n_modes: int = 1, *, reference: Reference = None
    ) -> None:
        checks.instance("measured", measured, Spectra)
        if checks.whole_number("n_modes", n_modes, 1) > 2:
            raise ValueError(
                f"n_modes: expected 1 or 2, got {n_modes}; take another band for modes "
                "that are further apart"
            )
        self.n_modes, self.sensors = n_modes, measured.sensors
        self.reference = _read_reference(reference, measured, n_modes)
        # What ends the names of each mode's parameters.
        self._ends = ("",) if n_modes == 1 else ("1", "2")
        self.ranges = self._find_ranges(measured)
        self.names = tuple(self.ranges)
        positive = [f"{key}{end}" for end in self._ends for key in ("f", "zeta")]
        self.bounds = dict.fromkeys(positive, (0.0, np.inf))
        modes: Sequence[int] = range(1, n_modes + 1)
        mode, part = {"mode": modes}, {"part": ["real", "imaginary"]}
        self.variables = {
            "frequency": Variable(mode, "Hz"),
            "damping_ratio": Variable(mode),
            "shapes": Variable({"sensor": measured.sensors} | mode),
            "force_psd": Variable(mode | {"other": modes} | part, stored=False),
            "noise_psd": Variable({}, stored=False),
        }

    def __call__(self, parameters: Parameters) -> dict[str, Floats]:
        """Return the modes and their spectral densities."""
        values, _ = checks.batch({name: parameters[name] for name in self.names})
        return self._respond(*values.values())

    def jacobian(self, parameters: Parameters) -> tuple[dict[str, Floats], Derivatives]:
        """Return the response and its derivatives, ``{variable: {parameter: ...}}``."""
        values = [parameters[name] for name in self.names]
        steps = STEP * np.maximum(np.abs(values), 1e-3)
        units = [np.ones_like(steps) * row[:, None] for row in np.eye(len(values))]
        slopes = derive_along(self._respond, values, units, steps, self.names)
        return self._respond(*values), slopes

    def _respond(self, *columns: Floats) -> dict[str, Floats]:
        """Return the response to one column of values for each of the names."""
        values = dict(zip(self.names, columns, strict=True))
        n = len(columns[0])
        f, zeta, ln_S = (
            np.stack([values[f"{key}{end}"] for end in self._ends], axis=1)
            for key in ("f", "zeta", "ln_S")
        )
        shapes = np.ones((n, len(self.sensors), self.n_modes))
        for i, end in enumerate(self._ends):
            for row, sensor in enumerate(self.sensors):
                if sensor != self.reference[i]:
                    shapes[:, row, i] = values[f"phi{end}_{sensor}"]
        force = np.zeros((n, self.n_modes, self.n_modes, 2))
        modes = np.arange(self.n_modes)
        force[:, modes, modes, 0] = np.exp(ln_S)
        if self.n_modes == 2:
            size = np.exp(ln_S.mean(axis=1))
            force[:, 0, 1, 0] = force[:, 1, 0, 0] = size * values["coherence_re"]
            force[:, 0, 1, 1] = size * values["coherence_im"]
            force[:, 1, 0, 1] = -force[:, 0, 1, 1]
        return {
            "frequency": f,
            "damping_ratio": zeta,
            "shapes": shapes / np.linalg.norm(shapes, axis=1, keepdims=True),
            "force_psd": force,
            "noise_psd": np.exp(values["ln_S_e"]),
        }

    def _find_ranges(self, measured: Spectra) -> dict[str, tuple[float, float]]:
        """Return wide ranges of the parameters, by the level of the spectra."""
        low, high = measured.lines[[0, -1]].tolist()
        power = measured.psd.sum(axis=1)
        over = (2 * np.pi * measured.lines) ** (2 * KINDS[measured.kind])
        # A mode alone has pi f S / (4 zeta) of power.
        whole = (power * over).mean() * (high - low) * 4 / (np.pi * high)
        S = tuple(np.log(whole * np.multiply(WIDEST_DAMPING, (0.1, 10))).tolist())
        component = (-LARGEST_COMPONENT, LARGEST_COMPONENT)
        ranges: dict[str, tuple[float, float]] = {}
        for end, reference in zip(self._ends, self.reference, strict=True):
            ranges |= {f"f{end}": (low, high), f"zeta{end}": WIDEST_DAMPING}
            ranges[f"ln_S{end}"] = S
            others = [sensor for sensor in self.sensors if sensor != reference]
            ranges |= {f"phi{end}_{sensor}": component for sensor in others}
        if self.n_modes == 2:
            ranges |= dict.fromkeys(("coherence_re", "coherence_im"), (-1.0, 1.0))
        noise = tuple(np.log([np.median(power) * 1e-8, power.max()]).tolist())
        return ranges | {"ln_S_e": noise}


def _read_reference(reference: Reference, measured: Spectra, n: int) -> tuple[str, ...]:
    """Return a sensor for each mode."""
    if reference is None:
        reference = measured.sensors[int(np.argmax(measured.psd.sum(axis=0)))]
    sensors = tuple(reference) if np.ndim(reference) else (str(reference),) * n
    if len(sensors) != n or any(x not in measured.sensors for x in sensors):
        raise ValueError(
            f"reference: expected one of {list(measured.sensors)}, or one for each of "
            f"{n} modes, got {reference!r}"
        )
    return sensors
