// Files: what is open, opening, saving, changes from outside, and unsaved work that is kept.

import { button, el, number, paused } from "studio/dom.js";
import { problemOf } from "studio/connection.js";

const KEY = "vinefab-studio-tab";
const FILES = "vinefab-studio-files";
const KEEP_AFTER_MS = 1200;
const OTHERS_ANSWER_MS = 600;
const MOST_DIFFERENCES = 8;

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const name = el("span", { class: "file-name" });
  const mark = el("span", { class: "file-mark" });
  root.append(el("span", { class: "file" }, name, mark));
  if (!app.live) {
    name.textContent = app.file.name ?? app.file.path;
    return;
  }
  mountLive(root, app, name, mark);
}

/** @param {HTMLElement} root @param {App} app @param {HTMLElement} name @param {HTMLElement} mark */
function mountLive(root, app, name, mark) {
  const store = app.store;
  const notes = createNotes(root);
  const known = app.restored ? readKnown() : {}; // files of this tab by path, so that undo finds the one it goes back to
  let saving = /** @type {Promise<unknown>} */ (Promise.resolve());
  let key = tabKey();
  const { restored } = app;

  const open = button("Open", () => openDialog.show(), { title: "Open a design, map or recipe (Ctrl-O)" });
  const save = button("Save", () => saveDesign(), { title: "Save the design (Ctrl-S)" });
  const saveAs = button("Save as", () => saveAsDialog.show(), { title: "Save the design in another file (Ctrl-Shift-S)" });
  root.append(el("span", { class: "group", role: "group", "aria-label": "File" }, open, save, saveAs));

  const openDialog = createOpenDialog(root, app, choose);
  const saveAsDialog = createSaveAsDialog(root, app, {
    id: "save", title: "Save as", ending: ".toml", renames: "Name the design after the file", write: writeAs,
    proposed: () => (app.file.writable ? app.file.path.replace(/\.toml$/, "_2.toml") : `${app.file.name ?? nameOf(app.file.path)}.toml`),
  });
  const saveMapDialog = createSaveAsDialog(root, app, {
    id: "save-map", title: "Save the map", ending: ".geojson", renames: "", write: (path, _, stamp) => writeMap(path, stamp),
    proposed() {
      const { file, environment, seed } = store.get().map?.source ?? {};
      return file ?? `${environment}_${seed}.geojson`;
    },
  });

  // What is open --------------------------------------------------------------------------------

  const isUnsaved = () => app.file.dirty || isEdited(store.get());

  function show() {
    app.file.dirty = plainText(store.get().design) !== plainText(app.file.saved_design);
    const shown = app.file.name ?? app.file.path;
    name.textContent = shown;
    name.title = app.file.writable ? app.file.path : `${app.file.path}: read only; Save as writes a copy`;
    mark.textContent = app.file.dirty ? "● unsaved" : app.file.writable ? "saved" : "read only";
    mark.dataset.dirty = String(app.file.dirty);
    save.disabled = app.file.writable && !app.file.dirty;
    document.title = `${isUnsaved() ? "● " : ""}${shown} – vinefab studio`;
  }

  /** Let another file be the open one; the state says which, so that undo and redo follow. @param {Omit<OpenFile, "dirty">} file */
  function setFile(file) {
    app.file = { ...file, dirty: false };
    known[file.path] = app.file;
    writeKnown(known);
    app.remember();
    show();
  }

  // Opening -------------------------------------------------------------------------------------

  /** @param {Kind} kind @param {Openable} entry */
  async function choose(kind, { name: title, path }) {
    if (kind === "design") return openDesign(path);
    if (kind === "environment") {
      const now = store.get().map?.source;
      const seed = now?.environment === title ? now.seed : 3;
      return takeMap({ environment: title, seed, options: {} }, title);
    }
    if (kind === "map") {
      const found = await app.request("open_map", { path });
      return takeMap(found.source, title);
    }
    const found = await app.request("open_recipe", { recipe: path });
    store.change(`open ${found.recipe}`, (state) => { state.recipe = found.recipe; });
    app.say(`Opened recipe ${found.recipe}`);
    return true;
  }

  /** @param {MapSource} source @param {string} title */
  async function takeMap(source, title) {
    if (isEdited(store.get())) {
      const answer = await askUser(root, {
        title: "The map has unsaved changes",
        text: "Opening another map leaves them to Undo.",
        choices: [["save", "Save the map first"], ["open", "Open; Undo brings them back"]],
      });
      if (answer === "save") await app.saveMap();
      if (answer !== "open" && (!answer || isEdited(store.get()))) return false;
    }
    store.change(`open map ${title}`, (state) => {
      state.map = { source, edits: [] };
      state.pose = null;
    });
    app.say(`Opened map ${title}`);
    return true;
  }

  /** @param {string} [path] */
  async function openDesign(path) {
    if (app.file.dirty) {
      const answer = await askUser(root, {
        title: `${app.file.name ?? app.file.path} has unsaved changes`,
        text: "Opening another design leaves them to Undo.",
        choices: [["save", "Save, then open"], ["open", "Open; Undo brings them back"]],
      });
      if (!answer || (answer === "save" && !(await saveDesign()))) return false;
    }
    const file = await app.request("open_design", { design: path });
    rememberOld();
    store.change(`open ${file.name}`, (state) => {
      state.design = file.design;
      state.opened = file.path;
      if (file.recipe) state.recipe = file.recipe;
      if (file.task) state.task = file.task;
    });
    setFile(fileOf(file, file.design));
    const note = file.run_note ? `; ${file.run_note}` : "";
    app.say(`Opened ${file.path}; Undo goes back to the design before${note}`);
    return true;
  }

  function rememberOld() {
    known[app.file.path] = app.file;
  }

  // Saving --------------------------------------------------------------------------------------

  /** Save the design; false if nothing was written. @returns {Promise<boolean>} */
  async function saveDesign(stamp = app.file.stamp) {
    if (!app.file.writable) {
      saveAsDialog.show();
      return false;
    }
    const design = structuredClone(store.get().design);
    const path = app.file.path;
    try {
      const answer = await write({ path, design, stamp });
      if (!answer.saved) return resolve(answer, design);
      saved(answer, design);
      return true;
    } catch (error) {
      app.fail(error);
      return false;
    }
  }

  /** Ask the server to write; changes on disk that it reports meanwhile wait, they may be our own. @param {object} ask */
  function write(ask) {
    const answer = app.request("save_design", { ...ask, autosave: key });
    saving = answer.catch(() => null);
    return answer;
  }

  /** @param {Saved} answer @param {Design} design */
  function saved(answer, design) {
    notes.clear("disk");
    setFile(fileOf({ ...answer, name: nameOf(answer.path) }, design));
    app.say(answer.note ? `Saved ${answer.path}; ${answer.note}` : `Saved ${answer.path}`);
    keepSoon(); // a copy that was on its way when the server dropped it goes too
  }

  /** Return null when the copy is written, or what stands in the way. @param {string} path @param {boolean} renames @param {string} [stamp] */
  async function writeAs(path, renames, stamp) {
    const design = structuredClone(store.get().design);
    const stem = nameOf(path);
    if (renames && /^[\p{L}\p{N}_-][\p{L}\p{N}_.-]{0,99}$/u.test(stem)) design.name = stem;
    const answer = await write({ path, design, stamp, from: app.file.stamp ? app.file.path : null });
    if (!answer.saved) return answer;
    rememberOld();
    store.change(`save as ${answer.path}`, (state) => {
      state.design = design;
      state.opened = answer.path;
    });
    saved(answer, design);
    return null;
  }

  // The map -------------------------------------------------------------------------------------

  // Another version of the map's file, which was read below changes of this page: nobody has answered it yet.
  let unanswered = /** @type {Conflict | null} */ (null);

  /** Write the map into its file; without one, or where it is another than expected, ask for a name. */
  app.saveMap = async () => {
    const { file, stamp } = store.get().map?.source ?? {};
    try {
      const asked = unanswered?.path === file ? unanswered : null;
      const refused = asked ?? (file ? await writeMap(file, stamp) : null);
      if (!file || refused) await saveMapDialog.show(refused);
    } catch (error) {
      app.fail(error);
    }
  };

  /** Return null when the map is written, or what stands in the way. @param {string} path @param {string} [stamp] */
  async function writeMap(path, stamp) {
    const { map, pose } = store.get();
    const answer = app.request("save_map", { path, map, pose, stamp });
    saving = answer.catch(() => null);
    const found = await answer;
    if (!found.saved) return found;
    const written = plainText([map, pose]);
    const take = (/** @type {StudioState} */ state) => {
      state.map = { source: found.source, edits: [] };
      state.pose = null;
    };
    if (map?.source.file === found.path) {
      // What was changed by numbers of obstacles is in the file now: no step may do it twice.
      store.rewrite((state) => { if (state.map?.source.file === found.path) take(state); });
    } else store.change(`save the map as ${found.path}`, (state) => { if (plainText([state.map, state.pose]) === written) take(state); });
    notes.clear("map");
    unanswered = null;
    app.say(`Saved ${found.path}`);
    keepSoon();
    return null;
  }

  /** Ask whose version stays; false if mine is not written. @param {Conflict} answer @param {Design} mine */
  async function resolve(answer, mine) {
    const theirs = answer.design;
    const differences = theirs ? differencesOf(theirs, mine) : [answer.problem ?? ""];
    const choice = await askUser(root, {
      title: `${answer.path} was changed outside`,
      text: theirs
        ? "Nothing was written. On disk and here differ in (on disk, here):"
        : "Nothing was written. The file on disk cannot be read:",
      lines: differences,
      choices: [
        ...(theirs ? [["theirs", "Take theirs"]] : []),
        ["mine", "Keep mine"],
        ["as", "Save mine as another file"],
      ],
    });
    if (choice === "theirs" && theirs) takeTheirs(answer, theirs);
    else if (choice === "mine") return saveDesign(answer.stamp);
    else if (choice === "as") saveAsDialog.show();
    return false;
  }

  /** @param {{ path: string, stamp: string }} version @param {Design} design */
  function takeTheirs({ path, stamp }, design) {
    notes.clear("disk");
    store.change(`${path} from disk`, (state) => { state.design = design; });
    setFile({ ...app.file, stamp, saved_design: design });
    app.say(`${path} changed on disk and was taken; Undo goes back`);
  }

  // Changes from outside ------------------------------------------------------------------------

  /** @param {FileChange} event */
  async function onFileChanged(event) {
    await saving;
    const { kind, path, stamp, design, problem } = event;
    if (kind !== "design") return onSourceChanged(event);
    if (path !== app.file.path) return;
    if (stamp === app.file.stamp) notes.clear("disk");
    else if (!design) {
      app.say(problem ?? "", "error");
      notes.show("disk", `Changed on disk, but not readable: ${problem}. It is looked at again when it changes.`, []);
    } else if (!app.file.dirty) {
      takeTheirs(event, design);
    } else {
      notes.show("disk", `${path} changed on disk, and you have unsaved changes here.`, [
        ["Take it", () => takeTheirs(event, design)],
        ["Keep mine", () => setFile({ ...app.file, stamp, saved_design: design })],
      ]);
    }
  }

  /** @param {FileChange} event */
  function onSourceChanged(event) {
    if (event.problem) {
      app.say(event.problem, "error");
      return;
    }
    const state = store.get();
    const isMap = state.map?.source?.file === event.path;
    if (isMap && state.map?.source.stamp === event.stamp) return; // written here
    store.change(`${event.path} from disk`, (copy) => {
      if (isMap && copy.map) copy.map.source.stamp = event.stamp;
      if (copy.family.files?.includes(event.path)) copy.family.stamp = event.stamp;
      if (copy.recipe === event.path) copy.recipe_stamp = event.stamp;
    });
    app.say(`${event.path} changed on disk and was read anew`);
    const count = state.map?.edits.length ?? 0;
    if (!isMap || !count) return;
    unanswered = { saved: false, why: "changed", path: event.path, stamp: event.stamp, design: null, problem: null };
    notes.show("map", `${event.path} changed on disk; your ${count} changes of obstacles go by their numbers and may now move others.`, [
      ["Drop my changes", () => { unanswered = null; store.change("drop changes of the map", (copy) => { if (copy.map) copy.map.edits = []; }); }],
      ["Leave them", () => { unanswered = null; }],
    ]);
  }

  /** Look whether the file is still as it was, after a reload or a new server. */
  async function lookAgain() {
    if (!app.file.stamp) return; // it has none
    try {
      const file = await app.request("open_design", { design: app.file.path });
      await onFileChanged({ kind: "design", path: app.file.path, stamp: file.stamp, design: file.design, problem: null });
    } catch (error) {
      app.fail(error);
    }
  }

  // Unsaved work --------------------------------------------------------------------------------

  let isKept = false;
  let reported = "";
  let other = ""; // the key of a tab that holds unsaved work
  const tabs = openTabs(() => key, (settled) => { if (settled === other) notes.clear("other"); });

  /** Keep unsaved work; with a key, in place of what was kept under it, in one step of the server. @param {string} [instead] */
  async function keep(instead) {
    const state = store.get();
    try {
      if (isUnsaved()) {
        isKept = true;
        const { path, name, stamp } = app.file;
        const file = stamp ? { path, name, stamp } : null;
        await app.request("keep_autosave", { key, state, file, instead });
      } else if (isKept) {
        isKept = false;
        await app.request("drop_autosave", { key });
        tabs.settled(key);
      }
    } catch (error) {
      // Once is enough: it would be reported again at every change.
      const problem = problemOf(error);
      if (problem !== reported && state === store.get()) app.fail(error);
      reported = problem;
    }
  }
  const keepSoon = paused(() => keep(), KEEP_AFTER_MS);

  async function findUnsaved() {
    const others = await tabs.others();
    if (others.has(key)) {
      // A tab that was duplicated has its own.
      key = newKey();
      sessionStorage.setItem(KEY, key);
    }
    isKept = restored;
    const found = (await app.request("autosaves")).autosaves;
    const [held] = found.filter((entry) => others.has(entry.key));
    if (held) {
      other = held.key;
      notes.show("other", `Another tab holds unsaved work: ${aboutKept(held)}. It can be saved there.`, []);
    }
    offer(found
      .filter((entry) => !others.has(entry.key) && !(restored && entry.key === key))
      .filter((entry) => workOf(entry) !== workOf(store.get()))); // what is open is not lost
  }

  /** Return what would be lost of a state: its design, and what was changed of its map. @param {{ design: unknown, map: OpenMap | null }} state */
  const workOf = ({ design, map }) => plainText([design, map?.edits ?? [], map?.targets ?? null]);

  /** @param {Autosave} entry */
  function aboutKept({ name: title, file, left, kept_at }) {
    const where = file?.path ?? left[0];
    return `${title ?? "a design"}${where ? ` (${where})` : ""}, kept ${when(kept_at)}`;
  }

  /** @param {Autosave[]} found */
  function offer(found) {
    const [entry, ...rest] = found;
    if (!entry) {
      notes.clear("unsaved");
      return;
    }
    const more = rest.length ? ` ${rest.length} more after this.` : "";
    const copy = entry.left.length ? ` Here it opens as a copy without ${entry.left.join(", ")}.` : "";
    notes.show("unsaved", `Unsaved work found: ${aboutKept(entry)}.${copy}${more}`, [
      [entry.left.length ? "Open a copy" : "Open it", () => takeUnsaved(entry).then(() => notes.clear("unsaved"))],
      ["Discard it", () => app.request("drop_autosave", { key: entry.key }).then(() => offer(rest))],
      ["Not now", () => {}],
    ]);
  }

  /** @param {Autosave} entry */
  async function takeUnsaved(entry) {
    try {
      const kept = await app.request("open_autosave", { key: entry.key });
      let file = /** @type {RequestAnswers["open_design"] | null} */ (null);
      try {
        if (kept.file?.path) file = await app.request("open_design", { design: kept.file.path });
      } catch {
        // The file went: what was made of it is still here.
      }
      rememberOld();
      const title = entry.name ?? "a design";
      const path = file?.path ?? `${title}: a copy`;
      store.replace("unsaved work", { ...kept.state, opened: path });
      // Its file may have been changed since: saving it then asks.
      if (file) setFile(fileOf({ ...file, stamp: kept.file?.stamp ?? file.stamp }, file.design));
      else setFile({ path, name: title, writable: false, stamp: "", saved_design: null });
      // What belongs to another folder stays there until it is taken up there.
      await keep(entry.left.length ? undefined : entry.key);
      if (!isUnsaved() && !entry.left.length) await app.request("drop_autosave", { key: entry.key });
      app.say(`Unsaved work of ${entry.name ?? "a design"} is open; Undo goes back`);
    } catch (error) {
      app.fail(error);
    }
  }

  // Begin ---------------------------------------------------------------------------------------

  if (restored && app.file.path in known) app.file = { ...known[app.file.path] };
  app.file.name ??= nameOf(app.file.path);
  const first = app.file.path;
  known[first] = app.file;
  store.subscribe((state) => {
    const path = state.opened ?? first;
    if (path !== app.file.path && known[path]) setFile(known[path]); // undo goes back to its file
    show();
    keepSoon();
  });
  app.on("file_changed", onFileChanged);
  app.on("again", lookAgain);
  addEventListener("beforeunload", (event) => {
    if (!isUnsaved()) return;
    keep();
    event.preventDefault();
  });
  addEventListener("visibilitychange", () => {
    if (document.visibilityState === "hidden") keep();
  });
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    const pressed = event.key.toLowerCase();
    if (pressed !== "s" && pressed !== "o") return;
    event.preventDefault();
    if (document.querySelector("dialog[open]")) return;
    if (pressed === "o") openDialog.show();
    else if (event.shiftKey) saveAsDialog.show();
    else if (save.disabled) app.say(`${app.file.path} is saved already`);
    else {
      if (document.activeElement instanceof HTMLElement) document.activeElement.blur(); // a number that is being typed counts
      saveDesign();
    }
  });
  show();
  if (app.hello.problem) notes.show("disk", `${app.hello.problem}. Shown is what was read before.`, []);
  else if (app.file.run_note) app.say(app.file.run_note);
  if (restored) lookAgain();
  findUnsaved().catch((error) => app.fail(error));
}

