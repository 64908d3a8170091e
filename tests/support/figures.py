"""What every figure must be: nothing clipped, nothing on top of another."""

from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.text import Text


def assert_readable(figure):
    """Check that every text lies on the canvas, up to 1 px, and on no other text.

    None is smaller than six points, the least that journals print.
    """
    assert type(figure) is Figure
    figure.canvas.draw()  # once, as savefig does
    hidden = set()
    for axes in figure.axes:
        if not axes.get_visible():
            hidden.update(axes.findobj(Text))
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                if not low <= tick.get_loc() <= high or not axis.get_visible():
                    hidden.update(tick.findobj(Text))
    width, height = figure.canvas.get_width_height()
    boxes = []
    for text in figure.findobj(Text):
        if text.get_visible() and text.get_text() and text not in hidden:
            assert text.get_fontsize() >= 6, text.get_text()
            box = text.get_window_extent()
            inside = box.x0 >= -1 and box.y0 >= -1 and box.x1 <= width + 1
            assert inside and box.y1 <= height + 1, (text.get_text(), box)
            for other, there in boxes:
                assert not box.overlaps(there), (text.get_text(), other)
            boxes.append((text.get_text(), box))


def leave_undrawn(figure):
    """Stand for what draws a picture, where nobody looks at it."""
    plt.close(figure)
    return b""
