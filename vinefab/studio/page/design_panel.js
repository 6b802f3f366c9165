// The design: every value with a slider, an exact number, its unit and range, and a lock.

import { patternOf } from "studio/deployed.js";
import { el, number, setAt, svgEl, valueAt } from "studio/dom.js";

/** Return the number rows of a table with their whole keys; lists are the levels'. */
function numberRows(rows, prefix) {
  return rows.filter((row) => row.slider && !row.first).map((row) => ({ ...row, key: join(prefix, row.key) }));
}

/** Return the rows that a level has in lists of the build; the trunk is level 1. */
function listRows(form, level) {
  const rows = buildLists(form).filter((row) => level >= row.first);
  return rows.map((row) => ({ ...row, list: `build.${row.key}`, key: `build.${row.key}.${level - row.first}` }));
}

const join = (prefix, key) => (prefix ? `${prefix}.${key}` : key);
const rowOf = (rows, key) => rows.find((row) => row.key === key);
const buildLists = (form) => rowOf(form.rows, "build").rows.filter((row) => row.first);

/** Return what a row shows where the design leaves the key out. */
const absent = (row) => row.absent ?? row.default ?? row.slider[0];

function writeValue(design, row, value) {
  if (row.list && !valueAt(design, row.list)?.length) {
    setAt(design, row.list, Array(design.level.length + 2 - row.first).fill(absent(row)));
  }
  setAt(design, row.key, value);
}

const DESIGN = {
  valueOf: (state, row) => valueAt(state.design, row.key) ?? absent(row),
  write: (state, row, value) => writeValue(state.design, row, value),
};

/** Return a row's elements and how to show a state in it; `tree` tells where its values stand. */
export function parameter(row, app, drag, tree = DESIGN) {
  const id = `value-${row.key.replaceAll(".", "-")}`;
  const [low, high] = row.slider;
  const slider = el("input", {
    type: "range", min: low, max: high, step: row.step, "aria-label": `${row.name} ${row.label}, slider`, "data-key": row.key,
  });
  const least = row.least ?? -Infinity;
  const most = row.most ?? Infinity;
  const exact = el("input", { type: "number", id, min: row.least, max: row.most, step: "any", "data-key": row.key });
  const lock = el("button", {
    type: "button", class: "lock", "aria-pressed": "false",
    "aria-label": `Lock ${row.name} ${row.label}`, title: "Locked: neither the hand, the fix nor a search changes it",
  }, svgEl("svg", { width: 14, height: 15, "aria-hidden": "true" },
    svgEl("path", { class: "shackle", d: "M4 7V4.5a3 3 0 0 1 6 0V7" }), svgEl("rect", { x: 2.5, y: 7, width: 9, height: 7, rx: 1 })));

  const set = (value, group) => {
    if (!Number.isFinite(value)) return;
    const fitting = Math.min(most, Math.max(least, row.whole ? Math.round(value) : value));
    app.store.change(`${row.name} ${row.label}`.toLowerCase(), (state) => tree.write(state, row, fitting), { group });
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
    else app.say(`${row.name} ${row.label}: ${row.least} to ${row.most} ${row.unit}`, "error");
    show(app.store.get());
  });
  lock.addEventListener("click", () => {
    app.store.change(`lock of ${row.name} ${row.label}`.toLowerCase(), (state) => {
      const locks = new Set(state.locks);
      if (!locks.delete(row.key)) locks.add(row.key);
      state.locks = [...locks].sort();
    });
  });

  function show(state) {
    const value = tree.valueOf(state, row);
    if (!Number.isFinite(value)) return;
    const locked = state.locks.includes(row.key);
    // A slider reaches as far as the value that it shows.
    slider.max = Math.max(high, Math.ceil(value));
    slider.min = Math.min(low, Math.floor(value));
    if (Number(slider.value) !== value) slider.value = value;
    slider.setAttribute("aria-valuetext", `${number(value, 3)} ${row.unit}`);
    if (document.activeElement !== exact || !app.live) exact.value = Number(number(value, 4));
    lock.setAttribute("aria-pressed", String(locked));
    for (const input of [slider, exact]) input.disabled = locked || !app.live;
    lock.disabled = !app.live;
  }

  const line = el(
    "div", { class: "parameter", "data-about": `${row.label}: ${row.about}` },
    el("label", { for: id, title: row.about }, row.label), slider, exact,
    el("span", { class: "unit", "aria-hidden": "true" }, row.unit), tree === DESIGN ? lock : null,
  );
  return { line, show };
}

function group(title, rows, app, drag, extra = []) {
  const parts = rows.map((row) => parameter({ ...row, name: title }, app, drag));
  const box = el("fieldset", {}, el("legend", {}, title), ...parts.map((part) => part.line), ...extra);
  return { box, show: (state) => parts.forEach((part) => part.show(state)) };
}

