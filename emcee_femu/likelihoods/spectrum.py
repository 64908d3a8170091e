"""The likelihood of FFTs near one mode or a close pair."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..interfaces import Batch, Floats, Parameters, Response, Variable, read
from ..measurements.spectra import KINDS, Spectra
from .term import Term, derive, move_along

Numbers: TypeAlias = Floats | NDArray[np.complex128]


class SpectrumTerm(Term):
    r"""Whittle likelihood of spectral matrices: FFTs are independent complex Gaussians.

    .. math:: \ln p = -n_d \sum_k \big[ n \ln \pi + \ln |E_k|
        + \mathrm{tr}(E_k^{-1} D_k) \big], \qquad
        E_k = \Phi H_k \Phi^T + S_e I

    .. math:: (H_k)_{ij} = S_{ij} h_{ik} h_{jk}^*, \qquad
        h_{ik} = \frac{(2 \pi i f_k)^{-q}}{1 - b_{ik}^2 - 2 i \zeta_i b_{ik}}, \qquad
        b_{ik} = f_i / f_k

    for n channels and :math:`n_d` averages, with q = 0, 1, 2 for acceleration, velocity
    and displacement: the density of the FFTs of all segments. No matrix of a line is
    inverted: with the shape of unit length the eigenvalues of one mode are
    :math:`S |h_k|^2 + S_e` and, n - 1 times, :math:`S_e`; a pair needs matrices of two
    rows in closed form. Where two frequencies do not ascend, or the coherence of the
    forces is not below 1, the likelihood is zero.

    Args:
        measured: :class:`Spectra`.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If measured is not Spectra, or name no text.

    Source: Au (2011), doi:10.1061/(ASCE)EM.1943-7889.0000213; Au, Operational Modal
    Analysis (2017), doi:10.1007/978-981-10-4118-1.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu.spectra import Spectra, SpectrumTerm
        >>> term = SpectrumTerm(Spectra([2.0], [[[0.5]]], averages=1))
        >>> modes = {"frequency": np.array([[1.0]]), "damping_ratio": np.array([[0.1]])}
        >>> modes |= {"shapes": np.ones((1, 1, 1)), "noise_psd": np.array([0.5])}
        >>> S = np.array([[[[0.5725 * 0.5, 0.0]]]])  # that over abs(h)^2 is 1 / 2
        >>> (-term({}, modes | {"force_psd": S}) - np.log(np.pi)).round(4).tolist()
        [0.5]
    """

    gaussian, scored = False, True

    def __init__(self, measured: Spectra, *, name: str = "spectrum") -> None:
        self.measured = checks.instance("measured", measured, Spectra)
        self.label(name)
        mode: dict[str, Any] = {"mode": [1]}  # or more
        force = mode | {"other": [1], "part": ["real", "imaginary"]}
        self.reads = {
            "frequency": Variable(mode, "Hz"),
            "damping_ratio": Variable(mode),
            "shapes": Variable({"sensor": measured.sensors} | mode),
            "force_psd": Variable(force),
            "noise_psd": Variable({}),
        }
        self._power = measured.psd.sum(axis=1)  # (lines,)
        D = measured.matrices.reshape(len(measured.lines), -1).T
        # (channels ** 2, lines)
        self._halves = np.ascontiguousarray(D.real), np.ascontiguousarray(D.imag)

    def __call__(self, parameters: Parameters, response: Response) -> Floats:
        """Return the log-likelihood of every parameter set, ``(n,)``."""
        log_likelihood = self._density(response)
        f, psd = read(response, "frequency"), read(response, "force_psd")
        if f.shape[1] == 2:  # which ascend, and whose forces can have these spectra
            cross = (psd[:, 0, 1] ** 2).sum(axis=1)
            possible = (f[:, 0] < f[:, 1]) & (cross < psd[:, 0, 0, 0] * psd[:, 1, 1, 0])
            log_likelihood[~possible] = -np.inf
        return log_likelihood

    def _density(self, response: Response) -> Floats:
        """Return the log-likelihood, of impossible pairs too."""
        lines, n_channels, _ = self.measured.matrices.shape
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            rank = read(response, "frequency").shape[1]
            values = self._one_mode(response) if rank == 1 else self._pair(response)
            noise = np.log(read(response, "noise_psd"))
            log_likelihood: Floats = -self.measured.averages * (
                values.sum(axis=1)
                + lines * ((n_channels - rank) * noise + n_channels * np.log(np.pi))
            )
        return log_likelihood

    def linearize(
        self, parameters: Parameters, response: Response, tangents: Batch, steps: Floats
    ) -> tuple[Floats, Floats]:
        r"""Return the gradient of the log-likelihood, and its scores ``(n, m, d)``.

        Fisher's information is

        .. math:: F_{ab} = n_d \sum_k \mathrm{tr}(E_k^{-1} \partial_a E_k
            E_k^{-1} \partial_b E_k),

        so that scores are the parts of :math:`E_k^{-1/2} \partial E_k E_k^{-1/2}`.

        Source: Whittle (1953), doi:10.1007/BF02590998; by Slepian and Bangs' formula.
        """
        steps = self._choose_steps(parameters, response, tangents, steps)
        _, moved = move_along(parameters, response, tangents, steps)
        gradient = derive(self._density(moved), steps)[:, 0]
        here, around = self._modal(response), self._modal(moved)
        (n, d), scores = steps.shape, []
        for i in range(n):  # one by one, for whole matrices are large
            E = _covariances(*(part[i : i + 1] for part in here))[0]
            rows = slice(2 * d * i, 2 * d * (i + 1))
            sides = _covariances(*(part[rows] for part in around))
            values, vectors = np.linalg.eigh(E)
            # By rounding, or where the likelihood is zero, they are below the noise.
            root = vectors / np.sqrt(np.maximum(values, here[-1][i]))[:, None]
            dE = derive(sides, steps[i : i + 1])[0].T.reshape(d, *E.shape)
            white = (root.conj().swapaxes(1, 2) @ dE @ root).reshape(d, -1).T
            parts = np.concatenate([white.real, white.imag])
            scores.append(np.linalg.qr(parts, mode="r"))
        return gradient, np.sqrt(self.measured.averages) * np.array(scores)

    def _modal(
        self, response: Response
    ) -> tuple[Floats, NDArray[np.complex128], Floats, Floats]:
        """Return shapes, what they transfer at each line, forces and noise."""
        forces = read(response, "force_psd") @ [1, 1j]
        noise = read(response, "noise_psd")
        return read(response, "shapes"), 1 / self._flexibility(response), forces, noise

    def _one_mode(self, response: Response) -> Floats:
        """Return what each line adds for one mode, but for the noise's logarithm."""
        phi = read(response, "shapes")[:, :, 0]
        h = 1 / self._flexibility(response)[:, 0]
        noise = read(response, "noise_psd")[:, None]
        total = read(response, "force_psd")[:, 0, 0, :1] * np.abs(h) ** 2 + noise
        along = self._project(phi, phi, 0)
        values: Floats = np.log(total) + along / total
        values += (self._power - along) / noise
        return values

    def _pair(self, response: Response) -> Floats:
        """Return what each line adds for two modes, but for the noise's logarithm."""
        phi, psd = read(response, "shapes"), read(response, "force_psd")
        noise = read(response, "noise_psd")[:, None]
        h = 1 / self._flexibility(response)
        H11 = psd[:, 0, 0, :1] * np.abs(h[:, 0]) ** 2
        H22 = psd[:, 1, 1, :1] * np.abs(h[:, 1]) ** 2
        S12 = psd[:, 0, 1, 0] + 1j * psd[:, 0, 1, 1]
        H12 = S12[:, None] * h[:, 0] * h[:, 1].conj()
        det = H11 * H22 - np.abs(H12) ** 2
        first, second = phi[:, :, 0], phi[:, :, 1]
        cosine = (first * second).sum(axis=1)[:, None]
        W11, W22 = self._project(first, first, 0), self._project(second, second, 0)
        W12 = self._project(first, second, 0) + 1j * self._project(first, second, 1)
        # Of the matrix of two rows noise I + (Phi^T Phi) H.
        determinant = noise**2 + noise * (H11 + H22 + 2 * cosine * H12.real)
        determinant += (1 - cosine**2) * det
        traced = H11 * W11 + H22 * W22 + 2 * (H12 * W12.conj()).real
        fitted = noise * traced + det * (W11 + W22 - 2 * cosine * W12.real)
        values: Floats = np.log(determinant)
        values += (self._power - fitted / determinant) / noise
        return values

    def _flexibility(self, response: Response) -> NDArray[np.complex128]:
        """Return 1 / h, complex, ``(n, modes, lines)``."""
        lines = self.measured.lines
        b = read(response, "frequency")[:, :, None] / lines
        zeta = read(response, "damping_ratio")[:, :, None]
        power = KINDS[self.measured.kind]
        inverse: NDArray[np.complex128] = 1 - b * b - 2j * zeta * b
        inverse *= (2j * np.pi * lines) ** power
        return inverse

    def _project(self, left: Floats, right: Floats, part: int) -> Floats:
        """Return one part of ``left^T D right``, ``(n, lines)``."""
        both = (left[:, :, None] * right[:, None]).reshape(len(left), 1, -1)
        result: Floats = (both @ self._halves[part])[:, 0]  # a row rounds as if alone
        return result


def _covariances(
    shapes: Numbers, h: Numbers, forces: Numbers, noise: Numbers
) -> NDArray[np.complex128]:
    """Return E of each line, ``(n, lines, channels, channels)``."""
    moving = np.einsum("nci,nik->nkci", shapes, h)
    E: NDArray[np.complex128]
    E = (moving @ forces[:, None]) @ moving.conj().swapaxes(2, 3)
    return E + noise[:, None, None, None] * np.eye(shapes.shape[1])
