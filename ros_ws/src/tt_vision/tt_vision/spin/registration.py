"""The spin that lays the marks of all images over each other, found without an initial guess.

Method 2 of the dissertation (Section 2.4) compares each image with the one before it and walks downhill from 1000 rpm. Here every
rotation that can occur between two frames is tried on coarse maps of the sphere first; the best few are refined on pairs of frames,
and the last one on all images of both cameras at once, with the unknown marks eliminated.

A registration is believed by two figures. Its residual tells how well the marks agree. It is taken on blurred marks, so that noise and
the sharpness of the images hardly change it. Its rivals, spins far from it that were refined in the same way, tell whether another spin
fits as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from tt_core.params import check, param
from tt_core.states import Array

from .coarse_search import COARSE_STEP, COARSE_TURN, DENSE_STEP, DENSE_TURN, CoarseMaps, candidate_rotations, coarse_maps, score_candidates
from .comparison import compare_all, compare_pairs
from .mark_sampling import first_samples
from .sphere_grid import fibonacci
from .surface_map import MarkImages, SurfaceMap
from .wide_search import ScoredSpins, aliases, score_spins

CANDIDATE_DISTANCE, WIDE_DISTANCE = 0.2, 0.12  # rad a frame between kept candidates, without and with distant pairs of frames
BEST_CANDIDATES = 10000  # that are looked through for those
RIVALS = 2  # that are refined beside the candidates
RIVAL_DISTANCE = 0.8  # rad a frame of a rival from the best candidate, two marks wide, so that it is not refined to the same spin
SAME = 0.3  # rad a frame within which two spins are the same
PAIR_STEPS = 4  # of the refinement of a candidate
STEPS = 12  # of the refinement on all images, at most; few marks seen aslant take 8
MOST_PAIR_STEP, MOST_STEP = 0.1, 0.05  # rad between two frames, largest step of the two refinements
ROUGH_STEP, LEAST_STEP = 6.0, 1.0  # rad/s, last step of a refinement: of one that another follows, and of the last one
LEAST_OVERLAP = 0.1  # of what one frame shows, that the next one must show too
WIDE_KEPT = 40, 600  # candidates that are refined in the wide search, and where none of the first ones fits: near 120 deg a frame
# every third frame looks alike whatever the axis, and only the little that neighbouring frames share tells it
GATE = 0.12  # residual above which a registration is not believed
RIVAL_SHARE = 0.3  # of a rival's residual, above which a registration is not told from the rival


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
        """Return parameters with which a measurement takes half of the time."""
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
    """

    spin: Array
    information: Array
    residual: float
    candidates: int
    marks: np.ndarray
    alternatives: Array

    @property
    def agrees(self) -> bool:
        """Whether the marks of all images agree."""
        return self.residual <= GATE

    @property
    def is_believed(self) -> bool:
        """Whether the marks agree, and with this spin alone."""
        return self.agrees and not len(self.alternatives)


class Trial(NamedTuple):
    """A spin refined on pairs of frames, and its residual there: 0 for marks that agree, 1 for unrelated ones."""

    spin: Array
    residual: float


class Refined(NamedTuple):
    """A spin after Gauss-Newton, and the comparison at its last step: normal matrix, mean squared error and marks."""

    spin: Array
    normal_matrix: Array
    error: float
    marks: np.ndarray


def register(surface: SurfaceMap, search: SearchParams = DEFAULT) -> Registration:
    """Find the spin of the ball from its marks.

    Args:
        surface: The marks.
        search: How much is spent. If no spin is found with it, a denser search with the default parameters follows, and then the wide one
            if `search.max_spin` asks for it.
    """
    times = surface.sharp.times
    times, maps, found = surface.sharp.times, coarse_maps(surface), list[Registration]()
    for step, turn, params in ((COARSE_STEP, COARSE_TURN, search), (DENSE_STEP, DENSE_TURN, replace(DEFAULT, max_spin=search.max_spin))):
        scored = _score_turns(maps, times, step, turn, params.pairs)
        found.append(_best_of(surface, scored, CANDIDATE_DISTANCE, params))
        if found[-1].is_believed:
            return found[-1]
    if search.max_spin * float(np.diff(times).min()) > DENSE_TURN:
        scored = score_spins(maps, times, search.max_spin)
        for kept in WIDE_KEPT:
            found.append(_best_of(surface, scored, WIDE_DISTANCE, replace(DEFAULT, max_spin=search.max_spin, kept=kept)))
            if found[-1].agrees:
                break
    return min(found, key=lambda each: each.residual)


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
    refined = _refine(surface.sharp, found.spin, fibonacci(search.fine_points), least_step)
    return replace(found, spin=refined.spin, information=_information(refined, search), marks=refined.marks)


def register_residual(surface: SurfaceMap, found: Registration, search: SearchParams = DEFAULT) -> Registration:
    """Return a registration with the residual that it has on a surface that is known better now."""
    renewed = surface.softened()
    return replace(found, residual=_residual(renewed, found.spin, _neighbours(surface.sharp.times), fibonacci(search.coarse_points)))


def _score_turns(maps: CoarseMaps, times: Array, step: float, largest: float, most: int) -> ScoredSpins:
    """Return the scores of all rotations up to `largest`, rad, between neighbouring frames, on at most `most` pairs of them."""
    pairs, candidates = _neighbours(times), candidate_rotations(step, largest)
    scored = pairs[np.linspace(0, len(pairs) - 1, min(most, len(pairs))).round().astype(np.int64)]
    scores = score_candidates(maps, candidates, scored)
    return ScoredSpins(candidates.rotations / float(np.diff(times).min()), scores, pairs)


