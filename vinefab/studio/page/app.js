// The page: its state, its connection to the server or the answers stored in a snapshot, its panels.

import * as branchPanel from "studio/branch_panel.js";
import * as comparePanel from "studio/compare.js";
import * as designPanel from "studio/design_panel.js";
import * as exportPanel from "studio/export_panel.js";
import * as familyPanel from "studio/family_panel.js";
import * as filesPanel from "studio/files_panel.js";
import * as growthPanel from "studio/growth_panel.js";
import * as mapPanel from "studio/map_panel.js";
import * as searchPanel from "studio/search_panel.js";
import * as sheetPanel from "studio/sheet_panel.js";
import { branchEdits } from "studio/branch_edits.js";
import { paused } from "studio/dom.js";
import { GONE, createConnection, problemOf } from "studio/connection.js";
import { createStore } from "studio/store.js";

const PANELS = {
  branch: branchPanel, design: designPanel, growth: growthPanel, map: mapPanel, sheet: sheetPanel, files: filesPanel,
  family: familyPanel, compare: comparePanel, search: searchPanel, export: exportPanel,
};
const KEPT_AFTER_MS = 200;
const KEPT = "vinefab-studio";
const TOKEN = "vinefab-token";
const MOST_KEPT_CHARS = 4_000_000; // of the storage of a tab, in most browsers 5 million
const WIDE = matchMedia("(min-width: 1151px)"); // as in studio.css

/** @param {string} id */
function byId(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no #${id}`);
  return found;
}

/** @param {string} text @param {"info" | "error"} kind */
function say(text, kind = "info", isOfConnection = false) {
  // While there is no server, that is the news; what failed for want of it is not.
  if (!isOfConnection && document.documentElement.dataset.connection === "down") return;
  const status = byId("status");
  status.textContent = text;
  status.dataset.kind = kind;
}

/**
 * Return what calls listeners by name.
 * @template {object} H
 */
function createSignals() {
  const listeners = /** @type {{ [N in keyof H]?: ((value: H[N]) => void)[] }} */ ({});
  return {
    /** @template {keyof H} N @param {N} name @param {(value: H[N]) => void} fn */
    on(name, fn) {
      listeners[name] ??= [];
      listeners[name].push(fn);
    },
    /** @template {keyof H} N @param {N} name @param {H[N]} value */
    emit(name, value) {
      for (const fn of listeners[name] ?? []) fn(value);
    },
  };
}

/** @param {Hello} hello @param {Connection | null} connection @param {Stored | null} stored @param {Kept | null} before @returns {App} */
function createApp(hello, connection, stored, before) {
  const answers = stored?.answers ?? {};
  const found = /** @type {typeof createSignals<Found>} */ (createSignals)();
  const heard = /** @type {typeof createSignals<Heard>} */ (createSignals)();
  const store = createStore(hello.state, before?.history);
  const turns = /** @type {{ [N in Panel]?: { asked: number, answered: number } }} */ ({});
  let known = /** @type {Partial<Answers>} */ ({});

  /** @type {App} */
  const app = {
    store,
    answers,
    hello,
    live: !stored,
    file: { ...hello.file, saved_design: structuredClone(hello.state.design), dirty: false },
    previewed: null,
    present: null,
    branch: null,
    reference: null,
    showGhost: true,
    restored: false,
    timings: [],
    remember() {},
    async saveMap() {},
    say,
    fail(thrown, about = "") {
      const problem = problemOf(thrown);
      if (problem) say(`${about}${problem}`, "error");
    },

    async ask(panel, ask = {}, { state } = {}) {
      if (!connection) throw { stale: true };
      const asked = state ?? app.shown();
      const turn = turns[panel] ?? { asked: 0, answered: 0 };
      turns[panel] = turn;
      turn.asked += 1;
      const number = turn.asked;
      const beforehand = /** @type {Answers[typeof panel] | undefined} */ (known[panel]);
      const told = /** @type {Found[typeof panel] | undefined} */ (beforehand && { answer: beforehand, state: asked });
      const reply = await (told ?? connection.ask(panel, ask, asked));
      if (number < turn.answered) throw { stale: true }; // a later question was answered beforehand
      turn.answered = number;
      answers[panel] = reply.answer;
      found.emit(panel, reply);
      return reply.answer;
    },
    knowing(answered, fn) {
      known = answered;
      try {
        fn();
      } finally {
        known = {};
      }
    },
    cancel: (panel) => connection?.cancel(panel),
    onProgress: (panel, fn) => connection?.onProgress(panel, fn),
    async request(name, ask = {}) {
      if (!connection) throw { message: "this is a snapshot, without a server" };
      return connection.request(name, ask, store.get());
    },
    on: heard.on,
    take: (message) => heard.emit(message.event, message),
    onAnswer(panel, fn) {
      found.on(panel, ({ answer, state }) => fn(answer, state));
      const answer = /** @type {Partial<Answers>} */ (answers)[panel];
      if (answer) fn(answer, store.get());
    },

    /** The state that is shown: with the previewed design, if there is one. */
    shown() {
      const state = store.get();
      return app.previewed ? { ...state, design: app.previewed } : state;
    },
    /** Show another design without taking it, with the present one as a ghost; null ends it. */
    preview(design) {
      app.previewed = design;
      heard.emit("preview", design);
    },
    onPreview: (fn) => heard.on("preview", fn),
    highlight: (branches) => heard.emit("highlight", branches),
    onHighlight: (fn) => heard.on("highlight", fn),
    setReference(reference) {
      app.reference = reference;
      heard.emit("reference", null);
    },
    onReference: (fn) => heard.on("reference", fn),
    /** Choose a branch, by its name, or by its id where the design has levels; null: none. */
    chooseBranch(label) {
      app.branch = label;
      heard.emit("branch", label);
    },
    onBranch: (fn) => heard.on("branch", fn),
    get edits() { return edits; },
  };
  const edits = branchEdits(app);
  return app;
}

