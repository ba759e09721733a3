// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

// The instant that is shown: a place between two frames of an episode, and how it advances.

export const SPEEDS = [1, 2, 4, 8, 16, 32, 64];

const MOST_BEHIND = 32; // frames

export class Player {
  constructor() {
    this.episode = null;
    this.place = 0; // in frames, with a fraction
    this.playing = true;
    this.following = false; // the running team, at its own speed
    this.speed = 8; // ticks per second
    this.arrived = 0; // time at which the last frames arrived, seconds
    this.interval = 0.1; // mean time between messages with frames, seconds
    this.behind = 0; // frames to catch up with until the next message
  }

  show(episode) {
    this.episode = episode;
    this.place = 0;
  }

  get frames() { return this.episode ? this.episode.frames : []; }
  get last() { return Math.max(0, this.frames.length - 1); }
  get index() { return Math.min(Math.floor(this.place), this.last); }
  get frame() { return this.frames[this.index]; }
  get next() { return this.frames[Math.min(this.index + 1, this.last)]; }
  get fraction() { return this.index < this.last ? this.place - this.index : 0; }
  get atEnd() { return this.place >= this.last; }

  // The tick whose decision is shown: the step from this frame to the next one, or the last step at the end.
  get tick() {
    if (!this.frame) return 0;
    return this.atEnd ? Math.max(0, this.frame.tick - 1) : this.frame.tick;
  }

  framesArrived(now, dropped) {
    const since = Math.min(now - this.arrived, 1);
    if (this.arrived) this.interval += 0.2 * (since - this.interval);
    this.arrived = now;
    this.place = Math.max(0, this.place - dropped);
    if (this.following) this.place = Math.max(this.place, this.last - MOST_BEHIND);
    this.behind = this.last - this.place;
  }

  // Advance by some seconds; returns whether that changed anything.
  advance(seconds) {
    const before = this.place;
    if (this.following) {
      this.place = Math.min(this.last, this.place + (seconds * this.behind) / this.interval);
    } else if (this.playing && this.frames.length > 1) {
      const gap = this.frame === this.next ? 1 : this.next.tick - this.frame.tick;
      this.place = Math.min(this.last, this.place + (seconds * this.speed) / gap);
    }
    return this.place !== before;
  }

  // Go some frames forward or back, to a whole frame, and pause.
  step(frames) {
    this.halt();
    const from = frames > 0 ? Math.floor(this.place) : Math.ceil(this.place);
    this.place = Math.max(0, Math.min(this.last, from + frames));
  }

  seekTick(tick) {
    this.halt();
    let place = 0;
    while (place < this.last && this.frames[place].tick < tick) place++;
    this.place = place;
  }

  halt() {
    this.playing = this.following = false;
  }

  toggle() {
    if (this.following) return this.halt();
    this.playing = !this.playing;
    if (this.playing && this.atEnd) this.place = 0;
  }

  faster(by) {
    const at = SPEEDS.indexOf(this.speed) + by;
    this.speed = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, at))];
  }
}
