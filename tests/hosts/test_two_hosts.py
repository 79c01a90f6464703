"""The robot on two machines, started as the README shows: it plays as on one, and goes on by itself after the cable was out."""

import time
from collections import defaultdict

import numpy as np
import pytest
from hosts.two_hosts import is_hit, one_host, two_hosts
from rosbags.highlevel import AnyReader
from tt_core.ros.convert import seconds
from tt_core.ros.diagnostics import Event, read_status
from tt_tools.reindex import reindex

BALLS = 5
ARGUMENTS = ("rate:=45.0", "markers:=false")  # 45 balls a minute; no test here looks at markers
START = 100.0  # s until the first ball is hit; 20 to 35 s on two shared cores
NEXT = 30.0  # s, room for 22 balls
RESULTS = {Event.PATH: "/ball/path", Event.STROKES: "/racket/strokes"}  # topics by the events that tell of them


def series(session, begun):
    """Hits of each BALLS balls in a row that ended after `begun` (s)."""
    hits = [is_hit(ball) for ball in session.balls(begun)]
    return [sum(hits[i : i + BALLS]) for i in range(len(hits) - BALLS + 1)]


def first_hit(session):
    """Wait for it; return the time (s) when that ball was over."""
    session.wait(lambda: any(map(is_hit, session.balls())), START, "a hit")
    return session.balls()[-1].time


@pytest.fixture(scope="module")
def alone(machines, tmp_path_factory):
    """(hits of BALLS balls on one machine, latencies in ms)."""
    one, _, domain = machines
    folder = tmp_path_factory.mktemp("one")
    with one_host(one, folder, domain, folder / "bag", *ARGUMENTS) as session:
        begun = first_hit(session)
        session.wait(lambda: bool(series(session, begun)), NEXT, f"{BALLS} balls")
        return series(session, begun)[0], session.latencies(begun)


@pytest.fixture(scope="module")
def pair(alone, machines, tmp_path_factory):
    """(session on two hosts, its bag, the cuts so far: time out, time in again)."""
    one, other, domain = machines
    folder = tmp_path_factory.mktemp("two")
    with two_hosts(one, other, folder, domain, folder / "bag", *ARGUMENTS) as session:
        yield session, folder / "bag", []


def test_two_machines_play_as_one_does(alone, pair, capsys):
    session, (hits, latencies) = pair[0], alone
    begun = first_hit(session)
    # As often as on one machine, less one; a series more where another program has just taken the cores.
    session.wait(lambda: max(series(session, begun), default=0) >= hits - 1, 2 * NEXT, f"{hits - 1} hits of {BALLS} balls")
    added = np.median(session.latencies(begun)) - np.median(latencies)
    with capsys.disabled():
        print(f"\nhits of {BALLS} balls on one machine: {hits}, on two: {series(session, begun)}; median latency added: {added:.1f} ms")


def test_the_clocks_agree(pair):
    session, *_ = pair
    session.wait(lambda: any(t.name == "watch" for t in session.statuses), NEXT, "clock offsets")
    offsets = [t.values for t in session.statuses if t.name == "watch"]
    assert {"sim", "estimate"} >= {values["worst"] for values in offsets}
    assert all(float(values["least_ms"]) == 0.0 for values in offsets)  # both machines have the clock of this one


@pytest.mark.parametrize("duration", [0.2, 1.0, 5.0])
def test_play_goes_on_after_the_cable_was_out(pair, machines, duration):
    """Out while the arm swings at a ball. The lease is 2 s: after 5 s all nodes must find each other anew."""
    session, _, cuts = pair
    begun = len(session.latencies())
    session.wait(lambda: len(session.latencies()) > begun, NEXT, "a swing")
    out = time.time()
    machines[1].unplug()
    time.sleep(duration)
    machines[1].plug()
    cuts.append((out, time.time()))
    session.wait(lambda: any(map(is_hit, session.balls(cuts[-1][1]))), NEXT, f"a hit after {duration} s without a cable")


def read_results(bag, since):
    """Return the stamps (s) of recorded results and of those that nodes told of, by topic, and the number of joint states after `since`."""
    if not (bag / "metadata.yaml").exists():  # DDS may hold up a recorder while all others leave, until the launcher kills it
        reindex(bag)
    recorded, reported, after = defaultdict(list), defaultdict(list), 0
    with AnyReader([bag]) as reader:
        for connection, time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic in RESULTS.values():
                recorded[connection.topic].append(seconds(message.header.stamp))
            elif connection.topic == "/diagnostics":
                for one in read_status(message):
                    if one.event in RESULTS:
                        reported[RESULTS[one.event]].append(float(one.values["stamp"]))
            elif connection.topic == "/joint_states":
                after += time * 1e-9 > since
    return recorded, reported, after


def test_the_recording_is_whole(pair):
    """Readable, and with every result that the nodes of the recorder's own machine told of, in order, across all cuts."""
    session, bag, cuts = pair
    session.close()
    counts, states = defaultdict(int), 0  # results by topic, and joint states, which the other machine sends, after the last cut
    for part in sorted(bag.parent.glob("bag*")):  # a recorder that stood still on a busy machine goes on in a new bag
        recorded, reported, after = read_results(part, cuts[-1][1] if cuts else 0.0)
        states += after
        for topic in RESULTS.values():
            made, told = recorded[topic], reported[topic]
            if part != bag:  # it begins with whichever topic is discovered first
                begin = max([*made[:1], *told[:1]], default=0.0)
                made, told = ([stamp for stamp in stamps if stamp > begin - 1e-6] for stamps in (made, told))
            assert made[: len(told)] == pytest.approx(told, abs=1e-6), (part, topic)
            assert len(made) <= len(told) + 1, (part, topic)  # the recorder may end between a result and what is told of it
            counts[topic] += len(told)
    assert all(counts[topic] > BALLS for topic in RESULTS.values())
    assert states > 0
