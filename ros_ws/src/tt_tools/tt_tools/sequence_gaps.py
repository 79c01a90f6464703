"""Messages of a topic that were lost on their way, by the numbers that their publishers give them."""

from __future__ import annotations

from collections.abc import Callable, Hashable


class SequenceGaps:
    """Counts the messages that are missing between those that arrive.

    Each publisher numbers its messages one after the other, but a message does not tell whose it is. Numbers that go on one after the
    other are therefore taken as those of one publisher.
    """

    def __init__(self, publishers: Callable[[], frozenset[Hashable]]) -> None:
        """Begin without messages.

        Args:
            publishers: Returns the identities of the present publishers of the topic. It is called when a message does not follow another.
        """
        self._look, self._publishers = publishers, frozenset[Hashable]()
        self._lasts = set[int]()  # number of the last message of each publisher

    def add(self, number: int) -> int:
        """Take the number of a message that has arrived; return how many messages are missing before it."""
        if number - 1 in self._lasts:
            self._lasts.remove(number - 1)
            self._lasts.add(number)
            return 0
        before, self._publishers = self._publishers, self._look()
        if before != self._publishers:  # a publisher that has come or gone makes no gap
            self._lasts.clear()
        last = max((last for last in self._lasts if last < number), default=None)
        if last is None or len(self._lasts) < len(self._publishers):  # the first message of a publisher
            self._lasts.add(number)
            return 0
        self._lasts.remove(last)
        self._lasts.add(number)
        return number - last - 1
