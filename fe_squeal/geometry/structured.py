"""Structured hexahedral meshes of the parametric geometries, with exact rotational and mirror symmetry."""

from __future__ import annotations

import numpy as np

from fe_squeal.geometry.block import Block
from fe_squeal.geometry.disc_pad import DiscPad
from fe_squeal.geometry.grouped import GroupedMesh, join_meshes
from fe_squeal.geometry.lattice import Floats, faces, hexahedra, number_lattice

Triple = tuple[float, float, float]
_SIDES = {"left": (0, 0), "right": (0, -1), "front": (1, 0), "back": (1, -1), "bottom": (2, 0), "top": (2, -1)}


def structured_disc_pad(geometry: DiscPad) -> GroupedMesh:
    """Return the hexahedra of a disc and its pads.

    Nodes are on circles about z at equal steps of angle and height, and of radius but for a graded or aligned disc. All
    sectors of the disc are alike, so that its double modes stay double. The mesh is symmetric about the plane y = 0,
    and with two pads about z = 0 too.
    """
    pads = [_pad(geometry, number) for number in range(1, geometry.pads + 1)]
    return join_meshes([_disc(geometry), *pads])


def structured_block(geometry: Block) -> GroupedMesh:
    """Return the hexahedra of the blocks and, if it has a thickness, of the belt."""
    order = geometry.geometry_order
    parts = []
    for number in range(1, geometry.count + 1):
        corner = (geometry.left_of(number), -0.5 * geometry.width, 0.0)
        extent = (geometry.length, geometry.width, geometry.height)
        suffix = geometry.suffix(number)
        names = {"block": f"block{suffix}", **{side: side + suffix for side in _SIDES}}
        parts.append(_box(corner, extent, geometry.block_counts, order, names))
    if geometry.has_belt:
        extent = (geometry.belt_length, geometry.belt_width, geometry.belt_thickness)
        corner = (-0.5 * extent[0], -0.5 * extent[1], -extent[2])
        names = {"block": "belt", **{side: f"belt_{side}" for side in _SIDES}}
        parts.append(_box(corner, extent, geometry.belt_counts, order, names))
    return join_meshes(parts)


