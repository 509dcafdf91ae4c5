"""What straight edges leave out of curved faces, which no refinement of the same domain shows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..assembly.assembly import Assembly
from ..fem.closing import bends
from ..fem.facets import facet_corners

_SHARE = 0.1  # of a body's surface: a smaller part that bends is a chamfer or a rounded edge
_NORMALS = 6  # of a curved face, at least: chamfers have fewer
_ANY = np.array([1.0, 0.618, 0.271])  # a direction that no face is likely to lie along
_ANGLES = np.radians([2.0, 35.0])  # of a facet: with less it leaves 0.01 % of the radius; with more the body has edges


def straight_edges(assembly: Assembly) -> Iterator[str]:
    """Yield a sentence for each body with curved faces of straight facets.

    A facet with corners on the face that stands for the angle φ lies inside of it by φ²/12 of the radius in the mean.
    Frequencies of rings and discs are wrong by up to about twice that. The refined mesh fills the same domain, so that
    bars do not hold it.

    Parameters
    ----------
    assembly : Assembly
    """
    mesh = assembly.loaded.mesh
    facets = mesh.boundary_facets()
    angles, x = bends(mesh, facets)[0], mesh.p.T[facet_corners(mesh, facets, mesh.f2t[0, facets])]
    normals = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])  # twice the area long
    area = np.linalg.norm(normals, axis=1)
    bent = (angles >= _ANGLES[0]) & (angles <= _ANGLES[1])
    for name, elements in assembly.bodies.items():
        own = np.isin(mesh.f2t[0, facets], elements)
        curved = own & bent
        ways = np.round(normals[curved] / area[curved][:, None], 3)
        ways *= np.where(ways @ _ANY < 0, -1.0, 1.0)[:, None]  # normals may point to either side
        if len(np.unique(ways, axis=0)) < _NORMALS or area[curved].sum() < _SHARE * area[own].sum():
            continue
        left = 100 * float(np.average(angles[curved] ** 2, weights=area[curved])) / 12
        yield (
            f"body {name} has faces of straight edges that bend from facet to facet: where they stand for curved ones,"
            f" they lie {left:.2g} % of the radius inside, and the error of that is not in the bars of the mesh;"
            " expected elements with middle nodes on the curved faces, or more of them around"
        )
