"""The picture of the front page: mode shapes on the structure, and the frequencies.

It runs the tutorial on a modal test. It draws two mode shapes with the measurements
of the sensors, beside the six frequencies before and after updating.

Run it:  python examples/front_picture.py  (20 s; writes .github/images/front.png)
"""

import argparse
import runpy
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # figures go to files

import numpy as np
from matplotlib import pyplot as plt

import emcee_femu as ef

ROOT = Path(__file__).parents[1]
DPI = 200


def main(output=ROOT / ".github" / "images" / "front.png"):
    """Run the tutorial, draw both figures, and join them."""
    plt.rcParams["font.size"] = 9
    page = runpy.run_path(str(ROOT / "examples" / "tutorials" / "modal_test.py"))
    shapes = ef.figures.plot_shapes(page["run"], modes=[1, 3])
    frequencies = ef.figures.plot_predictive(page["idata"], page["posterior"])
    frequencies.set_size_inches(5.0, shapes.get_size_inches()[1])
    table = ef.frequency_table(page["idata"])
    before, after = (table.column(name)[-1] for name in ("error %", "error % "))
    print(f"Mean error of the frequencies: {before:.1f} % before, {after:.1f} % after")
    pictures = []
    for figure in (shapes, frequencies):
        figure.set_dpi(DPI)
        figure.canvas.draw()
        pictures.append(np.asarray(figure.canvas.buffer_rgba())[..., :3])
    plt.imsave(output, np.hstack(pictures))
    print(f"Written to {output}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.parse_args()
    main()
