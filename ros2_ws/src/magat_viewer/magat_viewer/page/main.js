// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

// The page: messages of the server, input of the user, and the drawing loop.

import { isDark, setTheme } from "./colours.js";
import { Connection } from "./connection.js";
import { TeamMap } from "./map.js";
import { HealthPanel, RobotPanel, TeamPanel, outcome } from "./panel.js";
import { Player, SPEEDS } from "./player.js";
import { Episode } from "./team.js";

const $ = (id) => document.getElementById(id);
const PANEL_PERIOD = 100; // milliseconds between two updates of texts
const MOST_OUTDATED = 30; // ticks by which a shown detail may be old while the episode plays

// What the address selects: #robot=NAME&tick=N&episode=N&theme=dark
const requested = new URLSearchParams(location.hash.slice(1));

const player = new Player();
const map = new TeamMap($("map"), player, choose);
const teamPanel = new TeamPanel();
const robotPanel = new RobotPanel(choose);
const healthPanel = new HealthPanel(choose);
let live = false;
let newest = null; // the episode of the frames that arrive
let chosen = null;
let results = [];
let panelAt = 0;
let shownDetail = null;

showTheme(requested.get("theme") || localStorage.getItem("theme"));
if (matchMedia("(prefers-reduced-motion: reduce)").matches) player.halt();

// --- Messages of the server ---

const connection = new Connection({
  changed(connected) {
    $("connection").classList.toggle("lost", !connected);
    $("connection").textContent = connected ? "" : "The server does not answer. Reconnecting …";
    if (connected) newest = null;
  },
  message(message) {
    if (message.kind === "team") showTeam(message);
    else if (message.kind === "results") showResults(message.episodes);
    else if (message.kind === "scene") showScene(new Episode(message));
    else if (message.kind === "health") healthPanel.show(message);
    else if (message.kind === "detail" && newest && message.episode === newest.number) newest.keep(message);
  },
  frames(buffer) {
    const before = newest.frames.length;
    const dropped = newest.append(buffer);
    if (player.episode !== newest) return;
    player.framesArrived(performance.now() / 1000, dropped);
    if (!before) firstFrames();
  },
});

function showTeam(team) {
  live = team.live;
  player.following = live && player.playing;
  $("title").textContent = team.title;
  $("live").hidden = !live;
  document.title = `MAGAT: ${team.title}`;
  const first = Number(requested.get("episode") || 0);
  if (!live) connection.request({ episode: first });
}

function showResults(episodes) {
  results = episodes;
  const options = episodes.map((result) => {
    const option = new Option(`${result.episode}${result.measures && !result.measures.success ? " (not all goals reached)" : ""}`, result.episode);
    if (result.measures) option.title = outcome(result);
    return option;
  });
  $("episode").replaceChildren(...options);
  $("episode").disabled = live || options.length < 2;
  if (player.episode) $("episode").value = player.episode.number;
}

function showScene(episode) {
  newest = episode;
  if (live && !player.following && player.episode) return; // the user looks at an older episode
  const before = player.episode;
  const name = before && chosen !== null ? before.robots[chosen] : requested.get("robot");
  player.show(episode);
  map.fit();
  healthPanel.begin(episode);
  if (!before || before.robots.join() !== episode.robots.join()) {
    $("robot").replaceChildren(new Option("none", ""), ...episode.robots.map((robot, number) => new Option(robot, number)));
    $("robot").disabled = false;
  }
  $("episode").value = episode.number;
  $("notice").textContent = episode.obstacles ? "" : "The map is not known until the next episode starts";
  const robot = episode.robots.indexOf(name);
  choose(robot < 0 ? null : robot);
}

// Called with the first frames of an episode.
function firstFrames() {
  panelAt = 0;
  if (!live && newest.number !== Number(requested.get("episode") || newest.number)) return; // the requested episode comes later
  if (requested.has("tick")) player.seekTick(Number(requested.get("tick")));
  requested.delete("tick");
}

// --- Input of the user ---

function choose(robot) {
  chosen = robot;
  connection.request({ chosen });
  $("robot").value = robot ?? "";
  healthPanel.mark(robot);
  if (robot !== null) $("announcement").textContent = `${player.episode.robots[robot]} is chosen`;
  panelAt = 0;
}

function chooseNext(by) {
  if (!player.episode) return;
  const robots = player.episode.robots.length;
  choose(chosen === null ? (by > 0 ? 0 : robots - 1) : (chosen + by + robots) % robots);
}

function act(action) {
  action();
  panelAt = 0;
}

function follow() {
  if (!live || !newest) return;
  player.playing = player.following = true;
  if (player.episode !== newest) showScene(newest);
  player.place = player.last;
}

