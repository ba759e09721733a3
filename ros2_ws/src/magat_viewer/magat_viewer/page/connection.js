// The WebSocket to the server, made again as long as the page is open.

const PATIENCE = [250, 500, 1000, 2000];

export class Connection {
  // `on` has told(message), frames(buffer) and changed(connected).
  constructor(on) {
    this.on = on;
    this.failures = 0;
    this.wishes = {};
    this.open();
  }

  open() {
    this.socket = new WebSocket(`ws://${location.host}/socket`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.failures = 0;
      this.on.changed(true);
      this.socket.send(JSON.stringify(this.wishes));
    };
    this.socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.on.told(JSON.parse(data));
      else this.on.frames(data);
    };
    this.socket.onclose = () => {
      this.on.changed(false);
      const wait = PATIENCE[Math.min(this.failures++, PATIENCE.length - 1)];
      setTimeout(() => this.open(), wait);
    };
  }

  // Say what is to be seen: chosen, episode, tick.
  wish(wishes) {
    const news = Object.entries(wishes).filter(([name, value]) => this.wishes[name] !== value);
    Object.assign(this.wishes, wishes);
    if (news.length && this.socket.readyState === WebSocket.OPEN) {
      this.socket.send(JSON.stringify(Object.fromEntries(news)));
    }
  }
}
