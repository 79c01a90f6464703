"""Lost messages are counted; publishers that appear, disappear or alternate do not count as losses."""

from hypothesis import given
from hypothesis import strategies as st
from tt_tools.sequence_gaps import SequenceGaps


def counted(numbers, publishers=("a",)):
    gaps = SequenceGaps(lambda: frozenset(publishers))
    return [gaps.add(number) for number in numbers]


def test_missing_numbers_are_counted_once():
    assert counted([7, 8, 9, 12, 13, 20]) == [0, 0, 0, 2, 0, 6]


@given(st.lists(st.sampled_from("abc"), max_size=60), st.tuples(*[st.integers(1, 10_000)] * 3))
def test_publishers_that_take_turns_are_no_loss(turns, starts):
    first = dict(zip("abc", starts, strict=True))
    numbers = [first[who] + turns[:i].count(who) for i, who in enumerate(turns)]
    far = all(abs(first[a] - first[b]) > len(turns) for a, b in ("ab", "bc", "ac"))  # else a message may be that of either
    assert not far or sum(counted(numbers, "abc")) == 0


def test_a_publisher_that_is_started_again_is_no_loss():
    present = [frozenset("a")]
    gaps = SequenceGaps(lambda: present[0])
    assert [gaps.add(number) for number in (500, 501)] == [0, 0]
    present[0] = frozenset("b")
    assert [gaps.add(number) for number in (1, 2, 4)] == [0, 0, 1]
    present[0] = frozenset("bc")
    assert [gaps.add(number) for number in (900, 5, 901)] == [0, 0, 0]