function changeEpisode(by) {
  const options = [...$("episode").options].map((option) => Number(option.value));
  const at = options.indexOf(player.episode?.number) + by;
  if (!live && at >= 0 && at < options.length) connection.request({ episode: options[at] });
}

function changeTheme() {
  const theme = isDark() ? "light" : "dark";
  localStorage.setItem("theme", theme);
  showTheme(theme);
}

function showTheme(theme) {
  setTheme(theme);
  $("theme").textContent = isDark() ? "Light" : "Dark";
  map.refresh();
  panelAt = 0;
}

$("play").onclick = () => act(() => player.toggle());
$("back").onclick = () => act(() => player.step(-1));
$("forward").onclick = () => act(() => player.step(1));
$("live").onclick = () => act(follow);
$("scrubber").oninput = () => act(() => player.seekTick(Number($("scrubber").value)));
$("speed").append(...SPEEDS.map((speed) => new Option(`${speed} ticks/s`, speed)));
$("speed").onchange = () => act(() => { player.speed = Number($("speed").value); });
$("episode").onchange = () => connection.request({ episode: Number($("episode").value) });
$("robot").onchange = () => choose($("robot").value === "" ? null : Number($("robot").value));
$("theme").onclick = changeTheme;
$("help").onclick = () => $("keys").showModal();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => showTheme(localStorage.getItem("theme")));

const KEYS = {
  " ": () => player.toggle(),
  ArrowLeft: (event) => player.step(event.shiftKey ? -10 : -1),
  ArrowRight: (event) => player.step(event.shiftKey ? 10 : 1),
  Home: () => player.step(-Infinity),
  End: () => player.step(Infinity),
  ",": () => player.faster(-1),
  ".": () => player.faster(1),
  PageUp: () => changeEpisode(-1),
  PageDown: () => changeEpisode(1),
  n: () => chooseNext(1),
  p: () => chooseNext(-1),
  Escape: () => choose(null),
  l: follow,
  "+": () => map.zoom(1.25),
  "-": () => map.zoom(0.8),
  0: () => map.fit(),
  t: changeTheme,
  "?": () => $("keys").showModal(),
};

addEventListener("keydown", (event) => {
  const own = event.target.closest("select, input, dialog") || (event.key === " " && event.target.closest("button, summary"));
  const key = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!key || event.ctrlKey || event.altKey || event.metaKey || (own && event.key !== "Escape")) return;
  event.preventDefault();
  act(() => key(event));
});

// --- Drawing ---

const PLAY = "M4 2.5v11L13 8z";
const PAUSE = "M4 3h3v10H4zM9 3h3v10H9z";

function showPanels() {
  const { frame, episode } = player;
  if (!frame) return;
  const { frames } = player;
  teamPanel.show(player, results);
  robotPanel.show(player, chosen, shownDetail, live);
  const moving = player.playing && (player.following || !player.atEnd);
  $("play-sign").setAttribute("d", moving ? PAUSE : PLAY);
  $("play").setAttribute("aria-label", moving ? "Pause" : "Play");
  $("live").setAttribute("aria-pressed", String(player.following));
  $("speed").value = player.speed;
  $("speed").disabled = player.following;
  const scrubber = $("scrubber");
  scrubber.min = frames[0].tick;
  scrubber.max = frames.at(-1).tick;
  scrubber.value = frame.tick;
  scrubber.setAttribute("aria-valuetext", `tick ${frame.tick} of at most ${episode.tMax}`);
  $("clock").textContent = `tick ${frame.tick} / ${frames.at(-1).tick} (T_max ${episode.tMax})`;
}

// The detail of the chosen robot at the shown tick. While the episode plays, not every tick has one: then the last one.
function findDetail() {
  if (chosen === null || !player.episode) return null;
  const oldest = player.playing ? player.tick - MOST_OUTDATED : player.tick;
  for (let tick = player.tick; tick >= oldest; tick--) {
    const detail = player.episode.detail(chosen, tick);
    if (detail) return detail;
  }
  return null;
}

let last = performance.now();

function draw(now) {
  const moved = player.advance(Math.min(0.25, (now - last) / 1000));
  last = now;
  shownDetail = findDetail();
  if (!live && player.frame) connection.request({ tick: player.tick });
  map.draw(chosen, shownDetail);
  if (now - panelAt > PANEL_PERIOD || (!moved && panelAt === 0)) {
    panelAt = now;
    showPanels();
  }
  requestAnimationFrame(draw);
}

requestAnimationFrame(draw);

// For tests and the bench.
window.magat = { player, map, chosen: () => chosen, detail: () => shownDetail };