/** Return the shape of a design: what decides which rows there are. */
function shape(form, design) {
  const tables = form.rows.flatMap((row) => [row, ...(row.rows ?? [])]).filter((row) => row.rows);
  const held = tables.map((row) => Object.keys(design[row.key] ?? design.build[row.key] ?? {}));
  return JSON.stringify([design.level.length, held]);
}

/** What a new level has in the lists of the build, from the width before it. */
const NEW = {
  widths_mm: (width) => Number((0.6 * width).toFixed(2)),
  fillet_mm: (width) => Math.max(2, Number((0.15 * width).toFixed(2))),
};

function addLevel(form, state) {
  const { design } = state;
  const first = { branches: 2, length: design.trunk.length, angle_deg: 90 };
  for (const row of rowOf(form.rows, "level").rows) first[row.key] ??= row.default ?? row.slider?.[0];
  const last = design.level.at(-1) ?? first;
  const width = design.build.widths_mm.at(-1);
  design.level.push({ ...last, length: Math.round(0.7 * last.length) });
  for (const row of buildLists(form)) {
    const list = design.build[row.key];
    if (list?.length || row.absent === null) list.push(NEW[row.key]?.(width) ?? list.at(-1) ?? absent(row));
  }
}

function removeLevel(form, state) {
  const { design } = state;
  const gone = design.level.length - 1;
  design.level.pop();
  for (const row of buildLists(form)) design.build[row.key]?.pop();
  const lists = listRows(form, gone + 2).map((row) => row.key);
  state.locks = state.locks.filter((key) => !key.startsWith(`level.${gone}.`) && !lists.includes(key));
}

/** What a new table begins with, where its declaration does not say it. */
const START = {
  pouch(design, kind) {
    const width = design.build.widths_mm.at(-1);
    return kind === "round" ? { radius_mm: width } : { length_mm: 3 * width, width_mm: 2 * width };
  },
  collar: (design) => ({ clamp_diameter_mm: Number(((2 * design.build.widths_mm[0]) / Math.PI).toFixed(1)) }),
};

/** Add a table to the design, of a kind if it has kinds; null removes it. */
function setTable(state, row, key, kind) {
  const choice = row.rows.find((inner) => inner.choices);
  const made = choice ? { [choice.key]: kind } : {};
  for (const inner of choice ? [] : row.rows) made[inner.key] = inner.default ?? inner.slider[0];
  Object.assign(made, START[row.key]?.(state.design, kind));
  setAt(state.design, key, kind === null ? undefined : made);
  state.locks = state.locks.filter((locked) => !locked.startsWith(key));
}

/** Return how drags of sliders become steps of undo: one from release to release. */
export function dragSteps() {
  let drags = 0;
  addEventListener("released", () => drags++);
  return {
    group: (key) => `${key} ${drags}`,
    moved: (event) => dispatchEvent(new CustomEvent("moved", { detail: event.timeStamp })),
  };
}

/** Return a line that says what the value under hand or focus means. */
function hintLine(column) {
  const line = el("p", { class: "hint" });
  const show = ({ target }) => {
    const about = target.closest?.("[data-about]")?.dataset.about;
    if (about) line.textContent = about;
  };
  for (const event of ["focusin", "pointerover"]) column.addEventListener(event, show);
  return line;
}

const words = (choice) => choice.replaceAll("_", " ");

