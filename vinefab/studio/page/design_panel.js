// The design: every value with a slider, an exact number, its unit and range, and a lock.

import { el, number, setAt, valueAt } from "studio/dom.js";

const UNLIMITED = 10000;

/** Values of the trunk and of what is built once: label, unit, range, range of the slider, step. */
const BUILD = [
  { key: "build.pressure_kpa", label: "Pressure", unit: "kPa", least: 0, most: 10000, slider: [0, 60], step: 0.5 },
  { key: "build.tail_mm", label: "Tail", unit: "mm", least: 0, most: UNLIMITED, slider: [0, 400], step: 1 },
];
const POUCH = {
  round: [{ key: "build.pouch.radius_mm", label: "Radius", unit: "mm", least: 0.1, most: 1000, slider: [2, 60], step: 0.5 }],
  rectangle: [
    { key: "build.pouch.length_mm", label: "Length", unit: "mm", least: 0.1, most: 1000, slider: [2, 120], step: 0.5 },
    { key: "build.pouch.width_mm", label: "Width", unit: "mm", least: 0.1, most: 1000, slider: [2, 120], step: 0.5 },
  ],
};
const PIECES = [
  { key: "build.pieces.most", label: "At most", unit: "pieces", least: 1, most: 676, slider: [1, 12], step: 1, whole: true },
  { key: "build.pieces.lap_mm", label: "Lap", unit: "mm", least: 1, most: 1000, slider: [5, 40], step: 0.5 },
  { key: "build.pieces.ease_mm", label: "Ease", unit: "mm", least: 0, most: 100, slider: [0, 5], step: 0.1 },
];

function trunkRows() {
  return [
    { key: "trunk.length", label: "Length", unit: "mm", least: 0.1, most: UNLIMITED, slider: [10, 500], step: 1 },
    ...buildRows(0),
  ];
}

function levelRows(index) {
  const key = `level.${index}`;
  return [
    { key: `${key}.length`, label: "Length", unit: "mm", least: 0.1, most: UNLIMITED, slider: [10, 400], step: 1 },
    { key: `${key}.angle_deg`, label: "Fan", unit: "°", least: 0, most: 360, slider: [0, 360], step: 1, title: "Angle of the whole fan" },
    { key: `${key}.branches`, label: "Branches", unit: "", least: 1, most: 1000, slider: [1, 8], step: 1, whole: true, title: "Children of every branch before" },
    { key: `${key}.growth_percent`, label: "Growth", unit: "%", least: 0.1, most: 10000, slider: [20, 300], step: 1, title: "Length of the last child over that of the first" },
    ...buildRows(index + 1),
    { key: `build.fillet_mm.${index}`, label: "Fillet", unit: "mm", least: 0, most: 1000, slider: [0, 20], step: 0.1 },
  ];
}

function buildRows(level) {
  return [
    { key: `build.widths_mm.${level}`, label: "Width", unit: "mm", least: 0.1, most: 10000, slider: [3, 80], step: 0.1, title: "Lay-flat lumen width where its branches begin" },
    { key: `build.taper.${level}`, label: "Taper", unit: "×", least: 0.01, most: 1, slider: [0.3, 1], step: 0.01, absent: 1, title: "Width at the end over width at the beginning" },
  ];
}

function readValue(design, row) {
  return valueAt(design, row.key) ?? row.absent;
}

function writeValue(design, row, value) {
  if (row.key.startsWith("build.taper") && !design.build.taper?.length) {
    design.build.taper = design.build.widths_mm.map(() => 1);
  }
  setAt(design, row.key, value);
}

/** Return a row's elements and how to show a state in it. */
function parameter(row, app, drag) {
  const id = `value-${row.key.replaceAll(".", "-")}`;
  const [low, high] = row.slider;
  const slider = el("input", {
    type: "range", min: low, max: high, step: row.step, "aria-label": `${row.name} ${row.label}, slider`, "data-key": row.key,
  });
  const exact = el("input", { type: "number", id, min: row.least, max: row.most, step: "any", "data-key": row.key });
  const lock = el("button", {
    type: "button", class: "lock", "aria-pressed": "false",
    "aria-label": `Lock ${row.name} ${row.label}`, title: "Locked: neither the hand, the fix nor a search changes it",
  });

  const set = (value, group) => {
    if (!Number.isFinite(value)) return;
    const fitting = Math.min(row.most, Math.max(row.least, row.whole ? Math.round(value) : value));
    app.store.change(`${row.name} ${row.label}`.toLowerCase(), (state) => writeValue(state.design, row, fitting), { group });
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
    const value = readValue(state.design, row);
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
    "div", { class: "parameter" },
    el("label", { for: id, title: row.title }, row.label), slider, exact,
    el("span", { class: "unit", "aria-hidden": "true" }, row.unit), lock,
  );
  return { line, show };
}

function group(title, rows, app, drag, extra = []) {
  const parts = rows.map((row) => parameter({ ...row, name: title }, app, drag));
  const box = el("fieldset", {}, el("legend", {}, title), ...parts.map((part) => part.line), ...extra);
  return { box, show: (state) => parts.forEach((part) => part.show(state)) };
}

/** Return the shape of a design: what decides which rows there are. */
function shape(design) {
  const { pouch, pieces } = design.build;
  return JSON.stringify([design.level.length, pouch?.shape ?? "", Boolean(pieces)]);
}

