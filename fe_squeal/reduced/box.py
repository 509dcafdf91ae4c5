"""A reduced model that stands for a problem over a box of several parameters, within a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg as la
from scipy.optimize import linear_sum_assignment

from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..eigen.request import Request
from ..problem.parameters import Place
from ..problem.problem import Problem
from .basis import ReducedBasis
from .corners import are_all_corners, corners, has_softest_corner, softest_corner
from .estimate import SLIGHT, CertifiedBasis, Estimate, OnlineModel, neighbours
from .lowest import Blocks, KnownModes
from .model import ReducedModel
from .vectors import unit_columns

_NODES = 60  # largest number of places whose modes span the basis
# Times √tolerance: directions of new modes that include an angle with the basis whose sine is smaller are left out,
# since λ is off by the square of such an angle.
_TURNED = 0.3
_MOST = 600  # vectors: with more, the projected eigenvalue problem costs as much as a direct solve of a small brake
_LEAST = (1.0, 0.5, 0.3, 0.2, 0.15, 0.1)  # times √tolerance: singular values that a condensed basis leaves out
_LOWEST, _EVERY = 2, 3  # powers of the size of a basis with which the work for its lowest modes, or for all, grows
_TRIALS = 30  # places at which it is tried
_MARGIN = 3.0  # times the largest ratio of true errors to estimated ones there
_FAR = 100.0  # times the tolerance: beyond it the next place is the farthest from all others
_FEW = 10  # places that miss the tolerance, from which on the basis is made better before others are checked
_SMALL, _COUNTED = 20_000, 60  # unknowns up to which modes are counted at all places; of more, at so many places
_CHECKS = 4  # rounds of places that had no part in making the basis

Places = Sequence[tuple[float, ...]]


class BoxModel(ReducedModel):
    """The projection of a problem on right and left modes at few places of a box, chosen by the estimated error of λ.

    It begins with the modes without damping and friction at the softest corner. Wherever else in the box, stiffness is
    larger and mass smaller, so that by the minimum principle what the basis leaves out has higher frequencies still,
    and its P-norm bounds those of other places: the estimated errors need no constant that depends on the place.
    (Greedy choice: Veroy, Prud'homme, Rovas, Patera, AIAA 2003-3847.) Where no corner is the softest one of all, it
    begins in the middle. Then, and where friction depends on so many parameters that some corners are left out, modes
    are counted at the places that it is made for and checked at.

    Attributes
    ----------
    places : list of tuple of float
        The places whose modes are in the basis.
    proven : bool
        Whether it has all modes of the range at every place, and not only where they were counted.
    checked : int
        Number of places at which it was checked last. They had no part in making the basis, unless numbers have few
        values.
    missed : int
        Number of these places at which a mode misses the tolerance.
    error : float
        The largest estimated |Δλ/λ| there.
    """

    enough = 0.3  # errors at other places are larger than at those of the making
    _counts_start = True

    def __init__(
        self, problem: Problem, parameters: Sequence[str], low: np.ndarray, high: np.ndarray,
        draw: Callable[[int], Places], request: Request, linear_solver: LinearSolver | str = "auto",
        progress: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        """Build the model.

        Parameters
        ----------
        problem : Problem
            Affine in every parameter.
        parameters : sequence of str
        low, high : (d,) float
            The box.
        draw : callable of int
            Returns places in the box: the basis is made for those of number 0, and checked at those of 1, 2 and so on.
            Numbers with few values may draw the same places again and again.
        request : Request
        progress : callable of str

        Raises
        ------
        NotConvergedError
            If the problem without damping and friction is not positive semidefinite.
        """
        names = tuple(parameters)
        self._seen: dict[Place, np.ndarray] = {}  # right and left modes asked for, in coordinates of the basis
        self._blocks = KnownModes(np.maximum(np.subtract(high, low), np.finfo(float).tiny))
        self.condensed: CertifiedBasis | None = None
        softest, stiffest = softest_corner(problem, names, low, high), softest_corner(problem, names, high, low)
        self._least = request.count or 0
        self._begin(problem, names, softest, request, linear_solver)
        self._widen(problem, [stiffest])
        first = len(self.basis)
        self.places: list[Place] = []
        trained = _different(draw(0))
        self._made_for(trained, (stiffest,), progress)
        self._corrections.release()  # before others take memory
        before = len(self.basis)
        far = corners(problem, names, low, high)
        self.proven = has_softest_corner(problem, names, low, high) and are_all_corners(problem, names, low, high)
        soft = self._add_soft(far if self.proven else far.union(self._counted_at(trained)))
        self._exact = np.r_[:first, before : len(self.basis)]
        if soft:
            progress(f"{len(self.basis)} vectors, with modes that friction or gyroscopic forces bring into the range")
            self._made_for((*trained, *sorted(far)), (), progress)
        for i in range(1, _CHECKS + 1):
            places = _different(draw(i))
            missed = self._missed_at(places)
            before = len(self.basis)
            lacked = not self.proven and self._add_soft(self._counted_at(places))
            if lacked:
                self._exact = np.r_[self._exact, before : len(self.basis)]
                missed = self._missed_at(places)
            if not (missed or lacked) or i == _CHECKS or not self._has_room():
                break
            worst = max((self._off(p) for p in missed), default=0.0)
            progress(f"{len(self.basis)} vectors, {worst:.1e} times the tolerance at other places")
            self._made_for(missed, (), progress)
        self._release()
        self.condensed = self._condense()
        online = self.certified()
        found = [online.modes(p) for p in places]
        self.checked, self.missed = len(places), sum(bool(off.max(initial=0.0) > 1) for _, off, _ in found)
        self.error = max(float(relative.max(initial=0.0)) for _, _, relative in found)
        progress(f"{len(self.basis)} vectors, largest error {self.error:.1e} at {self.checked} other places")
        self._without = self.basis.undamped_values(self._sigma)
        self._known, self._seen, self._blocks = {}, {}, self._blocks.first(_TRIALS)

    def _counted_at(self, places: Places) -> Places:
        """Return the places, or the first of them, at which modes are counted where no corner is the softest one."""
        return places if self.problem.unknowns <= _SMALL else places[:_COUNTED]

    def _missed_at(self, places: Places) -> Places:
        """Return places that miss the tolerance, the first few of them, and keep nothing of others that are new."""
        before, missed = set(self._seen), list[tuple[float, ...]]()
        for place in places:
            if self._off(place) > 1:
                missed.append(place)
            elif place not in before:
                self._seen.pop(place, None)  # which is not there if modes at the place were known and given up
                self._blocks.blocks.pop(place, None)
            if len(missed) == _FEW:
                break
        return missed

    def online(self) -> OnlineModel | None:
        """Return what gives modes and errors without vectors of the problem's length.

        None where motions that nothing holds have to be followed, which takes these vectors.
        """
        if self.basis.problem.free_motions().motions.shape[1]:
            return None
        both = self.certified()
        small = None if both.condensed is None else both.condensed.without_vectors()
        return OnlineModel(both.whole.without_vectors(), small, self._number)

    def certified(self) -> OnlineModel:
        """Return what gives modes and errors, with all vectors."""
        return OnlineModel(self._whole(self._blocks.first(_TRIALS)), self.condensed, self._number)

    def _whole(self, known: KnownModes) -> CertifiedBasis:
        return CertifiedBasis(self.basis, self.request, self.highest, known)

    def modes(self, value: Place) -> Modes:
        """Return the modes asked for at one place, with vectors of length r and the errors of the projection."""
        return self.estimate(value)[0]

    def estimate(self, place: Place) -> Estimate:
        """Return the modes asked for at a place, for each how far it misses the tolerance, and |Δλ/λ|."""
        return self.certified().modes(place)

    def _condense(self) -> CertifiedBasis | None:
        """Return that of some bases inside this one with which modes cost least; None where that is the whole one.

        Each has the modes of the softest corner, on which the errors rest, and the main directions of the modes asked
        for at all places that the basis was made for (proper orthogonal decomposition). Modes that only some corners
        have in the range stay, too: no error tells where they are missing.
        """
        gram = np.zeros((len(self.basis), len(self.basis)))
        for x in self._seen.values():  # of a smaller basis: the first vectors of this one
            gram[: len(x), : len(x)] += x @ x.T
        exact = np.eye(len(self.basis))[:, self._exact]
        gram[self._exact] = gram[:, self._exact] = 0.0
        w, U = (a[..., ::-1] for a in la.eigh(gram))
        s = np.sqrt(np.maximum(w, 0.0))
        known, trials = self._blocks.first(_TRIALS), list(self._seen)[:_TRIALS]
        power = _LOWEST if known.blocks else _EVERY
        exact_modes = [self._estimated(p)[0] for p in trials]
        best, least_cost = None, float(len(self.basis)) ** power
        for least in _LEAST:
            W = np.hstack([exact, U[:, s > least * self.request.tolerance**0.5 * s[0]]])
            small = CertifiedBasis(self.basis.restricted(W), self.request, self.highest, known.on(W))
            found = [small.modes(p) for p in trials]
            ratios = [_ratio(f, e, SLIGHT * self.request.tolerance) for f, e in zip(found, exact_modes, strict=True)]
            scale = min(_MARGIN * max(ratios), 1.0)
            missed = np.mean([scale * off.max(initial=0.0) > 1 for _, off, _ in found])
            cost = W.shape[1] ** power + missed * len(self.basis) ** power
            if best is not None and cost > least_cost:
                break  # larger bases cost more still
            if cost < least_cost:
                best, least_cost = replace(small, scale=scale), cost
        return best

    def _estimated(self, value: Place) -> Estimate:
        self._forget()
        if value not in self._known:
            self._known[value], every = self._whole(self._blocks).found(value, self.enough)
            if self.problem.problem_class in ("symmetric", "nonsymmetric"):  # others are left to LAPACK
                self._blocks.blocks[value] = Blocks.of(every, self.request)
            wanted = self._known[value][0]
            assert wanted.left is not None
            self._seen[value] = unit_columns(wanted.right, wanted.left)
        return self._known[value]

    def residual_product(self, place: Place, lam: complex, right: np.ndarray, left: np.ndarray) -> float:
        """Return how far ψᴴQ(λ)φ may be off by the reduction, for vectors (r,) of the projected problem."""
        return self.basis.residual_product(place, lam, right, left, self.highest)

    def _made_for(
        self, places: Places, corners: Places, progress: Callable[[str], None]
    ) -> None:
        """Add the modes at the place with the largest errors, and so on until all places meet the tolerance."""
        off: dict[Place, float] = dict.fromkeys(places, np.inf)
        if corners and self._outside is None:
            self._search()  # as long as there are factors of P
        if corners and self._off(self._start) > 1:
            self._add_modes(self._start)
            self._add_missing([self._start, *corners])
            self.places.append(self._start)
        if corners:
            self._spread_over(places, progress)
        while self._has_room():
            worst = self._worst(off)
            if off[worst] <= self.enough:
                break
            progress(f"{len(self.basis)} vectors, {off[worst]:.1e} times the tolerance")
            before = len(self.basis)
            self._add_modes(worst)
            self.places.append(worst)
            if len(self.basis) == before and off[worst] <= 1:
                off[worst] = 0.0  # it meets the tolerance, and its own modes do not make it any better
        if corners and self._add_missing([self._start, *corners]):
            self._made_for(places, (), progress)

    def _spread_over(self, places: Places, progress: Callable[[str], None]) -> None:
        """Add modes at places as far apart as possible while modes at such places miss the tolerance by far.

        As long as that is so, an estimate at every place would cost more than it tells.
        """
        width = np.maximum(np.ptp(np.array([self._start, *places]), axis=0), np.finfo(float).tiny)
        spots = np.array(places) / width
        distance = np.linalg.norm(spots - np.array(self._start) / width, axis=1)
        while self._has_room():
            far = int(np.argmax(distance))
            off = self._off(places[far])
            if off <= _FAR:
                return
            progress(f"{len(self.basis)} vectors, {off:.1e} times the tolerance")
            self._add_modes(places[far])
            self.places.append(places[far])
            distance = np.minimum(distance, np.linalg.norm(spots - spots[far], axis=1))

    def _kept(self, wide: ReducedBasis, every: Modes, again: int) -> tuple[np.ndarray, float]:
        """Keep the modes asked for and their neighbours; those of the softest corner keep others far enough."""
        near = neighbours(every, self.request)
        return self._corrections.span(wide, near), _TURNED * self.request.tolerance**0.5

    def _has_room(self) -> bool:
        return len(self.places) < _NODES and len(self.basis) < min(_MOST, self.problem.unknowns // 2)


def _different(places: Places) -> Places:
    """Return the different ones of some places, in their order."""
    return list(dict.fromkeys(places))


def _ratio(found: Estimate, exact: Modes, slight: float) -> float:
    """Return the largest ratio of an error of λ to its estimate, or to a slight one; infinite for other modes."""
    modes, _, relative = found
    if len(modes) != len(exact) or not len(modes):
        return np.inf
    _, at = linear_sum_assignment(np.abs(modes.lam[:, None] - exact.lam[None, :]))
    off = np.abs(modes.lam - exact.lam[at]) / np.maximum(np.abs(modes.lam), np.finfo(float).tiny)
    return float((off / np.maximum(relative, slight)).max())