/** @param {{ path: string, name: string, writable: boolean, stamp: string }} file @param {Design} design */
function fileOf({ path, name, writable, stamp }, design) {
  return { path, name, writable, stamp, saved_design: structuredClone(design) };
}

/** Return the bars below the header, one of each kind. @param {HTMLElement} root */
function createNotes(root) {
  const place = el("div", { class: "file-notes" });
  root.closest("header")?.append(place);
  const bars = /** @type {Map<Note, Element>} */ (new Map());
  const clear = (/** @type {Note} */ kind) => {
    bars.get(kind)?.remove();
    bars.delete(kind);
  };
  return {
    clear,
    /** @param {Note} kind @param {string} text @param {NoteActions} actions */
    show(kind, text, actions) {
      clear(kind);
      const bar = el(
        "div", { class: "file-note", role: "alert", "data-note": kind }, el("span", {}, text),
        actions.map(([label, fn]) => button(label, () => { clear(kind); fn(); })),
        actions.length ? null : button("Close", () => clear(kind)),
      );
      bars.set(kind, bar);
      place.append(bar);
    },
  };
}

/**
 * Ask in a dialog; the promise gives the name of the choice, or nothing.
 * @param {HTMLElement} root
 * @param {{ title: string, text: string, lines?: string[], choices: string[][] }} question
 * @returns {Promise<string>}
 */
