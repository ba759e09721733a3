// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

// The column beside the map: the team, the chosen robot, and the health of the processes.

import { colours, colourOf } from "./colours.js";
import { mean } from "./layers.js";
import { ARROWS, PRIMITIVES, blocked, moved, silent, action } from "./team.js";

const LISTED = 12; // neighbours
const STALE = 5; // seconds without a status
const SIDE = 11; // of a field of view with its border, cells

const $ = (id) => document.getElementById(id);

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// Set a text only if it has changed, to avoid a new layout of the page.
function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function barRow(kind) {
  const row = element("div", { class: "bar-row", role: kind });
  for (const part of ["name", "bar", "share", "mark"]) row.append(element("span", { class: part, role: "cell" }));
  row.children[1].append(element("i"));
  return row;
}

function setBar(row, share) {
  row.children[1].firstChild.style.width = `${100 * share}%`;
  write(row.children[2], `${(100 * share).toFixed(share < 0.0995 ? 1 : 0)} %`);
}

// --- Team ---

const MEASURES = [
  ["at goal", (frame, robots) => [frame.onGoal, `of ${robots}`]],
  ["visited", (frame, robots) => [frame.visited, `of ${robots}`]],
  ["ticks/s", (frame) => [frame.seconds > 0 ? (1 / frame.seconds).toFixed(0) : "–", ""]],
  ["blocked moves", (frame) => [frame.blocked, ""]],
  ["late answers", (frame) => [frame.silences, ""]],
  ["radio links", (frame) => [frame.links, ""]],
];

export class TeamPanel {
  constructor() {
    this.values = MEASURES.map(([name]) => {
      const value = element("dd", {}, element("span"), " ", element("small"));
      $("measures").append(element("div", {}, element("dt", {}, name), value));
      return value;
    });
  }

  show(player, results) {
    const { frame, episode } = player;
    MEASURES.forEach(([, measure], at) => {
      const [value, unit] = measure(frame, episode.robots.length);
      write(this.values[at].children[0], String(value));
      write(this.values[at].children[1], unit);
    });
    const result = results.find(({ episode: number }) => number === episode.number);
    write($("result"), result && result.measures ? outcome(result) : "");
  }
}

export function outcome({ ticks, measures }) {
  const end = measures.success ? "succeeded" : `ended with ${(100 * measures.p_rg).toFixed(0)} % of the goals reached`;
  const longer = measures.delta_ft === null ? "no expert solution" : `delta_FT ${(100 * measures.delta_ft).toFixed(1)} %`;
  return `Episode ${end} after ${ticks} ticks, makespan ${measures.makespan}, ${longer}`;
}

// --- The chosen robot ---

export class RobotPanel {
  constructor(choose) {
    this.choose = choose;
    this.rows = PRIMITIVES.map((name, primitive) => {
      const row = barRow("row");
      write(row.children[0], `${ARROWS[primitive]} ${name}`);
      $("probabilities").append(row);
      return row;
    });
    this.views = ["obstacles", "robots", "goal"].map((name) => {
      const canvas = element("canvas", { width: 11 * SIDE, height: 11 * SIDE, role: "img", "aria-label": `Field of view: ${name}` });
      $("views").append(element("figure", {}, canvas, element("figcaption", {}, name)));
      return canvas.getContext("2d");
    });
    this.neighbours = Array.from({ length: LISTED }, () => {
      const row = barRow("presentation");
      const button = element("button", { type: "button" });
      button.onclick = () => this.choose(Number(button.value));
      row.children[0].append(button);
      row.children[3].remove();
      $("neighbours").append(element("li", {}, row));
      return row;
    });
  }