def _best_of(surface: SurfaceMap, scored: ScoredSpins, distance: float, params: SearchParams) -> Registration:
    """Refine the spins with the lowest scores and their rivals on pairs of frames, and the best of them on all images."""
    points, gap, pairs = fibonacci(params.coarse_points), float(np.diff(surface.soft.times).min()), scored.pairs
    before = first_samples(points, pairs, surface.soft)
    trials = [_refine_on_pairs(surface, spin, points, before, pairs) for spin in _chosen(scored, gap, distance, params.kept)]
    best = min(trials, key=lambda trial: trial.residual)
    spin = _refine(surface.soft, best.spin, points, ROUGH_STEP).spin
    refined = _refine(surface.sharp, spin, fibonacci(params.fine_points), ROUGH_STEP if params.second_look else LEAST_STEP)
    residual = _residual(surface, refined.spin, pairs, points)
    near = _apart([each.spin for each in trials if each.residual * RIVAL_SHARE < best.residual], best.spin, SAME / gap)
    rivals = [_refine(surface.soft, rival, points, ROUGH_STEP).spin for rival in near]
    rivals = [rival for rival in rivals if _residual(surface, rival, pairs, points) * RIVAL_SHARE < residual]
    alternatives = _apart([*rivals, *aliases(refined.spin, gap, params.max_spin)], refined.spin, SAME / gap)
    return Registration(refined.spin, _information(refined, params), residual, len(scored.spins), refined.marks, alternatives)


def _chosen(scored: ScoredSpins, gap: float, distance: float, kept: int) -> list[Array]:
    """Return the spins with the lowest scores that are not neighbours, and rivals that are far from the first one and from each other."""
    spins, chosen = scored.spins, list[Array]()
    best = spins[np.argsort(scored.scores)[:BEST_CANDIDATES]]
    while len(best) and len(chosen) < kept:
        chosen.append(best[0])
        best = best[np.linalg.norm(best - best[0], axis=1) * gap > distance]
    far = chosen[:1]
    for _ in range(RIVALS):
        is_far = np.min([np.linalg.norm(spins - other, axis=1) for other in far], axis=0) * gap > RIVAL_DISTANCE
        if is_far.any():
            far.append(spins[np.argmin(np.where(is_far, scored.scores, np.inf))])
    return chosen + far[1:]


def _apart(spins: Sequence[Array], best: Array, distance: float) -> Array:
    """Return the spins (n, 3) that are further than `distance` from the best one and from each other, rad/s."""
    kept = [best]
    for spin in spins:
        if all(np.linalg.norm(spin - other) > distance for other in kept):
            kept.append(spin)
    return np.array(kept[1:]).reshape(-1, 3)


def _refine_on_pairs(surface: SurfaceMap, spin: Array, points: Array, before: np.ndarray, pairs: np.ndarray) -> Trial:
    """Refine a spin on pairs of frames by Gauss-Newton."""
    most = MOST_PAIR_STEP / float(np.diff(surface.soft.times).min())
    for _ in range(PAIR_STEPS):
        pair = compare_pairs(spin, points, before, pairs, surface.soft, surface.soft_contrast)
        spin = spin - _step(pair.normal_matrix, pair.gradient, most)
    return Trial(spin, 1.0 + pair.cost / (2.0 * max(pair.weight, 1e-12) * surface.soft_contrast))


def _residual(surface: SurfaceMap, spin: Array, pairs: np.ndarray, points: Array) -> float:
    """Return the residual of a spin, on the blurred marks."""
    before, images = first_samples(points, pairs, surface.soft), surface.soft
    pair = compare_pairs(spin, points, before, pairs, images, 0.0)
    if pair.weight <= LEAST_OVERLAP * float((before["weight"] ** 2).sum()):
        return 1.0
    return max(pair.cost / (2.0 * pair.weight), compare_all(spin, points, images).error) / surface.soft_contrast


def _neighbours(times: Array) -> np.ndarray:
    """Return the pairs (p, 2) of frames that follow each other; a lost frame leaves a longer gap."""
    gaps = np.diff(times)
    first = np.flatnonzero(gaps < 1.5 * gaps.min())
    return np.stack([first, first + 1], axis=1)


def _refine(images: MarkImages, spin: Array, points: Array, least_step: float) -> Refined:
    """Refine a spin on all images by Gauss-Newton, until a step is shorter than `least_step` rad/s."""
    most = MOST_STEP / float(np.diff(images.times).min())
    for _ in range(STEPS):
        compared = compare_all(spin, points, images)
        change = _step(compared.normal_matrix, compared.gradient, most)
        spin = spin - change
        if np.linalg.norm(change) < least_step:
            break
    return Refined(spin, compared.normal_matrix, compared.error, compared.marks)


def _information(refined: Refined, search: SearchParams) -> Array:
    """Return the information (3, 3), as if the default number of points had been compared."""
    return DEFAULT.fine_points / search.fine_points * refined.normal_matrix / max(refined.error, 1e-12)


def _step(h: Array, g: Array, most: float) -> Array:
    """Return the Gauss-Newton step (3,) rad/s, at most `most` long."""
    step = np.linalg.solve(h + (1e-9 * np.trace(h) + 1e-30) * np.eye(3), g)
    return step * min(1.0, most / max(float(np.linalg.norm(step)), 1e-12))
