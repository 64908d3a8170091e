"""FRFs and coherences from data sets 58 of universal files."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .frf_kinds import Channel
from .identification import Path, read_sets

FRF, COHERENCE = 4, 6  # types of functions
ORDINATES = {8: "receptance", 11: "mobility", 12: "accelerance"}
FORCE = 13
AXES = ("x", "y", "z", "rx", "ry", "rz")


def read_uff58(path: Path, averages: int | None) -> dict[str, Any]:
    """Return the arguments of :class:`FRFMeasurements` that a universal file holds."""
    sets = read_sets(path, 58)
    functions = {i: own for i, own in sets.items() if own["func_type"] == FRF}
    if not functions:
        types = sorted({int(own["func_type"]) for own in sets.values()})
        raise ValueError(
            f"{path}: expected data sets 58 of type 4 (FRF), got {len(sets)} data sets "
            f"58, of types {types}"
        )
    first = next(iter(functions))
    lines = np.asarray(functions[first]["x"], dtype=float)
    kinds, values = {}, {}
    for i, own in functions.items():
        if not np.array_equal(own["x"], lines):
            raise ValueError(
                f"{path}, data set {i}: its lines are not those of data set {first}"
            )
        kinds[i] = _find_kind(path, i, own)
        channel, sign = _find_channel(own)
        if channel in values:
            raise ValueError(f"{path}, data set {i}: {channel.label} appears twice")
        values[channel] = sign * np.asarray(own["data"], dtype=complex)
    if len(set(kinds.values())) > 1:
        raise ValueError(f"{path}: expected FRFs of one kind, got {kinds} by data set")
    found = {
        "lines": lines,
        "values": np.array([*values.values()]),
        "channels": [*values],
        "kind": kinds[first],
    }
    if averages is None:
        return found
    given = {
        _find_channel(own)[0]: np.asarray(own["data"]).real
        for own in sets.values()
        if own["func_type"] == COHERENCE
    }
    missing = [channel.label for channel in values if channel not in given]
    if missing:
        raise ValueError(
            f"averages: {path} has no coherence of {missing}; leave it out"
        )
    coherence = np.array([given[channel] for channel in values])
    return {**found, "coherence": coherence, "averages": averages}


def _find_kind(path: Path, i: int, own: Mapping[str, Any]) -> str:
    above, below = own["ordinate_spec_data_type"], own["orddenom_spec_data_type"]
    if above not in ORDINATES or below != FORCE:
        raise ValueError(
            f"{path}, data set {i}: expected displacement, velocity or acceleration "
            f"(types {list(ORDINATES)}) over force ({FORCE}), got type {above} over "
            f"{below}"
        )
    return ORDINATES[above]


def _find_channel(own: Mapping[str, Any]) -> tuple[Channel, float]:
    """Return labels of DOFs, and the sign of both directions."""
    labels, sign = [], 1.0
    for end in ("rsp", "ref"):
        direction = int(own[f"{end}_dir"])
        sign *= -1.0 if direction < 0 else 1.0
        axis = f":{AXES[abs(direction) - 1]}" if direction else ""
        labels.append(f"{int(own[f'{end}_node'])}{axis}")
    return Channel(*labels), sign
