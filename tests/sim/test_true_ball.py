"""The true world: contacts at their instant, energy never made, every surface met."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_core.constants import BALL_RADIUS, FLOOR_Z, GRAVITY, NET_X
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import BallState, RacketState
from tt_eval.scenario import load
from tt_predict.rollout import StopRule, rollout
from tt_sim.world.true_ball import RACKET_RADIUS, RacketMotion, Surface, World

AWAY = RacketMotion(np.array([-9.0, 0, 9]), np.eye(3), np.zeros(3), np.zeros(3))
TICK = 0.002


def advance(world, duration, racket=lambda t: AWAY):
    """Whole ticks; racket(t) is where it is at time t."""
    contacts, t = [], world.ball.time
    for i in range(round(duration / TICK)):
        contacts += world.advance(t + (i + 1) * TICK, (racket(t + i * TICK), racket(t + (i + 1) * TICK)), TICK)
    return contacts


def still(position, normal):
    """A racket at rest."""
    x = np.cross(normal, [0.3, 0.9, 0.1])
    x /= np.linalg.norm(x)
    return RacketMotion(np.array(position), np.column_stack([x, np.cross(normal, x), normal]), np.zeros(3), np.zeros(3))


def energy(ball):
    return 0.5 * (ball.velocity @ ball.velocity + 2 / 3 * BALL_RADIUS**2 * ball.spin @ ball.spin) + GRAVITY * ball.position[2]


launches = st.builds(
    lambda vx, vy, vz, wx, wy, wz: BallState(0.0, [2.6, 0.76, 0.3], [vx, vy, vz], [wx, wy, wz]),
    st.floats(-9, -1),
    st.floats(-2, 2),
    st.floats(-2, 3),
    *[st.floats(-400, 400)] * 3,
)


units = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: np.array(v) / np.linalg.norm(v))
anywhere = st.tuples(st.floats(-0.3, 3.0), st.floats(-0.3, 1.8), st.floats(0.06, 0.5))


@given(anywhere, st.tuples(*[st.floats(-8, 8)] * 3), st.tuples(*[st.floats(-600, 600)] * 3), anywhere, units, st.integers(0, 10**6))
def test_nothing_at_rest_gives_energy_and_no_ball_is_inside_anything(position, velocity, spin, place, normal, seed):
    """Against net, edges, corners, floor, a racket's faces and rim, with the coefficients of any trial of the hardest world."""
    physics = load("harsh").world.domain_randomization.draw(Physics.measured(), np.random.default_rng(seed))
    world = World(physics)
    world.ball = BallState(0.0, position, velocity, spin)
    racket = still(place, normal)
    if np.linalg.norm(world.ball.position - place) < RACKET_RADIUS + 2 * BALL_RADIUS:
        return
    if abs(position[0] - NET_X) < 2 * BALL_RADIUS and position[2] < 0.2:
        return
    last = energy(world.ball)
    for i in range(300):
        contacts = world.advance((i + 1) * TICK, (racket, racket), TICK)
        for contact in contacts:
            assert energy(contact.after) <= energy(contact.before) + 1e-9  # J/kg, rounding
        if world.ball is None:
            return
        assert energy(world.ball) <= last + 1e-9
        last, (x, y, z) = energy(world.ball), world.ball.position
        over = np.hypot(x - np.clip(x, 0, 2.74), y - np.clip(y, 0, 1.525))
        assert np.hypot(over, max(z, 0.0)) >= BALL_RADIUS - 1e-9 or z < 0.0


def test_a_ball_that_grazes_an_edge_between_ticks_is_found():
    """The valley of the distance lies inside a tick: both ends are clear of the table."""
    deep = 1e-5  # m
    world = World(Physics.liu())
    c = np.sqrt(0.5) * (BALL_RADIUS - deep)
    nearest = np.array([-c, 0.7, c, 3.0, 0, 3.0, 0, 0, 0])
    world.ball = BallState.from_vector(0.0, fly(nearest, -0.003, Physics.liu().air.coefficients))
    (contact,) = advance(world, 0.006)
    assert contact.surface is Surface.TABLE and contact.edge


def test_the_edge_sends_the_ball_off_the_line_to_the_nearest_point():
    physics = Physics.liu()
    world = World(physics)
    world.ball = BallState(0.0, [-0.012, 0.7, 0.1], [0, 0, -2.0], [0, 0, 0])
    contact = advance(world, 0.1)[0]
    normal = np.array([contact.before.position[0], 0.0, contact.before.position[2]]) / BALL_RADIUS
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)
    assert contact.edge and contact.after.velocity @ normal == pytest.approx(-0.93 * (contact.before.velocity @ normal), rel=1e-9)  # e_t


