"""Splitting any polygon into convex pieces, which is what physics sees."""

import shapely
from shapely.geometry.base import BaseGeometry

from pourcast.scenes.geometry import Polygon

DECIMALS = 6
"""Coordinates are rounded to a micrometre, so that a file holds what is simulated."""

_MIN_PIECE_AREA = 1e-7


def convex_pieces(shape: BaseGeometry) -> list[Polygon]:
    """Split a polygon, with holes or not, into convex pieces.

    The constrained Delaunay triangles are merged greedily as long as the union
    is convex (Hertel & Mehlhorn 1983 give the bound: at most four times the
    least possible number).

    Parameters
    ----------
    shape
        A shapely polygon or collection of polygons [m]; valid.

    Returns
    -------
    list of Polygon
        Convex, counter-clockwise; slivers below 1e-7 m^2 are dropped.

    Examples
    --------
    >>> ell = shapely.Polygon([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)])
    >>> len(convex_pieces(ell))
    2
    """
    pieces = list(shapely.get_parts(shapely.constrained_delaunay_triangles(shape)))
    merged = True
    while merged:
        merged = _merge_one_pair(pieces)
    return [ring_of(piece) for piece in pieces if piece.area > _MIN_PIECE_AREA]


def _merge_one_pair(pieces: list[BaseGeometry]) -> bool:
    for first in range(len(pieces)):
        for second in range(first + 1, len(pieces)):
            union = pieces[first].union(pieces[second])
            if union.geom_type == "Polygon" and union.convex_hull.area - union.area < 1e-9:
                pieces[first] = union
                del pieces[second]
                return True
    return False


def ring_of(shape: BaseGeometry) -> Polygon:
    """Corners of a convex shape, rounded, counter-clockwise, without those on a straight line."""
    rounded = shapely.MultiPoint(shapely.get_coordinates(shape).round(DECIMALS))
    ring = shapely.get_coordinates(shapely.orient_polygons(rounded.convex_hull))[:-1]
    return tuple((float(x), float(y)) for x, y in ring)
