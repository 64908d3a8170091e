"""The modes that a test measured: frequencies, shapes and their uncertainty."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from os import PathLike
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats
from ..digits import show
from ..table import Parts, Report, Table
from . import csv_files, directions, modes, uff


class Measurements(Report):
    r"""Measured modes in ascending order of frequency.

    Frequencies, mode shapes, damping ratios and their standard deviations, from arrays
    or from one of the ``from_`` methods. Pass them to :class:`FrequencyTerm`,
    :class:`ShapeTerm` and :class:`PairedModel`.

    Complex shapes are converted to real ones: each is rotated to the phase at which its
    real part is largest. The modal phase collinearity measures how much this neglects,

    .. math:: MPC = \left(\frac{|\phi^T \phi|}{\phi^H \phi}\right)^2 \in [0, 1],

    which is the MAC between the shape and its complex conjugate: 1 if all sensors move
    in phase or in antiphase, 0 for a travelling wave. Real shapes have an MPC of 1.

    Args:
        frequencies: Natural frequencies in Hz, ``(n_modes,)``, ascending, because a
            term without pairing compares them with the model's in this order.
        shapes: Mode shapes at the sensors, ``(n_sensors, n_modes)``, real or complex,
            on any scale; NaN for a sensor that was missing in a mode.
        sd: Standard deviations of the frequencies in Hz, ``(n_modes,)``; None if
            unknown. NaN or None for a single mode whose value is unknown.
        covariance: Covariance of the frequencies in Hz^2, ``(n_modes, n_modes)``; give
            either sd or covariance.
        shape_sd: Standard deviations of (real) shapes, ``(n_sensors, n_modes)``, on the
            same scale.
        sensors: Labels of the sensors; by default those of dofs, or s1, s2, ...
        dofs: The model's DOF at each sensor, as the model names its DOFs: numbers
            from 0, or labels such as ``"3:uy"`` for a :class:`FrameModel`. None if the
            rows of the model's shapes are the sensors, in order. For a sensor that
            points backwards, write ``"3:-uy"``: the sign of its row in ``shapes`` is
            reversed, and ``dofs`` then holds ``"3:uy"``. A sensor that measures a
            combination of DOFs is ``{"3:ux": 0.6, "3:uy": 0.8}``, or as a text, also in
            a file, ``"0.6*3:ux + 0.8*3:uy"``; a difference is ``"3:ux - 2:ux"``.
        phase_collinearity: MPC of shapes that were complex before, ``(n_modes,)``; None
            to compute it.
        damping: Damping ratios, ``(n_modes,)``, 0.01 for 1 %; None if unknown, for all
            or for single modes.
        damping_sd: Standard deviations of the damping ratios, ``(n_modes,)``, likewise.

    Attributes:
        n_modes: The number of measured modes.
        n_sensors: The number of sensors, 0 without shapes.

    Raises:
        TypeError: If an argument does not hold numbers of the kind described.
        ValueError: If the frequencies are not ascending, or one is zero or NaN; a mode
            is listed twice; a shape is zero; a standard deviation is not positive or a
            covariance not positive definite; or sizes do not match.

    Warns:
        UserWarning: If the MPC of a mode is below 0.9, or a damping ratio above 0.2.

    Source: Pappa, Elliott and Schenk (1993), doi:10.2514/3.21092 (MPC); here without
    subtracting the mean, which would be meaningless if all sensors move alike.

    Examples:
        >>> from emcee_femu import Measurements
        >>> shapes = [[1.0, 1j], [1.6, -0.6j]]
        >>> print(Measurements([3.1, 9.8], sd=[0.01, 0.02], shapes=shapes))
        Measured modes: 2, sensors: 2 (s1, s2)
        ----------------------------
        mode  f [Hz]  sd [Hz]    MPC
        ----------------------------
        1      3.100    0.010  1.000
        2      9.800    0.020  1.000
        ----------------------------
    """

    def __init__(
        self,
        frequencies: ArrayLike,
        shapes: ArrayLike | None = None,
        *,
        sd: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        shape_sd: ArrayLike | None = None,
        sensors: Sequence[str] | None = None,
        dofs: ArrayLike | None = None,
        phase_collinearity: ArrayLike | None = None,
        damping: ArrayLike | None = None,
        damping_sd: ArrayLike | None = None,
    ) -> None:
        if damping is None and damping_sd is not None:
            raise ValueError("damping_sd: expected damping with it, got none")
        if sd is not None and covariance is not None:
            raise TypeError(
                "sd, covariance: expected at most one of the two; sd**2 is the "
                "diagonal of the covariance"
            )
        of_shapes = dict(shape_sd=shape_sd, sensors=sensors, dofs=dofs)
        of_shapes |= {"phase_collinearity": phase_collinearity}
        for name, value in of_shapes.items():
            if shapes is None and value is not None:
                raise ValueError(f"{name}: expected shapes with it, got none")
        self.frequencies = modes.frequencies(frequencies)
        self.n_modes = n_modes = len(self.frequencies)
        self.n_sensors = 0
        self.shapes = self.phase_collinearity = there = None
        if shapes is not None:
            raw = modes.shapes(shapes, n_modes, missing=True)
            if raw.ndim > 2:
                got = f"{raw.shape}; for repeated tests see from_repeats"
                raise ValueError(f"shapes: expected (n_sensors, {n_modes}), got {got}")
            self.n_sensors, there = len(raw), ~np.isnan(raw)
            raw[~there] = 0.0
        self.dofs, signs = directions.read_dofs(dofs, self.n_sensors)
        if sensors is None and self.dofs is not None and self.dofs.dtype.kind == "U":
            sensors = self.dofs.tolist()
        self.sensors = modes.labels(sensors, self.n_sensors)
        if there is not None:
            alike = np.where(modes.compares(raw, self._labels), raw, 0.0)
            phases = modes.phases(alike)
            modes.refuse_duplicates(self.frequencies, (alike * phases).real)
            real = (raw * phases).real * signs[:, None]
            self.shapes = np.where(there, real, np.nan)
            mpc = modes.phase_collinearity(alike, phase_collinearity)
            self.phase_collinearity = mpc
            modes.warn_about_complex(mpc)
        self.sd = modes.deviations("sd", sd, (n_modes,), partly=True)
        self.covariance = None
        if covariance is not None:
            self.covariance = modes.covariance(covariance, n_modes)
        shape = self.n_sensors, n_modes
        self.shape_sd = modes.deviations("shape_sd", shape_sd, shape, there)
        self.damping = modes.deviations("damping", damping, (n_modes,), partly=True)
        if self.damping is not None:
            critical = modes.LARGE_DAMPING, "the critical one"
            modes.doubt_percent("damping", self.damping, *critical)
        self.damping_sd = modes.deviations(
            "damping_sd", damping_sd, (n_modes,), partly=True
        )

    @property
    def _labels(self) -> Sequence[object]:
        """What says of a sensor whether it measures a rotation."""
        return self.sensors if self.dofs is None else self.dofs.tolist()

    @property
    def compared(self) -> Floats:
        """Shapes by which a MAC compares modes, ``(n_sensors, n_modes)``.

        NaN at a missing sensor. Rotations (such as ``"3:ry"``) are NaN as well where
        there are translations, which have another unit, unless a mode only turns.
        """
        if self.shapes is None:
            return np.empty((0, self.n_modes))
        alike = modes.compares(self.shapes, self._labels)
        return np.where(alike, self.shapes, np.nan)

    @classmethod
    def from_repeats(
        cls,
        frequencies: ArrayLike,
        shapes: ArrayLike | None = None,
        *,
        correlated: bool = True,
        sensors: Sequence[str] | None = None,
        dofs: ArrayLike | None = None,
    ) -> Self:
        r"""Return the mean and the scatter of repeated tests of one structure.

        .. math:: \bar f = \frac1N \sum_t f_t, \qquad
            C = \frac1{N - 1} \sum_t (f_t - \bar f)(f_t - \bar f)^T

        C is the covariance of a single test. It is not divided by N, because errors
        common to all tests (sensor mounting, temperature, the model) do not average
        out: a posterior that narrows as 1 / sqrt(N) would be too confident.

        Each test's shape is scaled to unit length, and its sign or phase is aligned
        with the first singular vector of all tests; ``shapes`` holds the mean,
        ``shape_sd`` the sample standard deviations.

        Args:
            frequencies: In Hz, ``(n_tests, n_modes)``; each column is one mode. NaN if
                a test missed the mode: mean and deviation are those of the others.
            shapes: ``(n_tests, n_sensors, n_modes)``, real or complex, on any scale;
                ignored where a test missed the mode.
            correlated: Whether to keep the full covariance, which requires every mode
                in every test. With False there is one standard deviation per mode, for
                which two tests suffice.
            sensors: Labels of the sensors.
            dofs: The model's DOF at each sensor.

        Returns:
            The means, and the scatter of a single test.

        Raises:
            ValueError: If there are too few tests, a mode does not scatter at all, or
                a shape has a MAC below 0.5 with the mean (modes in different orders).

        Examples:
            >>> from emcee_femu import Measurements
            >>> tests = [[3.10, 9.80], [3.14, 9.78], [3.12, 9.85]]
            >>> repeated = Measurements.from_repeats(tests, correlated=False)
            >>> repeated.frequencies.round(2).tolist(), repeated.sd.round(3).tolist()
            ([3.12, 9.81], [0.02, 0.036])
        """
        scatter = modes.frequency_scatter(frequencies, correlated)
        if shapes is not None:
            found = ~np.isnan(np.asarray(frequencies, dtype=np.float64))
            labels = sensors if dofs is None else np.asarray(dofs).tolist()
            scatter |= modes.shape_scatter(shapes, found, labels)
        return cls(**scatter, sensors=sensors, dofs=dofs)

    @classmethod
    def from_csv(cls, path: str | PathLike[str]) -> Self:
        """Read a CSV file that :meth:`to_csv` wrote or that was filled in by hand.

        The file has one column per mode. The first cell of a row names its quantity.
        All rows except the frequencies are optional, and shapes have one row per
        sensor::

            quantity,sensor,dof,mode 1,mode 2
            frequency [Hz],,,3.13,9.83
            sd [Hz],,,0.01,0.02
            shape,roof,12,1.0,0.62
            shape,floor 1,6,0.61,-1.0
            shape sd,roof,,0.02,0.03
            shape sd,floor 1,,0.02,0.03

        Rows ``covariance [Hz2]``, one per mode, may replace ``sd [Hz]``. A row ``phase
        collinearity`` holds the MPC of shapes that were complex. ``damping ratio`` and
        ``damping sd`` are fractions; a row ``damping [%]`` is in percent. Other common
        titles are understood: ``Freq (Hz)``, ``std``, ``zeta``. Leave a cell of
        ``shape`` blank if the sensor was missing in that mode, and a cell of ``sd`` or
        damping if the value is unknown. Put single quotes around a ``dof`` label of
        digits: ``'12'``. Semicolons may separate the cells; decimal commas are then
        allowed.

        Args:
            path: The file.

        Returns:
            The measurements.

        Raises:
            ValueError: If a cell cannot be read; the message names line and column.

        Examples:
            >>> from pathlib import Path
            >>> from tempfile import TemporaryDirectory
            >>> from emcee_femu import Measurements
            >>> with TemporaryDirectory() as folder:
            ...     path = Path(folder, "test.csv")
            ...     Measurements([3.1, 9.8], sd=[0.01, 0.02]).to_csv(path)
            ...     print(path.read_text().splitlines()[1])
            ...     Measurements.from_csv(path).sd.tolist()
            frequency [Hz],,,3.1,9.8
            [0.01, 0.02]
        """
        return cls(**csv_files.read_csv(path))

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write everything at full precision: :meth:`from_csv` returns the same bits.

        Args:
            path: The file, which is overwritten.

        Raises:
            OSError: If it cannot be written.
        """
        csv_files.write_csv(path, vars(self))

    @classmethod
    def from_uff(
        cls,
        path: str | PathLike[str],
        *,
        modes: Sequence[int] | None = None,
        sensors: Sequence[str] | None = None,
        dofs: ArrayLike | None = None,
        nodes: Mapping[int, Hashable] | None = None,
        axes: str | None = None,
    ) -> Self:
        """Read normal or complex modes from a universal file.

        Modes are read from data sets 55, which test systems write, and 2414, which FE
        programs write. A sensor is a node and a direction, ``"12:x"``. The modes are
        sorted by frequency. Frequencies are in Hz whatever the file's units, and
        undamped. Positive damping ratios are also read:
        the viscous ratio, or else half the hysteretic one, or the ratio that follows
        from the eigenvalue.

        Args:
            path: The file; other data sets are ignored.
            modes: The modes to read, 1 = the first in the file; None for all. Modes
                that are not read are not checked, so a rigid-body mode at 0 Hz or a
                damaged mode can be skipped.
            sensors: The sensors to keep, in this order. By default all are kept except
                those that are zero in every mode, which marks unmeasured DOFs in these
                files. A node that is absent from a mode counts as missing in it.
            dofs: The model's DOF at each sensor that is kept.
            nodes: In place of dofs, ``{node of the file: node of the model}``; sensors
                at other nodes are left out. With ``{12: 3}`` the sensor ``"12:x"`` is
                at the DOF ``"3:ux"``.
            axes: Needed where the file defines axes of their own for nodes (their
                displacement coordinate systems: data sets 15, 781 or 2411, and 18 or
                2420). "global" if the values are along global axes all the same, as
                the format says of shapes; "own" if they are along the axes of each
                node, as many test programs write them. A sensor is then at the
                combination of the model's ``"3:ux"``, ``"3:uy"`` and ``"3:uz"`` by
                their direction cosines, of Cartesian or of cylindrical axes.

        Returns:
            The modes, with shapes at the kept sensors.

        Raises:
            TypeError: If both dofs and nodes are given.
            ValueError: If there are no modes, a mode cannot be read or has 0 Hz, a
                sensor or a node is unknown; or nodes are given without axes where they
                have their own, or these are spherical or not defined.

        Warns:
            UserWarning: If sensors are zero in all modes, or absent from some; or if
                their nodes have axes of their own, and neither axes nor a combination
                of DOFs says what they are along.

        Examples:
            >>> from emcee_femu import Measurements
            >>> modes = Measurements.from_uff("a.uff", dofs=[4, 9])  # doctest: +SKIP
            >>> at = {11: 0, 12: 3}
            >>> modes = Measurements.from_uff("b.uff", nodes=at)  # doctest: +SKIP
        """
        return cls(**uff.read_uff(path, sensors, modes, dofs, nodes, axes))

    @classmethod
    def from_pyoma2(
        cls,
        result: object,
        *,
        shape_sd: bool = False,
        modes: Sequence[int] | None = None,
        sensors: Sequence[str] | None = None,
        dofs: ArrayLike | None = None,
    ) -> Self:
        """Take the modes that pyOMA2 extracted: ``algorithm.result`` after ``mpe``.

        Reads Fn, Phi, Xi (damping ratios) and, if the uncertainties were computed
        (``calc_unc=True``), Fn_std and Xi_std. The modes are sorted by frequency.

        Args:
            result: Any record with these attributes.
            shape_sd: Whether to read Phi_std too. In pyOMA2 1.4.3 it is up to ten times
                the scatter of simulated records, because it is evaluated before the
                shapes are scaled to 1; Fn_std agrees with the scatter.
            modes: The modes to take, 1 = the first of Fn; None for all. Others may be
                NaN.
            sensors: Labels of the channels.
            dofs: The model's DOF at each channel.

        Returns:
            The modes, with shapes at all channels.

        Raises:
            TypeError: If result has no Fn and Phi.
            ValueError: If there are no modes yet, shape_sd is True but Phi_std is
                missing, or a mode was not identified.

        Examples:
            >>> from types import SimpleNamespace
            >>> from emcee_femu import Measurements
            >>> result = SimpleNamespace(Fn=[9.8, 3.1], Phi=[[1.0, 0.6], [-0.6, 1.0]])
            >>> Measurements.from_pyoma2(result).frequencies.tolist()
            [3.1, 9.8]
        """
        fields = uff.read_pyoma2(result, shape_sd, modes)
        return cls(**fields, sensors=sensors, dofs=dofs)

    def _parts(self) -> Parts:
        return (self._table(),)

    def to_frame(self) -> Any:
        """Return the printed table as a ``pandas.DataFrame`` at full precision."""
        return self._table().to_frame()

    def _table(self) -> Table:
        title = f"Measured modes: {self.n_modes}"
        if self.sensors:
            title += f", sensors: {self.n_sensors} ({checks.listed(self.sensors)})"
        sd = self.sd
        if self.covariance is not None:
            sd = np.sqrt(np.diag(self.covariance))
        its = np.full(self.n_modes, np.nan) if sd is None else sd
        percent = None if self.damping is None else 100 * self.damping
        its_sd = None if self.damping_sd is None else 100 * self.damping_sd
        columns = (
            ("mode", "d", [*range(1, self.n_modes + 1)]),
            ("f [Hz]", show(self.frequencies, its), self.frequencies),
            ("sd [Hz]", show(its, its), sd),
            ("damping %", ".3g", percent),
            ("its sd %", ".2g", its_sd),
            ("MPC", ".3f", self.phase_collinearity),
        )
        shown = [(t, form, v) for t, form, v in columns if v is not None]
        return Table.from_columns(title, shown)