def test_a_turning_face_hits_with_the_speed_of_its_point():
    """Off the centre by a and turning at w about y, the face comes at w a."""
    physics, aside, turning = Physics.liu(), 0.05, 4.0
    racket = RacketMotion(np.array([0.0, 0.7, 0.5]), np.eye(3), np.zeros(3), np.array([0.0, turning, 0.0]))
    world = World(physics)
    world.ball = BallState(0.0, [aside, 0.7, 0.56], [0, 0, -1.0], [0, 0, 0])
    (contact,) = advance(world, 0.06, lambda t: racket)
    gone = contact.after.velocity[2] - -turning * aside
    assert gone == pytest.approx(-0.73 * (contact.before.velocity[2] + turning * aside), rel=1e-9)  # e_r
    assert contact.offset == pytest.approx(aside, abs=1e-4)


@given(launches)
def test_energy_is_never_made(launch):
    world = World(Physics.measured())
    world.ball, last = launch, energy(launch)
    for i in range(400):
        world.advance((i + 1) * TICK, (AWAY, AWAY), TICK)
        if world.ball is None:
            return
        assert energy(world.ball) <= last + 1e-9  # J/kg, rounding
        last = energy(world.ball)


def test_ticks_do_not_change_the_path():
    ball = BallState(0.0, [2.6, 0.76, 0.3], [-6.2, 0.1, 1.0], [20, -360, 30])
    world = World(Physics.liu())
    world.ball = ball
    contacts = advance(world, 0.5)
    path = rollout(ball, Physics.liu(), StopRule.at_time(0.5))
    assert [c.surface for c in contacts] == [Surface.TABLE]
    assert contacts[0].before.time == pytest.approx(path.bounces[0].time, abs=1e-9)
    assert world.ball.vector == pytest.approx(path.end.vector, abs=1e-6)


def test_a_moving_racket_is_met_at_its_face_and_gives_what_the_model_gives():
    physics = Physics.liu()
    state = RacketState(0.0, [-0.2, 0.7, 0.3], [1.5, 0.1, 1.0], -0.1, 0.9)

    def racket(t):
        return RacketMotion(state.position + (t - 0.1) * state.velocity, state.rotation, state.velocity, np.zeros(3))

    meet = state.position + BALL_RADIUS * state.normal
    start = fly(np.concatenate([meet, [-3.0, 0.1, 0.4], [0, 150, 0]]), -0.1, physics.air.coefficients)
    world = World(physics)
    world.ball = BallState.from_vector(0.0, start)
    (contact,) = advance(world, 0.15, racket)
    assert contact.surface is Surface.RACKET
    assert contact.before.time == pytest.approx(0.1, abs=1e-9)
    assert contact.offset == pytest.approx(0.0, abs=1e-7)
    velocity, spin = physics.racket.after(contact.before.velocity, contact.before.spin, state)
    assert contact.after.velocity == pytest.approx(velocity, abs=1e-7)
    assert contact.after.spin == pytest.approx(spin, abs=1e-5)


@pytest.mark.parametrize(("aside", "met"), [(0.9, True), (1.2, True), (1.3, False)])
def test_the_racket_ends_at_its_rim(aside, met):
    racket = RacketMotion(np.array([0.0, 0.7, 0.5]), np.eye(3), np.zeros(3), np.zeros(3))
    world = World(Physics.liu())
    world.ball = BallState(0.0, [0.0, 0.7 + aside * RACKET_RADIUS, 0.56], [0, 0, -1], [0, 0, 0])
    contacts = advance(world, 0.06, lambda t: racket)
    assert bool(contacts) == met  # a ball of 20 mm beside a racket of 75 mm touches its rim up to 1.27 radii
    assert not met or contacts[0].edge == (aside > 1.0)


@pytest.mark.parametrize(
    ("position", "velocity", "surface"),
    [
        ([1.6, 0.7, 0.1], [-5, 0, 0], Surface.NET),
        ([1.6, 0.7, 0.16], [-8, 0, 0], Surface.NET),
        ([1.1, 0.7, 0.1], [5, 0, 0], Surface.NET),
        ([1.6, 0.7, 0.3], [-5, 0, 0], Surface.TABLE),
        ([1.6, -0.5, 0.1], [-8, 0, 0], Surface.FLOOR),
        ([-0.5, 0.7, 0.1], [-1, 0, 0], Surface.FLOOR),
    ],
)
def test_what_a_ball_meets_first(position, velocity, surface):
    world = World(Physics.liu())
    world.ball = BallState(0.0, position, velocity, [0, 0, 0])
    first = advance(world, 0.6)[0]
    assert first.surface is surface
    if surface is Surface.NET:
        assert (first.after.position[0] - NET_X) * velocity[0] < 0  # it stays on its side
    if surface is Surface.FLOOR:
        assert first.before.position[2] == pytest.approx(FLOOR_Z + BALL_RADIUS, abs=1e-9)
        assert world.ball is None