function addLevel(state) {
  const { design } = state;
  const last = design.level.at(-1) ?? { branches: 2, length: design.trunk.length, angle_deg: 90, growth_percent: 100 };
  const width = design.build.widths_mm.at(-1);
  design.level.push({ ...last, length: Math.round(0.7 * last.length) });
  design.build.widths_mm.push(Number((0.6 * width).toFixed(2)));
  design.build.fillet_mm.push(Math.max(2, Number((0.15 * width).toFixed(2))));
  if (design.build.taper?.length) design.build.taper.push(1);
}

function removeLevel(state) {
  const { design } = state;
  const gone = design.level.length - 1;
  design.level.pop();
  design.build.widths_mm.pop();
  design.build.fillet_mm.pop();
  if (design.build.taper?.length) design.build.taper.pop();
  const kept = (key) => !key.startsWith(`level.${gone}.`) && !key.endsWith(`widths_mm.${gone + 1}`)
    && !key.endsWith(`taper.${gone + 1}`) && !key.endsWith(`fillet_mm.${gone}`);
  state.locks = state.locks.filter(kept);
}

function setPouch(state, kind) {
  const width = state.design.build.widths_mm.at(-1);
  const sizes = { round: { radius_mm: width }, rectangle: { length_mm: 3 * width, width_mm: 2 * width } };
  if (kind) state.design.build.pouch = { shape: kind, ...sizes[kind] };
  else delete state.design.build.pouch;
  state.locks = state.locks.filter((key) => !key.startsWith("build.pouch"));
}

function setPieces(state, isCut) {
  if (isCut) state.design.build.pieces = { most: 6, lap_mm: 15, ease_mm: 1 };
  else delete state.design.build.pieces;
  state.locks = state.locks.filter((key) => !key.startsWith("build.pieces"));
}

export function mount(root, app) {
  let parts = [];
  let built = "";
  let drags = 0;
  const drag = {
    // What happened since the last release is one step of undo.
    group: (key) => `${key} ${drags}`,
    moved: (event) => dispatchEvent(new CustomEvent("moved", { detail: event.timeStamp })),
  };
  addEventListener("released", () => drags++);

  const name = el("input", { type: "text", id: "design-name", maxlength: 100, pattern: "[\\w\\-.]+", spellcheck: "false" });
  name.addEventListener("change", () => {
    if (name.validity.valid && name.value) app.store.change("name", (state) => { state.design.name = name.value; });
    else app.say("A name has letters, digits, '_', '-' and '.'", "error");
    name.value = app.store.get().design.name;
  });
  const more = el("button", { type: "button", onclick: () => app.store.change("a level more", addLevel) }, "Add a level");
  const less = el("button", { type: "button", onclick: () => app.store.change("a level less", removeLevel) }, "Remove the last");
  const pouch = el("select", { id: "pouch-shape" },
    el("option", { value: "" }, "rounded tips"), el("option", { value: "round" }, "round pouch"), el("option", { value: "rectangle" }, "rectangular pouch"));
  pouch.addEventListener("change", () => app.store.change("pouch", (state) => setPouch(state, pouch.value)));
  const pieces = el("input", { type: "checkbox", id: "in-pieces" });
  pieces.addEventListener("change", () => app.store.change("pieces", (state) => setPieces(state, pieces.checked)));
  const mounting = el("select", { id: "mounting" },
    el("option", { value: "tail_inverted" }, "tail inverted, inside ends outside"), el("option", { value: "turned" }, "turned inside out first"));
  mounting.addEventListener("change", () => app.store.change("mounting", (state) => { state.design.build.mounting = mounting.value; }));
  const body = el("div", { class: "parameters" });
  root.append(
    el("div", { class: "field" }, el("label", { for: "design-name" }, "Name"), name),
    body,
  );

  function build(state) {
    const { design } = state;
    parts = [group("Trunk", trunkRows(), app, drag)];
    design.level.forEach((_, index) => parts.push(group(`Level ${index + 2}`, levelRows(index), app, drag)));
    const levels = el("div", { class: "buttons" }, more, less);
    const tips = el("div", { class: "field" }, el("label", { for: "pouch-shape" }, "Tips"), pouch);
    const tipsGroup = group("Pouch", POUCH[design.build.pouch?.shape] ?? [], app, drag, [tips]);
    const cut = el("div", { class: "field" }, pieces, el("label", { for: "in-pieces" }, "may be cut in pieces"));
    const piecesGroup = group("Pieces", design.build.pieces ? PIECES : [], app, drag, [cut]);
    const mounted = el("div", { class: "field" }, el("label", { for: "mounting" }, "Mounting"), mounting);
    const built = group("Build", BUILD, app, drag, [mounted]);
    parts.push(built, tipsGroup, piecesGroup);
    const boxes = parts.map((part) => part.box);
    boxes.splice(1 + design.level.length, 0, levels);
    body.replaceChildren(...boxes);
  }

  function show(state) {
    const wanted = shape(state.design);
    if (wanted !== built) {
      built = wanted;
      build(state);
    }
    for (const part of parts) part.show(state);
    if (document.activeElement !== name) name.value = state.design.name;
    name.disabled = !app.live;
    pouch.value = state.design.build.pouch?.shape ?? "";
    pieces.checked = Boolean(state.design.build.pieces);
    mounting.value = state.design.build.mounting ?? "tail_inverted";
    for (const control of [pouch, pieces, mounting, more]) control.disabled = !app.live;
    more.disabled ||= state.design.level.length >= 9;
    less.disabled = !app.live || state.design.level.length === 0;
  }

  app.store.subscribe(show);
  show(app.store.get());
}
