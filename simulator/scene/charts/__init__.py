"""Test charts, exact to the share of each cell that they cover.

The first polygon of each is the sheet that it is printed on; see outline().
"""

from simulator.scene.charts.checker import checker
from simulator.scene.charts.edge import slanted_edge
from simulator.scene.charts.siemens import siemens_star
from simulator.scene.charts.usaf import line_pairs, usaf_1951
from simulator.scene.polygons import Polygons


def outline(chart: Polygons) -> Polygons:
    """The sheet that a chart is printed on: what it hides of what is behind it."""
    return Polygons(chart.corners[:1], (1.0,))


__all__ = [
    "checker",
    "line_pairs",
    "outline",
    "siemens_star",
    "slanted_edge",
    "usaf_1951",
]
