// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

// Drawing of the three canvases of the map. Cells are (x, y), y up; a view converts them to pixels, y down.

import { colourOf, colours } from "./colours.js";
import { DELTAS, blocked, silent, action } from "./team.js";

// Smallest cells, in pixels, with detailed robots and with labels.
const DETAILED = 11;
const LABELLED = 17;
// Length of a trail in frames, and opacity of its newest part.
const TRAIL = 8;
const FRESH = 0.38;

const x = (view, cell) => view.left + (cell + 0.5) * view.scale;
const y = (view, cell) => view.top + (view.height - cell - 0.5) * view.scale;

// --- Ground: what does not change during an episode ---

export function drawGround(ctx, view, episode) {
  const { scale } = view;
  const right = view.left + episode.width * scale;
  const bottom = view.top + episode.height * scale;
  ctx.fillStyle = colours.card;
  ctx.fillRect(view.left, view.top, right - view.left, bottom - view.top);
  if (scale >= 4) {
    ctx.beginPath();
    for (let i = 1; i < episode.width; i++) line(ctx, view.left + i * scale, view.top, view.left + i * scale, bottom);
    for (let i = 1; i < episode.height; i++) line(ctx, view.left, view.top + i * scale, right, view.top + i * scale);
    stroke(ctx, colours.grid, 1);
  }
  if (episode.obstacles) {
    const side = scale * (scale >= DETAILED ? 0.88 : 1);
    ctx.beginPath();
    episode.obstacles.forEach((there, cell) => {
      if (!there) return;
      const left = x(view, cell % episode.width) - side / 2;
      const top = y(view, Math.floor(cell / episode.width)) - side / 2;
      if (scale >= DETAILED) ctx.roundRect(left, top, side, side, side * 0.18);
      else ctx.rect(left, top, side, side);
    });
    ctx.fillStyle = colours.wall;
    ctx.globalAlpha = scale >= DETAILED ? 1 : 0.6; // so that small robots stand out
    ctx.fill();
    ctx.globalAlpha = 1;
  }
  ctx.strokeStyle = colours.quiet;
  ctx.lineWidth = 1;
  ctx.strokeRect(view.left - 0.5, view.top - 0.5, right - view.left + 1, bottom - view.top + 1);
}

// --- Past: goals and trails, redrawn with each frame ---

export function drawPast(ctx, view, player, chosen) {
  const { episode, index } = player;
  const shown = player.frame;
  drawGoals(ctx, view, episode, shown, chosen);
  const from = Math.max(0, index - TRAIL);
  for (let step = from; step < index; step++) {
    const [before, after] = [episode.frames[step], episode.frames[step + 1]];
    ctx.globalAlpha = FRESH * (1 - (index - step - 1) / TRAIL);
    trail(ctx, view, before, after, 1);
  }
  ctx.globalAlpha = 1;
}

function drawGoals(ctx, view, episode, frame, chosen) {
  const half = Math.max(1.5, view.scale * 0.3);
  ctx.globalAlpha = view.scale >= DETAILED ? 1 : 0.55;
  byColour(episode.robots.length, (robot) => {
    const [goalX, goalY] = episode.goals[robot];
    if (frame.x[robot] === goalX && frame.y[robot] === goalY) return;
    if (!visible(view, goalX, goalY)) return;
    ctx.roundRect(x(view, goalX) - half, y(view, goalY) - half, 2 * half, 2 * half, half * 0.35);
  }, ctx, (ink) => stroke(ctx, ink, view.scale >= DETAILED ? 1.8 : 1));
  ctx.globalAlpha = 1;
  if (view.scale >= LABELLED) {
    episode.labels.forEach((text, robot) => {
      const [goalX, goalY] = episode.goals[robot];
      if (visible(view, goalX, goalY)) label(ctx, view, text, x(view, goalX), y(view, goalY), colourOf(robot), 0.3);
    });
  }
  if (chosen !== null) {
    const [goalX, goalY] = episode.goals[chosen];
    const wide = half + 3;
    ctx.beginPath();
    ctx.roundRect(x(view, goalX) - wide, y(view, goalY) - wide, 2 * wide, 2 * wide, wide * 0.3);
    stroke(ctx, colours.ink, 1.5);
  }
}