function askUser(root, { title, text, lines = [], choices }) {
  return new Promise((resolve) => {
    const dialog = el(
      "dialog", { class: "files-dialog ask", "aria-label": title },
      el("h2", {}, title), el("p", {}, text),
      lines.length ? el("ul", {}, lines.map((line) => el("li", {}, line))) : null,
      el(
        "div", { class: "buttons" },
        choices.map(([value, label], place) => button(label, () => { dialog.close(value); }, { class: place ? null : "primary" })),
        button("Cancel", () => { dialog.close(""); }),
      ),
    );
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(dialog.returnValue);
    });
    root.append(dialog);
    dialog.showModal();
  });
}

/**
 * Return the dialog that offers what can be opened.
 * @param {HTMLElement} root
 * @param {App} app
 * @param {(kind: Kind, entry: Openable) => Promise<boolean>} choose returns whether it was opened
 */
function createOpenDialog(root, app, choose) {
  const search = el("input", { type: "search", id: "open-search", autocomplete: "off", placeholder: "part of a name" });
  const list = el("div", { class: "choices" });
  const problem = el("p", { class: "problem", role: "alert" });
  const where = el("p", { class: "standing" });
  const dialog = el(
    "dialog", { class: "files-dialog open", "aria-labelledby": "open-title" },
    el("h2", { id: "open-title" }, "Open"),
    el("div", { class: "field" }, el("label", { for: "open-search" }, "Find"), search),
    list, problem, where,
    el("div", { class: "buttons" }, button("Close", () => { dialog.close(); })),
  );
  root.append(dialog);
  let groups = /** @type {[title: string, kind: Kind, entries: Openable[]][]} */ ([]);

  function fill() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    list.replaceChildren(...groups.map(([title, kind, entries]) => {
      const shown = entries.filter((entry) => {
        const text = `${entry.name} ${entry.path ?? ""} ${entry.where ?? ""} ${title}`.toLowerCase();
        return words.every((word) => text.includes(word));
      });
      if (!shown.length) return "";
      return el(
        "section", { "aria-label": title }, el("h3", {}, title),
        shown.map((entry) => button([
          el("span", {}, entry.name),
          el("span", { class: "standing" }, entry.about ?? (entry.where === "folder" ? entry.path : entry.where)),
        ], () => take(kind, entry), { class: "choice", "data-kind": kind })),
      );
    }));
    if (!list.querySelector("button")) list.replaceChildren(el("p", {}, "Nothing is called so."));
  }

  /** @param {Kind} kind @param {Openable} entry */
  async function take(kind, entry) {
    problem.textContent = "";
    try {
      if (await choose(kind, entry)) dialog.close();
    } catch (error) {
      problem.textContent = problemOf(error);
    }
  }

  search.addEventListener("input", fill);
  dialog.addEventListener("keydown", (event) => {
    const buttons = [...list.querySelectorAll("button")];
    const at = buttons.findIndex((one) => one.matches(":focus"));
    if (event.key === "Enter" && document.activeElement === search && buttons.length) {
      event.preventDefault();
      buttons[0].click();
    } else if (event.key === "ArrowDown" && at < buttons.length - 1) {
      event.preventDefault();
      buttons[at + 1].focus();
    } else if (event.key === "ArrowUp" && at >= 0) {
      event.preventDefault();
      (buttons[at - 1] ?? search).focus();
    }
  });

  return {
    async show() {
      search.value = "";
      problem.textContent = "";
      list.replaceChildren(el("p", {}, "Looking"));
      dialog.showModal();
      search.focus();
      try {
        const found = await app.request("choices");
        groups = [
          ["Designs", "design", found.designs],
          ["Maps: files", "map", found.maps],
          ["Maps: environments", "environment", found.environments],
          ["Recipes", "recipe", found.recipes],
        ];
        where.textContent = `Folders: ${found.folders.join(", ")}${found.complete ? "" : " (too many files: not all are listed)"}`;
        fill();
      } catch (error) {
        problem.textContent = problemOf(error);
        list.replaceChildren();
      }
    },
  };
}

