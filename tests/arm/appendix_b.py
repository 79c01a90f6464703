"""The closed form of the dissertation's Appendix B: (B.9) to (B.20) as printed, and the Jacobian of (B.21) with its misprints put right."""

import math

import numpy as np

PRINTED = {  # elements of 0T7, (B.9) to (B.20)
    "11": (
        "C7 C6 C5 C4 C1 C2 C3 - C7 C6 C5 C4 S1 S3 - C7 C6 C5 C1 S2 S4 - C7 C6 S5 C1 C2 S3 - C7 C6 S5 S1 C3 - C7 S6 S4 C1 C2 C3 "
        "+ C7 S6 S4 S1 S3 - C7 S6 C1 S2 C4 - S7 S5 C4 C1 C2 C3 + S7 S5 C4 S1 S3 + S7 S5 C1 S2 S4 - S7 C5 C1 C2 S3 - S7 C5 S1 C3"
    ),
    "12": (
        "- S7 C6 C5 C4 C1 C2 C3 + S7 C6 C5 C4 S1 S3 + S7 C6 C5 C1 S2 S4 + S7 C6 S5 C1 C2 S3 + S7 C6 S5 S1 C3 + S7 S6 S4 C1 C2 "
        "C3 - S7 S6 S4 S1 S3 + S7 S6 C1 S2 C4 - C7 S5 C4 C1 C2 C3 + C7 S5 C4 S1 S3 + C7 S5 C1 S2 S4 - C7 C5 C1 C2 S3 - C7 C5 S1 "
        "C3"
    ),
    "13": (
        "S6 C5 C4 C1 C2 C3 - S6 C5 C4 S1 S3 - S6 C5 C1 S2 S4 - S6 S5 C1 C2 S3 - S6 S5 S1 C3 + C6 S4 C1 C2 C3 - C6 S4 S1 S3 + C6 C1 S2 C4"
    ),
    "14": (
        "lw S6 C5 C4 C1 C2 C3 - lw S6 C5 C4 S1 S3 - lw S6 C5 C1 S2 S4 - lw S6 S5 C1 C2 S3 - lw S6 S5 S1 C3 + lw C6 S4 C1 C2 C3 "
        "- lw C6 S4 S1 S3 + lw C6 C1 S2 C4 + le S4 C1 C2 C3 - le S4 S1 S3 + le C1 S2 C4 + C1 S2 ls"
    ),
    "21": (
        "C7 C6 C5 C4 S1 C2 C3 + C7 C6 C5 C4 C1 S3 - C7 C6 C5 S1 S2 S4 - C7 C6 S5 S1 C2 S3 + C7 C6 S5 C1 C3 - C7 S6 S4 S1 C2 C3 "
        "- C7 S6 S4 C1 S3 - C7 S6 S1 S2 C4 - S7 S5 C4 S1 C2 C3 - S7 S5 C4 C1 S3 + S7 S5 S1 S2 S4 - S7 C5 S1 C2 S3 + S7 C5 C1 C3"
    ),
    "22": (
        "- S7 C6 C5 C4 S1 C2 C3 - S7 C6 C5 C4 C1 S3 + S7 C6 C5 S1 S2 S4 + S7 C6 S5 S1 C2 S3 - S7 C6 S5 C1 C3 + S7 S6 S4 S1 C2 "
        "C3 + S7 S6 S4 C1 S3 + S7 S6 S1 S2 C4 - C7 S5 C4 S1 C2 C3 - C7 S5 C4 C1 S3 + C7 S5 S1 S2 S4 - C7 C5 S1 C2 S3 + C7 C5 C1 "
        "C3"
    ),
    "23": (
        "S6 C5 C4 S1 C2 C3 + S6 C5 C4 C1 S3 - S6 C5 S1 S2 S4 - S6 S5 S1 C2 S3 + S6 S5 C1 C3 + C6 S4 S1 C2 C3 + C6 S4 C1 S3 + C6 S1 S2 C4"
    ),
    "24": (
        "lw S6 C5 C4 S1 C2 C3 + lw S6 C5 C4 C1 S3 - lw S6 C5 S1 S2 S4 - lw S6 S5 S1 C2 S3 + lw S6 S5 C1 C3 + lw C6 S4 S1 C2 C3 "
        "+ lw C6 S4 C1 S3 + lw C6 S1 S2 C4 + le S4 S1 C2 C3 + le S4 C1 S3 + le S1 S2 C4 + S1 S2 ls"
    ),
    "31": (
        "- C7 C6 C5 S2 C3 C4 - C7 C6 C5 C2 S4 + C7 C6 S2 S3 S5 + C7 S6 S2 C3 S4 - C7 S6 C2 C4 + S7 S5 S2 C3 C4 + S7 S5 C2 S4 + S7 S2 S3 C5"
    ),
    "32": (
        "S7 C6 C5 S2 C3 C4 + S7 C6 C5 C2 S4 - S7 C6 S2 S3 S5 - S7 S6 S2 C3 S4 + S7 S6 C2 C4 + C7 S5 S2 C3 C4 + C7 S5 C2 S4 + C7 S2 S3 C5"
    ),
    "33": "- S6 C5 S2 C3 C4 - S6 C5 C2 S4 + S6 S2 S3 S5 - C6 S2 C3 S4 + C6 C2 C4",
    "34": ("- lw S6 C5 S2 C3 C4 - lw S6 C5 C2 S4 + lw S6 S2 S3 S5 - lw C6 S2 C3 S4 + lw C6 C2 C4 - le S2 C3 S4 + le C2 C4 + C2 ls + lb"),
}


