"""Derivatives of the Whittle likelihood of a few modes in noise."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..interfaces import Floats, read


def linearize_spectrum(
    matrices: Any, averages: int, h: Any, dh: Any, response: Any, tangents: Any
) -> tuple[Floats, Floats]:
    r"""Return gradient ``(n, d)`` of the log-likelihood, and its scores ``(n, m, d)``.

    With :math:`\Phi = Q R` the covariance is :math:`B_k = S_e I + R H_k R^T` within the
    span of Q and :math:`S_e` across it, so that Fisher's information,

    .. math:: F_{ab} = n_d \sum_k \mathrm{tr}(E_k^{-1} \partial_a E_k
        E_k^{-1} \partial_b E_k),

    has three parts: within, between, where only shapes turn out of the span, and
    across, where only the noise changes.

    Args:
        matrices: Measured D, ``(lines, channels, channels)``.
        averages: The number of segments.
        h: Of each mode and line, complex, ``(n, modes, lines)``.
        dh: Its derivatives, ``(n, modes, lines, d)``.
        response: Shapes, force_psd and noise_psd.
        tangents: Their derivatives.

    Source: Whittle (1953), doi:10.1007/BF02590998; by Slepian and Bangs' formula.
    """
    phi, noise = read(response, "shapes"), read(response, "noise_psd")
    S, dS = read(response, "force_psd") @ [1, 1j], _complex(tangents["force_psd"])
    Q, R = np.linalg.qr(phi)
    (n, c, r), lines = Q.shape, len(matrices)
    across = (c - r) * lines
    H = np.einsum("nij,nik,njk->nkij", S, h, h.conj())
    B = R[:, None] @ H @ R.swapaxes(1, 2)[:, None]
    B += noise[:, None, None, None] * np.eye(r)
    found, vectors = np.linalg.eigh(B)
    # By rounding, or where the likelihood is zero, they are below the noise.
    sizes = np.sqrt(np.maximum(found, noise[:, None, None]))[:, :, None]
    adjoint = vectors / sizes
    inverse = adjoint.conj().swapaxes(2, 3)  # of a root of B

    turned = np.einsum("nci,ncjd->nijd", Q, tangents["shapes"])
    out = tangents["shapes"] - np.einsum("nci,nijd->ncjd", Q, turned)
    HR = H @ R.swapaxes(1, 2)[:, None]
    dB = np.einsum("naid,nkib->nkabd", turned, HR)
    dB = dB + dB.conj().swapaxes(2, 3)
    dH = np.einsum("nijd,nik,njk->nkijd", dS, h, h.conj())
    moved = np.einsum("nij,nikd,njk->nkijd", S, dh, h.conj())
    dH += moved + moved.conj().swapaxes(2, 3)
    dB += np.einsum("nai,nkijd,nbj->nkabd", R, dH, R)
    dB += np.eye(r)[..., None] * tangents["noise_psd"][:, None, None, None]
    within = np.einsum("nkab,nkbcd,nkce->nkaed", inverse, dB, adjoint)

    seen = np.einsum("nca,kce->nkae", Q, matrices)
    inside = seen @ Q[:, None]
    rest = np.eye(r) - inverse @ inside @ adjoint
    gradient = np.einsum("nkab,nkbad->nd", rest, within).real
    solved = adjoint @ inverse  # B^-1
    to_shapes = (HR @ solved @ seen).sum(axis=1).real / noise[:, None, None]
    gradient -= 2 * np.einsum("nmc,ncmd->nd", to_shapes, out)
    by_noise = tangents["noise_psd"] / noise[:, None]
    total = np.einsum("kcc->", matrices).real
    beyond = total - np.einsum("nkaa->n", inside).real
    gradient += (across - beyond / noise)[:, None] * by_noise

    between = 2 * (HR @ solved @ HR.conj().swapaxes(2, 3)).sum(axis=1).real
    values, vectors = np.linalg.eigh(between / noise[:, None, None])
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    scores = [
        within.real.reshape(n, lines * r * r, -1),
        within.imag.reshape(n, lines * r * r, -1),
        np.einsum("ncmd,nmp->ncpd", out, root).reshape(n, c * root.shape[1], -1),
        np.sqrt(across) * by_noise[:, None],
    ]
    return -averages * gradient, np.sqrt(averages) * np.concatenate(scores, axis=1)


def differentiate_h(
    h: Any, lines: Floats, over: Any, response: Any, tangents: Mapping[str, Floats]
) -> Any:
    r"""Return derivatives of h by each direction, ``(n, modes, lines, d)``.

    .. math:: dh = h^2 (2 \pi i f_k)^q [2 (b + i \zeta) db + 2 i b d\zeta]

    Args:
        h: Complex, ``(n, modes, lines)``.
        lines: In Hz.
        over: :math:`(2 \pi i f_k)^q`.
        response: frequency and damping_ratio.
        tangents: Their derivatives ``(n, modes, d)``.
    """
    b = read(response, "frequency")[:, :, None] / lines
    zeta = read(response, "damping_ratio")[:, :, None]
    by_b, by_zeta = 2 * (b + 1j * zeta) / lines, 2j * b
    slopes = by_b[..., None] * tangents["frequency"][:, :, None]
    slopes = slopes + by_zeta[..., None] * tangents["damping_ratio"][:, :, None]
    return (h * h * over)[..., None] * slopes


def _complex(parts: Floats) -> Any:
    """Return derivatives ``(n, modes, modes, d)`` of real and imaginary parts."""
    return parts[:, :, :, 0] + 1j * parts[:, :, :, 1]
