// The page: its state, its link to the server or the answers stored in a snapshot, its panels.

import * as comparePanel from "studio/compare.js";
import * as designPanel from "studio/design_panel.js";
import * as exportPanel from "studio/export_panel.js";
import * as familyPanel from "studio/family_panel.js";
import * as filesPanel from "studio/files_panel.js";
import * as growthPanel from "studio/growth_panel.js";
import * as mapPanel from "studio/map_panel.js";
import * as searchPanel from "studio/search_panel.js";
import * as sheetPanel from "studio/sheet_panel.js";
import { GONE, createLink } from "studio/link.js";
import { createStore } from "studio/store.js";

const PANELS = {
  design: designPanel, growth: growthPanel, map: mapPanel, sheet: sheetPanel, files: filesPanel,
  family: familyPanel, compare: comparePanel, search: searchPanel, export: exportPanel,
};
const KEPT = "vinefab-studio";
const TOKEN = "vinefab-token";
const WIDE = matchMedia("(min-width: 1151px)"); // as in studio.css

const byId = (id) => document.getElementById(id);

function say(text, kind = "info", isOfLink = false) {
  // While there is no server, that is the news; what failed for want of it is not.
  if (!isOfLink && document.documentElement.dataset.link === "down") return;
  const status = byId("status");
  status.textContent = text;
  status.dataset.kind = kind;
}

function createApp(hello, link, stored) {
  const answers = stored?.answers ?? {};
  const answerListeners = new Map();
  const eventListeners = new Map();
  const previewListeners = new Set();
  const highlightListeners = new Set();
  const referenceListeners = new Set();
  const store = createStore(hello.state);

  function keep(panel, answer, state) {
    answers[panel] = answer;
    for (const fn of answerListeners.get(panel) ?? []) fn(answer, state);
  }

  const app = {
    store,
    answers,
    hello,
    live: !stored,
    file: { ...hello.file, saved_design: structuredClone(hello.state.design), dirty: false },
    previewed: null,
    reference: null,
    showGhost: true,
    say,

    async ask(panel, ask = {}, { state } = {}) {
      if (!link) throw { stale: true };
      const asked = state ?? app.shown();
      const found = await link.ask(panel, ask, asked);
      keep(panel, found.answer, found.state);
      return found.answer;
    },
    cancel: (panel) => link?.cancel(panel),
    onProgress: (panel, fn) => link?.onProgress(panel, fn),
    async desk(name, ask = {}) {
      if (!link) throw { message: "this is a snapshot, without a server" };
      return link.desk(name, ask, store.get());
    },
    on(event, fn) {
      if (!eventListeners.has(event)) eventListeners.set(event, new Set());
      eventListeners.get(event).add(fn);
    },
    take(message) {
      for (const fn of eventListeners.get(message.event) ?? []) fn(message);
    },
    onAnswer(panel, fn) {
      if (!answerListeners.has(panel)) answerListeners.set(panel, new Set());
      answerListeners.get(panel).add(fn);
      if (answers[panel]) fn(answers[panel], store.get());
    },

    /** The state that is shown: with the previewed design, if there is one. */
    shown() {
      const state = store.get();
      return app.previewed ? { ...state, design: app.previewed } : state;
    },
    /** Show another design without taking it, with the present one as a ghost; null ends it. */
    preview(design) {
      app.previewed = design;
      for (const fn of previewListeners) fn(design);
    },
    onPreview: (fn) => previewListeners.add(fn),
    highlight(branches) {
      for (const fn of highlightListeners) fn(branches);
    },
    onHighlight: (fn) => highlightListeners.add(fn),
    setReference(reference) {
      app.reference = reference;
      for (const fn of referenceListeners) fn(reference);
    },
    onReference: (fn) => referenceListeners.add(fn),
  };
  return app;
}

