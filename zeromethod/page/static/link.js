// The connection: asks for the newest, decodes it, and comes back by itself when it breaks.

export const token = new URLSearchParams(location.search).get("token") ?? "";
const RETRY_MS = 1000;

function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const begin = 4 + length;
  for (const part of Object.values(header.parts)) {
    part.bytes = new Uint8Array(buffer, begin + part.start, part.length);
    if (part.maps) readMaps(part, buffer, begin + part.start);
  }
  return header;
}

// Run lengths (count, kind, count, kind, ...) as one kind a node.
function spread(lengths, size) {
  const found = new Uint8Array(size);
  for (let k = 0, at = 0; k < lengths.length; at += lengths[k], k += 2) found.fill(lengths[k + 1], at, at + lengths[k]);
  return found;
}

// Maps of 16 bits as floats, NaN where there is no value.
function readMaps(part, buffer, begin) {
  if (part.kinds) part.kind = spread(part.kinds, part.shape[0] * part.shape[1]);
  const size = part.shape[0] * part.shape[1];
  Object.values(part.maps).forEach((map, index) => {
    const codes = new Uint16Array(buffer, begin + 2 * size * index, size);
    const values = (map.values = new Float32Array(size));
    for (let k = 0; k < size; k++) values[k] = codes[k] === 65535 ? NaN : map.offset + map.step * codes[k];
  });
}

export class Link {
  // wanted: gives the next request. on: hello, content, state ("open" or "closed", why).
  constructor(wanted, on) {
    this.wanted = wanted;
    this.on = on;
    this.calls = new Map();
    this.numbers = 0;
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/live?token=${encodeURIComponent(token)}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => this.on.state("open", "");
    this.socket.onmessage = ({ data }) => this.take(data);
    this.socket.onclose = ({ reason }) => {
      for (const call of this.calls.values()) call.reject(new Error("the connection is lost"));
      this.calls.clear();
      this.on.state("closed", reason);
      setTimeout(() => this.connect(), RETRY_MS);
    };
  }

  take(data) {
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (message.hello) {
        this.on.hello(message);
        this.ask();
      } else {
        const call = this.calls.get(message.id);
        this.calls.delete(message.id);
        if (message.error) call?.reject(new Error(message.error));
        else call?.resolve(message.result);
      }
      return;
    }
    const at = performance.timeOrigin + performance.now();
    const content = decode(data);
    content.arrived = at;
    // the next one is asked for once the picture of this one is on the screen: what cannot be drawn in time is
    // not sent, and the rest of this one is drawn while the next is on its way
    let asked = false;
    const ask = () => {
      if (!asked) this.ask();
      asked = true;
    };
    Promise.resolve(this.on.content(content, ask)).finally(ask);
  }

  ask() {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(this.wanted()));
  }

  call(method, args = {}) {
    if (this.socket.readyState !== WebSocket.OPEN) return Promise.reject(new Error("there is no connection"));
    const id = ++this.numbers;
    return new Promise((resolve, reject) => {
      this.calls.set(id, { resolve, reject });
      this.socket.send(JSON.stringify({ id, call: method, arguments: args }));
    });
  }
}
