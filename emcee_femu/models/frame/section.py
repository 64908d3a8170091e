"""Sections of bars, whose properties are numbers or named parameters."""

import math
from dataclasses import dataclass, fields

from ... import checks
from ...interfaces import Floats, Parameters

# What multiplies each unit matrix of an element, by the properties that it reads.
STIFFNESS_KINDS = {
    "EA": ("E", "A"),
    "GJ": ("GJ",),
    "EIz": ("E", "Iz"),
    "EIy": ("E", "Iy"),
}
MASS_KINDS = {"rhoA": ("rho", "A"), "rhoI": ("rho", "Iy", "Iz")}
KINDS = STIFFNESS_KINDS | MASS_KINDS


@dataclass(frozen=True)
class Section:
    """Properties of a bar; each is a number, or the name of a parameter.

    Args:
        E: Young's modulus, N/m2.
        GJ: Torsional stiffness, N m2.
        rho: Density, kg/m3.
        A: Area, m2.
        Iy: Second moment of area that resists displacement along local z, m4.
        Iz: Second moment of area that resists displacement along local y, m4.
        orientation: A vector whose part normal to the bar is local y; local x runs
            along the bar. The default is global z.

    Raises:
        TypeError: If a property is neither a real number nor a name.
        ValueError: If a number is not above zero, or orientation is not (3,) or zero.

    Examples:
        >>> from emcee_femu import Section
        >>> bar = Section(E="E", GJ=700.0, rho=2700.0, A=3e-4, Iy=2e-9, Iz="Iz")
        >>> sorted(bar.parameters)
        ['E', 'Iz']
    """

    E: float | str
    GJ: float | str
    rho: float | str
    A: float | str
    Iy: float | str
    Iz: float | str
    orientation: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Check the properties."""
        for name, value in self._properties().items():
            if not isinstance(value, str):
                checks.positive_array(name, value, 0)
            elif not value:
                raise ValueError(f"{name}: expected a parameter name, got ''")
        vector = checks.real_array("orientation", self.orientation, 1)
        if vector.shape != (3,) or not vector.any():
            raise ValueError(
                f"orientation: expected a vector (3,) that is not zero, got {vector}"
            )

    def _properties(self) -> dict[str, float | str]:
        return {item.name: getattr(self, item.name) for item in fields(self)[:6]}

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of parameters among the properties."""
        return tuple(v for v in self._properties().values() if isinstance(v, str))

    def varies(self, kind: str) -> bool:
        """Return whether the coefficient of ``kind`` depends on a parameter."""
        return any(isinstance(getattr(self, name), str) for name in KINDS[kind])

    def coefficient(self, kind: str, parameters: Parameters) -> Floats | float:
        """Return EA, GJ, EIz, EIy, rhoA or rhoI = rho (Iy + Iz), ``(n,)`` or a number.

        Products of parameters are exact: the matrices are affine in these
        coefficients, whichever properties vary.
        """
        if kind == "rhoI":
            return self._value("rho", parameters) * (
                self._value("Iy", parameters) + self._value("Iz", parameters)
            )
        product: Floats | float = 1.0
        for name in KINDS[kind]:
            product = product * self._value(name, parameters)
        return product

    def slopes(self, kind: str, parameters: Parameters) -> dict[str, Floats | float]:
        """Return the derivative of a coefficient by each parameter that it depends on.

        Each is ``(n,)`` or a number; a parameter that is the value of several
        properties gets the sum over them.
        """
        values = {name: self._value(name, parameters) for name in KINDS[kind]}
        total: dict[str, Floats | float] = {}
        for name in values:
            parameter = getattr(self, name)
            if not isinstance(parameter, str):
                continue
            if kind == "rhoI":
                change = values["Iy"] + values["Iz"] if name == "rho" else values["rho"]
            else:
                others = [value for other, value in values.items() if other != name]
                change = math.prod(others, start=1.0)
            total[parameter] = total.get(parameter, 0.0) + change
        return total

    def _value(self, name: str, parameters: Parameters) -> Floats | float:
        given = getattr(self, name)
        return parameters[given] if isinstance(given, str) else float(given)
