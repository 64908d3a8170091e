"""The ArviZ object that carries a certificate, for tables, figures and netCDF."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from .arviz_objects import groups, wrap
from .certificate import CORRECTED, Certificate
from .inference_data import to_inference_data


class SolvedRun:
    """One walker whose steps are draws that were solved in full.

    Args:
        theta: The draws, ``(n, d)``.
        rows: Their rows, ``(n, columns)``.
    """

    nwalkers = 1
    seed = "unknown (solved at chosen draws)"
    recipe = "draws of an emulated posterior, solved in full and weighted"

    def __init__(self, theta: Floats, rows: Floats) -> None:
        self._theta, self._rows = theta, rows
        self.iteration = len(theta)
        self.accepted: NDArray[np.float64] = np.array([np.nan])

    def get_chain(self, **_: Any) -> Floats:
        """Return the draws, ``(n, 1, d)``."""
        return self._theta[:, None]

    def get_log_prob(self, **_: Any) -> Floats:
        """Return the log-posterior, ``(n, 1)``."""
        return self._rows[:, :1]

    def get_blobs(self, **_: Any) -> Floats:
        """Return the rest of the rows, ``(n, 1, columns - 1)``."""
        return self._rows[:, None, 1:]


def with_certificate(
    idata: Any,
    posterior: LogPosterior,
    found: Certificate,
    rows: Floats,
    log_emulated: Floats,
) -> Any:
    """Return an ArviZ object with the certificate.

    Args:
        idata: Of the emulated posterior.
        posterior: The true one.
        found: The certificate.
        rows: Rows of the true posterior at the solved draws, ``(n, columns)``.
        log_emulated: The emulated log-posterior there, ``(n,)``.
    """
    import xarray

    n = len(found.weights)
    text = f"{found.short} by {found.solves} full solves"
    if found.short == CORRECTED:
        possible = found.weights > 0
        text = f"corrected by the weights of {n} full solves"
        made = to_inference_data(
            SolvedRun(found.theta[possible], rows[possible]), posterior
        )
        held = groups(made)
        weights = found.weights[possible][None]
        held["sample_stats"] = held["sample_stats"].assign(
            weight=(("chain", "draw"), weights)
        )
    else:
        held = groups(idata)
    held["posterior"] = held["posterior"].assign_attrs(certificate=text)
    values = {
        "theta": (("solve", "parameter"), found.theta),
        "weight": ("solve", found.weights),
        "lp": ("solve", found.log_posterior),
        "lp_emulated": ("solve", log_emulated),
    }
    held["certificate"] = xarray.Dataset(
        values,
        {"solve": np.arange(n), "parameter": list(found.names)},
        {
            "verdict": found.verdict,
            "short": found.short,
            "solves": found.solves,
            "efficiency": found.efficiency,
            "pareto_k": found.pareto_k,
            "findings": json.dumps(found.findings),
        },
    )
    return wrap(held)
