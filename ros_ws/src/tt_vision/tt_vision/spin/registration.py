"""The spin that lays the marks of all images over each other, found without an initial guess.

Method 2 of the dissertation (Section 2.4) compares each image with the one before it and walks downhill from 1000 rpm. Here every
rotation that can occur between two frames is tried on coarse maps of the sphere first; the best few are refined on neighbouring frames,
and the last one on all images of both cameras at once, with the unknown marks eliminated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from tt_core.params import check, param
from tt_core.states import Array

from .coarse_search import COARSE_STEP, DENSE_STEP, candidate_rotations, coarse_maps, score_candidates
from .comparison import compare_all, compare_pairs
from .mark_sampling import first_samples
from .sphere_grid import fibonacci
from .surface_map import MarkImages, SurfaceMap

CANDIDATE_DISTANCE = 0.2  # rad between kept candidates
BEST_CANDIDATES = 200  # that are looked through for those
PAIR_STEPS = 4  # of the refinement of a candidate
STEPS = 12  # of the refinement on all images, at most; few marks seen aslant take 8
MOST_PAIR_STEP, MOST_STEP = 0.1, 0.05  # rad between two frames, largest step of the two refinements
ROUGH_STEP, LEAST_STEP = 6.0, 1.0  # rad/s, last step of a refinement: of one that another follows, and of the last one
LEAST_OVERLAP = 0.1  # of what one frame shows, that the next one must show too
GATE = 0.05  # residual above which a registration is not believed: right ones reach 0.03, wrong ones start at 0.09


@dataclass(frozen=True)
class SearchParams:
    """How much is spent on the spin."""

    pairs: int = param(9, "", "largest number of pairs of neighbouring frames on which the coarse search is scored", low=1, high=100)
    kept: int = param(
        5, "", "number of candidates that are refined; the right one was first in each of 160 bursts at 9,000 rpm", low=1, high=100
    )
    coarse_points: int = param(500, "", "number of points on the sphere in the refinement of the candidates", low=100, high=100000)
    fine_points: int = param(2500, "", "number of points on the sphere in the last refinement", low=100, high=20000)
    second_look: bool = param(True, "", "whether light and outlines are fitted again once the marks are known")

    @classmethod
    def fast(cls) -> SearchParams:
        """Return parameters with which a measurement takes half of the time."""
        return cls(pairs=3, kept=3, coarse_points=400, fine_points=800, second_look=False)

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
        residual: 0 for marks that agree, 1 for unrelated ones. The larger one of neighbouring frames and of all images, because cameras
            that see different balls agree each with itself. Above GATE no spin was found.
        candidates: How many rotations were tried.
        marks: (n,) POINT_MARK at `fibonacci(n)` on the ball as it is turned in the middle of the burst.
    """

    spin: Array
    information: Array
    residual: float
    candidates: int
    marks: np.ndarray


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
        search: How much is spent. If no spin is found with it, a denser search with the default parameters follows.
    """
    times = surface.sharp.times
    pairs, maps, found = _neighbours(times), coarse_maps(surface), list[Registration]()
    for step, params in ((COARSE_STEP, search), (DENSE_STEP, DEFAULT)):
        candidates = candidate_rotations(step)
        scored = pairs[np.linspace(0, len(pairs) - 1, min(params.pairs, len(pairs))).round().astype(np.int64)]
        scores = score_candidates(maps, candidates, scored, surface.contrast)
        found.append(_best_of(surface, pairs, candidates.rotations, scores, params))
        if found[-1].residual < GATE:
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
    points = fibonacci(search.coarse_points)
    error = compare_all(found.spin, points, surface.sharp).error
    return replace(found, residual=_residual(surface, found.spin, _neighbours(surface.sharp.times), points, error))


def _best_of(surface: SurfaceMap, pairs: np.ndarray, rotations: Array, scores: np.ndarray, params: SearchParams) -> Registration:
    """Refine the candidates with the lowest scores on neighbouring frames, and the best of them on all images."""
    chosen: list[Array] = []
    for i in np.argsort(scores)[:BEST_CANDIDATES]:
        if all(np.linalg.norm(rotations[i] - other) > CANDIDATE_DISTANCE for other in chosen):
            chosen.append(rotations[i])
        if len(chosen) == params.kept:
            break
    points, gap = fibonacci(params.coarse_points), float(np.diff(surface.soft.times).min())
    before = first_samples(points, pairs, surface.soft)
    trials = []
    for rotation in chosen:
        spin = rotation / gap
        for _ in range(PAIR_STEPS):
            pair = compare_pairs(spin, points, before, pairs, surface.soft, surface.soft_contrast)
            spin = spin - _step(pair.normal_matrix, pair.gradient, MOST_PAIR_STEP / gap)
        trials.append((pair.cost, spin))
    spin = min(trials, key=lambda trial: trial[0])[1]
    spin = _refine(surface.soft, spin, points, ROUGH_STEP).spin
    refined = _refine(surface.sharp, spin, fibonacci(params.fine_points), ROUGH_STEP if params.second_look else LEAST_STEP)
    residual = _residual(surface, refined.spin, pairs, points, refined.error)
    return Registration(refined.spin, _information(refined, params), residual, len(rotations), refined.marks)


def _residual(surface: SurfaceMap, spin: Array, pairs: np.ndarray, points: Array, error: float) -> float:
    """Return the residual of a registration whose mean squared error over all images is `error`."""
    before = first_samples(points, pairs, surface.sharp)
    pair = compare_pairs(spin, points, before, pairs, surface.sharp, 0.0)
    if pair.weight <= LEAST_OVERLAP * float((before["weight"] ** 2).sum()):
        return 1.0
    return max(pair.cost / (2.0 * pair.weight), error) / surface.contrast


def _neighbours(times: Array) -> np.ndarray:
    """Return the first frames of the pairs that follow each other; a lost frame leaves a longer gap."""
    gaps = np.diff(times)
    return np.flatnonzero(gaps < 1.5 * gaps.min())


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
