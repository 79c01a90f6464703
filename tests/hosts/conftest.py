"""Two machines on this one, or the reason why not."""

import pytest
from domain_coordinator import domain_id
from domains import next_domain
from hosts.two_hosts import NotPossible, two_machines


@pytest.fixture(scope="module")
def machines():
    """(one machine, the other, a free domain)."""
    try:
        with two_machines() as pair, domain_id(next_domain) as domain:
            yield *pair, domain
    except NotPossible as error:
        pytest.skip(f"no two machines here: {error}")
