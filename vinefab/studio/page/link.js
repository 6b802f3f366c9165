// The socket to the server: per panel one question in flight and one that waits, the newest.

/** What is said while there is no server, whoever asks it. */
export const GONE = "The studio does not answer; what you changed stays here. Trying again";

const RETRY_MS = 1000;

/** Return a link that reconnects by itself. */
export function createLink(token, { onEvent, onState }) {
  const panels = new Map(); // panel -> {flight, waiting}
  const desk = new Map(); // seq -> {resolve, reject}
  const progress = new Map(); // panel -> Set of functions
  let seq = 0;
  let socket = null;

  function connect() {
    socket = new WebSocket(`ws://${location.host}/socket`, ["vinefab", token]);
    socket.onmessage = (event) => take(JSON.parse(event.data));
    socket.onclose = () => {
      for (const slot of panels.values()) {
        slot.flight?.reject({ stale: true });
        slot.waiting?.reject({ stale: true });
      }
      panels.clear();
      for (const question of desk.values()) question.reject({ message: GONE });
      desk.clear();
      onState(false, false);
      setTimeout(retry, RETRY_MS);
    };
  }

  /** Connect once there is a server, unless it refuses the token: a socket does not say why. */
  async function retry() {
    try {
      const { status } = await fetch(`/?token=${token}`, { method: "HEAD" });
      if (status === 403) onState(false, true);
      else connect();
    } catch {
      setTimeout(retry, RETRY_MS);
    }
  }

  function take(message) {
    if (message.event) {
      if (message.event === "hello") onState(true, false);
      onEvent(message);
    } else if ("desk" in message) settle(message, desk.get(message.seq), () => desk.delete(message.seq));
    else takeAnswer(message);
  }

  function settle(message, question, forget) {
    if (!question) return;
    forget();
    if (message.error) question.reject(message.error);
    else question.resolve(message.answer);
  }

  function takeAnswer(message) {
    const slot = panels.get(message.panel);
    const flight = slot?.flight;
    if (!flight || flight.seq !== message.seq) return; // late: its question was dropped
    if (message.progress) {
      for (const fn of progress.get(message.panel) ?? []) fn(...message.progress);
      return;
    }
    slot.flight = null;
    if (message.error) flight.reject(message.error);
    else flight.resolve({ answer: message.answer, state: flight.state });
    next(message.panel, slot);
  }

  function next(panel, slot) {
    if (slot.flight || !slot.waiting) return;
    slot.flight = slot.waiting;
    slot.waiting = null;
    const { state, ask } = slot.flight;
    slot.flight.seq = ++seq;
    socket.send(JSON.stringify({ panel, seq, state, ask }));
  }

  connect();
  return {
    /** Ask for a panel; the promise gives {answer, state}, or rejects with {stale} or {message}. */
    ask(panel, ask, state) {
      return new Promise((resolve, reject) => {
        if (socket.readyState !== WebSocket.OPEN) return reject({ stale: true });
        const slot = panels.get(panel) ?? { flight: null, waiting: null };
        panels.set(panel, slot);
        slot.waiting?.reject({ stale: true });
        slot.waiting = { ask, state, resolve, reject };
        next(panel, slot);
      });
    },

    /** Drop what a panel has asked, and stop it on the server. */
    cancel(panel) {
      const slot = panels.get(panel);
      if (!slot) return;
      slot.waiting?.reject({ stale: true });
      slot.waiting = null;
      if (slot.flight) socket.send(JSON.stringify({ cancel: panel }));
    },

    desk(name, ask, state) {
      return new Promise((resolve, reject) => {
        if (socket.readyState !== WebSocket.OPEN) return reject({ message: GONE });
        desk.set(++seq, { resolve, reject });
        socket.send(JSON.stringify({ desk: name, seq, ask, state }));
      });
    },

    onProgress(panel, fn) {
      if (!progress.has(panel)) progress.set(panel, new Set());
      progress.get(panel).add(fn);
      return () => progress.get(panel).delete(fn);
    },
  };
}
