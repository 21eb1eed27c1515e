# SPDX-License-Identifier: BSD-3-Clause
"""How all plots look."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

INK, MUTED, LIGHT = "#222222", "#6b7280", "#e4e4e4"
BLUE, RED, GREEN, ORANGE, GREY = "#1d4f76", "#b9474b", "#5c9a5a", "#e0914f", "#5e5e5e"
SEQUENCE = ("#3b6a8f", "#6ea6ab", "#8fbf7f", "#dccb6e", ORANGE, RED, "#8c6bb1", GREY)
REST = "#c8c8c8"

plt.rcParams.update({
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#999999", "axes.axisbelow": True,
    "axes.labelsize": 12, "axes.titlesize": 13,
    "grid.color": LIGHT, "xtick.labelsize": 11, "ytick.labelsize": 11, "legend.frameon": False, "legend.fontsize": 10})


def tidy(axes, title=None, x_label=None, y_label=None):
    axes.tick_params(color="#999999", labelcolor="#333333")
    axes.yaxis.grid(True)
    for label, put in ((title, lambda text: axes.set_title(text, loc="left")), (x_label, axes.set_xlabel),
                       (y_label, axes.set_ylabel)):
        if label is not None:
            put(label)


def save(figure, out, dpi=110, **options):
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=dpi, facecolor="white", **options)
    plt.close(figure)


def legend_below(figure, axes, columns, **options):
    """One legend for all panels; save(..., bbox_inches="tight") shows it."""
    figure.legend(*axes.get_legend_handles_labels(), loc="upper center", bbox_to_anchor=(0.5, 0.0), ncol=columns,
                  **options)
