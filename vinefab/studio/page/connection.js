// The socket to the server: per panel one question in flight and one that waits, the newest.

/** The message while there is no server. */
export const GONE = "The studio does not answer; what you changed stays here. Trying again";

/** Tell whether a question failed because a newer one took its place. @param {unknown} thrown */
export const isStale = (thrown) => Boolean(/** @type {Failure} */ (Object(thrown)).stale);

/** Tell whether a question failed because it was stopped. @param {unknown} thrown */
export const isStopped = (thrown) => Boolean(/** @type {Failure} */ (Object(thrown)).stopped);

/**
 * Return what the user should read of a question that failed: nothing where it only came too late.
 * @param {unknown} thrown
 */
export function problemOf(thrown) {
  const { stale, stopped, message } = /** @type {Failure} */ (Object(thrown));
  return stale || stopped ? "" : message ?? String(thrown);
}

const RETRY_MS = 1000;

/**
 * Return a connection that reconnects by itself.
 * @param {string} token
 * @param {{ onEvent(message: Events[keyof Events]): void, onState(isUp: boolean, isOver: boolean): void }} listeners
 */
export function createConnection(token, { onEvent, onState }) {
  const panels = /** @type {Map<Panel, Slot>} */ (new Map());
  const requests = /** @type {Map<number, Pick<Asked, "resolve" | "reject">>} */ (new Map()); // by seq
  const progress = /** @type {Map<Panel, Progress>} */ (new Map());
  let seq = 0;
  let socket = connect();

  function connect() {
    const opened = new WebSocket(`ws://${location.host}/socket`, ["vinefab", token]);
    opened.onmessage = (event) => take(JSON.parse(event.data));
    opened.onclose = () => {
      for (const slot of panels.values()) {
        slot.flight?.reject({ stale: true });
        slot.waiting?.reject({ stale: true });
      }
      panels.clear();
      for (const question of requests.values()) question.reject({ message: GONE });
      requests.clear();
      onState(false, false);
      setTimeout(retry, RETRY_MS);
    };
    return opened;
  }

  /** Connect once there is a server, unless it refuses the token: a socket does not say why. */
  async function retry() {
    try {
      const { status } = await fetch(`/?token=${token}`, { method: "HEAD" });
      if (status === 403) onState(false, true);
      else socket = connect();
    } catch {
      setTimeout(retry, RETRY_MS);
    }
  }

  /** @param {Message} message */
  function take(message) {
    if (message.event) {
      if (message.event === "hello") onState(true, false);
      onEvent(message);
    } else if ("request" in message) takeReply(message);
    else takeAnswer(message);
  }

  /** @param {RequestReply} message */
  function takeReply(message) {
    const question = requests.get(message.seq);
    requests.delete(message.seq);
    if (message.error) question?.reject(message.error);
    else question?.resolve(message.answer);
  }

  /** @param {PanelReply} message */
  function takeAnswer(message) {
    const slot = panels.get(message.panel);
    const flight = slot?.flight;
    if (!flight || flight.seq !== message.seq) return; // late: its question was dropped
    if (message.progress) {
      progress.get(message.panel)?.(...message.progress);
      return;
    }
    slot.flight = null;
    if (message.error) flight.reject(message.error);
    else flight.resolve({ answer: message.answer, state: flight.state });
    next(message.panel, slot);
  }

  /** @param {Panel} panel @param {Slot} slot */
  function next(panel, slot) {
    if (slot.flight || !slot.waiting) return;
    slot.flight = slot.waiting;
    slot.waiting = null;
    const { state, ask } = slot.flight;
    seq += 1;
    slot.flight.seq = seq;
    socket.send(JSON.stringify({ panel, seq, state, ask }));
  }

  return {
    /**
     * Ask for a panel; the promise gives {answer, state}, or rejects with a Failure.
     * @template {Panel} P
     * @param {P} panel
     * @param {object} ask
     * @param {StudioState} state
     * @returns {Promise<Found[P]>}
     */
    ask(panel, ask, state) {
      return new Promise((resolve, reject) => {
        if (socket.readyState !== WebSocket.OPEN) return reject({ stale: true });
        const slot = panels.get(panel) ?? { flight: null, waiting: null };
        panels.set(panel, slot);
        slot.waiting?.reject({ stale: true });
        slot.waiting = { seq: 0, ask, state, resolve: /** @type {(found: unknown) => void} */ (resolve), reject };
        next(panel, slot);
      });
    },

    /** Drop what a panel has asked, and stop it on the server. @param {Panel} panel */
    cancel(panel) {
      const slot = panels.get(panel);
      if (!slot) return;
      slot.waiting?.reject({ stale: true });
      slot.waiting = null;
      if (slot.flight) socket.send(JSON.stringify({ cancel: panel }));
    },

    /**
     * @template {RequestName} Q
     * @param {Q} name
     * @param {object} ask
     * @param {StudioState} state
     * @returns {Promise<RequestAnswers[Q]>}
     */
    request(name, ask, state) {
      return new Promise((resolve, reject) => {
        if (socket.readyState !== WebSocket.OPEN) return reject({ message: GONE });
        seq += 1;
        requests.set(seq, { resolve: /** @type {(found: unknown) => void} */ (resolve), reject });
        socket.send(JSON.stringify({ request: name, seq, ask, state }));
      });
    },

    /** Call a function with every progress of a panel. @param {Panel} panel @param {Progress} fn */
    onProgress(panel, fn) {
      progress.set(panel, fn);
    },
  };
}
