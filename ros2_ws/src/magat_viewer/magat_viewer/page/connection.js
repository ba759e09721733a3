// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

// The WebSocket to the server, reconnected as long as the page is open.

const DELAYS = [250, 500, 1000, 2000];

export class Connection {
  // `on` has message(object), frames(buffer) and changed(connected).
  constructor(on) {
    this.on = on;
    this.failures = 0;
    this.requests = {};
    this.open();
  }

  open() {
    this.socket = new WebSocket(`ws://${location.host}/socket`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.failures = 0;
      this.on.changed(true);
      this.socket.send(JSON.stringify(this.requests));
    };
    this.socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.on.message(JSON.parse(data));
      else this.on.frames(data);
    };
    this.socket.onclose = () => {
      this.on.changed(false);
      const delay = DELAYS[Math.min(this.failures++, DELAYS.length - 1)];
      setTimeout(() => this.open(), delay);
    };
  }

  // Tell the server what the page shows: chosen, episode, tick.
  request(values) {
    const news = Object.entries(values).filter(([name, value]) => this.requests[name] !== value);
    Object.assign(this.requests, values);
    if (news.length && this.socket.readyState === WebSocket.OPEN) {
      this.socket.send(JSON.stringify(Object.fromEntries(news)));
    }
  }
}
