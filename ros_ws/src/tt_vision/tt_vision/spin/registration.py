"""Registration: find the spin with which the ball's marks agree in all images of a burst, without an initial guess.

"Marks" are the printed or drawn dots on the ball; a burst holds the images of one ball's passage through the high speed cameras (about six
pairs); a frame is the images of all cameras at one instant.

Method 2 of the Nagoya dissertation (Section 2.4) compares each image with the one before it, and minimises the difference from a start at
1000 rpm. Here every rotation that can occur between two frames is tried first, on coarse maps of the ball's surface. The best few are
refined on pairs of frames. The best of these is refined on all images of both cameras at once, and the unknown marks are eliminated from
the equations. All this is done at half the resolution; `register_again` refines the spin at the full resolution.

Four numbers decide whether a registration is believed:

- The residual is the disagreement of the marks between the images. It is computed from blurred marks, so that noise and the sharpness of
  the images hardly change it.
- The rivals are other spins, refined in the same way, that may fit as well. Those far from the spin found come from the search, those near
  it from `with_near_rivals`.
- The distinctness is the increase of the disagreement when the spin changes.
- The disparity is the difference between spins that are measured with either camera alone, or with the early and the late frames alone.
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
from .surface_map import MarkImages, SurfaceMap, shortest_gap
from .wide_search import ScoredSpins, aliases, score_spins

# rad per frame, least distance of kept candidates: in the usual and in the wide search
CANDIDATE_DISTANCE, WIDE_CANDIDATE_DISTANCE = 0.2, 0.12
RIVALS = 2  # number of rivals that are refined besides the candidates
RIVAL_DISTANCE = 0.8  # rad per frame, least distance of a rival from the best candidate: two marks, so it is not refined to the same spin
SAME_SPIN = 0.3  # rad per frame; spins that differ by less count as the same
MOST_PAIR_STEP = 0.1  # rad per frame, largest step of the refinement on pairs of frames
# rad/s; a refinement ends after a shorter step: one that another refinement follows, and the last one
ROUGH_STEP, LEAST_SPIN_STEP = 6.0, 1.0
LEAST_OVERLAP = 0.1  # share of what one frame shows of the surface that the next frame must show, too
WIDE_KEPT = 40, 600  # number of candidates that are refined in the wide search: at first, and then if none of these fits. Near 120 deg per
# frame every third frame looks alike for any axis, and only the small part that neighbouring frames share determines the axis
FIRST_POINTS = 800  # number of points on the ball in the refinement on all images at half the resolution
GATE = 0.12  # residual above which a registration is not believed
RIVAL_SHARE = 0.3  # of a rival's residual; a registration with a larger residual than this cannot be told from the rival

NEAR_RIVALS = 0.1, 0.2  # rad per frame, distances from the spin found at which the refinements of near rivals start
SAME_NEAR = 0.015  # rad per frame; refined spins that differ by less count as the same; 130 rpm at 900 frames per second
NEAR_RATIO = 1.5  # a near rival fits as well if its squared error is less than this times that of the spin found
LEAST_DISTINCTNESS = 50.0  # a spin is refused if its distinctness is below this times its residual. With blur or few marks this refuses 6
# of 7 spins that are wrong by 300 to 500 rpm, and a tenth of the correct ones; of 80 bursts with many marks it refuses none
DISTINCT = 30.0  # distinctness above which near rivals are not searched: of 82 bursts with near rivals none had more than 29
# near rivals are not searched either if the squared error rises to more than this times its value on a step of NEAR_RIVALS[0] in the
# direction in which it rises least: 1 in 20 of the bursts with near rivals had such a rise
DISTINCT_STEP = 8.0
NEAR_POINTS = 400  # number of points on the ball in the search for near rivals
# rad per frame, 340 rpm at 900 frames per second. Of the bursts with near rivals, this refuses 5 of the 11 whose spin is wrong by more than
# 300 rpm, and 1 in 60 of the others
MOST_DISPARITY = 0.04
LEAST_HALVED = 4  # number of frames from which on the early and the late ones are compared


@dataclass(frozen=True)
class SearchParams:
    """Parameters of the search for the spin, which determine its accuracy and its computing time."""

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
        """Return parameters with which a measurement takes two thirds of the time, but the spin has larger errors."""
        return cls(pairs=3, kept=2, coarse_points=400, fine_points=800, second_look=False)

    def __post_init__(self) -> None:
        """Raise an error for a value outside its range."""
        check(self)


DEFAULT_SEARCH = SearchParams()


@dataclass(frozen=True, eq=False)
class Registration:
    """Result of a registration: a spin, and how well the ball's marks (dots) agree in all images with this spin.

    Attributes:
        spin: (3,) rad/s in `table`.
        information: (3, 3) (rad/s)^-2, normal matrix of the last least-squares fit divided by its squared error.
        residual: Disagreement of the marks: 0 if they agree, 1 if they are unrelated. It is the larger one of the residual of pairs of
            frames and that of all images, because the images of each camera may agree even if the cameras see different balls.
        candidates: Number of rotations that were tried.
        marks: (n,) POINT_MARK, brightness of the surface at the points `fibonacci(n)` of the ball, in its orientation at the mean time of
            the frames.
        alternatives: (m, 3) rad/s, other spins that the images do not rule out.
        distinctness: Relative increase of the mean squared error of the brightness if the spin changes by NEAR_RIVALS[0] rad per frame in
            the direction in which the increase is least; computed from derivatives. It is infinite until `with_near_rivals` computes it.
        disparity: rad per frame, largest difference of the spins measured with halves of the images. It is 0 if it was not computed.
    """

    spin: Array
    information: Array
    residual: float
    candidates: int
    marks: np.ndarray
    alternatives: Array
    distinctness: float = np.inf
    disparity: float = 0.0

    @property
    def agrees(self) -> bool:
        """Whether the marks agree well enough in all images."""
        return self.residual <= GATE

    @property
    def is_distinct(self) -> bool:
        """Whether the marks would disagree clearly between the images if the spin changed a little."""
        return self.distinctness >= LEAST_DISTINCTNESS * self.residual

    @property
    def is_consistent(self) -> bool:
        """Whether nearly the same spin is measured with each half of the images."""
        return self.disparity <= MOST_DISPARITY

    @property
    def is_believed(self) -> bool:
        """Whether the spin is believed: the marks agree with it in all parts of the images, and with no other spin."""
        return self.agrees and self.is_distinct and self.is_consistent and not len(self.alternatives)


class Proposal(NamedTuple):
    """Result of a search for the spin, before it is confirmed on all images.

    Attributes:
        spin: (3,) rad/s in `table`, the spin that fits best.
        rivals: (n, 3) rad/s, spins far from it that fit nearly as well.
        candidates: Number of rotations or spins that were tried.
    """

    spin: Array
    rivals: Array
    candidates: int


def register(surface: SoftSurface, search: SearchParams = DEFAULT_SEARCH, proposal: Proposal | None = None) -> Registration:
    """Find the spin of the ball by registration: the spin with which the marks agree in all images.

    Args:
        surface: The ball's surface in all images, at half the resolution.
        search: Parameters of the search. If it finds no spin that is believed, a denser search with the default parameters follows, and
            then a search for faster spins if `search.max_spin` is large enough.
        proposal: Result of `propose` on some of the frames; None if there is none. If it is not believed on all images, it is not used and
            the spin is searched.

    Returns:
        The registration with the lowest residual, or the first one that is believed; check `is_believed`.
    """
    found = list[Registration]()
    if proposal is not None:
        found.append(_confirm(surface, proposal, _neighbours(surface.blurred.times), search))
        if found[-1].is_believed:
            return found[-1]
    times, maps = surface.blurred.times, coarse_maps(surface)
    for step, turn, params in (
        (COARSE_STEP, COARSE_TURN, search),
        (DENSE_STEP, DENSE_TURN, replace(DEFAULT_SEARCH, max_spin=search.max_spin)),
    ):
        scored = _score_turns(maps, times, step, turn, params.pairs)
        found.append(_confirm(surface, _best_of(surface, scored, CANDIDATE_DISTANCE, params), scored.pairs, params))
        if found[-1].is_believed:
            return found[-1]
    if search.max_spin * shortest_gap(times) > DENSE_TURN:
        scored = score_spins(maps, times, search.max_spin)
        for kept in WIDE_KEPT:
            params = replace(DEFAULT_SEARCH, max_spin=search.max_spin, kept=kept)
            found.append(_confirm(surface, _best_of(surface, scored, WIDE_CANDIDATE_DISTANCE, params), scored.pairs, params))
            if found[-1].agrees:
                break
    return min(found, key=lambda each: each.residual)


def propose(surface: SoftSurface, search: SearchParams = DEFAULT_SEARCH) -> Proposal:
    """Search the spin that fits some of the frames of a burst best, and its rivals, for `register` to confirm on all frames.

    Args:
        surface: The ball's surface in these frames, at half the resolution.
        search: Parameters of the search.
    """
    scored = _score_turns(coarse_maps(surface), surface.blurred.times, COARSE_STEP, COARSE_TURN, search.pairs)
    return _best_of(surface, scored, CANDIDATE_DISTANCE, search)


def register_again(
    surface: SurfaceMap, found: Registration, search: SearchParams = DEFAULT_SEARCH, least_step: float = LEAST_SPIN_STEP
) -> Registration:
    """Refine the spin of a registration on a map of the ball's surface at the full resolution. Its residual is not computed again.

    Args:
        surface: The ball's surface in all images.
        found: The registration so far.
        search: Parameters of the search, of which the number of points is used.
        least_step: rad/s; the refinement ends after a shorter step. With infinity it makes a single step.

    Returns:
        The registration with new `spin`, `information` and `marks`.
    """
    points = fibonacci_single(search.fine_points)
    spin, compared = refine_on_all(found.spin, points, surface.images, least_step)
    return replace(found, spin=spin, information=_information(compared, search.fine_points), marks=compared.marks)


def register_marks(surface: SoftSurface, found: Registration, search: SearchParams = DEFAULT_SEARCH) -> Registration:
    """Compute the marks of a registration again at more points on the ball, as many as `register_again` uses.

    Args:
        surface: The ball's surface in all images, at half the resolution.
        found: The registration; its spin stays as it is.
        search: Parameters of the search, of which the number of points is used.

    Returns:
        The registration with new `marks`.
    """
    return replace(found, marks=compare_all(found.spin, fibonacci_single(search.fine_points), surface.images).marks)


def register_residual(surface: SoftSurface, found: Registration, search: SearchParams = DEFAULT_SEARCH) -> Registration:
    """Compute the residual of a registration again, on a surface that has become more accurate.

    Args:
        surface: The ball's surface in all images, at half the resolution.
        found: The registration; its spin stays as it is.
        search: Parameters of the search, of which the number of points is used.

    Returns:
        The registration with a new `residual`.
    """
    return replace(found, residual=_residual(surface, found.spin, _neighbours(surface.blurred.times), search.coarse_points))


def with_near_rivals(surface: SurfaceMap, found: Registration) -> Registration:
    """Compute the distinctness of a registration, and search spins near it that fit the marks as well.

    If the ball has few marks, refinements can converge to several spins within some 1000 rpm of each other. In such a case the disparity is
    computed, too.

    Args:
        surface: The ball's surface in all images, at the full resolution.
        found: The last registration of a burst.

    Returns:
        The registration with its `distinctness` and `disparity`, and with the near spins that were found added to its `alternatives`.
    """
    images, points = surface.images, fibonacci_single(NEAR_POINTS)
    gap = shortest_gap(images.times)
    best, compared = refine_on_all(found.spin, points, images, ROUGH_STEP)
    values, vectors = np.linalg.eigh(compared.normal_matrix)
    error = max(compared.error, 1e-12)
    distinctness = (NEAR_RIVALS[0] / gap) ** 2 * float(values[0]) / (error * max(compared.weight, 1e-12))
    steps = [side * turn / gap * axis for turn in NEAR_RIVALS for axis in vectors.T for side in (1.0, -1.0)]
    if distinctness > DISTINCT or min(compare_all(best + step, points, images).error for step in steps[:2]) > DISTINCT_STEP * error:
        return replace(found, distinctness=distinctness)
    trials = [refine_on_all(best + step, points, images, ROUGH_STEP) for step in steps]
    near = _apart([spin for spin, its in trials if its.error < NEAR_RATIO * error], best, SAME_NEAR / gap)
    points = fibonacci_single(FIRST_POINTS)  # on more of them there are fewer minima
    best, compared = refine_on_all(best, points, images, LEAST_SPIN_STEP)
    trials = [refine_on_all(spin, points, images, LEAST_SPIN_STEP) for spin in near]
    rivals = [spin for spin, its in trials if its.error < NEAR_RATIO * compared.error]
    alternatives = np.concatenate([found.alternatives, _apart(rivals, best, SAME_NEAR / gap)])
    return replace(found, distinctness=distinctness, alternatives=alternatives, disparity=_disparity(best, points, images))


def _disparity(spin: Array, points: np.ndarray, images: MarkImages) -> float:
    """Return the largest difference (rad per frame) between the spins that are measured with two halves of the images.

    The images are halved in two ways: into those of the left and of the right camera, and into early and late frames.

    Args:
        spin: (3,) rad/s, spin from all images, where the refinements start.
        points: (n, 3) float32 unit vectors, points on the ball.
        images: The ball's surface in all images, all images of the first camera first.
    """
    frames, halves = len(images.times), list[np.ndarray]()
    if len(images.views) == 2 * frames:
        halves.append(np.arange(2 * frames) < frames)
    if frames >= LEAST_HALVED:
        halves.append(images.frame_of < frames // 2)
    differences = [0.0]
    for half in halves:
        one, other = (refine_on_all(spin, points, images.only(chosen), LEAST_SPIN_STEP)[0] for chosen in (half, ~half))
        differences.append(float(np.linalg.norm(one - other)))
    return shortest_gap(images.times) * max(differences)


def _score_turns(maps: CoarseMaps, times: Array, step: float, largest: float, most: int) -> ScoredSpins:
    """Score all rotations between neighbouring frames up to a largest angle.

    Args:
        maps: Coarse maps of the ball's surface in each frame.
        times: (frames,) s.
        step: rad between the rotations that are tried.
        largest: rad, largest angle.
        most: Largest number of pairs of frames on which the rotations are scored.
    """
    pairs, candidates = _neighbours(times), candidate_rotations(step, largest)
    scored = pairs[np.linspace(0, len(pairs) - 1, min(most, len(pairs))).round().astype(np.int64)]
    scores = score_candidates(maps, candidates, scored)
    return ScoredSpins(candidates.rotations / shortest_gap(times), scores, pairs)


def _best_of(surface: SoftSurface, scored: ScoredSpins, distance: float, params: SearchParams) -> Proposal:
    """Refine the spins with the lowest scores and their rivals on pairs of frames, and return the best one with its rivals.

    Args:
        surface: The ball's surface in all images.
        scored: The spins with their scores.
        distance: rad per frame, least distance between two spins that are refined.
        params: Parameters of the search.
    """
    images, points, pairs = surface.blurred, fibonacci(params.coarse_points), scored.pairs
    gap = shortest_gap(images.times)
    before = first_samples(points, pairs, images)
    chosen = scored.spins[_chosen(scored.spins, scored.scores, distance / gap, params.kept, RIVAL_DISTANCE / gap)]
    trials = [refine_on_pairs(spin, points, before, pairs, images, surface.blurred_contrast, MOST_PAIR_STEP / gap) for spin in chosen]
    spin, residual = min(trials, key=lambda trial: trial[1])
    rivals = _apart([rival for rival, its in trials if its * RIVAL_SHARE < residual], spin, SAME_SPIN / gap)
    return Proposal(spin, rivals, len(scored.spins))


def _confirm(surface: SoftSurface, proposal: Proposal, pairs: np.ndarray, params: SearchParams) -> Registration:
    """Refine a proposal on all images, and find which of its rivals the images do not rule out.

    Args:
        surface: The ball's surface in all images.
        proposal: The spin and its rivals.
        pairs: (p, 2) indices of frames, the pairs on which residuals are computed.
        params: Parameters of the search.
    """
    images, points = surface.blurred, fibonacci_single(params.coarse_points)
    gap = shortest_gap(images.times)
    spin = refine_on_all(proposal.spin, points, images, ROUGH_STEP)[0]
    spin, compared = refine_on_all(spin, fibonacci_single(FIRST_POINTS), surface.images, ROUGH_STEP)
    residual = _residual(surface, spin, pairs, params.coarse_points)
    rivals = [refine_on_all(rival, points, images, ROUGH_STEP)[0] for rival in proposal.rivals]
    rivals = [rival for rival in rivals if _residual(surface, rival, pairs, params.coarse_points) * RIVAL_SHARE < residual]
    alternatives = _apart([*rivals, *aliases(spin, gap, params.max_spin)], spin, SAME_SPIN / gap)
    information = 0.25 * _information(compared, FIRST_POINTS)  # a quarter of the pixels
    return Registration(spin, information, residual, proposal.candidates, compared.marks, alternatives)


@njit(cache=True, nogil=True)
def _chosen(spins: Array, scores: np.ndarray, distance: float, kept: int, far: float) -> np.ndarray:
    """Choose the spins with the lowest scores as candidates, and RIVALS further spins that are far from the best one and from each other.

    Args:
        spins: (n, 3) rad/s.
        scores: (n,) scores; lower ones are better.
        distance: rad/s, least distance between two candidates.
        kept: Largest number of candidates.
        far: rad/s, least distance of a rival from the best candidate and from other rivals.

    Returns:
        Indices of the candidates, the best one first, and then of the rivals.
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
    """Set `free` (n,) to False for all spins (n, 3) within a distance (rad/s) of the spin with the index `which`."""
    for i in range(len(spins)):
        x, y, z = spins[i, 0] - spins[which, 0], spins[i, 1] - spins[which, 1], spins[i, 2] - spins[which, 2]
        if x * x + y * y + z * z <= distance * distance:
            free[i] = False