def scalars(q, lengths):
    """What the letters stand for. q: (7,) rad. lengths: lb, ls, le, lw, m."""
    values = dict(zip(("lb", "ls", "le", "lw"), lengths, strict=True))
    for i, angle in enumerate(q, 1):
        values[f"C{i}"], values[f"S{i}"] = math.cos(angle), math.sin(angle)
    return values


def pose(q, lengths):
    """(4, 4) 0T7."""
    values, out = scalars(q, lengths), np.eye(4)
    for place, terms in PRINTED.items():
        total = 0.0
        for term in terms.replace("- ", "+ -1 ").split("+"):
            if term.strip():
                total += math.prod(-1.0 if factor == "-1" else values[factor] for factor in term.split())
        out[int(place[0]) - 1, int(place[1]) - 1] = total
    return out


def jacobian(q, lengths):
    """(6, 7) of the flange. Every printed column is the axis of its joint across what lies beyond it, multiplied out: upper arm, forearm
    and hand are those of (B.23), the axes those of the last three rows. So misprints show: j32 without "+ S1 S2 L2", j22 S1 times the
    bracket of j12, the brackets of j24 and j34 closed, j44 and j45 apart, "j45 = -S1" is j42, and "j6" j66."""
    values = scalars(q, lengths)
    _, ls, le, lw = lengths
    c1, c2, c3, c4, c5, c6, _ = (values[f"C{i}"] for i in range(1, 8))
    s1, s2, s3, s4, s5, s6, _ = (values[f"S{i}"] for i in range(1, 8))
    upper = np.array([c1 * s2, s1 * s2, c2])
    first = np.array([c1 * c2 * c3 - s1 * s3, s1 * c2 * c3 + c1 * s3, -s2 * c3])
    elbow = np.array([-c1 * c2 * s3 - s1 * c3, -s1 * c2 * s3 + c1 * c3, s2 * s3])
    forearm, second = first * s4 + upper * c4, first * c4 - upper * s4
    wrist = -second * s5 + elbow * c5
    hand = (second * c5 + elbow * s5) * s6 + forearm * c6
    beyond_wrist = lw * hand
    beyond_elbow = beyond_wrist + le * forearm
    beyond_shoulder = beyond_elbow + ls * upper
    axes = [[0.0, 0.0, 1.0], [-s1, c1, 0.0], upper, elbow, forearm, wrist, hand]
    arms = [beyond_shoulder] * 3 + [beyond_elbow] * 2 + [beyond_wrist] * 2
    return np.vstack([np.cross(axes, arms).T, np.transpose(axes)])
