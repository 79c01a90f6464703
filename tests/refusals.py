"""What a refusal must tell: class or code say what is wrong, its text names the values. Words are left to the authors."""

from contextlib import contextmanager

import pytest


@contextmanager
def refused(kind, *values):
    """Expect an error of class `kind` whose text names all of `values`."""
    with pytest.raises(kind) as caught:
        yield caught
    check_named(str(caught.value), *values)


def check_named(text, *values):
    """Check that a text for people names all of `values`: numbers, and names of parameters, topics and files."""
    missing = [value for value in values if str(value) not in text]
    assert not missing, f"{text!r} does not name {missing}"


def is_told(failure, statuses):
    """Whether one of the statuses that were received has the code of `failure`, and all of its values."""
    wanted = {"code": failure.code.name, **{name: str(value) for name, value in failure.values.items()}}
    return any(wanted.items() <= status.values.items() for status in statuses)
