"""The spin that lays the marks of all images over each other, found without an initial guess.

Method 2 of the dissertation (Section 2.4) compares each image with the one before it and walks downhill from 1000 rpm. Here every
rotation that can occur between two frames is tried on coarse maps of the sphere first; the best few are refined on pairs of frames,
and the last one on all images of both cameras at once, with the unknown marks eliminated. All this is done at half the resolution;
`register_again` refines the spin on the full one.

A registration is believed by three figures. Its residual tells how well the marks agree. It is taken on blurred marks, so that noise and
the sharpness of the images hardly change it. Its rivals, spins that were refined in the same way, tell whether another spin fits as well:
those far from it are found by the search, those near it by `with_near_rivals`. Its distinctness tells how much the marks disagree when
the spin changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.params import check, param
from tt_core.states import Array

from .coarse_search import COARSE_STEP, COARSE_TURN, DENSE_STEP, DENSE_TURN, CoarseMaps, candidate_rotations, coarse_maps, score_candidates
from .comparison import Comparison, compare_all, compare_pairs, refine_on_all, refine_on_pairs
from .mark_sampling import first_samples
from .soft_surface import SoftSurface
from .sphere_grid import fibonacci, fibonacci_single
from .surface_map import MarkImages, SurfaceMap
from .wide_search import ScoredSpins, aliases, score_spins

CANDIDATE_DISTANCE, WIDE_DISTANCE = 0.2, 0.12  # rad a frame between kept candidates, without and with distant pairs of frames
RIVALS = 2  # that are refined beside the candidates
RIVAL_DISTANCE = 0.8  # rad a frame of a rival from the best candidate, two marks wide, so that it is not refined to the same spin
SAME = 0.3  # rad a frame within which two spins are the same
MOST_PAIR_STEP, MOST_STEP = 0.1, 0.05  # rad between two frames, largest step of the two refinements
ROUGH_STEP, LEAST_STEP = 6.0, 1.0  # rad/s, last step of a refinement: of one that another follows, and of the last one
LEAST_OVERLAP = 0.1  # of what one frame shows, that the next one must show too
WIDE_KEPT = 40, 600  # candidates that are refined in the wide search, and where none of the first ones fits: near 120 deg a frame
# every third frame looks alike whatever the axis, and only the little that neighbouring frames share tells it
FIRST_POINTS = 800  # on the sphere, in the refinement on all images at half the resolution
GATE = 0.12  # residual above which a registration is not believed
RIVAL_SHARE = 0.3  # of a rival's residual, above which a registration is not told from the rival

NEAR = 0.1, 0.2  # rad a frame: how far from the spin found the refinements of near rivals start
SAME_NEAR = 0.015  # rad a frame within which two refinements have found the same spin; 130 rpm at 900 frames a second
NEAR_RATIO = 1.5  # a near rival fits as well if its squared error is less than so many times that of the spin found
LEAST_DISTINCTNESS = 50.0  # times the residual, below which a spin is refused. With blur or few marks that refuses 6 of 7 spins that are
# wrong by 300 to 500 rpm, and a tenth of the right ones; of 80 bursts with many marks it refuses none
DISTINCT = 30.0  # distinctness above which near rivals are not searched: of 82 bursts with near rivals none had more than 29
DISTINCT_STEP = 8.0  # times the squared error, to which it rises on a step of NEAR[0] along the direction in which it rises least; with a
# steeper rise near rivals are not searched either: 1 in 20 of the bursts with near rivals had one
NEAR_POINTS = 400  # on the sphere, in the search for near rivals


@dataclass(frozen=True)
class SearchParams:
    """How much is spent on the spin."""

    pairs: int = param(9, "", "largest number of pairs of neighbouring frames on which the coarse search is scored", low=1, high=100)
    kept: int = param(
        3, "", "number of candidates that are refined; the right one was first in each of 160 bursts at 9,000 rpm", low=1, high=1000
    )
    coarse_points: int = param(500, "", "number of points on the sphere in the refinement of the candidates", low=100, high=100000)
    fine_points: int = param(2500, "", "number of points on the sphere in the last refinement", low=100, high=20000)
    max_spin: float = param(
        0.0,
        "rad/s",
        "largest spin that is searched where the ball may turn by more than 80 deg between frames; 0: no such search",
        low=0.0,
        high=3000.0,
    )
    second_look: bool = param(True, "", "whether light and outlines are fitted again once the marks are known")

    @classmethod
    def fast(cls) -> SearchParams:
        """Return parameters with which a measurement takes two thirds of the time."""
        return cls(pairs=3, kept=2, coarse_points=400, fine_points=800, second_look=False)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


DEFAULT = SearchParams()


@dataclass(frozen=True, eq=False)
class Registration:
    """A spin, and how well the marks of all images agree with it.

    Attributes:
        spin: (3,) rad/s in `table`.
        information: (3, 3) (rad/s)^-2, of the last least squares.
        residual: 0 for marks that agree, 1 for unrelated ones. The larger one of pairs of frames and of all images, because cameras that
            see different balls agree each with itself.
        candidates: How many rotations were tried.
        marks: (n,) POINT_MARK at `fibonacci(n)` on the ball as it is turned in the middle of the burst.
        alternatives: (m, 3) rad/s, other spins that the images do not rule out.
        distinctness: Rise of the mean squared error of the brightness, divided by that error, if the spin changes by NEAR[0] rad a frame in
            the direction in which the rise is least; from its derivatives. Infinite until `with_near_rivals` computes it.
    """

    spin: Array
    information: Array
    residual: float
    candidates: int
    marks: np.ndarray
    alternatives: Array
    distinctness: float = np.inf

    @property
    def agrees(self) -> bool:
        """Whether the marks of all images agree."""
        return self.residual <= GATE

    @property
    def is_distinct(self) -> bool:
        """Whether a small change of the spin would make the marks of the images disagree clearly."""
        return self.distinctness >= LEAST_DISTINCTNESS * self.residual

    @property
    def is_believed(self) -> bool:
        """Whether the marks agree, and with this spin alone."""
        return self.agrees and self.is_distinct and not len(self.alternatives)


class Proposal(NamedTuple):
    """What a search on some frames finds.

    Attributes:
        spin: (3,) rad/s, the best one.
        rivals: (n, 3) rad/s, spins far from it that fit nearly as well.
        candidates: How many were tried.
    """

    spin: Array
    rivals: Array
    candidates: int


def register(surface: SoftSurface, search: SearchParams = DEFAULT, proposal: Proposal | None = None) -> Registration:
    """Find the spin of the ball from its marks.

    Args:
        surface: The marks.
        search: How much is spent. If no spin is found with it, a denser search with the default parameters follows, and then the wide one
            if `search.max_spin` asks for it.
        proposal: What `propose` found on fewer frames; if it is not believed on all of them, all are searched.
    """
    found = list[Registration]()
    if proposal is not None:
        found.append(_confirm(surface, proposal, _neighbours(surface.blurred.times), search))
        if found[-1].is_believed:
            return found[-1]
    times, maps = surface.blurred.times, coarse_maps(surface)
    for step, turn, params in ((COARSE_STEP, COARSE_TURN, search), (DENSE_STEP, DENSE_TURN, replace(DEFAULT, max_spin=search.max_spin))):
        scored = _score_turns(maps, times, step, turn, params.pairs)
        found.append(_confirm(surface, _best_of(surface, scored, CANDIDATE_DISTANCE, params), scored.pairs, params))
        if found[-1].is_believed:
            return found[-1]
    if search.max_spin * float(np.diff(times).min()) > DENSE_TURN:
        scored = score_spins(maps, times, search.max_spin)
        for kept in WIDE_KEPT:
            params = replace(DEFAULT, max_spin=search.max_spin, kept=kept)
            found.append(_confirm(surface, _best_of(surface, scored, WIDE_DISTANCE, params), scored.pairs, params))
            if found[-1].agrees:
                break
    return min(found, key=lambda each: each.residual)


def propose(surface: SoftSurface, search: SearchParams = DEFAULT) -> Proposal:
    """Return the spin that fits some of the frames of a burst best, and its rivals."""
    scored = _score_turns(coarse_maps(surface), surface.blurred.times, COARSE_STEP, COARSE_TURN, search.pairs)
    return _best_of(surface, scored, CANDIDATE_DISTANCE, search)


def register_again(
    surface: SurfaceMap, found: Registration, search: SearchParams = DEFAULT, least_step: float = LEAST_STEP
) -> Registration:
    """Refine a registration on a surface that is known better now; its residual stays as it is.

    Args:
        surface: The marks.
        found: The registration so far.
        search: How many points are compared.
        least_step: rad/s, the last step; infinite for a single one.
    """
    points = fibonacci_single(search.fine_points)
    spin, compared = refine_on_all(found.spin, points, surface.images, _most_step(surface.images, MOST_STEP), least_step)
    return replace(found, spin=spin, information=_information(compared, search.fine_points), marks=compared.marks)


def register_marks(surface: SoftSurface, found: Registration, search: SearchParams = DEFAULT) -> Registration:
    """Return a registration with the marks at as many points as the refinement on the full resolution compares."""
    return replace(found, marks=compare_all(found.spin, fibonacci_single(search.fine_points), surface.images).marks)


def register_residual(surface: SoftSurface, found: Registration, search: SearchParams = DEFAULT) -> Registration:
    """Return a registration with the residual that it has on a surface that is known better now."""
    return replace(found, residual=_residual(surface, found.spin, _neighbours(surface.blurred.times), search.coarse_points))


def with_near_rivals(surface: SurfaceMap, found: Registration) -> Registration:
    """Return a registration with its distinctness, and among its alternatives the spins near it that fit the marks as well.

    Few marks leave several spins within some 1000 rpm to which a refinement converges.

    Args:
        surface: The marks.
        found: The last registration of a burst.
    """
    images, points = surface.images, fibonacci_single(NEAR_POINTS)
    gap, most = float(np.diff(images.times).min()), _most_step(images, MOST_STEP)
    best, compared = refine_on_all(found.spin, points, images, most, ROUGH_STEP)
    values, vectors = np.linalg.eigh(compared.normal_matrix)
    error = max(compared.error, 1e-12)
    distinctness = (NEAR[0] / gap) ** 2 * float(values[0]) / (error * max(compared.weight, 1e-12))
    steps = [side * turn / gap * axis for turn in NEAR for axis in vectors.T for side in (1.0, -1.0)]
    if distinctness > DISTINCT or min(compare_all(best + step, points, images).error for step in steps[:2]) > DISTINCT_STEP * error:
        return replace(found, distinctness=distinctness)
    trials = [refine_on_all(best + step, points, images, most, ROUGH_STEP) for step in steps]
    near = _apart([spin for spin, its in trials if its.error < NEAR_RATIO * error], best, SAME_NEAR / gap)
    points = fibonacci_single(FIRST_POINTS)  # on more of them there are fewer minima
    best, compared = refine_on_all(best, points, images, most, LEAST_STEP)
    trials = [refine_on_all(spin, points, images, most, LEAST_STEP) for spin in near]
    rivals = [spin for spin, its in trials if its.error < NEAR_RATIO * compared.error]
    alternatives = np.concatenate([found.alternatives, _apart(rivals, best, SAME_NEAR / gap)])
    return replace(found, distinctness=distinctness, alternatives=alternatives)


def _score_turns(maps: CoarseMaps, times: Array, step: float, largest: float, most: int) -> ScoredSpins:
    """Return the scores of all rotations up to `largest`, rad, between neighbouring frames, on at most `most` pairs of them."""
    pairs, candidates = _neighbours(times), candidate_rotations(step, largest)
    scored = pairs[np.linspace(0, len(pairs) - 1, min(most, len(pairs))).round().astype(np.int64)]
    scores = score_candidates(maps, candidates, scored)
    return ScoredSpins(candidates.rotations / float(np.diff(times).min()), scores, pairs)


def _best_of(surface: SoftSurface, scored: ScoredSpins, distance: float, params: SearchParams) -> Proposal:
    """Refine the spins with the lowest scores and their rivals on pairs of frames."""
    images, points, pairs = surface.blurred, fibonacci(params.coarse_points), scored.pairs
    gap, most = float(np.diff(images.times).min()), _most_step(images, MOST_PAIR_STEP)
    before = first_samples(points, pairs, images)
    chosen = scored.spins[_chosen(scored.spins, scored.scores, distance / gap, params.kept, RIVAL_DISTANCE / gap)]
    trials = [refine_on_pairs(spin, points, before, pairs, images, surface.blurred_contrast, most) for spin in chosen]
    spin, residual = min(trials, key=lambda trial: trial[1])
    rivals = _apart([rival for rival, its in trials if its * RIVAL_SHARE < residual], spin, SAME / gap)
    return Proposal(spin, rivals, len(scored.spins))


def _confirm(surface: SoftSurface, proposal: Proposal, pairs: np.ndarray, params: SearchParams) -> Registration:
    """Refine a proposal on all images, and tell which of its rivals the images do not rule out. pairs: (p, 2) frames for the residuals."""
    images, points = surface.blurred, fibonacci_single(params.coarse_points)
    gap, most = float(np.diff(images.times).min()), _most_step(images, MOST_STEP)
    spin = refine_on_all(proposal.spin, points, images, most, ROUGH_STEP)[0]
    spin, compared = refine_on_all(spin, fibonacci_single(FIRST_POINTS), surface.images, most, ROUGH_STEP)
    residual = _residual(surface, spin, pairs, params.coarse_points)
    rivals = [refine_on_all(rival, points, images, most, ROUGH_STEP)[0] for rival in proposal.rivals]
    rivals = [rival for rival in rivals if _residual(surface, rival, pairs, params.coarse_points) * RIVAL_SHARE < residual]
    alternatives = _apart([*rivals, *aliases(spin, gap, params.max_spin)], spin, SAME / gap)
    information = 0.25 * _information(compared, FIRST_POINTS)  # a quarter of the pixels
    return Registration(spin, information, residual, proposal.candidates, compared.marks, alternatives)


@njit(cache=True, nogil=True)
def _chosen(spins: Array, scores: np.ndarray, distance: float, kept: int, far: float) -> np.ndarray:
    """Return which spins have the lowest scores and are not neighbours, and RIVALS that are far from the first one and from each other.

    Args:
        spins: (n, 3) rad/s.
        scores: (n,).
        distance: rad/s between those that are not neighbours.
        kept: How many of them are returned at most.
        far: rad/s between those that are far.
    """
    chosen = np.empty(kept + RIVALS, dtype=np.int64)
    free, count = np.ones(len(spins), dtype=np.bool_), 0
    for k in range(kept + RIVALS):
        if k == kept:
            free[:] = True
            _leave_out(free, spins, chosen[0], far)
        best = -1
        for i in range(len(spins)):
            if free[i] and (best < 0 or scores[i] < scores[best]):
                best = i
        if best < 0:
            continue
        chosen[count] = best
        count += 1
        _leave_out(free, spins, best, distance if k < kept else far)
    return chosen[:count]


@njit(cache=True, nogil=True)
def _leave_out(free: np.ndarray, spins: Array, which: int, distance: float) -> None:
    """Set `free` (n,) to False within a distance of one of the spins (n, 3)."""
    for i in range(len(spins)):
        x, y, z = spins[i, 0] - spins[which, 0], spins[i, 1] - spins[which, 1], spins[i, 2] - spins[which, 2]
        if x * x + y * y + z * z <= distance * distance:
            free[i] = False


def _apart(spins: Sequence[Array], best: Array, distance: float) -> Array:
    """Return the spins (n, 3) that are further than `distance` from the best one and from each other, rad/s."""
    kept = [best]
    for spin in spins:
        if all(np.linalg.norm(spin - other) > distance for other in kept):
            kept.append(spin)
    return np.array(kept[1:]).reshape(-1, 3)


def _residual(surface: SoftSurface, spin: Array, pairs: np.ndarray, count: int) -> float:
    """Return the residual of a spin, on the blurred marks at `count` points."""
    images, points = surface.blurred, fibonacci(count)
    before = first_samples(points, pairs, images)
    pair = compare_pairs(spin, points, before, pairs, images, 0.0)
    if pair.weight <= LEAST_OVERLAP * float((before["weight"] ** 2).sum()):
        return 1.0
    return max(pair.cost / (2.0 * pair.weight), compare_all(spin, fibonacci_single(count), images).error) / surface.blurred_contrast


def _neighbours(times: Array) -> np.ndarray:
    """Return the pairs (p, 2) of frames that follow each other; a lost frame leaves a longer gap."""
    gaps = np.diff(times)
    first = np.flatnonzero(gaps < 1.5 * gaps.min())
    return np.stack([first, first + 1], axis=1)


def _most_step(images: MarkImages, turn: float) -> float:
    """Return the spin, rad/s, that turns the ball by `turn` in the shortest time between frames."""
    return turn / float(np.diff(images.times).min())


def _information(compared: Comparison, points: int) -> Array:
    """Return the information (3, 3), as if the default number of points had been compared."""
    return DEFAULT.fine_points / points * compared.normal_matrix / max(compared.error, 1e-12)