def _box(
    corner: Triple, extent: Triple, counts: tuple[int, int, int], order: int, names: dict[str, str]
) -> GroupedMesh:
    axes = [a + _steps(length, n * order) for a, length, n in zip(corner, extent, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    ids = number_lattice(points.shape[:3])
    return GroupedMesh(
        points=points.reshape(-1, 3),
        volumes={names["block"]: hexahedra(ids, order)},
        surfaces={names[side]: faces(ids, axis, end, order) for side, (axis, end) in _SIDES.items()},
    )


def _disc(geometry: DiscPad) -> GroupedMesh:
    order = geometry.geometry_order
    n_r, n_theta, n_z = (order * n for n in geometry.disc_counts)
    if geometry.disc_grading == 1.0 and not geometry.disc_aligned:
        radii = geometry.inner_radius + _steps(geometry.outer_radius - geometry.inner_radius, n_r)
    else:
        radii = _with_middles(geometry.disc_radii, order)
    points = _revolved(radii, _circle(n_theta), _centred_steps(geometry.thickness, n_z))
    ids = number_lattice(points.shape[:3], periodic=True)
    return GroupedMesh(
        points=points.reshape(-1, 3),
        volumes={"disc": hexahedra(ids, order)},
        surfaces={
            "hub": faces(ids, 0, 0, order),
            "rim": faces(ids, 0, -1, order),
            "disc_face_1": faces(ids, 2, -1, order),
            "disc_face_2": faces(ids, 2, 0, order),
        },
    )


def _pad(geometry: DiscPad, number: int) -> GroupedMesh:
    """Return the hexahedra of pad `number`; lining and back plate are one lattice, so that they share nodes."""
    order = geometry.geometry_order
    n_r, n_theta, n_lining, n_plate = (order * n for n in geometry.pad_counts)
    radii = geometry.pad_inner_radius + _steps(geometry.pad_outer_radius - geometry.pad_inner_radius, n_r)
    if geometry.is_ring:
        circle = _circle(n_theta)
    else:
        angles = _centred_steps(geometry.pad_angle, n_theta)
        circle = np.stack([np.cos(angles), np.sin(angles)])
    heights = 0.5 * geometry.thickness + geometry.gap + _steps(geometry.pad_thickness, n_lining)
    if geometry.has_back_plate:
        heights = np.append(heights, heights[-1] + _steps(geometry.back_plate_thickness, n_plate)[1:])
    # Pad 2 is the mirror image of pad 1. Its lattice runs along +z too, since Jacobians would be negative otherwise,
    # and so the back plate comes first and the lining last.
    above = number == 1
    if not above:
        heights = -heights[::-1]

    points = _revolved(radii, circle, heights)
    ids = number_lattice(points.shape[:3], periodic=geometry.is_ring)
    lining = ids[:, :, : n_lining + 1] if above else ids[:, :, n_plate:]
    plate = ids[:, :, n_lining:] if above else ids[:, :, : n_plate + 1]
    volumes = {f"pad_{number}": hexahedra(lining, order)}
    if geometry.has_back_plate:
        volumes[f"back_plate_{number}"] = hexahedra(plate, order)
    surfaces = {
        f"pad_face_{number}": faces(ids, 2, 0 if above else -1, order),
        f"pad_back_{number}": faces(ids, 2, -1 if above else 0, order),
        f"pad_inner_edge_{number}": faces(ids, 0, 0, order),
        f"pad_outer_edge_{number}": faces(ids, 0, -1, order),
    }
    if not geometry.is_ring:
        surfaces[f"pad_leading_{number}"] = faces(ids, 1, 0, order)
        surfaces[f"pad_trailing_{number}"] = faces(ids, 1, -1, order)
    return GroupedMesh(points=points.reshape(-1, 3), volumes=volumes, surfaces=surfaces)


def _steps(length: float, n: int) -> Floats:
    return length * np.arange(n + 1) / n


def _with_middles(ends: Floats, order: int) -> Floats:
    """Return the places of the nodes along a line of elements with these ends; mid-nodes are in the middle."""
    places = np.empty(order * (len(ends) - 1) + 1)
    places[::order] = ends
    if order == 2:
        places[1::2] = 0.5 * (ends[:-1] + ends[1:])
    return places


def _centred_steps(length: float, n: int) -> Floats:
    """Return n + 1 values at equal steps from -length/2 to length/2, symmetric about zero to the last bit."""
    return length * (np.arange(n + 1) - 0.5 * n) / n


def _circle(n: int) -> Floats:
    """Return cosines and sines (2, n) of n equal steps around, n a multiple of 4.

    One quarter is computed and the others are copies of it, so that quarter turns and reflections about x, y and x = y
    map the points onto each other exactly.
    """
    quarter = np.cos(2.0 * np.pi * np.arange(n // 4) / n)
    rising = np.append(0.0, quarter[:0:-1])
    cosines = np.concatenate([quarter, -rising, -quarter, rising])
    sines = np.concatenate([rising, quarter, -rising, -quarter])
    return np.stack([cosines, sines]) + 0.0  # -0.0 becomes 0.0


def _revolved(radii: Floats, circle: Floats, heights: Floats) -> Floats:
    """Return the points (nr, n_theta, nz, 3) at radii (nr,), directions `circle` (2, n_theta) and heights (nz,)."""
    points = np.empty((len(radii), circle.shape[1], len(heights), 3))
    points[..., 0] = (radii[:, None] * circle[0])[:, :, None]
    points[..., 1] = (radii[:, None] * circle[1])[:, :, None]
    points[..., 2] = heights
    return points
