// The design: every value with a slider, an exact number, its unit and range, and a lock.

import { patternOf } from "studio/deployed.js";
import { button, el, number, optionsOf, setAt, svgEl, valueAt } from "studio/dom.js";

/** @param {string} prefix @param {string} key */
const join = (prefix, key) => (prefix ? `${prefix}.${key}` : key);
/** @param {string} kind @param {string} key */
const idOf = (kind, key) => `${kind}-${key.replaceAll(".", "-")}`;
/** @param {FormRow} row */
const isNumber = (row) => row.slider !== undefined;
/** @param {FormRow} row */
const isChoice = (row) => row.choices !== undefined;
/** @param {FormRow} row */
const isTable = (row) => row.rows !== undefined;

/** Return the number rows of a table with their whole keys; lists are the levels'. @param {FormRow[]} rows @param {string} prefix */
function numberRows(rows, prefix) {
  return rows.filter(isNumber).filter((row) => !row.first).map((row) => ({ ...row, key: join(prefix, row.key) }));
}

/** Return the rows of a table of the form. @param {Form} form @param {string} key */
export const rowsOf = (form, key) => form.rows.filter(isTable).find((row) => row.key === key)?.rows ?? [];

/** Return the rows of the lists of the build, and which level each begins with. @param {Form} form */
const buildLists = (form) => rowsOf(form, "build").filter(isNumber).flatMap((row) => (row.first ? [{ ...row, first: row.first }] : []));

/** Return the list of the build that a row is about. @param {Design} design @param {NumberRow} row */
const listOf = ({ build }, { key }) => /** @type {number[] | undefined} */ (valueAt(build, key));

/** Return the rows that a level has in lists of the build; the trunk is level 1. @param {Form} form @param {number} level */
function listRows(form, level) {
  return buildLists(form).filter((row) => level >= row.first)
    .map((row) => ({ ...row, list: row, key: `build.${row.key}.${level - row.first}` }));
}

/** Return what a row shows where the design leaves the key out. @param {NumberRow} row */
const absent = (row) => row.absent ?? row.default ?? row.slider[0];

/** @type {ValueTree} */
const DESIGN = {
  valueOf: ({ design }, row) => valueAt(design, row.key) ?? absent(row),
  write({ design }, row, value) {
    const { list } = row;
    if (list && !listOf(design, list)?.length) {
      setAt(design.build, list.key, Array(design.build.widths_mm.length + 1 - list.first).fill(absent(row)));
    }
    setAt(design, row.key, value);
  },
};

/** Return a field with its label and what it means. @param {string} id @param {{ label: string, about: string }} row @param {Element} input */
export function labelled(id, { label, about }, input) {
  return el("div", { class: "field", "data-about": `${label}: ${about}` }, el("label", { for: id, title: about }, label), input);
}

/**
 * Return a row's elements and how to show a state in it; `tree` tells where its values stand.
 * @param {string} name of the table
 * @param {ValueRow} row
 * @param {App} app
 * @param {Drag} drag
 * @returns {Part}
 */
