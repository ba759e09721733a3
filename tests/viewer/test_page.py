# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page in a real browser: it loads, plays and reacts to mouse and keyboard, without errors in the console."""

from collections.abc import Callable, Iterator
from urllib.parse import urlsplit

import pytest

from magat_recording.tables import TeamRecording
from magat_viewer.browser import chromium, until
from magat_viewer.recorded import RecordedTeam
from magat_viewer.server import PageServer
from magat_viewer.watched_episode import EpisodeResult, Scene


@pytest.fixture(scope="module")
def browser(needs_chromium) -> Iterator:
    """Opened once."""
    with chromium() as opened:
        yield opened


@pytest.fixture
def show(browser) -> Iterator[Callable]:
    """Opens the page of a team. Errors in the console and requests to other hosts fail the test."""
    complaints, asked, opened = [], [], []

    def open_page(source, fragment: str = ""):
        server = PageServer(source)
        server.__enter__()
        context = browser.new_context(viewport={"width": 1200, "height": 800}, reduced_motion="no-preference")
        opened.extend([server, context])
        page = context.new_page()
        page.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: asked.append(urlsplit(request.url).netloc))
        page.goto(f"{server.url}#{fragment}")
        until(page, "Boolean(window.magat && magat.player.frame)")
        page.own = urlsplit(server.url).netloc
        return page

    yield open_page
    assert complaints == []
    for server, context in zip(opened[::2], opened[1::2], strict=True):
        assert set(asked) <= {urlsplit(one.url).netloc for one in opened[::2]}
        context.close()
        server.__exit__(None, None, None)


@pytest.fixture
def recorded(simulate, small_policy) -> RecordedTeam:
    """Two episodes of six robots."""
    policy = small_policy()
    return RecordedTeam(TeamRecording(simulate(policy).bag), policy, "a recorded team")


def shown(page, expression: str):
    return page.evaluate(expression)


def text(page, selector: str) -> str:
    return page.locator(selector).inner_text()


def cells(page) -> list[list[int]]:
    return page.evaluate("[[...magat.player.frame.x], [...magat.player.frame.y]]")


def point(page, robot: int) -> tuple[float, float]:
    """The position of a robot on the page, pixels."""
    box = page.locator("#map").bounding_box()
    x, y = page.evaluate(
        """robot => {
            const { view } = magat.map, { frame } = magat.player;
            return [view.left + (frame.x[robot] + 0.5) * view.scale,
                    view.top + (view.height - frame.y[robot] - 0.5) * view.scale];
        }""",
        robot,
    )
    return box["x"] + x, box["y"] + y


def test_the_page_shows_the_episode_and_robots_move(show, recorded):
    page = show(recorded)
    assert text(page, "#title") == "a recorded team"
    until(page, "document.getElementById('measures').innerText.includes('of 6')")
    until(page, "magat.player.frame.tick >= 2")
    before, place = page.locator("#now").screenshot(), shown(page, "magat.player.place")
    until(page, f"magat.player.place > {place} + 1.4")
    assert page.locator("#now").screenshot() != before
    until(page, "magat.player.atEnd")
    until(page, "document.getElementById('result').textContent.includes('Episode')")
    assert shown(page, "magat.player.frame.tick") == recorded.results()[0].ticks


def test_the_scrubber_shows_the_chosen_tick(show, recorded):
    page = show(recorded)
    worlds = recorded._recording.all_episodes[0].log.worlds
    for tick in (5, 0, 11):
        page.locator("#scrubber").fill(str(tick))
        until(page, f"magat.player.frame.tick === {tick} && !magat.player.playing")
        assert cells(page) == [list(worlds[tick].x), list(worlds[tick].y)]
        until(page, f"document.getElementById('clock').textContent.startsWith('tick {tick} / 12')")