function mountTabs() {
  for (const list of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[role=tablist]"))) {
    const tabs = /** @type {HTMLElement[]} */ ([...list.querySelectorAll("[role=tab]")]);
    const panelOf = (/** @type {HTMLElement} */ tab) => tab.getAttribute("aria-controls") ?? "";
    const show = (/** @type {HTMLElement} */ chosen) => {
      for (const tab of tabs) {
        const isChosen = tab === chosen;
        tab.setAttribute("aria-selected", String(isChosen));
        tab.tabIndex = isChosen ? 0 : -1;
        byId(panelOf(tab)).hidden = !isChosen;
      }
      dispatchEvent(new CustomEvent("tabshown", { detail: panelOf(chosen) }));
    };
    for (const tab of tabs) tab.addEventListener("click", () => show(tab));
    // On a wide window the sheet is a column: its tab is there on narrow ones alone.
    WIDE.addEventListener("change", () => { if (!byId("side").hidden) tabs[0].click(); });
    list.addEventListener("keydown", ({ key }) => {
      const step = key === "ArrowRight" ? 1 : key === "ArrowLeft" ? -1 : 0;
      if (!step) return;
      const shown = tabs.filter((tab) => tab.checkVisibility());
      const next = shown.at((shown.findIndex((tab) => tab.matches(":focus")) + step) % shown.length);
      if (!next) return;
      next.focus();
      show(next);
    });
  }
}

function mountTheme() {
  const button = byId("theme");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const set = (/** @type {boolean} */ isDark) => {
    document.documentElement.dataset.theme = isDark ? "dark" : "light";
    button.setAttribute("aria-pressed", String(isDark));
  };
  set(dark.matches);
  button.addEventListener("click", () => set(document.documentElement.dataset.theme !== "dark"));
  dark.addEventListener("change", () => set(dark.matches));
}

/** @param {App} app */
function mountHistory(app) {
  const undo = byId("undo");
  const redo = byId("redo");
  /** @param {HTMLElement} button @param {string} label @param {string} word */
  const showStep = (button, label, word) => {
    button.toggleAttribute("disabled", !label || !app.live);
    button.title = label ? `${word}: ${label}` : `Nothing to ${word.toLowerCase()}`;
  };
  const show = () => {
    showStep(undo, app.store.canUndo(), "Undo");
    showStep(redo, app.store.canRedo(), "Redo");
  };
  undo.addEventListener("click", () => app.store.undo());
  redo.addEventListener("click", () => app.store.redo());
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey || !app.live) return;
    const key = event.key.toLowerCase();
    const isText = event.target instanceof Element && event.target.matches("input[type=text], textarea");
    if (isText || (key !== "z" && key !== "y")) return;
    event.preventDefault();
    if (key === "y" || event.shiftKey) app.store.redo();
    else app.store.undo();
  });
  app.store.subscribe(show);
  show();
}