export function parameter(name, row, app, drag, tree = DESIGN) {
  const title = `${name} ${row.label}`;
  const id = idOf("value", row.key);
  const [low, high] = row.slider;
  const slider = el("input", {
    type: "range", min: low, max: high, step: row.step, "aria-label": `${title}, slider`, "data-key": row.key,
  });
  const least = row.least ?? -Infinity;
  const most = row.most ?? Infinity;
  const exact = el("input", { type: "number", id, min: row.least, max: row.most, step: "any", "data-key": row.key });
  const lock = button(svgEl("svg", { width: 14, height: 15, "aria-hidden": "true" },
    svgEl("path", { class: "shackle", d: "M4 7V4.5a3 3 0 0 1 6 0V7" }), svgEl("rect", { x: 2.5, y: 7, width: 9, height: 7, rx: 1 })),
  () => app.store.change(`lock of ${title}`.toLowerCase(), (state) => {
    const locks = new Set(state.locks);
    if (!locks.delete(row.key)) locks.add(row.key);
    state.locks = [...locks].sort();
  }), {
    class: "lock", "aria-pressed": "false",
    "aria-label": `Lock ${title}`, title: "Locked: neither the hand, the fix nor a search changes it",
  });

  /** @param {number} value @param {string} [group] */
  const set = (value, group) => {
    if (!Number.isFinite(value)) return;
    const fitting = Math.min(most, Math.max(least, row.whole ? Math.round(value) : value));
    app.store.change(title.toLowerCase(), (state) => tree.write(state, row, fitting), { group });
  };
  slider.addEventListener("input", (event) => {
    drag.moved(event);
    set(Number(slider.value), drag.group(row.key));
  });
  slider.addEventListener("change", () => {
    app.store.endGroup();
    dispatchEvent(new CustomEvent("released"));
  });
  exact.addEventListener("change", () => {
    if (exact.validity.valid && exact.value !== "") set(Number(exact.value));
    else app.say(`${title} is ${exact.value || "no number"}; type ${row.least} to ${row.most} ${row.unit}`, "error");
    show(app.store.get());
  });

  /** @param {StudioState} state */
  function show(state) {
    const value = tree.valueOf(state, row);
    if (typeof value !== "number" || !Number.isFinite(value)) return;
    const locked = state.locks.includes(row.key);
    // A slider reaches as far as the value that it shows.
    slider.max = String(Math.max(high, Math.ceil(value)));
    slider.min = String(Math.min(low, Math.floor(value)));
    if (Number(slider.value) !== value) slider.value = String(value);
    slider.setAttribute("aria-valuetext", `${number(value, 3)} ${row.unit}`);
    if (document.activeElement !== exact || !app.live) exact.value = String(Number(number(value, 4)));
    lock.setAttribute("aria-pressed", String(locked));
    for (const input of [slider, exact]) input.disabled = locked || !app.live;
    lock.disabled = !app.live;
  }

  const box = el(
    "div", { class: "parameter", "data-about": `${row.label}: ${row.about}` },
    el("label", { for: id, title: row.about }, row.label), slider, exact,
    el("span", { class: "unit", "aria-hidden": "true" }, row.unit), tree === DESIGN ? lock : null,
  );
  return { box, show };
}

/** Return the shape of a design: what decides which rows there are. @param {Form} form @param {Design} design */
function shape(form, design) {
  const tables = form.rows.flatMap((row) => [row, ...(row.rows ?? [])]).filter(isTable);
  const held = tables.map(({ key }) => Object.keys(Object(valueAt(design, key) ?? valueAt(design.build, key))));
  return JSON.stringify([design.level.length, design.build.widths_mm.length, Boolean(design.branch), held]);
}

/** What a new level has in the lists of the build, from the width before it. @type {Record<string, (width: number) => number>} */
const NEW = {
  widths_mm: (width) => Number((0.6 * width).toFixed(2)),
  fillet_mm: (width) => Math.max(2, Number((0.15 * width).toFixed(2))),
};

/** @param {Form} form @param {Design} design */
function addLevel(form, design) {
  const usual = Object.fromEntries(rowsOf(form, "level").filter(isNumber).map((row) => [row.key, row.default ?? row.slider[0]]));
  const last = design.level.at(-1) ?? /** @type {Level} */ ({ ...usual, branches: 2, length: design.trunk.length, angle_deg: 90 });
  const width = lastWidth(design);
  design.level.push({ ...last, length: Math.round(0.7 * last.length) });
  for (const row of buildLists(form)) {
    const list = listOf(design, row);
    if (list && (list.length || row.absent === null)) list.push(NEW[row.key]?.(width) ?? list.at(-1) ?? absent(row));
  }
}

/** @param {Form} form @param {StudioState} state */
function removeLevel(form, state) {
  const { design } = state;
  const gone = design.level.length - 1;
  design.level.pop();
  for (const row of buildLists(form)) listOf(design, row)?.pop();
  const lists = listRows(form, gone + 2).map((row) => row.key);
  state.locks = state.locks.filter((key) => !key.startsWith(`level.${gone}.`) && !lists.includes(key));
}

/** Return the width of the last level. @param {Design} design */
const lastWidth = ({ build }) => build.widths_mm[build.widths_mm.length - 1];

/** What a new table begins with, where its declaration does not say it. @type {Record<string, (design: Design, kind: string | null) => object>} */
const START = {
  pouch(design, kind) {
    const width = lastWidth(design);
    return kind === "round" ? { radius_mm: width } : { length_mm: 3 * width, width_mm: 2 * width };
  },
  collar: (design) => ({ clamp_diameter_mm: Number(((2 * design.build.widths_mm[0]) / Math.PI).toFixed(1)) }),
};

/**
 * Add a table to the design, of a kind if it has kinds; null removes it.
 * @param {StudioState} state
 * @param {TableRow} row
 * @param {string} key
 * @param {string | null} kind
 */