def test_a_click_chooses_a_robot_and_shows_its_detail(show, recorded):
    page = show(recorded, "tick=3")
    for robot in (4, 1):
        page.mouse.click(*point(page, robot))
        assert shown(page, "magat.chosen()") == robot
        until(page, f"magat.detail()?.robot === {robot} && magat.detail().tick === 3")
    assert page.locator("#robot").input_value() == "1"
    until(page, "document.getElementById('chosen-heading').textContent === 'bob'")
    found = recorded.detail(0, 3, 1)
    until(page, "document.querySelector('#probabilities .share').textContent.includes('%')")
    rows = [row.inner_text().split() for row in page.locator("#probabilities .bar-row").all()]
    assert [row[1] for row in rows] == ["idle", "up", "down", "left", "right"]
    shares = [float(row[2]) for row in rows]
    assert shares == pytest.approx([100 * share for share in found.probabilities], abs=0.51)
    assert "drawn" in " ".join(rows[found.action])
    listed = page.locator("#neighbours li:visible").all()
    assert len(listed) == len(found.neighbours) > 0
    page.locator("#map").click(position={"x": 4, "y": 4})
    assert shown(page, "magat.chosen()") is None
    until(page, "document.getElementById('inside').hidden")


def test_every_key_works(show, recorded):
    page = show(recorded, "tick=3")
    press = page.keyboard.press
    assert not shown(page, "magat.player.playing")
    press("ArrowRight")
    press("Shift+ArrowRight")
    assert shown(page, "magat.player.frame.tick") == 12
    press("ArrowLeft")
    assert shown(page, "magat.player.frame.tick") == 11
    press("Home")
    assert shown(page, "magat.player.frame.tick") == 0
    press(" ")
    until(page, "magat.player.playing && magat.player.place > 0")
    press(" ")
    assert not shown(page, "magat.player.playing")
    press("n")
    press("n")
    assert shown(page, "magat.chosen()") == 1
    press("p")
    assert shown(page, "magat.chosen()") == 0
    press("Escape")
    assert shown(page, "magat.chosen()") is None
    speed = shown(page, "magat.player.speed")
    press(".")
    assert shown(page, "magat.player.speed") == 2 * speed
    scale = shown(page, "magat.map.view.scale")
    press("+")
    assert shown(page, "magat.map.view.scale") > scale
    press("0")
    assert shown(page, "magat.map.view.scale") == scale
    press("PageDown")
    until(page, "magat.player.episode.number === 1 && magat.player.frame")
    theme = page.locator("html").get_attribute("data-theme")
    press("t")
    assert {theme, page.locator("html").get_attribute("data-theme")} == {"light", "dark"}
    press("?")
    assert page.locator("#keys").is_visible()


def test_the_address_selects_episode_tick_and_robot(show, recorded):
    page = show(recorded, "episode=1&tick=7&robot=carol&theme=dark")
    until(page, "magat.player.episode.number === 1 && magat.player.frame?.tick === 7")
    assert shown(page, "magat.chosen()") == 2
    assert page.locator("html").get_attribute("data-theme") == "dark"
    assert not shown(page, "magat.player.playing")


class ReplayedTeam:
    """A live team that sends the frames of a recorded one up to the tick ``upto``."""

    live, title = True, "a live team"

    def __init__(self, recorded: RecordedTeam) -> None:
        self.recorded, self.upto, self.newest = recorded, 0, 0
        self.poll, self.health, self.detail = recorded.poll, recorded.health, lambda *_: None

    def results(self) -> list[EpisodeResult]:
        return self.recorded.results()[: self.newest]

    def scene(self, episode: int) -> Scene:
        return self.recorded.scene(episode)

    def frames(self, episode: int, after: int) -> tuple[int, bytes]:
        last, frames = self.recorded.frames(episode, -1)
        size = len(frames) // (last + 1)
        return self.upto, frames[(after + 1) * size : (self.upto + 1) * size]


def test_a_live_team_is_followed_and_can_be_looked_back_at(show, recorded):
    source = ReplayedTeam(recorded)
    page = show(source)
    assert page.locator("#live").is_visible()
    source.upto = 6
    until(page, "magat.player.frame.tick === 6")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    source.upto = 9
    until(page, "magat.player.last === 9")
    assert shown(page, "magat.player.frame.tick") == 4
    page.keyboard.press("l")
    until(page, "magat.player.frame.tick === 9")
    source.newest, source.upto = 1, 2
    until(page, "magat.player.episode.number === 1 && magat.player.frame?.tick === 2")
