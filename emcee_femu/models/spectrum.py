"""One mode, or a close pair, that broad-band forces excite."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .. import checks
from ..interfaces import Derivatives, Floats, Parameters, Variable
from ..measurements.spectra import KINDS, Spectra

WIDEST_DAMPING = (1e-4, 0.2)
LARGEST_COMPONENT = 2.0  # of a shape, over the reference
STEP = 1e-5  # of a parameter, relative: no solve adds noise


@dataclass(frozen=True, eq=False, init=False)
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

    sensors: tuple[str, ...]
    reference: tuple[str, ...]
    names: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    variables: Mapping[str, Variable] = field(repr=False)

    def __init__(
        self,
        measured: Spectra,
        n_modes: int = 1,
        *,
        reference: str | Sequence[str] | None = None,
    ) -> None:
        if not isinstance(measured, Spectra):
            raise TypeError(f"measured: expected Spectra, got {measured!r}")
        if checks.whole_number("n_modes", n_modes, 1) > 2:
            raise ValueError(
                f"n_modes: expected 1 or 2, got {n_modes}; take another band for modes "
                "that are further apart"
            )
        chosen = _read_reference(reference, measured, n_modes)
        modes: Sequence[int] = range(1, n_modes + 1)
        by_mode = {"mode": modes}
        checks.set_fields(
            self,
            sensors=measured.sensors,
            reference=chosen,
            variables={
                "frequency": Variable(by_mode, "Hz"),
                "damping_ratio": Variable(by_mode),
                "shapes": Variable({"sensor": measured.sensors} | by_mode),
                "force_psd": Variable(
                    by_mode | {"other": modes, "part": ["real", "imaginary"]},
                    stored=False,
                ),
                "noise_psd": Variable({}, stored=False),
            },
        )
        ranges = self._find_ranges(measured)
        checks.set_fields(self, ranges=ranges, names=tuple(ranges))

    @property
    def n_modes(self) -> int:
        """The number of modes."""
        return len(self.reference)

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Frequencies and damping ratios stay above zero."""
        names = [f"{key}{end}" for end in self._ends for key in ("f", "zeta")]
        return dict.fromkeys(names, (0.0, np.inf))

    @property
    def _ends(self) -> tuple[str, ...]:
        """What ends the names of each mode's parameters."""
        return ("",) if self.n_modes == 1 else ("1", "2")

    def __call__(self, parameters: Parameters) -> dict[str, Floats]:
        """Return the modes and their spectral densities."""
        values, n = checks.batch({name: parameters[name] for name in self.names})
        shapes = [self._scaled(values, i) for i in range(self.n_modes)]
        S = np.exp([values[f"ln_S{end}"] for end in self._ends])
        force = np.zeros((n, self.n_modes, self.n_modes, 2))
        for i, own in enumerate(S):
            force[:, i, i, 0] = own
        if self.n_modes == 2:
            size = np.sqrt(S[0] * S[1])
            force[:, 0, 1, 0] = force[:, 1, 0, 0] = size * values["coherence_re"]
            force[:, 0, 1, 1] = size * values["coherence_im"]
            force[:, 1, 0, 1] = -force[:, 0, 1, 1]
        return {
            "frequency": np.stack([values[f"f{end}"] for end in self._ends], axis=1),
            "damping_ratio": np.stack(
                [values[f"zeta{end}"] for end in self._ends], axis=1
            ),
            "shapes": np.stack(shapes, axis=2),
            "force_psd": force,
            "noise_psd": np.exp(values["ln_S_e"]),
        }

    def jacobian(self, parameters: Parameters) -> tuple[dict[str, Floats], Derivatives]:
        """Return the response and its derivatives, ``{variable: {parameter: ...}}``."""
        response = self(parameters)
        derivatives: Derivatives = {variable: {} for variable in response}
        for name in self.names:
            step = STEP * np.maximum(np.abs(parameters[name]), 1e-3)
            ahead, behind = (
                self({**parameters, name: parameters[name] + by})
                for by in (step, -step)
            )
            for variable, value in ahead.items():
                width = 2 * step.reshape(-1, *[1] * (value.ndim - 1))
                derivatives[variable][name] = (value - behind[variable]) / width
        return response, derivatives

    def _scaled(self, parameters: Parameters, i: int) -> Floats:
        """Return the shape of a mode, of unit length, ``(n, sensors)``."""
        end, reference = self._ends[i], self.reference[i]
        ones = np.ones(len(parameters["ln_S_e"]))
        columns = [
            ones if sensor == reference else parameters[f"phi{end}_{sensor}"]
            for sensor in self.sensors
        ]
        shape = np.stack(columns, axis=1)
        scaled: Floats = shape / np.linalg.norm(shape, axis=1, keepdims=True)
        return scaled

    def _find_ranges(self, measured: Spectra) -> dict[str, tuple[float, float]]:
        """Return wide ranges of the parameters, by the level of the spectra."""
        low, high = measured.lines[[0, -1]].tolist()
        power = measured.psd.sum(axis=1)
        over = (2 * np.pi * measured.lines) ** (2 * KINDS[measured.kind])
        # A mode alone has pi f S / (4 zeta) of power.
        whole = (power * over).mean() * (high - low) * 4 / (np.pi * high)
        S = tuple(np.log(whole * np.multiply(WIDEST_DAMPING, (0.1, 10))).tolist())
        noise = tuple(np.log([np.median(power) * 1e-8, power.max()]).tolist())
        component = (-LARGEST_COMPONENT, LARGEST_COMPONENT)
        found: dict[str, tuple[float, float]] = {}
        for end, reference in zip(self._ends, self.reference, strict=True):
            found |= {f"f{end}": (low, high), f"zeta{end}": WIDEST_DAMPING}
            found[f"ln_S{end}"] = S
            others = [sensor for sensor in self.sensors if sensor != reference]
            found |= {f"phi{end}_{sensor}": component for sensor in others}
        if self.n_modes == 2:
            found |= dict.fromkeys(("coherence_re", "coherence_im"), (-1.0, 1.0))
        return found | {"ln_S_e": noise}


def _read_reference(reference: object, measured: Spectra, n: int) -> tuple[str, ...]:
    """Return a sensor for each mode."""
    if reference is None:
        strongest = int(np.argmax(measured.psd.sum(axis=0)))
        return (measured.sensors[strongest],) * n
    given = [reference] * n if isinstance(reference, str) else reference
    if (
        not isinstance(given, Sequence)
        or len(given) != n
        or any(one not in measured.sensors for one in given)
    ):
        raise ValueError(
            f"reference: expected one of {list(measured.sensors)}, or one for each of "
            f"{n} modes, got {reference!r}"
        )
    return tuple(given)