function setTable(state, row, key, kind) {
  const choice = row.rows.find(isChoice);
  const made = choice ? { [choice.key]: kind } : Object.fromEntries(row.rows.filter(isNumber).map((inner) => [inner.key, inner.default ?? inner.slider[0]]));
  setAt(state.design, key, kind === null ? undefined : { ...made, ...START[row.key]?.(state.design, kind) });
  state.locks = state.locks.filter((locked) => !locked.startsWith(key));
}

/** Return how drags of sliders become steps of undo: one from release to release. @returns {Drag} */
export function dragSteps() {
  let drags = 0;
  addEventListener("released", () => { drags += 1; });
  return {
    group: (key) => `${key} ${drags}`,
    moved: (event) => dispatchEvent(new CustomEvent("moved", { detail: event.timeStamp })),
  };
}

/** Return a line that says what the value under hand or focus means. @param {Node} column */
function hintLine(column) {
  const line = el("p", { class: "hint" });
  const show = (/** @type {Event} */ { target }) => {
    const about = target instanceof Element && target.closest("[data-about]")?.getAttribute("data-about");
    if (about) line.textContent = about;
  };
  for (const event of ["focusin", "pointerover"]) column.addEventListener(event, show);
  return line;
}

/** @param {string} choice */
const words = (choice) => choice.replaceAll("_", " ");

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  let parts = /** @type {Part[]} */ ([]);
  let built = "";
  const drag = dragSteps();
  const name = el("input", { type: "text", id: "design-name", maxlength: 100, pattern: "[\\w\\-.]+", spellcheck: "false" });
  name.addEventListener("change", () => {
    if (name.validity.valid && name.value) app.store.change("name", (state) => { state.design.name = name.value; });
    else app.say("A name has letters, digits, '_', '-' and '.'", "error");
    name.value = app.store.get().design.name;
  });
  const { form } = app.hello;
  const more = button("Add a level", () => app.store.change("a level more", (state) => addLevel(form, state.design)));
  const less = button("Remove the last", () => app.store.change("a level less", (state) => removeLevel(form, state)));
  const free = button("Free this design", () => app.edits.edit("free", app.branch ?? undefined), { title: "Write it branch by branch: then each can be changed for itself" });
  const body = el("div", { class: "parameters" });
  const column = root.parentElement ?? root; // the chosen branch is in it too
  root.append(el("div", { class: "field" }, el("label", { for: "design-name" }, "Name"), name), body);
  column.append(hintLine(column));

  /**
   * Return a field with a choice: of a key, or of whether and as what there is a table.
   * @param {string} key
   * @param {{ label: string, about: string }} row
   * @param {string[][]} options
   * @param {(design: Design) => unknown} chosen
   * @param {(state: StudioState, value: string) => void} set
   * @returns {Part}
   */
  function choiceField(key, row, options, chosen, set) {
    const id = idOf("choice", key);
    const select = el("select", { id }, optionsOf(options));
    select.addEventListener("change", () => app.store.change(row.label.toLowerCase(), (state) => set(state, select.value)));
    return {
      box: labelled(id, row, select),
      show(state) {
        select.value = String(chosen(state.design));
        select.disabled = !app.live;
      },
    };
  }

  /** Return the field that adds a table to the design and removes it. @param {string} key @param {TableRow} row @returns {Part} */
  function tableField(key, row) {
    const choice = row.rows.find(isChoice);
    if (choice) {
      const options = [["", "none"], ...choice.choices.map((value) => [value, words(value)])];
      return choiceField(key, { ...choice, about: row.about }, options, (design) => valueAt(design, join(key, choice.key)) ?? "",
        (state, value) => setTable(state, row, key, value || null));
    }
    const id = idOf("choice", key);
    const box = el("input", { type: "checkbox", id });
    box.addEventListener("change", () => app.store.change(row.label.toLowerCase(), (state) => setTable(state, row, key, box.checked ? "" : null)));
    return {
      box: el("div", { class: "field" }, box, el("label", { for: id, title: row.about }, row.about.split(/[,;]/)[0])),
      show({ design }) {
        box.checked = Boolean(valueAt(design, key));
        box.disabled = !app.live;
      },
    };
  }

  /**
   * Return the groups of a table: its own numbers and choices, then the tables in it.
   * @param {Design} design
   * @param {string} title
   * @param {FormRow[]} rows
   * @param {string} prefix
   * @param {ValueRow[]} lists
   * @param {Part | null} field that adds and removes the table
   * @returns {Part[]}
   */
  function tableGroups(design, title, rows, prefix, lists, field = null) {
    const fields = field ? [field] : [];
    for (const row of field ? [] : rows.filter(isChoice)) {
      const key = join(prefix, row.key);
      const options = row.choices.map((value) => [value, words(value)]);
      fields.push(choiceField(key, row, options, (shown) => valueAt(shown, key) ?? row.default, (state, value) => setAt(state.design, key, value)));
    }
    const held = prefix ? valueAt(design, prefix) : design;
    const isOfKind = field && rows.some(isChoice); // then only what this kind has
    const numbers = held ? numberRows(rows, prefix).filter((row) => !isOfKind || valueAt(design, row.key) !== undefined) : [];
    const own = [...[...numbers, ...lists].map((row) => parameter(title, row, app, drag)), ...fields];
    const groups = [{
      box: /** @type {Element} */ (el("fieldset", {}, el("legend", {}, title), own.map((part) => part.box))),
      show: (/** @type {StudioState} */ state) => { for (const part of own) part.show(state); },
    }];
    for (const row of field || !prefix ? [] : rows.filter(isTable).filter((one) => !one.many)) {
      const key = join(prefix, row.key);
      groups.push(...tableGroups(design, row.label, row.rows, key, [], tableField(key, row)));
    }
    return groups;
  }

  /** @param {Design} design */
  function build(design) {
    const levels = el("div", { class: "buttons" }, more, less, free);
    parts = [];
    const top = form.rows.filter((row) => !isTable(row));
    if (top.length) parts.push(...tableGroups(design, "Design", top, "", []));
    for (const row of form.rows.filter(isTable)) {
      if (!row.many) parts.push(...tableGroups(design, row.label, row.rows, row.key, row.key === "trunk" ? listRows(form, 1) : []));
      else if (row.key === "branch" && design.branch) {
        const about = "Angle and length of a branch: click it on the map, or drag its tip.";
        parts.push({ box: el("p", { class: "facts" }, about), show() {} });
        // What branches have that say nothing of their own; the trunk's stands with it.
        for (const index of design.build.widths_mm.slice(1).keys()) {
          parts.push(...tableGroups(design, `Level ${index + 2}`, [], "", listRows(form, index + 2)));
        }
      } else if (row.key === "level" && !design.branch) {
        for (const index of design.level.keys()) {
          parts.push(...tableGroups(design, `Level ${index + 2}`, row.rows, `level.${index}`, listRows(form, index + 2)));
        }
        parts.push({ box: levels, show() {} });
      }
    }
    body.replaceChildren(...parts.map((part) => part.box));
  }

  // ---- what must be cut for an angle: from the table at once, from the rules exactly

  let notes = /** @type {Record<string, CutNote>} */ ({});
  let notesOf = "";
  let exact = { of: "", notes };

  /** Show the notes on values, by key: below the slider of each. @param {Record<string, CutNote>} found @param {string} of the pattern */
  function showNotes(found, of) {
    [notes, notesOf] = [found, of];
    for (const slider of column.querySelectorAll("input[type=range]")) {
      const key = slider.getAttribute("data-key") ?? "";
      const line = slider.parentElement;
      line?.querySelector(".value-note")?.remove();
      if (!notes[key]) continue;
      const { kind, text, about } = notes[key];
      const box = el("p", { id: idOf("note", key), class: `value-note ${kind}`, title: about }, text);
      line?.append(box);
      slider.setAttribute("aria-describedby", box.id);
    }
    markStale();
  }

  function markStale() {
    column.classList.toggle("stale-notes", app.live && notesOf !== patternOf(app.shown()));
  }

  app.onAnswer("cut", (found, state) => {
    const of = patternOf(state);
    showNotes(exact.of === of ? exact.notes : found.cut, of);
  });
  app.onAnswer("rules", (found, state) => {
    exact = { of: patternOf(state), notes: found.cut };
    if (exact.of === patternOf(app.shown())) showNotes(exact.notes, exact.of);
  });

  /** @param {StudioState} state */
  function show(state) {
    const wanted = shape(form, state.design);
    if (wanted !== built) {
      built = wanted;
      build(state.design);
      showNotes(notes, notesOf);
    }
    markStale();
    for (const part of parts) part.show(state);
    if (document.activeElement !== name) name.value = state.design.name;
    name.disabled = !app.live;
    more.disabled = !app.live || state.design.level.length >= form.most_levels;
    less.disabled = !app.live || state.design.level.length === 0;
    free.disabled = !app.live;
  }

  app.store.subscribe(show);
  addEventListener("built", () => showNotes(notes, notesOf));
  show(app.store.get());
}