/** Keep the state over a reload of the tab; unsaved work outlives the tab in its autosave. @param {App} app */
function mountKeeping(app) {
  app.remember = () => {
    const content = { started: app.hello.started, state: app.store.get(), file: app.file };
    // Of a long history the newest steps are kept.
    const { past, future } = app.store.history();
    const one = JSON.stringify(content.state).length;
    const room = Math.floor(MOST_KEPT_CHARS / (2 * one)) - 1;
    const history = room < 1 ? { past: [], future: [] } : { past: past.slice(-room), future: future.slice(-room) };
    try {
      sessionStorage.setItem(KEPT, JSON.stringify({ ...content, history }));
    } catch {
      // Storage is full or forbidden: a reload begins with the file.
    }
  };
  app.store.subscribe(paused(() => app.remember(), KEPT_AFTER_MS));
  addEventListener("pagehide", () => app.remember());
}

/**
 * Return what a reload of this tab finds of itself.
 * @param {Hello} hello
 * @returns {Kept | null}
 */
function kept(hello) {
  try {
    const found = JSON.parse(sessionStorage.getItem(KEPT) ?? "null");
    return found && found.started === hello.started ? found : null;
  } catch {
    return null;
  }
}

/** @param {Hello} hello @param {Connection | null} connection @param {Stored | null} stored */
function start(hello, connection, stored) {
  const before = stored ? null : kept(hello);
  const app = createApp(before ? { ...hello, state: before.state } : hello, connection, stored, before);
  if (before) Object.assign(app.file, before.file);
  app.restored = Boolean(before);
  globalThis.studio = app; // for the console and for tests
  mountTabs();
  mountTheme();
  mountHistory(app);
  if (app.live) mountKeeping(app);
  for (const [name, panel] of Object.entries(PANELS)) panel.mount(byId(name), app);
  document.documentElement.dataset.ready = "true";
  say(stored ? snapshotWords(stored) : "Ready");
  return app;
}

/** Say of a snapshot what it is, and how to go on from it. @param {Stored} stored */
function snapshotWords({ date, hello }) {
  const file = decodeURIComponent(location.pathname.replace(/.*\//, ""));
  const opens = file.endsWith(".html") ? file : "FILE.html";
  return `A snapshot${date ? ` of ${date}` : ""} by vinefab ${hello.version}: nothing here is computed anew.`
    + ` To go on from it: vinefab studio ${/^[\w.-]+$/.test(opens) ? opens : `'${opens}'`}`;
}

/** Return the token, and move it from the address into the storage of this host and port. */
function takenToken() {
  const given = new URLSearchParams(location.search).get("token");
  try {
    if (given === null) return localStorage.getItem(TOKEN);
    localStorage.setItem(TOKEN, given);
    history.replaceState(null, "", "/");
  } catch {
    // Storage is forbidden: a reload needs the address as it is.
  }
  return given;
}

/** Leave for the page that says what to do without a token. */
function leave() {
  location.replace("/?token=");
}

function main() {
  const stored = document.getElementById("stored");
  if (stored) {
    const content = JSON.parse(stored.textContent);
    start(content.hello, null, content);
    return;
  }
  let app = /** @type {App | null} */ (null);
  const token = takenToken();
  if (!token) {
    leave();
    return;
  }
  const connection = createConnection(token, {
    onEvent(message) {
      if (message.event !== "hello") app?.take(message);
      else if (app) app.take({ ...message, event: "again" });
      else app = start(message, connection, null);
    },
    onState(isUp, isOver) {
      document.documentElement.dataset.connection = isUp ? "up" : "down";
      if (isUp) return;
      if (isOver && !app) leave();
      say(isOver ? "The studio was started anew: open the address that it printed" : GONE, "error", true);
    },
  });
}

main();
