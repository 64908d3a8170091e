"""GARTEUR SM-AG19, the aircraft of COST Action F3, as beams with offsets and masses.

Run it:  python examples/garteur.py   (prints mass and nominal frequencies)

A body, wings with drums at their tips, a fin with its tailplane: the test bed on which
methods of updating have been compared since 1995. x points forward, y to the left, z
up; the origin is on the axis of the body below the wing. N, m, kg. Sources:

- D: the dimensioned drawing after A. Gravelle (ed.), GARTEUR TP-115, 1999, in the
  tutorials of FinEtools, and F: its beam model there
- P: the beam model in the examples of pystran (both programs are public)
- B: Balmes and Wright, DETC'97 / 15th IMAC, pp. 1346-1352, Fig. 5, laboratory C
"""

import numpy as np

import emcee_femu as ef

MEASURED = [6.376, 16.104, 33.125, 33.531, 35.647, 48.384, 49.433, 55.076]  # Hz, B
E, NU, RHO, STEEL = 7.2e10, 0.3, 2700.0, 7850.0  # P: aluminium after TP-115

# Heights (along z, of the fin along x) and widths (along y, x) in m.
BODY, PLATE = (0.150, 0.050), (0.010, 0.100)  # D, P, F; wings, drums, tailplane
FIN, LAYER = (0.100, 0.010), (0.0011, 0.0762)  # P; D, F
NOSE, REAR, TAIL = 0.600, -0.900, -0.850  # x, P; the fin is at TAIL
ABOVE = 0.096  # from the axis of the body to that of the wing, P (F: 0.0805)
DRUM = 0.010  # from there to the axis of a drum, P
OUTER = 0.950  # y of the middle of a drum, D, P, F
COVERED, ON_TOP, BEHIND = 0.850, 0.0056, -0.0119  # the layer ends; where it is, D, F
BOLTED = 0.016 * 0.070 * 0.130 * STEEL, 2 * 0.015 * 0.015 * 0.100 * STEEL  # kg, P
STIFF, STIFF_TURN = 1e9, 1e7  # N/m, N m: the joint where it does not give
JOINT = 1e5  # N m, about z, what its parameter multiplies

SENSORS = ("ux", "uy", "uz")  # of all nodes: no rotations


def rectangle(name, height, width, density, factors, up=(0, 0, 1)):
    """The section of a part, whose stiffnesses have factors where they are named."""
    small, large = sorted((height, width))
    thin = 1 / 3 - 0.21 * small / large * (1 - (small / large) ** 4 / 12)
    stiff, weak = small * large**3 / 12, large * small**3 / 12
    along_y, along_z = (weak, stiff) if height < width else (stiff, weak)

    def times(number, kind):
        factor = f"{name} {kind}"
        return (number, factor) if factor in factors else number

    kinds = ("small", "large") if along_y < along_z else ("large", "small")
    return ef.Section(
        E=times(E, "E"),
        GJ=times(E / 2 / (1 + NU) * large * small**3 * thin, "torsion"),
        rho=density,
        A=height * width,
        Iy=times(along_z, kinds[1]),
        Iz=times(along_y, kinds[0]),
        orientation=up,
        Ip=stiff + weak,  # no factor of a stiffness changes the mass
    )


def garteur(factors=(), n_modes=8, shapes=False, joint=False, layer=False):
    """The free aircraft, with factors of 1 where they are named.

    Factors are "density", and "wing small", "wing large", "wing torsion", "fin small",
    ...: of the smaller and the larger second moment of area and of the torsional
    stiffness. With `joint` the wing is held by a spring about z, of JOINT times the
    parameter "joint"; with `layer` the constraining layer is there, and the parameter
    "layer" is the share of its stiffness that acts.
    """
    nodes, bars = [], []

    def node(*place):
        nodes.append(place)
        return len(nodes) - 1

    def line(first, name, places, offset=None):
        """Bars from a node, or from an offset of it, to new nodes."""
        for place in places:
            last = node(*place)
            bars.append((first, last, name, (offset, None)))
            first, offset = last, None
        return first

    centre = node(0, 0, 0)
    line(centre, "body", [(NOSE / 2, 0, 0), (NOSE, 0, 0)])
    tail = line(centre, "body", [(TAIL * part / 3, 0, 0) for part in (1, 2, 3)])
    line(tail, "body", [(REAR, 0, 0)])
    masses, springs = [(centre, BOLTED[0], (0, 0, 0.083))], []
    root, up = centre, (0, 0, ABOVE)
    if joint:
        root, up = node(0, 0, ABOVE), None
        held = dict.fromkeys(SENSORS, STIFF) | dict.fromkeys(("rx", "ry"), STIFF_TURN)
        springs = [(root, centre, held | {"rz": (JOINT, "joint")})]
    stations = [*np.linspace(0, COVERED if layer else OUTER, 6)[1:]]
    for side in (1, -1):
        first = len(nodes)
        outer = stations + [OUTER] * layer
        tip = line(root, "wing", [(0, side * y, ABOVE) for y in outer], up)
        if layer:
            inner = [root, *range(first, first + len(stations))]
            on = BEHIND, 0.0, ON_TOP
            at_root = on if up is None else np.add(up, on)
            ends = [at_root] + [on] * len(stations)
            for i in range(len(stations)):
                bars.append((inner[i], inner[i + 1], "layer", (ends[i], ends[i + 1])))
        line(tip, "wing", [(0, side, ABOVE)])
        drum, high = (0, 0, DRUM), ABOVE + DRUM
        front = line(tip, "drum", [(0.2, side * OUTER, high)], drum)
        line(tip, "drum", [(-0.2, side * OUTER, high)], drum)
        masses.append((front, 0.2, (-0.02, -0.03 * side, 0)))  # P, F
    foot = (0, 0, BODY[0] / 2)
    top = line(tail, "fin", [(TAIL, 0, 0.225), (TAIL, 0, 0.375)], foot)
    for side in (1, -1):
        line(top, "tailplane", [(TAIL, 0.2 * side, 0.38)], (0, 0, 0.005))
    masses.append((top, BOLTED[1], (0, 0, -0.005)))
    density = (RHO, "density") if "density" in factors else RHO
    names = {"body": BODY, "wing": PLATE, "drum": PLATE, "tailplane": PLATE}
    sections = {k: rectangle(k, *v, density, factors) for k, v in names.items()}
    sections["fin"] = rectangle("fin", *FIN, density, factors, up=(1, 0, 0))
    if layer:
        thin = rectangle("layer", *LAYER, density, ())
        share = {"E": (E, "layer"), "GJ": (thin.GJ, "layer")}
        sections["layer"] = ef.Section(**(vars(thin) | share))
    if shapes:
        shapes = [f"{i}:{along}" for i in range(len(nodes)) for along in SENSORS]
    options = {"masses": masses, "springs": springs, "skip": 6, "shapes": shapes}
    return ef.FrameModel(nodes, bars, sections, n_modes=n_modes, **options)


def total_mass(model):
    """Of a model without factors of masses, kg: what resists motion along x."""
    along = np.array([dof.endswith("ux") for dof in model.dofs], dtype=float)
    return along @ model.M0 @ along


if __name__ == "__main__":
    nominal = garteur(n_modes=10)
    print(f"{len(nominal.dofs)} DOFs, {total_mass(nominal):.1f} kg")
    print(nominal({}).frequencies[0].round(2), "Hz")
