# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A robot that computes: what it finds out about the others from everything that it receives in an episode.

docs/protocol.md, "Anonymity", says what it must not find out and what it can. The order in which messages of robots and
simulator are sent is attacked in test_episode_server.py, test_relay.py and tests/robot/test_crew.py.
"""

import itertools
from collections.abc import Callable, Iterable

import numpy as np
import pytest
from team_secret import SECRET

from magat_sim.case import draw_case
from magat_sim.grid import Primitive
from magat_sim.simulator import Simulator
from magat_sim.streams import episode_streams
from magat_sim.ticks import DistributedEpisode, ReceivedPreference, RobotObservation

ROBOTS = 10
SEED, NUMBER = 2021, 25_507
#: What the attacker takes for likely: small seeds and years; small numbers and those of the test cases.
SEEDS = [*range(5), *range(2019, 2024)]
NUMBERS = [*range(30), *range(25_500, 25_530)]
TICKS = 500
ME = 3


def find_streams(stream: int, secrets: Iterable[bytes | None]) -> tuple[int, int, int] | None:
    """Seed, number and index of the robot that has this stream, by trying all that are likely; None if not found."""
    for secret, seed, number in itertools.product(secrets, SEEDS, NUMBERS):
        place = np.flatnonzero(episode_streams(seed, number, ROBOTS, secret).robots == np.uint64(stream))
        if len(place):
            return seed, number, int(place[0])
    return None


def test_streams_without_a_secret_give_everything_away() -> None:
    """This is why a team has a secret."""
    own = int(episode_streams(SEED, NUMBER, ROBOTS).robots[ME])
    assert find_streams(own, [None]) == (SEED, NUMBER, ME)


def test_streams_with_a_secret_are_not_found_by_trying() -> None:
    own = int(episode_streams(SEED, NUMBER, ROBOTS, SECRET).robots[ME])
    assert find_streams(own, [None, bytes(32), b"\xff" * 32, own.to_bytes(32, "little")]) is None


def test_own_stream_tells_no_bit_of_the_streams_of_others() -> None:
    """Neither for the robots of one episode nor for those of many episodes with one secret."""
    streams = np.array([episode_streams(SEED, number, 2, SECRET).robots for number in range(4000)])
    bits = (streams[:, :, None] >> np.arange(64, dtype=np.uint64) & np.uint64(1)).astype(np.float64) - 0.5
    mine, others, later = bits[:-1, 0], bits[:-1, 1], bits[1:, 0]
    for hidden in (others, later):
        # 64 x 64 correlations of standard deviation 0.0158; the largest of them is hardly ever beyond 6 of these.
        assert abs(4 * mine.T @ hidden / len(mine)).max() < 0.095


@pytest.fixture(scope="module")
def received() -> list[list[RobotObservation]]:
    """By tick, what every robot receives; robot `ME` is the attacker, the rest is the truth. Nobody moves."""
    case = draw_case(SEED, NUMBER, 9, 9, ROBOTS)
    episode = DistributedEpisode(case, TICKS, episode_streams(SEED, NUMBER, ROBOTS, SECRET))
    ticks = []
    for _ in range(TICKS):
        ticks.append(episode.look(np.ones(ROBOTS, dtype=bool)))
        for observed in ticks[-1]:
            episode.answer(observed.own_tag, ReceivedPreference(Primitive.IDLE, 0, 0))
        episode.advance()
    return ticks


def owners(observations: list[RobotObservation]) -> list[int]:
    """The truth: which robots the tags belong to that the attacker is told."""
    owner = {observed.own_tag: robot for robot, observed in enumerate(observations)}
    return [owner[tag] for tag in observations[ME].audible_tags]


def test_tags_are_not_those_of_any_generator_that_the_attacker_can_seed(received: list[list[RobotObservation]]) -> None:
    tags = {observed.own_tag for observations in received for observed in observations}
    assert len(tags) == TICKS * ROBOTS
    state = np.random.SeedSequence([SEED, NUMBER], spawn_key=(1,)).generate_state(ROBOTS + 2, np.uint64)
    known = [*state.tolist(), received[0][ME].stream, received[0][ME].own_tag, received[1][ME].own_tag, SEED, NUMBER]
    for seed in known:
        predicted = np.random.Generator(np.random.PCG64(seed)).integers(1, 2**64, size=2000, dtype=np.uint64)
        assert tags.isdisjoint(predicted.tolist()), seed


GUESSES: dict[str, Callable[[list[int]], list[int]]] = {
    "its place in the list": lambda tags: list(range(len(tags))),
    "its place from the end": lambda tags: list(range(len(tags)))[::-1],
    "its rank by value": lambda tags: np.argsort(np.argsort(np.array(tags, dtype=np.uint64))).tolist(),
    "its rank by the low bits": lambda tags: np.argsort(np.argsort([tag % 64 for tag in tags], kind="stable")).tolist(),
    "its place in a set": lambda tags: [list(set(tags)).index(tag) for tag in tags],
}


@pytest.mark.parametrize("guess", GUESSES.values(), ids=GUESSES)
def test_tags_are_not_linked_from_tick_to_tick(received: list[list[RobotObservation]], guess: Callable) -> None:
    """The attacker says that two tags of consecutive ticks belong to one robot if they agree in something."""
    hits = tries = 0
    for before, after in itertools.pairwise(received):
        was, now = (dict(zip(guess(seen[ME].audible_tags), owners(seen), strict=True)) for seen in (before, after))
        neighbours = len(was)
        assert len(now) == neighbours > 4
        hits += sum(was[key] == now[key] for key in was)
        tries += neighbours
    chance = 1 / neighbours
    # Guesses within a tick are hardly correlated; five standard deviations of independent ones.
    assert abs(hits / tries - chance) < 5 * np.sqrt(chance * (1 - chance) / tries)


@pytest.mark.parametrize("guess", GUESSES.values(), ids=GUESSES)
def test_tags_do_not_tell_whose_they_are(received: list[list[RobotObservation]], guess: Callable) -> None:
    places, robots = [], []
    for observations in received:
        places += guess(observations[ME].audible_tags)
        robots += owners(observations)
    assert abs(np.corrcoef(places, robots)[0, 1]) < 5 / np.sqrt(len(places))


def test_own_tag_tells_nothing_of_own_number(received: list[list[RobotObservation]]) -> None:
    ranks = np.argsort(
        np.argsort(np.array([[o.own_tag for o in seen] for seen in received], dtype=np.uint64), axis=1), axis=1
    )
    robots = np.broadcast_to(np.arange(ROBOTS), ranks.shape)
    assert abs(np.corrcoef(ranks.ravel(), robots.ravel())[0, 1]) < 5 / np.sqrt(ranks.size)


def views(seed: int, number: int) -> list[bytes]:
    """What the robots see at the start of a case."""
    case = draw_case(seed, number, 20, 20, ROBOTS)
    simulator = Simulator([case], [1], [episode_streams(seed, number, ROBOTS)])
    return [view.tobytes() for view in simulator.observe().field_of_view]


@pytest.mark.parametrize(("seed", "found"), [(SEED, [(SEED, NUMBER)]), (0x7C3F_19D2_A4B8_605E, [])])
def test_a_case_is_recognised_by_its_map_if_its_seed_can_be_guessed(seed: int, found: list) -> None:
    """No secret hides a map that is public: docs/protocol.md says so, and what to do."""
    seen = views(seed, NUMBER)[ME]
    assert [(SEED, number) for number in NUMBERS[30:] if seen in views(SEED, number)] == found
