"""Descriptors of modes: nodal diameters and circles, motion along the axis, the body that moves most."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from skfem.quadrature import get_quadrature

from ..eigen.blocks import lift, pieces, projected, with_short_indices
from ..eigen.columns import Columns
from ..eigen.linear.spread_matrix import SpreadMatrix
from ..problem.description import Description, shares_by_name, undescribed
from ..problem.terms import Term
from .cells import cell_points
from .element_matrices import nodal_mass
from .harmonics import Harmonics, fit_harmonics
from .row_assembly import spread_mass
from .spaces import DisplacementSpace

_SAME = 1e-9  # relative distance of waves with and against the turning, below which a shape is a standing one


@dataclass(frozen=True)
class ModeDescriber:
    """Describes the modes of a discretisation, or of a reduced model of it.

    Attributes
    ----------
    bodies : tuple of str
        Their mass terms are called mass.BODY.
    along, nodal : mapping of mass term to (n, n)
        PᵀMP with P the part of a displacement along the axis, and M without bubbles, of the bodies that turn (of all
        bodies where nothing turns).
    sampled : (3 s, n)
        Displacements at the nodes of the fit, along x, y and z; behind `on` the amplitudes themselves, (3 b, r).
    harmonics : Harmonics or None
        None where no body with a mesh turns about an axis.
    fitted : bool
        Whether `sampled` gives amplitudes.
    """

    bodies: tuple[str, ...]
    along: Mapping[str, Any]
    nodal: Mapping[str, Any]
    sampled: Any
    harmonics: Harmonics | None
    fitted: bool = False

    def describe(self, terms: Iterable[Term], parameters: Mapping[str, float], shapes: np.ndarray) -> Description:
        """Return the descriptors of shapes (n, k), see `fe_squeal.problem.description.Describer`."""
        count = shapes.shape[1]
        found, terms = undescribed(count), tuple(terms)
        if not count:
            return found
        shares = shares_by_name(terms, parameters, shapes, [f"mass.{name}" for name in self.bodies])
        most = shares.argmax(axis=0)
        moving = shares.max(axis=0) > 0
        found["body"] = [self.bodies[b] if some else None for b, some in zip(most, moving, strict=True)]
        found["body_share"] = [float(s) if some else None for s, some in zip(shares.max(axis=0), moving, strict=True)]
        found["out_of_plane"] = self._out_of_plane(terms, parameters, shapes)
        if self.harmonics is not None:
            spectra = self._spectra(shapes)
            moves = np.abs(spectra).reshape(-1, count).max(axis=0) > 0
            self._describe_waves(self.harmonics, spectra[:, :, moves], np.flatnonzero(moves), found)
        return found

    def on(self, V: Columns) -> ModeDescriber:
        """Return the describer of shapes V y that takes their coordinates y, for a basis V (n, r) float."""
        forms = self.along, self.nodal
        along, nodal = ({name: projected(V, A, 1) for name, A in of.items()} for of in forms)
        sampled = None
        if self.harmonics is not None:
            sampled = np.concatenate([self._spectra(X) for X in pieces(V)], axis=2).reshape(-1, V.shape[1])
        return replace(self, along=along, nodal=nodal, sampled=sampled, fitted=True)

    def _spectra(self, shapes: np.ndarray) -> np.ndarray:
        """Return the amplitudes (b, 3, k)."""
        assert self.harmonics is not None
        values = lift(self.sampled, shapes).reshape(-1, 3, shapes.shape[1])
        return values if self.fitted else self.harmonics.spectrum(values)

    def _out_of_plane(
        self, terms: Iterable[Term], parameters: Mapping[str, float], shapes: np.ndarray
    ) -> list[float | None]:
        along, whole = np.zeros(shapes.shape[1]), np.zeros(shapes.shape[1])
        for term in terms:
            if term.slot == "M" and term.name in self.along:
                factor = float(np.real(term.factor(1.0, parameters)))
                for total, A in ((along, self.along[term.name]), (whole, self.nodal[term.name])):
                    total += factor * np.einsum("nk,nk->k", shapes.conj(), lift(A, shapes)).real
        return [float(np.clip(a / w, 0.0, 1.0)) if w > 0 else None for a, w in zip(along, whole, strict=True)]

    def _describe_waves(
        self, harmonics: Harmonics, spectra: np.ndarray, positions: np.ndarray, found: Description
    ) -> None:
        """Describe the waves of some amplitudes (b, 3, k), none of them all zero, of the modes at k positions."""
        table = harmonics.table(spectra)
        waves, energy = harmonics.energies(table)
        share = energy / energy.sum(axis=0)
        order = np.argsort(-share, axis=0, kind="stable")
        circles = harmonics.circles(table, order[0])
        for j, k in enumerate(positions):
            first, second = (int(m) for m in order[:2, j])
            with_, against = waves[first, :, j]
            travelling = 0.0 if not first else float((with_ - against) / (with_ + against))
            found["nodal_diameters"][k] = first
            found["nodal_circles"][k] = int(circles[j])
            found["nodal_diameters_share"][k] = float(share[first, j])
            found["other_nodal_diameters"][k] = second
            found["other_share"][k] = float(share[second, j])
            found["travelling"][k] = travelling if abs(travelling) > _SAME else 0.0


def make_describer(
    space: DisplacementSpace,
    masses: Mapping[str, Any],
    bodies: Mapping[str, np.ndarray],
    turning: tuple[str, ...],
    axis: np.ndarray | None,
    centre: np.ndarray | None,
) -> ModeDescriber:
    """Return what describes the modes of a discretisation.

    Parameters
    ----------
    masses : mapping of body to its mass matrix (n, n), of density 1 kg/m^3
    bodies : mapping of body to (e,) int elements
    turning : tuple of str
        Bodies that turn about the axis; none where nothing with a mesh turns.
    axis : (3,) float or None
        Axis of the rotation, along the angular velocity; for a belt the normal of its contact, None if it has no one.
    centre : (3,) float, m, or None
        A point of the axis; None for a belt.
    """
    if axis is None:
        return ModeDescriber(tuple(bodies), {}, {}, None, None)
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    measured = turning or tuple(bodies)
    size = next(iter(masses.values())).shape[0]
    nodal = np.zeros(size)
    nodal[: space.nodal_unknowns] = 1.0
    N = sp.diags_array(nodal).tocsr()
    along = {f"mass.{b}": with_short_indices(_along(space, masses[b], bodies[b], axis)) for b in measured}
    plain = {f"mass.{b}": masses[b] if space.bubbles is None else sp.csr_array(N @ masses[b] @ N) for b in measured}
    harmonics, sampled = None, None
    if turning and centre is not None:
        nodes, weights = _node_weights(space, np.concatenate([bodies[b] for b in turning]))
        harmonics = fit_harmonics(space.coordinates[nodes], weights, axis, centre)
        if harmonics is not None:
            rows = (3 * nodes[harmonics.nodes][:, None] + np.arange(3)).ravel()
            sampled = sp.csr_array(space.nodal_map[rows])
            sampled.resize((len(rows), size))
            sampled = with_short_indices(sampled)
    return ModeDescriber(tuple(bodies), along, plain, sampled, harmonics)


def _along(space: DisplacementSpace, mass: Any, elements: np.ndarray, axis: np.ndarray) -> sp.csr_array:
    """Return PᵀMP (n, n) of a body, P the part of the nodal displacements along the axis, and M of density 1 kg/m^3."""
    size = mass.shape[0]
    if space.ties:  # the part along the axis of what a reference moves is not a motion that the tie allows
        scalar = sp.kron(sp.eye_array(space.nodes), axis[None], format="csr") @ space.nodal_map
        part = sp.csr_array(scalar.T @ nodal_mass(space, elements) @ scalar)
        part.resize((size, size))
        return part
    if isinstance(mass, SpreadMatrix) and space.bubbles is None:
        return spread_mass(space, elements, np.outer(axis, axis))
    full = sp.kron(sp.eye_array(space.nodes), sp.csr_array(np.outer(axis, axis)), format="csr")
    P = sp.csr_array(full[space.free][:, space.free])
    P.eliminate_zeros()
    P.resize((size, size))
    return sp.csr_array(P.T @ mass @ P)


def _node_weights(space: DisplacementSpace, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes of elements and the volume (nodes,) m^3 that each stands for, equal parts of its elements'."""
    cells = space.dofs.element_dofs[:, elements]
    X, W = get_quadrature(space.mesh.refdom, 2)
    volume = np.abs(cell_points(space.mesh, elements, X)[2]) @ W
    weights = np.bincount(cells.ravel(), np.tile(volume / len(cells), len(cells)), minlength=space.nodes)
    nodes = np.unique(cells)
    return nodes, weights[nodes]
