"""Test charts as polygons, which are drawn without sampling error.

The first polygon of each chart is the sheet that it is printed on; see outline().
"""

from simulator.scene.charts.checker import checker
from simulator.scene.charts.edge import slanted_edge
from simulator.scene.charts.siemens import siemens_star
from simulator.scene.charts.usaf import line_pairs, usaf_1951
from simulator.scene.polygons import Polygons


def outline(chart: Polygons) -> Polygons:
    """Return the sheet that a chart is printed on, as the cover of a `Sheet`.

    Parameters
    ----------
    chart : Polygons
        A chart of this package, whose first polygon is its sheet.

    Returns
    -------
    Polygons
        The sheet with the value 1: it hides everything behind it.
    """
    return Polygons(chart.corners[:1], (1.0,))


__all__ = [
    "checker",
    "line_pairs",
    "outline",
    "siemens_star",
    "slanted_edge",
    "usaf_1951",
]
