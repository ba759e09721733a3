// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

// Messages of the server as objects. The layout of frames is documented in magat_viewer/watched_episode.py.

const HEAD = 32;
// Of a longer live episode the oldest frames are dropped.
const MOST_FRAMES = 6000;

export const PRIMITIVES = ["idle", "up", "down", "left", "right"];
export const ARROWS = ["·", "↑", "↓", "←", "→"];
export const DELTAS = [[0, 0], [0, 1], [0, -1], [-1, 0], [1, 0]];

export class Episode {
  constructor(scene) {
    this.number = scene.episode;
    this.robots = scene.robots;
    this.width = scene.width;
    this.height = scene.height;
    this.goals = scene.goals;
    this.tMax = scene.t_max;
    this.radioRange = scene.radio_range;
    this.viewRadius = scene.view_radius;
    this.obstacles = scene.obstacles && Uint8Array.from(scene.obstacles, Number);
    this.labels = scene.robots.map(label);
    this.frames = [];
    this.details = new Map();
  }

  // Append the frames of a message; returns how many old ones were dropped.
  append(buffer) {
    const robots = this.robots.length;
    const size = HEAD + Math.ceil((5 * robots) / 4) * 4;
    for (let at = 0; at + size <= buffer.byteLength; at += size) {
      const head = new DataView(buffer, at, HEAD);
      if (head.getUint32(0, true) !== this.number) continue;
      this.frames.push({
        tick: head.getUint32(4, true),
        onGoal: head.getUint32(8, true),
        visited: head.getUint32(12, true),
        blocked: head.getUint32(16, true),
        silences: head.getUint32(20, true),
        links: head.getUint32(24, true),
        seconds: head.getFloat32(28, true),
        x: new Int16Array(buffer, at + HEAD, robots),
        y: new Int16Array(buffer, at + HEAD + 2 * robots, robots),
        flags: new Uint8Array(buffer, at + HEAD + 4 * robots, robots),
      });
    }
    const dropped = Math.max(0, this.frames.length - MOST_FRAMES);
    this.frames.splice(0, dropped);
    return dropped;
  }

  detail(robot, tick) {
    return this.details.get(`${robot}/${tick}`);
  }

  keep(detail) {
    if (this.details.size > MOST_FRAMES) this.details.clear();
    this.details.set(`${detail.robot}/${detail.tick}`, detail);
  }
}

export const action = (flags) => flags & 7;
export const moved = (flags) => (flags >> 3) & 7;
export const silent = (flags) => (flags & 64) !== 0;
export const blocked = (flags) => action(flags) !== 0 && action(flags) !== moved(flags);

// The label on a robot: its number, or the first letters of its name.
function label(name) {
  const digits = /(\d+)$/.exec(name);
  return digits ? String(Number(digits[1])) : name.slice(0, 2);
}
