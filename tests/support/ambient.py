"""Records of oscillators under white noise, by an integrator of their own."""

import numpy as np
from scipy import signal

import emcee_femu as ef


def simulate(rng, f, zeta, S, shapes, noise, periods, rate=10.0, coherence=0.0):
    """Return accelerations ``(samples, channels)``, after 100 / f s of running in.

    The force is constant over each of 1 / rate s, so exact: state space by the matrix
    exponential. Its one-sided density is S well below half the rate. ``rate`` is over
    the lowest frequency; ``coherence`` is that of the two forces, complex.
    """
    f, shapes = (
        np.atleast_1d(f),
        np.asarray(shapes, dtype=float).reshape(-1, np.size(f)),
    )
    dt = 1 / (rate * f.min())
    n, before = round(periods / f.min() / dt), round(100 / f.min() / dt)
    forces = rng.standard_normal((len(f), n + before))
    if coherence:
        mixed = signal.hilbert(forces[0])
        own = np.sqrt(1 - abs(coherence) ** 2) * forces[1]
        # E(p1 conj(p2)) = coherence: p2 turns by the conjugate.
        forces[1] = (np.conj(coherence) * mixed).real + own
    modes = []
    zeta, S = np.broadcast_to(zeta, f.shape), np.broadcast_to(S, f.shape)
    for i, (hertz, ratio) in enumerate(zip(f, zeta, strict=True)):
        w = 2 * np.pi * hertz
        over_force = [1.0, 0.0, 0.0], [1.0, 2 * ratio * w, w * w]
        b, a, _ = signal.cont2discrete(over_force, dt)
        p = forces[i] * np.sqrt(S[i] / (2 * dt))
        modes.append(signal.lfilter(b.ravel(), a, p)[before:])
    record = np.transpose(modes) @ shapes.T
    record += rng.standard_normal(record.shape) * np.sqrt(noise / (2 * dt))
    return record, 1 / dt


def widely(model):
    """Return the prior that is uniform over the model's own ranges."""
    ranges = model.ranges.items()
    return ef.IndependentPrior({k: (*v,) for k, v in ranges})


def draw_spectra(rng, model, parameters, lines, averages=1, kind="acceleration"):
    """Return :class:`Spectra` of the likelihood's law, by E_k in full."""
    modes = model({name: np.array([v]) for name, v in parameters.items()})
    return sample_matrices(rng, matrices(modes, lines, kind)[0], averages, lines, kind)


def matrices(modes, lines, kind="acceleration"):
    """Return E ``(n, lines, channels, channels)``, written out mode by mode."""
    q = {"acceleration": 0, "velocity": 1, "displacement": 2}[kind]
    b = modes["frequency"][:, :, None] / lines
    zeta = modes["damping_ratio"][:, :, None]
    h = (2j * np.pi * lines) ** -q / (1 - b**2 - 2j * zeta * b)
    S = modes["force_psd"] @ [1, 1j]
    phi = modes["shapes"]
    E = np.einsum("nij,nik,njk,nai,nbj->nkab", S, h, h.conj(), phi, phi)
    return E + modes["noise_psd"][:, None, None, None] * np.eye(phi.shape[1])


def sample_matrices(rng, E, averages, lines, kind):
    """Return :class:`Spectra` of complex Gaussian FFTs."""
    half = np.linalg.cholesky(E)
    shape = (averages, len(lines), E.shape[-1], 2)
    z = rng.standard_normal(shape) @ [1, 1j] / np.sqrt(2)
    F = np.einsum("kab,skb->ska", half, z)
    D = np.einsum("ska,skb->kab", F, F.conj()) / averages
    return ef.spectra.Spectra(lines, D, averages=averages, kind=kind)
