"""The dissertation's tables come out of the code, to the printed digits where they can."""

from collections import Counter

import pytest
from reproduction.tables import INPUTS, numbers

NUMBERS = numbers()


@pytest.mark.parametrize("number", NUMBERS, ids=lambda n: f"{n.table} {n.row} {n.quantity}")
def test_a_printed_number_is_reproduced_or_explained(number):
    assert number.verdict != "differs", f"printed {number.printed}, ours {number.ours:.4f}, allowed {number.allowed:.4f}"
    assert number.verdict != "explained" or number.note


def test_all_thirty_numbers_of_table_4_3_have_the_printed_digits_with_the_inputs_of_the_errata():
    assert Counter(n.verdict for n in NUMBERS if n.table == "4.3" and n.row.endswith(INPUTS[1][0])) == {"same digits": 30}


def test_what_is_explained_is_what_contradicts_another_print():
    # 4 in Table 3.6, the column of Table 3.7, p_y of 4.4 case 2 and alpha of 4.5(c) back spin for at least one set of inputs
    explained = Counter(n.table for n in NUMBERS if n.verdict == "explained")
    assert explained["3.6"] == 4 and explained["3.7"] == 6 and explained["4.4"] == 2 and explained["4.5(c)"] == 1