/**
 * Return the dialog that asks for a new name; a second press of its button replaces what is there.
 * @param {HTMLElement} root
 * @param {App} app
 * @param {{
 *   id: string, title: string, ending: string, renames: string, proposed(): string,
 *   write(path: string, renames: boolean, stamp?: string): Promise<Conflict | null>,
 * }} kind
 */
function createSaveAsDialog(root, app, { id, title, ending, renames: question, proposed, write }) {
  const path = el("input", { type: "text", id: `${id}-path`, autocomplete: "off", spellcheck: "false", required: true });
  const renames = el("input", { type: "checkbox", id: `${id}-renames`, checked: true });
  const problem = el("p", { class: "problem", role: "alert" });
  const save = el("button", { type: "submit", class: "primary" }, "Save");
  const form = el(
    "form", { method: "dialog" },
    el("div", { class: "field" }, el("label", { for: path.id }, `File (${ending})`), path),
    el("p", { class: "standing" }, `In ${app.hello.folder}, or in the folder of a file that was named with the command`),
    question ? el("div", { class: "field" }, renames, el("label", { for: renames.id }, question)) : null,
    problem,
    el("div", { class: "buttons" }, save, button("Cancel", () => { dialog.close(); })),
  );
  const dialog = el(
    "dialog", { class: "files-dialog save-as", "aria-labelledby": `${id}-title` },
    el("h2", { id: `${id}-title` }, title), form,
  );
  root.append(dialog);
  let there = /** @type {Conflict | null} */ (null); // the file that a second press of the button replaces

  const forget = () => {
    there = null;
    save.textContent = "Save";
    problem.textContent = "";
  };
  /** @param {Conflict} refused */
  const offer = (refused) => {
    there = refused;
    save.textContent = "Replace it";
    const what = refused.why === "changed" ? "was changed outside" : "exists";
    problem.textContent = `${refused.path} ${what}${refused.design ? ` (${refused.design.name})` : ""}.`;
  };
  path.addEventListener("input", forget);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const given = path.value.trim();
    problem.textContent = "";
    try {
      const refused = await write(given.endsWith(ending) ? given : `${given}${ending}`, renames.checked, there?.stamp);
      if (refused) offer(refused);
      else dialog.close();
    } catch (error) {
      problem.textContent = problemOf(error);
    }
  });

  return {
    /** Ask; the promise ends when the dialog is closed. @param {Conflict | null} [refused] */
    show(refused = null) {
      forget();
      path.value = refused?.path ?? proposed();
      if (refused) offer(refused);
      dialog.showModal();
      path.select();
      return new Promise((done) => { dialog.addEventListener("close", done, { once: true }); });
    },
  };
}