// The way of the robots between two frames, up to a share of it.
function trail(ctx, view, before, after, share) {
  byColour(before.x.length, (robot) => {
    const [fromX, fromY] = [before.x[robot], before.y[robot]];
    const [toX, toY] = [after.x[robot], after.y[robot]];
    if ((fromX === toX && fromY === toY) || !visible(view, toX, toY)) return;
    const endX = fromX + share * (toX - fromX);
    const endY = fromY + share * (toY - fromY);
    line(ctx, x(view, fromX), y(view, fromY), x(view, endX), y(view, endY));
  }, ctx, (ink) => stroke(ctx, ink, Math.max(1, view.scale * 0.12), "square"));
}

// --- Now: robots and the details of the chosen one, redrawn whenever anything moves ---

export function drawNow(ctx, view, player, chosen, detail) {
  const { episode, frame, next, fraction } = player;
  const place = (robot) => [
    x(view, frame.x[robot] + fraction * (next.x[robot] - frame.x[robot])),
    y(view, frame.y[robot] + fraction * (next.y[robot] - frame.y[robot])),
  ];
  if (fraction > 0) {
    ctx.globalAlpha = FRESH;
    trail(ctx, view, frame, next, fraction);
    ctx.globalAlpha = 1;
  }
  if (chosen !== null) drawRange(ctx, view, episode, place(chosen), chosen);
  if (chosen !== null && detail) drawLinks(ctx, view, place, chosen, detail);
  drawRobots(ctx, view, player, place);
  if (chosen !== null) {
    const [cx, cy] = place(chosen);
    ctx.beginPath();
    ctx.arc(cx, cy, Math.max(5, view.scale * 0.55), 0, 2 * Math.PI);
    stroke(ctx, colours.halo, 4.5);
    stroke(ctx, colours.ink, 2.2);
    if (detail) drawShares(ctx, view, place, detail);
  }
}

function drawRobots(ctx, view, player, place) {
  const { episode, frame, next, fraction } = player;
  const radius = Math.max(2.2, view.scale * 0.4);
  const halfway = fraction > 0.5 ? next : frame;
  const count = episode.robots.length;
  const seen = (robot) => visible(view, frame.x[robot], frame.y[robot]);
  const home = (robot) => {
    const [goalX, goalY] = episode.goals[robot];
    return frame.x[robot] === goalX && frame.y[robot] === goalY && next.x[robot] === goalX && next.y[robot] === goalY;
  };
  byColour(count, (robot) => {
    if (!seen(robot)) return;
    const [cx, cy] = place(robot);
    if (home(robot)) {
      ctx.roundRect(cx - radius, cy - radius, 2 * radius, 2 * radius, radius * 0.35);
    } else {
      ctx.moveTo(cx + radius, cy);
      ctx.arc(cx, cy, radius, 0, 2 * Math.PI);
    }
  }, ctx, (ink) => { ctx.fillStyle = ink; ctx.fill(); });

  for (let robot = 0; robot < count; robot++) {
    if (!seen(robot)) continue;
    const flags = next.flags[robot];
    const [cx, cy] = place(robot);
    if (next.tick > 0 && silent(flags)) {
      ctx.beginPath();
      ctx.arc(cx, cy, radius, 0, 2 * Math.PI);
      ctx.fillStyle = colours.card;
      ctx.fill();
      const arm = radius * 0.62;
      line(ctx, cx - arm, cy - arm, cx + arm, cy + arm);
      line(ctx, cx - arm, cy + arm, cx + arm, cy - arm);
      stroke(ctx, colourOf(robot), Math.max(1, radius * 0.28));
    } else if (view.scale >= LABELLED) {
      label(ctx, view, episode.labels[robot], cx, cy, colours.card, 0.46);
    }
    if (home(robot) && view.scale >= DETAILED) check(ctx, view, cx, cy, colourOf(robot));
    if (blocked(flags) && halfway !== frame || (blocked(flags) && frame === next)) {
      const [dx, dy] = DELTAS[action(flags)];
      const far = Math.max(3.5, view.scale * 0.5);
      const half = Math.max(2, view.scale * 0.3);
      const [mx, my] = [cx + dx * far, cy - dy * far];
      ctx.beginPath();
      line(ctx, mx - dy * half, my - dx * half, mx + dy * half, my + dx * half);
      stroke(ctx, colours.alarm, Math.max(1.5, view.scale * 0.13));
    }
  }
}