  show(player, chosen, detail, live) {
    $("invitation").hidden = chosen !== null;
    $("inside").hidden = chosen === null;
    const heading = $("chosen-heading");
    if (chosen === null) return write(heading, "Robot");
    const { episode } = player;
    const name = episode.robots[chosen];
    if (heading.textContent !== name) {
      heading.replaceChildren(element("i"), name);
      heading.firstChild.style.background = colourOf(chosen);
    }
    this.decision(player, chosen, detail);
    const missing = live ? "This tick has no details: the page did not receive them." : "The recording has no observation of this tick.";
    const other = detail && detail.tick !== player.tick ? `Field of view and decision are from tick ${detail.tick}. ` : "";
    const reason = detail && detail.no_attention ? `No attention: ${detail.no_attention}.` : "";
    write($("note"), detail ? other + reason : missing);
    this.view(detail);
    this.links(episode, detail);
  }

  decision(player, chosen, detail) {
    const after = player.atEnd ? player.frame : player.next;
    const flags = after && after.tick > 0 ? after.flags[chosen] : 0;
    const [wanted, made] = [action(flags), moved(flags)];
    const line = [`Tick ${player.tick}: `];
    if (!after || after.tick === 0) line.push("not started");
    else if (silent(flags)) line.push(element("b", { class: "alarm" }, "no answer in time"), ", so it does not move");
    else if (blocked(flags)) {
      line.push(`action ${PRIMITIVES[wanted]} ${ARROWS[wanted]}, `);
      line.push(element("b", { class: "alarm" }, made ? `changed by the shield to ${PRIMITIVES[made]} ${ARROWS[made]}` : "blocked by the shield"));
    } else if (wanted !== made) line.push(`action idle, changed by the shield to ${PRIMITIVES[made]} ${ARROWS[made]}`);
    else line.push(wanted ? `action ${PRIMITIVES[wanted]} ${ARROWS[wanted]}` : "action idle");
    const heard = detail && detail.heard !== null ? `. Received ${detail.heard} of ${detail.audible} messages.` : ".";
    const text = line.map((part) => part.textContent ?? part).join("") + heard;
    if ($("decision").textContent !== text) $("decision").replaceChildren(...line, heard);
    this.rows.forEach((row, primitive) => {
      const known = detail && detail.probabilities;
      setBar(row, known ? detail.probabilities[primitive] : 0);
      if (!known) write(row.children[2], "–");
      const drawn = known && detail.action === primitive;
      const marks = [drawn ? "drawn" : "", after && after.tick > 0 && made === primitive ? "made" : ""].filter(Boolean);
      write(row.children[3], marks.join(", "));
    });
  }

  view(detail) {
    this.views.forEach((ctx, channel) => {
      const cell = ctx.canvas.width / SIDE;
      ctx.fillStyle = colours.card;
      ctx.fillRect(0, 0, ctx.canvas.width, ctx.canvas.height);
      ctx.fillStyle = colours.grid;
      for (const [left, top, wide, high] of [[0, 0, SIDE, 1], [0, SIDE - 1, SIDE, 1], [0, 0, 1, SIDE], [SIDE - 1, 0, 1, SIDE]]) {
        ctx.fillRect(left * cell, top * cell, wide * cell, high * cell);
      }
      if (!detail) return;
      const ink = [colours.wall, colours.accent, colours.alarm][channel];
      for (let at = 0; at < SIDE * SIDE; at++) {
        if (detail.field_of_view[channel][at] !== "1") continue;
        const [left, top] = [(at % SIDE) * cell, (SIDE - 1 - Math.floor(at / SIDE)) * cell];
        ctx.fillStyle = ink;
        ctx.fillRect(left + 0.5, top + 0.5, cell - 1, cell - 1);
      }
      // The robot itself is in the middle.
      ctx.strokeStyle = colours.ink;
      ctx.lineWidth = 1.5;
      ctx.strokeRect(5 * cell + 1, 5 * cell + 1, cell - 2, cell - 2);
    });
  }