/** Tell whether the map has changes that no file has. @param {StudioState} state */
export const isEdited = ({ map, pose }) => Boolean(map && (map.edits.length || map.targets || pose));

/** @param {string} path */
function nameOf(path) {
  return path.replace(/.*[\\/]/, "").replace(/\.toml$/i, "");
}

/** Return a value as text that is the same whatever order its keys are in. @param {unknown} value */
function plainText(value) {
  return JSON.stringify(value, (_, part) => {
    if (part === null || typeof part !== "object" || Array.isArray(part)) return part;
    return Object.fromEntries(Object.entries(part).sort(([a], [b]) => (a < b ? -1 : 1)));
  });
}

/** Return the plain values in a value, by their dotted keys. @param {unknown} value @returns {[key: string, value: unknown][]} */
function flat(value, key = "") {
  if (value === null || typeof value !== "object") return [[key, value]];
  return Object.entries(value).flatMap(([part, inner]) => flat(inner, key ? `${key}.${part}` : part));
}

/** Return the values in which two designs differ, a line each. @param {Design} theirs @param {Design} mine */
function differencesOf(theirs, mine) {
  const [one, other] = [new Map(flat(theirs)), new Map(flat(mine))];
  const shown = (/** @type {unknown} */ value) => (value === undefined ? "–" : typeof value === "number" ? number(value, 4) : String(value));
  const lines = [...new Set([...one.keys(), ...other.keys()])]
    .filter((key) => one.get(key) !== other.get(key))
    .map((key) => `${key}: ${shown(one.get(key))}, ${shown(other.get(key))}`);
  const rest = lines.length - MOST_DIFFERENCES;
  return rest > 0 ? [...lines.slice(0, MOST_DIFFERENCES), `and ${rest} more`] : lines.length ? lines : ["comments or order only"];
}

