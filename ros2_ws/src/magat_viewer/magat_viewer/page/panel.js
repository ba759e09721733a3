// The column beside the map: measures of the team, the inside of the chosen robot, the health of all.

import { colours, inkOf } from "./colours.js";
import { mean } from "./layers.js";
import { ARROWS, PRIMITIVES, blocked, moved, silent, action } from "./team.js";

const LISTED = 12; // neighbours
const STALE = 5; // seconds without a status
const SIDE = 11; // of an observation, cells

const $ = (id) => document.getElementById(id);

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// Set a text only where it changed: the page is laid out anew otherwise.
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
  ["moves blocked", (frame) => [frame.blocked, ""]],
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
  const how = measures.success ? "complete" : `${(100 * measures.p_rg).toFixed(0)} % arrived`;
  const longer = measures.delta_ft === null ? "no expert's solution" : `delta_FT ${(100 * measures.delta_ft).toFixed(1)} %`;
  return `Episode ${how} after ${ticks} ticks, makespan ${measures.makespan}, ${longer}`;
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
      heading.firstChild.style.background = inkOf(chosen);
    }
    this.decision(player, chosen, detail);
    const nothing = live ? "No detail of this tick was seen." : "The recording has no observation of this tick.";
    const other = detail && detail.tick !== player.tick ? `What it saw and decided is of tick ${detail.tick}. ` : "";
    write($("why"), detail ? other + detail.why : nothing);
    this.view(detail);
    this.links(episode, detail);
  }

  decision(player, chosen, detail) {
    const after = player.atEnd ? player.frame : player.next;
    const flags = after && after.tick > 0 ? after.flags[chosen] : 0;
    const [want, made] = [action(flags), moved(flags)];
    const line = [`Tick ${player.tick}: `];
    if (!after || after.tick === 0) line.push("not begun");
    else if (silent(flags)) line.push(element("b", { class: "alarm" }, "no answer in time"), ", so it stays");
    else if (blocked(flags)) {
      line.push(`wants ${PRIMITIVES[want]} ${ARROWS[want]}, and `);
      line.push(element("b", { class: "alarm" }, made ? `the shield makes it ${PRIMITIVES[made]}` : "the shield holds it back"));
    } else if (want !== made) line.push(`wants to stay, and the shield moves it ${PRIMITIVES[made]} ${ARROWS[made]}`);
    else line.push(want ? `wants ${PRIMITIVES[want]} ${ARROWS[want]}, and the shield lets it` : "wants to stay, and stays");
    const heard = detail && detail.heard !== null ? `. Heard ${detail.heard} of ${detail.audible}.` : ".";
    const text = line.map((part) => part.textContent ?? part).join("") + heard;
    if ($("decision").textContent !== text) $("decision").replaceChildren(...line, heard);
    this.rows.forEach((row, primitive) => {
      const known = detail && detail.probabilities;
      setBar(row, known ? detail.probabilities[primitive] : 0);
      if (!known) write(row.children[2], "–");
      const drawn = known && detail.primitive === primitive;
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
        if (detail.view[channel][at] !== "1") continue;
        const [left, top] = [(at % SIDE) * cell, (SIDE - 1 - Math.floor(at / SIDE)) * cell];
        ctx.fillStyle = ink;
        ctx.fillRect(left + 0.5, top + 0.5, cell - 1, cell - 1);
      }
      // The robot itself, in the middle.
      ctx.strokeStyle = colours.ink;
      ctx.lineWidth = 1.5;
      ctx.strokeRect(5 * cell + 1, 5 * cell + 1, cell - 2, cell - 2);
    });
  }

  links(episode, detail) {
    const near = detail ? [...detail.neighbours] : [];
    const share = ({ attention }) => (attention ? mean(attention) : -1);
    near.sort((a, b) => share(b) - share(a));
    write($("neighbours-heading"), near.length ? `Listens to (${near.length} in range)` : "Nobody is in range");
    this.neighbours.forEach((row, at) => {
      const one = near[at];
      row.parentNode.hidden = !one;
      if (!one) return;
      const button = row.children[0].firstChild;
      button.value = one.robot;
      write(button, episode.robots[one.robot]);
      setBar(row, Math.max(0, share(one)));
      if (!one.attention) write(row.children[2], detail.why ? "?" : "lost");
    });
  }
}

// --- Health ---

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
    const equipment = new Set(processes.map((p) => `${p.policy}, ${p.digest.slice(0, 12)}, ${p.encoding}, radio ${p.radio}`));
    write($("equipment"), [...equipment].join("; ") || "No robot has said anything of itself yet.");
    const ill = this.ills();
    const well = episode.robots.length - ill.size;
    const lines = [`${well} of ${episode.robots.length} robots are well`];
    const list = element("ul");
    for (const [robot, reasons] of [...ill].slice(0, 8)) list.append(element("li", {}, `${episode.robots[robot]}: ${reasons.join(", ")}`));
    if (ill.size > 8) list.append(element("li", {}, `and ${ill.size - 8} more`));
    $("summary").replaceChildren(...lines, ...(ill.size ? [list] : []));
    this.roster();
  }

  // Who is not well, and why.
  ills() {
    const ill = new Map();
    const add = (robot, reason) => ill.set(robot, [...(ill.get(robot) || []), reason]);
    const digests = new Set(this.health.processes.map(({ digest }) => digest));
    for (const [robot, times] of Object.entries(this.health.late)) add(Number(robot), `late ${times} ${times === 1 ? "time" : "times"}`);
    for (const process of this.health.processes) {
      for (const robot of process.robots) {
        if (process.age > STALE) add(robot, `no status for ${process.age.toFixed(0)} s`);
        if (process.restarts) add(robot, `restarted ${process.restarts} times`);
        if (digests.size > 1) add(robot, `carries ${process.policy} (${process.digest.slice(0, 6)})`);
      }
    }
    return ill;
  }

  roster() {
    if (!this.episode || !$("roster").open) return;
    this.cells ||= this.episode.robots.map((name, robot) => this.row(name, robot));
    const of = new Map();
    for (const process of this.health.processes) for (const robot of process.robots) of.set(robot, process);
    this.cells.forEach((cells, robot) => {
      const process = of.get(robot);
      const late = this.health.late[robot] || 0;
      const said = process ? [late, process.restarts, process.features_missing, process.digest.slice(0, 6)] : [late, "–", "–", "–"];
      said.forEach((value, at) => {
        write(cells[at], String(value));
        cells[at].className = at < 2 && value > 0 ? "ill" : "";
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
