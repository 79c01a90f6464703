"""Writes docs/reproduction.md: python docs/reproduce.py, in the project's environment."""

from __future__ import annotations

import sys
from collections import Counter
from itertools import groupby
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from reproduction.tables import Number, numbers  # noqa: E402

HEAD = """# The dissertation's tables, reproduced

Written by `docs/reproduce.py` from the numbers that `tests/reproduction` holds. Verdicts:

- **same digits**: ours rounds to the printed number.
- **within allowance**: ours misses by no more than the rounding of the printed inputs allows. Tables 4.3 to 4.5 were not quite made with
  their printed inputs (g 9.81 and p_y 0.7625 give every digit of Table 4.3); with the printed ones 0.01 more is allowed.
- **explained**: the print contradicts another print, as the note says.
"""


def page(all_numbers: list[Number]) -> str:
    lines = [HEAD]
    counts = {table: Counter(n.verdict for n in rows) for table, rows in groupby(all_numbers, lambda n: n.table)}
    verdicts = ["same digits", "within allowance", "explained", "differs"]
    lines += [f"| table | {' | '.join(verdicts)} |", "|---" * (len(verdicts) + 1) + "|"]
    lines += [f"| {table} | {' | '.join(str(count[v]) for v in verdicts)} |" for table, count in counts.items()]
    for table, rows in groupby(all_numbers, lambda n: n.table):
        lines += ["", f"## Table {table}", "| row | | printed | ours | difference | allowance | verdict | note |", "|---" * 8 + "|"]
        lines += [
            f"| {n.row} | {n.quantity} | {n.printed} | {n.ours:.{n.digits + 2}f} | {n.difference:+.{n.digits + 2}f} "
            f"| {n.allowed:.{n.digits + 2}f} | {n.verdict} | {n.note} |"
            for n in rows
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    out = ROOT / "docs" / "reproduction.md"
    out.write_text(page(numbers()))
    print(out.relative_to(ROOT))


if __name__ == "__main__":
    main()