  links(episode, detail) {
    const neighbours = detail ? [...detail.neighbours] : [];
    const share = ({ attention }) => (attention ? mean(attention) : -1);
    neighbours.sort((a, b) => share(b) - share(a));
    const robots = neighbours.length === 1 ? "robot" : "robots";
    write($("neighbours-heading"), neighbours.length ? `Attention (${neighbours.length} ${robots} in range)` : "No robot in range");
    this.neighbours.forEach((row, at) => {
      const one = neighbours[at];
      row.parentNode.hidden = !one;
      if (!one) return;
      const button = row.children[0].firstChild;
      button.value = one.robot;
      write(button, episode.robots[one.robot]);
      setBar(row, Math.max(0, share(one)));
      if (!one.attention) write(row.children[2], detail.no_attention ? "–" : "lost");
    });
  }
}

// --- Health ---

const count = (times) => `${times} ${times === 1 ? "time" : "times"}`;

export class HealthPanel {
  constructor(choose) {
    this.choose = choose;
    this.body = $("roster").querySelector("tbody");
    this.health = { late: {}, processes: [] };
    $("roster").addEventListener("toggle", () => this.roster());
  }

  begin(episode) {
    this.episode = episode;
    this.cells = null;
    this.body.replaceChildren();
    $("roster").open = episode.robots.length <= 20;
  }

  show(health) {
    this.health = health;
    const { episode } = this;
    const processes = health.processes;
    const configurations = new Set(processes.map((p) => `${p.policy}, ${p.digest.slice(0, 12)}, ${p.encoding}, radio ${p.radio}`));
    write($("configuration"), [...configurations].join("; ") || "No robot has reported its status yet.");
    const faults = this.faults();
    const healthy = episode.robots.length - faults.size;
    const lines = [`${healthy} of ${episode.robots.length} robots are healthy`];
    const list = element("ul");
    for (const [robot, reasons] of [...faults].slice(0, 8)) list.append(element("li", {}, `${episode.robots[robot]}: ${reasons.join(", ")}`));
    if (faults.size > 8) list.append(element("li", {}, `and ${faults.size - 8} more`));
    $("summary").replaceChildren(...lines, ...(faults.size ? [list] : []));
    this.roster();
  }

  // Robots with faults: a map from their numbers to lists of reasons.
  faults() {
    const faults = new Map();
    const add = (robot, reason) => faults.set(robot, [...(faults.get(robot) || []), reason]);
    const digests = new Set(this.health.processes.map(({ digest }) => digest));
    for (const [robot, times] of Object.entries(this.health.late)) add(Number(robot), `late ${count(times)}`);
    for (const process of this.health.processes) {
      for (const robot of process.robots) {
        if (process.age > STALE) add(robot, `no status for ${process.age.toFixed(0)} s`);
        if (process.restarts) add(robot, `restarted ${count(process.restarts)}`);
        if (digests.size > 1) add(robot, `carries ${process.policy} (${process.digest.slice(0, 6)})`);
      }
    }
    return faults;
  }

  roster() {
    if (!this.episode || !$("roster").open) return;
    this.cells ||= this.episode.robots.map((name, robot) => this.row(name, robot));
    const of = new Map();
    for (const process of this.health.processes) for (const robot of process.robots) of.set(robot, process);
    this.cells.forEach((cells, robot) => {
      const process = of.get(robot);
      const late = this.health.late[robot] || 0;
      const values = process ? [late, process.restarts, process.features_missing, process.digest.slice(0, 6)] : [late, "–", "–", "–"];
      values.forEach((value, at) => {
        write(cells[at], String(value));
        cells[at].className = at < 2 && value > 0 ? "fault" : "";
      });
    });
  }

  row(name, robot) {
    const cells = Array.from({ length: 4 }, () => element("td"));
    const button = element("button", { type: "button" }, name);
    const row = element("tr", {}, element("td", {}, button), ...cells);
    row.onclick = () => this.choose(robot);
    this.body.append(row);
    return cells;
  }

  mark(chosen) {
    this.body.querySelector("[aria-selected]")?.removeAttribute("aria-selected");
    if (chosen !== null) this.body.children[chosen]?.setAttribute("aria-selected", "true");
  }
}