function mountTabs() {
  for (const list of document.querySelectorAll("[role=tablist]")) {
    const tabs = [...list.querySelectorAll("[role=tab]")];
    const show = (chosen) => {
      for (const tab of tabs) {
        const isChosen = tab === chosen;
        tab.setAttribute("aria-selected", String(isChosen));
        tab.tabIndex = isChosen ? 0 : -1;
        byId(tab.getAttribute("aria-controls")).hidden = !isChosen;
      }
      dispatchEvent(new CustomEvent("tabshown", { detail: chosen.getAttribute("aria-controls") }));
    };
    for (const tab of tabs) tab.addEventListener("click", () => show(tab));
    // On a wide window the sheet is a column: its tab is there on narrow ones alone.
    WIDE.addEventListener("change", () => { if (byId("side") && !byId("side").hidden) tabs[0].click(); });
    list.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const shown = tabs.filter((tab) => tab.checkVisibility());
      const next = shown.at((shown.indexOf(document.activeElement) + step) % shown.length);
      next.focus();
      show(next);
    });
  }
}

function mountTheme() {
  const button = byId("theme");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const set = (isDark) => {
    document.documentElement.dataset.theme = isDark ? "dark" : "light";
    button.setAttribute("aria-pressed", String(isDark));
  };
  set(dark.matches);
  button.addEventListener("click", () => set(document.documentElement.dataset.theme !== "dark"));
  dark.addEventListener("change", () => set(dark.matches));
}

function mountHistory(app) {
  const undo = byId("undo");
  const redo = byId("redo");
  const show = () => {
    for (const [button, label, word] of [
      [undo, app.store.canUndo(), "Undo"],
      [redo, app.store.canRedo(), "Redo"],
    ]) {
      button.disabled = !label || !app.live;
      button.title = label ? `${word}: ${label}` : `Nothing to ${word.toLowerCase()}`;
    }
  };
  undo.addEventListener("click", () => app.store.undo());
  redo.addEventListener("click", () => app.store.redo());
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey || !app.live) return;
    const key = event.key.toLowerCase();
    const isText = event.target.matches?.("input[type=text], textarea");
    if (isText || (key !== "z" && key !== "y")) return;
    event.preventDefault();
    if (key === "y" || event.shiftKey) app.store.redo();
    else app.store.undo();
  });
  app.store.subscribe(show);
  show();
}

/** Keep the state over a reload of the tab; unsaved work outlives the tab in the recovery file. */
function mountKeeping(app) {
  app.remember = () => {
    const content = { started: app.hello.started, state: app.store.get(), file: app.file };
    try {
      sessionStorage.setItem(KEPT, JSON.stringify(content));
    } catch {
      // Storage is full or forbidden: a reload begins with the file.
    }
  };
  app.store.subscribe(app.remember);
}

function kept(hello) {
  try {
    const found = JSON.parse(sessionStorage.getItem(KEPT) ?? "null");
    return found && found.started === hello.started ? found : null;
  } catch {
    return null;
  }
}

function start(hello, link, stored) {
  const before = stored ? null : kept(hello);
  const app = createApp(before ? { ...hello, state: before.state } : hello, link, stored);
  if (before) Object.assign(app.file, before.file);
  app.restored = Boolean(before);
  globalThis.studio = app; // for the console and for tests
  mountTabs();
  mountTheme();
  mountHistory(app);
  if (app.live) mountKeeping(app);
  for (const [name, panel] of Object.entries(PANELS)) panel.mount(byId(name), app);
  document.documentElement.dataset.ready = "true";
  say(app.live ? "Ready" : snapshotWords(stored));
  return app;
}

/** Say of a snapshot what it is, and how to go on from it. */
function snapshotWords({ date, hello }) {
  const file = decodeURIComponent(location.pathname.split("/").at(-1));
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
  const stored = byId("stored");
  if (stored) {
    const content = JSON.parse(stored.textContent);
    start(content.hello, null, content);
    return;
  }
  let app = null;
  const token = takenToken();
  if (!token) {
    leave();
    return;
  }
  const link = createLink(token, {
    onEvent(message) {
      if (message.event === "hello" && !app) app = start(message, link, null);
      else if (message.event === "hello") app.take({ ...message, event: "again" });
      else app?.take(message);
    },
    onState(isUp, isOver) {
      document.documentElement.dataset.link = isUp ? "up" : "down";
      if (isUp) return;
      if (isOver && !app) leave();
      say(
        isOver ? "The studio was started anew: open the address that it printed"
          : GONE,
        "error",
        true,
      );
    },
  });
}

main();
