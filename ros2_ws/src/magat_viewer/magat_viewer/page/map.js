// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

// The map: three stacked canvases, each redrawn only if it has changed; zoom, and clicks on robots.

import { drawGround, drawNow, drawPast } from "./layers.js";

const CLOSEST = 80; // pixels per cell
const MARGIN = 18;

export class TeamMap {
  // `choose(robot)` is called with the number of the clicked robot, or null.
  constructor(element, player, choose) {
    this.element = element;
    this.player = player;
    this.choose = choose;
    this.canvases = ["ground", "past", "now"].map((id) => document.getElementById(id));
    this.contexts = this.canvases.map((canvas) => canvas.getContext("2d"));
    this.view = null; // pixels: scale (of a cell), left and top (corner of the map), across and down (size of the canvas)
    this.moved = false; // by the user
    this.drawn = {};
    this.statistics = { frames: 0, milliseconds: [] };
    new ResizeObserver(() => this.resize()).observe(element);
    this.listen();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.element;
    for (const canvas of this.canvases) {
      canvas.width = Math.round(clientWidth * ratio);
      canvas.height = Math.round(clientHeight * ratio);
    }
    this.contexts.forEach((ctx) => ctx.setTransform(ratio, 0, 0, ratio, 0, 0));
    if (!this.moved) this.fit();
    this.refresh();
  }

  // Show the whole map.
  fit() {
    this.moved = false;
    const { episode } = this.player;
    if (!episode) return;
    const [across, down] = [this.element.clientWidth, this.element.clientHeight];
    const legend = 22;
    const room = [across - 2 * MARGIN, down - 2 * MARGIN - legend];
    const scale = Math.max(0.5, Math.min(room[0] / episode.width, room[1] / episode.height, CLOSEST));
    const exact = scale > 4 ? Math.floor(scale) : scale; // whole pixels: sharp lines
    this.view = {
      scale: exact,
      left: Math.round((across - exact * episode.width) / 2),
      top: Math.round((down - legend - exact * episode.height) / 2),
      height: episode.height,
      across,
      down,
    };
    this.refresh();
  }

  // Zoom around a point of the canvas, by default its middle.
  zoom(factor, px = this.element.clientWidth / 2, py = this.element.clientHeight / 2) {
    const { view } = this;
    if (!view) return;
    const scale = Math.max(1, Math.min(CLOSEST, view.scale * factor));
    view.left = px - ((px - view.left) * scale) / view.scale;
    view.top = py - ((py - view.top) * scale) / view.scale;
    view.scale = scale;
    this.moved = true;
    this.refresh();
  }

  refresh() {
    this.drawn = {};
    if (this.view) Object.assign(this.view, { across: this.element.clientWidth, down: this.element.clientHeight });
  }

  // Draw the layers that have changed.
  draw(chosen, detail) {
    const { player, view } = this;
    if (!player.frame || !view) return;
    const started = performance.now();
    const { episode } = player;
    const past = `${episode.number}/${player.frame.tick}/${chosen}`;
    const now = `${past}/${player.place}/${player.last}/${detail ? detail.tick : ""}`;
    this.layer(0, episode.number, (ctx) => drawGround(ctx, view, episode));
    this.layer(1, past, (ctx) => drawPast(ctx, view, player, chosen));
    if (this.layer(2, now, (ctx) => drawNow(ctx, view, player, chosen, detail))) {
      this.statistics.frames++;
      this.statistics.milliseconds.push(performance.now() - started);
      if (this.statistics.milliseconds.length > 1000) this.statistics.milliseconds.shift();
    }
  }

  layer(number, key, paint) {
    if (this.drawn[number] === key) return false;
    this.drawn[number] = key;
    const ctx = this.contexts[number];
    ctx.clearRect(0, 0, this.view.across, this.view.down);
    paint(ctx);
    return true;
  }

  // The robot at a point of the canvas, or null.
  robotAt(px, py) {
    const { frame, next, fraction } = this.player;
    if (!frame || !this.view) return null;
    const { scale, left, top, height } = this.view;
    const cellX = (px - left) / scale - 0.5;
    const cellY = height - (py - top) / scale - 0.5;
    let [nearest, least] = [null, Math.max(0.8, 9 / scale)];
    for (let robot = 0; robot < frame.x.length; robot++) {
      const atX = frame.x[robot] + fraction * (next.x[robot] - frame.x[robot]);
      const atY = frame.y[robot] + fraction * (next.y[robot] - frame.y[robot]);
      const distance = Math.hypot(atX - cellX, atY - cellY);
      if (distance < least) [nearest, least] = [robot, distance];
    }
    return nearest;
  }

  listen() {
    const { element } = this;
    let pressed = null;
    element.addEventListener("pointerdown", (event) => {
      pressed = { x: event.offsetX, y: event.offsetY, dragged: false };
      element.setPointerCapture(event.pointerId);
    });
    element.addEventListener("pointermove", (event) => {
      if (!pressed || !this.view) return;
      const [dx, dy] = [event.offsetX - pressed.x, event.offsetY - pressed.y];
      if (!pressed.dragged && Math.hypot(dx, dy) < 5) return;
      this.view.left += dx;
      this.view.top += dy;
      pressed = { x: event.offsetX, y: event.offsetY, dragged: true };
      this.moved = true;
      this.refresh();
    });
    element.addEventListener("pointerup", (event) => {
      if (pressed && !pressed.dragged) this.choose(this.robotAt(event.offsetX, event.offsetY));
      pressed = null;
    });
    element.addEventListener("pointercancel", () => { pressed = null; });
    element.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
    }, { passive: false });
    element.addEventListener("dblclick", () => this.fit());
  }
}