def _apart(spins: Sequence[Array], best: Array, distance: float) -> Array:
    """Return those spins (n, 3) that are farther than `distance` (rad/s) from `best` and from those returned before them."""
    kept = [best]
    for spin in spins:
        if all(np.linalg.norm(spin - other) > distance for other in kept):
            kept.append(spin)
    return np.array(kept[1:]).reshape(-1, 3)


def _residual(surface: SoftSurface, spin: Array, pairs: np.ndarray, count: int) -> float:
    """Return the residual of a spin, computed from the blurred marks at `count` points; see `Registration.residual`."""
    images, points = surface.blurred, fibonacci(count)
    before = first_samples(points, pairs, images)
    pair = compare_pairs(spin, points, before, pairs, images, 0.0)
    if pair.weight <= LEAST_OVERLAP * float((before["weight"] ** 2).sum()):
        return 1.0
    return max(pair.cost / (2.0 * pair.weight), compare_all(spin, fibonacci_single(count), images).error) / surface.blurred_contrast


def _neighbours(times: Array) -> np.ndarray:
    """Return the pairs (p, 2) of frames that follow each other directly, without a lost frame between them."""
    gaps = np.diff(times)
    first = np.flatnonzero(gaps < 1.5 * gaps.min())
    return np.stack([first, first + 1], axis=1)


def _information(compared: Comparison, points: int) -> Array:
    """Return the information (3, 3), (rad/s)^-2, scaled to the default number of points on the ball."""
    return DEFAULT_SEARCH.fine_points / points * compared.normal_matrix / max(compared.error, 1e-12)