/** @param {string} text */
function when(text) {
  const time = new Date(text);
  if (Number.isNaN(time.getTime())) return "at an unknown time";
  const isToday = time.toDateString() === new Date().toDateString();
  return isToday ? `today at ${time.toLocaleTimeString()}` : `on ${time.toLocaleString()}`;
}

function newKey() {
  return [...crypto.getRandomValues(new Uint8Array(12))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

function tabKey() {
  const found = sessionStorage.getItem(KEY) ?? newKey();
  sessionStorage.setItem(KEY, found);
  return found;
}

/**
 * Join the open tabs: each answers with the key of its unsaved work, and tells when that is saved.
 * @param {() => string} ownKey
 * @param {(key: string) => void} onSettled
 */
function openTabs(ownKey, onSettled) {
  const channel = new BroadcastChannel("vinefab-studio");
  const found = /** @type {Set<string>} */ (new Set());
  channel.onmessage = ({ data }) => {
    if (data.who) channel.postMessage({ here: ownKey() });
    else if (data.here) found.add(data.here);
    else if (data.settled) onSettled(data.settled);
  };
  return {
    /** @returns {Promise<Set<string>>} */
    others() {
      channel.postMessage({ who: true });
      return new Promise((resolve) => setTimeout(() => resolve(found), OTHERS_ANSWER_MS));
    },
    /** @param {string} key */
    settled(key) { channel.postMessage({ settled: key }); },
  };
}

/** @returns {Record<string, OpenFile>} */
function readKnown() {
  try {
    return JSON.parse(sessionStorage.getItem(FILES) ?? "{}");
  } catch {
    return {};
  }
}

/** @param {Record<string, OpenFile>} known */
function writeKnown(known) {
  try {
    sessionStorage.setItem(FILES, JSON.stringify(known));
  } catch {
    // Storage is full: undo over a reload keeps to the file that is open.
  }
}