export function mount(root, app) {
  let parts = [];
  let built = "";
  const drag = dragSteps();
  const name = el("input", { type: "text", id: "design-name", maxlength: 100, pattern: "[\\w\\-.]+", spellcheck: "false" });
  name.addEventListener("change", () => {
    if (name.validity.valid && name.value) app.store.change("name", (state) => { state.design.name = name.value; });
    else app.say("A name has letters, digits, '_', '-' and '.'", "error");
    name.value = app.store.get().design.name;
  });
  const { form } = app.hello;
  const more = el("button", { type: "button", onclick: () => app.store.change("a level more", (state) => addLevel(form, state)) }, "Add a level");
  const less = el("button", { type: "button", onclick: () => app.store.change("a level less", (state) => removeLevel(form, state)) }, "Remove the last");
  const body = el("div", { class: "parameters" });
  root.append(el("div", { class: "field" }, el("label", { for: "design-name" }, "Name"), name), body);
  root.parentNode.append(hintLine(root.parentNode));

  /** Return a field with a choice: of a key, or of whether and as what there is a table. */
  function choiceField(key, row, options, valueOf, set) {
    const id = `choice-${key.replaceAll(".", "-")}`;
    const select = el("select", { id }, options.map(([value, text]) => el("option", { value }, text)));
    select.addEventListener("change", () => app.store.change(row.label.toLowerCase(), (state) => set(state, select.value)));
    const box = el("div", { class: "field", "data-about": `${row.label}: ${row.about}` }, el("label", { for: id, title: row.about }, row.label), select);
    const show = (state) => {
      select.value = valueOf(state.design);
      select.disabled = !app.live;
    };
    return { box, show };
  }

  /** Return the field that adds a table to the design and removes it. */
  function tableField(key, row) {
    const choice = row.rows.find((inner) => inner.choices);
    if (choice) {
      const options = [["", "none"], ...choice.choices.map((value) => [value, words(value)])];
      const valueOf = (design) => valueAt(design, key)?.[choice.key] ?? "";
      return choiceField(key, { ...choice, about: row.about }, options, valueOf, (state, value) => setTable(state, row, key, value || null));
    }
    const id = `choice-${key.replaceAll(".", "-")}`;
    const box = el("input", { type: "checkbox", id });
    box.addEventListener("change", () => app.store.change(row.label.toLowerCase(), (state) => setTable(state, row, key, box.checked ? "" : null)));
    const show = (state) => {
      box.checked = Boolean(valueAt(state.design, key));
      box.disabled = !app.live;
    };
    return { box: el("div", { class: "field" }, box, el("label", { for: id, title: row.about }, row.about.split(/[,;]/)[0])), show };
  }

  /** Return the groups of a table: its own numbers and choices, then the tables in it. */
  function tableGroups(design, title, rows, prefix, lists, field = null) {
    const fields = field ? [field] : [];
    for (const row of rows.filter((one) => one.choices && !field)) {
      const key = join(prefix, row.key);
      const options = row.choices.map((value) => [value, words(value)]);
      fields.push(choiceField(key, row, options, (shown) => valueAt(shown, key) ?? row.default, (state, value) => setAt(state.design, key, value)));
    }
    const held = prefix ? valueAt(design, prefix) : design;
    const isOfKind = field && rows.some((row) => row.choices); // then only what this kind has
    const numbers = held ? numberRows(rows, prefix).filter((row) => !isOfKind || valueAt(design, row.key) !== undefined) : [];
    const own = group(title, [...numbers, ...lists], app, drag, fields.map((one) => one.box));
    const groups = [{ box: own.box, show: (state) => [own, ...fields].forEach((part) => part.show(state)) }];
    for (const row of field ? [] : rows.filter((one) => one.rows && !one.many && prefix)) {
      const key = join(prefix, row.key);
      groups.push(...tableGroups(design, row.label, row.rows, key, [], tableField(key, row)));
    }
    return groups;
  }

  function build(state) {
    const { design } = state;
    const levels = el("div", { class: "buttons" }, more, less);
    parts = [];
    const top = form.rows.filter((row) => !row.rows);
    if (top.length) parts.push(...tableGroups(design, "Design", top, "", []));
    for (const row of form.rows.filter((one) => one.rows)) {
      if (!row.many) parts.push(...tableGroups(design, row.label, row.rows, row.key, row.key === "trunk" ? listRows(form, 1) : []));
      else if (row.key === "level") {
        design.level.forEach((_, index) => parts.push(...tableGroups(design, `Level ${index + 2}`, row.rows, `level.${index}`, listRows(form, index + 2))));
        parts.push({ box: levels, show() {} });
      }
    }
    body.replaceChildren(...parts.map((part) => part.box));
  }

  // ---- what must be cut for an angle: from the table at once, from the rules exactly

  let notes = {};
  let exact = { of: "", notes: {} };

  /** Show the notes on values, by key: below the slider of each. */
  function showNotes(found) {
    notes = found ?? {};
    for (const slider of body.querySelectorAll("input[type=range]")) {
      const { key } = slider.dataset;
      const line = slider.closest(".parameter");
      let box = line.querySelector(".value-note");
      if (!notes[key]) {
        box?.remove();
        continue;
      }
      if (!box) {
        box = el("p", { id: `note-${key.replaceAll(".", "-")}` });
        line.append(box);
        slider.setAttribute("aria-describedby", box.id);
      }
      box.className = `value-note ${notes[key].kind}`;
      box.textContent = notes[key].text;
      box.title = notes[key].about;
    }
  }

  app.onAnswer("cut", (found, state) => showNotes(exact.of === patternOf(state) ? exact.notes : found.cut));
  app.onAnswer("rules", (found, state) => {
    exact = { of: patternOf(state), notes: found.cut };
    if (exact.of === patternOf(app.shown())) showNotes(exact.notes);
  });

  function show(state) {
    const wanted = shape(form, state.design);
    if (wanted !== built) {
      built = wanted;
      build(state);
      showNotes(notes);
    }
    for (const part of parts) part.show(state);
    if (document.activeElement !== name) name.value = state.design.name;
    name.disabled = !app.live;
    more.disabled = !app.live || state.design.level.length >= form.most_levels;
    less.disabled = !app.live || state.design.level.length === 0;
  }

  app.store.subscribe(show);
  show(app.store.get());
}
