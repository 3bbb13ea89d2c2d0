// JSON-RPC with a language server over its standard input and output.
"use strict";
const {spawn} = require("child_process");

class Connection {
  // `onNotification(method, params)` gets the server's notifications, `onEnd(why)` the server's end.
  constructor(command, folder, onNotification, onEnd) {
    this.onNotification = onNotification;
    this.pending = new Map();
    this.last = 0;
    this.received = Buffer.alloc(0);
    this.server = spawn(command[0], command.slice(1), {cwd: folder});
    this.errors = "";
    this.server.stderr.on("data", data => { this.errors = (this.errors + data).slice(-2000); });
    this.server.stdin.on("error", () => {});
    this.server.stdout.on("data", data => this.receive(data));
    const end = why => {
      if (this.ended) return;
      this.ended = true;
      for (const {reject} of this.pending.values()) reject(new Error(why));
      onEnd(why);
    };
    this.server.on("error", error => end(error.message));
    this.server.on("close", code => end(this.errors.trim() || `exit code ${code}`));
  }

  request(method, params) {
    if (this.ended) return Promise.resolve(null);
    const id = ++this.last;
    const answer = new Promise((resolve, reject) => this.pending.set(id, {resolve, reject}));
    this.send({id, method, params});
    return answer;
  }

  notify(method, params) {
    if (!this.ended) this.send({method, params});
  }

  send(message) {
    const body = Buffer.from(JSON.stringify({jsonrpc: "2.0", ...message}));
    this.server.stdin.write(`Content-Length: ${body.length}\r\n\r\n`);
    this.server.stdin.write(body);
  }

  receive(data) {
    this.received = Buffer.concat([this.received, data]);
    for (;;) {
      const head = this.received.indexOf("\r\n\r\n");
      if (head < 0) return;
      const length = /content-length: *(\d+)/i.exec(this.received.toString("ascii", 0, head));
      const end = head + 4 + Number(length[1]);
      if (this.received.length < end) return;
      const message = JSON.parse(this.received.toString("utf8", head + 4, end));
      this.received = this.received.subarray(end);
      this.dispatch(message);
    }
  }

  dispatch({id, method, params, result, error}) {
    if (method && id !== undefined) {  // the server's own requests need no answer of substance
      this.send({id, result: null});
    } else if (method) {
      this.onNotification(method, params);
    } else if (this.pending.has(id)) {
      const {resolve, reject} = this.pending.get(id);
      this.pending.delete(id);
      if (error) reject(new Error(error.message)); else resolve(result);
    }
  }

  async stop() {
    await this.request("shutdown").catch(() => null);
    this.notify("exit");
  }
}

module.exports = {Connection};
