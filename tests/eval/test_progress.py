"""Progress of long computations, where there is no terminal."""

import pytest
from tt_eval.progress import progress, tracked


def lines(capsys):
    out, err = capsys.readouterr()
    assert not out  # which holds results
    return [line.split()[0] for line in err.splitlines()]


@pytest.mark.parametrize("total", [1, 7, 1000])
def test_a_line_is_told_for_each_tenth_at_most(capsys, total):
    assert list(tracked("balls", total, range(total))) == list(range(total))
    told = lines(capsys)
    assert told[-1] == str(total) and len(told) <= 10


def test_what_was_done_before_is_counted(capsys):
    with progress("balls", 100, done=95) as advance:
        advance(3)
        advance(2)
    assert lines(capsys) == ["100"]
