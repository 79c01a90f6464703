"""What a refusal must tell: the class of the error says what is wrong, its text names the values. Words are left to the authors."""

from contextlib import contextmanager

import pytest


@contextmanager
def refused(kind, *values):
    """Expect an error of class `kind` whose text names all of `values`."""
    with pytest.raises(kind) as caught:
        yield caught
    text = str(caught.value)
    missing = [value for value in values if str(value) not in text]
    assert not missing, f"{text!r} does not name {missing}"