// A check mark in the corner of a robot at its goal, readable without colour.
function check(ctx, view, cx, cy, ink) {
  const unit = view.scale * 0.1;
  const [ox, oy] = [cx + 3.4 * unit, cy - 3.4 * unit];
  ctx.beginPath();
  ctx.arc(ox, oy, 2.4 * unit, 0, 2 * Math.PI);
  ctx.fillStyle = colours.card;
  ctx.fill();
  ctx.beginPath();
  ctx.moveTo(ox - 1.2 * unit, oy);
  ctx.lineTo(ox - 0.3 * unit, oy + unit);
  ctx.lineTo(ox + 1.3 * unit, oy - 1.1 * unit);
  stroke(ctx, ink, Math.max(1, 0.7 * unit));
}

// The field of view, the radio range, and the direction to the goal.
function drawRange(ctx, view, episode, [cx, cy], chosen) {
  const half = (episode.viewRadius + 0.5) * view.scale;
  ctx.fillStyle = colours.view;
  ctx.fillRect(cx - half, cy - half, 2 * half, 2 * half);
  ctx.strokeStyle = colours.accent;
  ctx.lineWidth = 1;
  ctx.strokeRect(cx - half, cy - half, 2 * half, 2 * half);
  ctx.setLineDash([6, 5]);
  ctx.beginPath();
  ctx.arc(cx, cy, episode.radioRange * view.scale, 0, 2 * Math.PI);
  stroke(ctx, colours.quiet, 1.3);
  ctx.setLineDash([2, 4]);
  ctx.beginPath();
  line(ctx, cx, cy, x(view, episode.goals[chosen][0]), y(view, episode.goals[chosen][1]));
  stroke(ctx, colourOf(chosen), 1.6);
  ctx.setLineDash([]);
}

// Links to the robots in range: as wide as the attention, dashed without attention.
function drawLinks(ctx, view, place, chosen, detail) {
  const from = place(chosen);
  for (const { robot, attention } of detail.neighbours) {
    ctx.beginPath();
    line(ctx, ...from, ...place(robot));
    if (!attention) ctx.setLineDash([3, 4]);
    const width = attention ? 1 + mean(attention) * Math.min(14, 4 + view.scale * 0.4) : 1;
    ctx.globalAlpha = attention ? 0.85 : 0.6;
    stroke(ctx, attention ? colours.accent : colours.quiet, width);
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  }
}

// The attention of the chosen robot in percent, beside each neighbour.
function drawShares(ctx, view, place, detail) {
  if (view.scale < DETAILED || detail.neighbours.length > 16) return;
  for (const { robot, attention } of detail.neighbours) {
    if (!attention) continue;
    const [cx, cy] = place(robot);
    ctx.font = "600 11px system-ui, sans-serif";
    ctx.textAlign = "left";
    ctx.textBaseline = "middle";
    const text = `${Math.round(100 * mean(attention))} %`;
    const [left, top] = [cx + view.scale * 0.5, cy - view.scale * 0.5];
    ctx.lineWidth = 3.5;
    ctx.strokeStyle = colours.halo;
    ctx.lineJoin = "round";
    ctx.strokeText(text, left, top);
    ctx.fillStyle = colours.ink;
    ctx.fillText(text, left, top);
  }
}

export const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

// --- Helpers ---

function line(ctx, fromX, fromY, toX, toY) {
  ctx.moveTo(fromX, fromY);
  ctx.lineTo(toX, toY);
}

function stroke(ctx, colour, width, cap = "round") {
  ctx.strokeStyle = colour;
  ctx.lineWidth = width;
  ctx.lineCap = cap;
  ctx.stroke();
}

// One path for each colour instead of one for each robot, so that a thousand robots are drawn as fast as ten.
function byColour(count, add, ctx, paint) {
  const inks = colours.robots.length;
  for (let ink = 0; ink < Math.min(inks, count); ink++) {
    ctx.beginPath();
    for (let robot = ink; robot < count; robot += inks) add(robot);
    paint(colourOf(ink));
  }
}

function visible(view, cellX, cellY) {
  const [px, py] = [x(view, cellX), y(view, cellY)];
  const rim = 2 * view.scale;
  return px > -rim && py > -rim && px < view.across + rim && py < view.down + rim;
}

function label(ctx, view, text, cx, cy, colour, share) {
  ctx.font = `700 ${view.scale * share * (text.length > 2 ? 0.8 : 1)}px system-ui, sans-serif`;
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillStyle = colour;
  ctx.fillText(text, cx, cy + view.scale * 0.03);
}
