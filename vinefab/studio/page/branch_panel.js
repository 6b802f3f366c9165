// The branch that is chosen on the map: its numbers and bends, and what can be done with it.

import { dragSteps, labelled, parameter, rowsOf } from "studio/design_panel.js";
import { button, el, number, optionsOf, setAt, valueAt } from "studio/dom.js";

/** @param {string} key */
const lastOf = (key) => key.slice(key.lastIndexOf(".") + 1);
/** @param {FormRow} row @returns {row is NumberRow} */
const isNumber = (row) => row.slider !== undefined;

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const { form } = app.hello;
  const drag = dragSteps();
  const title = el("h2");
  const text = el("p", { class: "facts" });
  const body = el("div", { class: "parameters" });
  const act = (/** @type {string} */ words, /** @type {BranchEdit} */ name, about = "") =>
    button(words, () => app.edits.edit(name, app.branch ?? undefined), { title: about });
  const free = act("Free this design", "free", "Write it branch by branch: then each can be changed for itself");
  const child = act("Add a child", "child");
  const bend = act("Add a bend", "bend", "In the middle of its longest straight part; or double-click the branch on the map");
  const mirror = act("Mirror", "mirror", "Put its mirror image, with all that grow from it, on its parent's other side");
  const remove = act("Remove", "remove", "With all that grow from it");
  const close = button("×", () => app.chooseBranch(null), { class: "close", "aria-label": "Choose no branch" });
  root.append(el("div", { class: "head" }, title, close), text, el("div", { class: "buttons" }, free, child, bend, mirror, remove), body);

  let parts = /** @type {Part[]} */ ([]);
  let built = "";

  /** Return what the library says of the branch, if it is of this one. */
  const found = () => (app.answers.live?.branch?.label === app.branch ? app.answers.live?.branch : null);

  /** @type {ValueTree} */
  const OF_BRANCH = {
    valueOf: ({ design }, { key }) => valueAt(design, key) ?? valueAt(found()?.values, lastOf(key)),
    write: ({ design }, { key }, value) => setAt(design, key, value),
  };

  /** Return the key of the table of a branch; empty where its level has one. @param {Design} design @param {string} label */
  function tableOf({ branch }, label) {
    if (!branch) return "";
    return label === "trunk" ? "trunk" : `branch.${branch.findIndex(({ name }) => name === label)}`;
  }

  /** Return a value with a slider; what may be left out can be given back to its level. @param {string} name @param {NumberRow} row @param {string} table @returns {Part} */
  function field(name, row, table) {
    const key = `${table}.${row.key}`;
    const part = parameter(name, { ...row, key }, app, drag, OF_BRANCH);
    if (row.default !== null || !row.about.includes("left out")) return part;
    const back = button("↺", () => app.store.change(`${row.label} as its level`.toLowerCase(), ({ design }) => setAt(design, key, undefined)), {
      class: "lock", title: "As its level", "aria-label": `${name} ${row.label} as its level`,
    });
    part.box.append(back);
    return {
      box: part.box,
      show(state) {
        part.show(state);
        back.hidden = valueAt(state.design, key) === undefined;
        back.disabled = !app.live;
      },
    };
  }

  /** Return the choice of the pouch at the tip of a branch, and its sizes. @param {string} name @param {string} table @param {Design} design @returns {Part[]} */
  function pouchFields(name, table, design) {
    const key = `${table}.pouch`;
    const rows = rowsOf(form, "build").find((row) => row.key === "pouch")?.rows ?? [];
    const shapes = rows.flatMap((row) => row.choices ?? []);
    const select = el("select", { id: "branch-pouch" }, optionsOf([["", "as in the build"], ["none"], ...shapes.map((one) => [one])]));
    const own = valueAt(design, key);
    select.addEventListener("change", () => app.store.change("pouch", (state) => {
      const width = Number(found()?.values.width_mm ?? 10);
      const sizes = select.value === "round" ? { radius_mm: width } : { length_mm: 3 * width, width_mm: 2 * width };
      const made = select.value === "none" ? false : { shape: select.value, ...sizes };
      setAt(state.design, key, select.value ? made : undefined);
    }));
    const choice = {
      box: labelled("branch-pouch", { label: "Pouch", about: "at its tip, where it has no children" }, select),
      show(/** @type {StudioState} */ state) {
        const value = valueAt(state.design, key);
        select.value = value === false ? "none" : String(valueAt(value, "shape") ?? "");
        select.disabled = !app.live;
      },
    };
    const sizes = own ? rows.filter(isNumber).filter((row) => valueAt(own, row.key) !== undefined) : [];
    return [choice, ...sizes.map((row) => parameter(`${name} pouch`, { ...row, key: `${key}.${row.key}` }, app, drag, OF_BRANCH))];
  }

  /** Return the two numbers of a bend, and what removes it. @param {string} name @param {string} table @param {number} index @returns {Part} */
  function bendField(name, table, index) {
    const called = `${name} bend ${index + 1}`;
    const numbers = form.bend.filter(isNumber).map((row) => parameter(called, { ...row, key: `${table}.bends.${index}.${row.key}` }, app, drag, OF_BRANCH));
    const gone = button("Remove bend", () => app.store.change("a bend less", ({ design }) => {
      const bends = /** @type {number[][]} */ (valueAt(design, `${table}.bends`)).filter((_, place) => place !== index);
      setAt(design, `${table}.bends`, bends.length ? bends : undefined);
    }), { "aria-label": `Remove bend ${index + 1}` });
    return {
      box: el("div", { class: "bend" }, el("h3", {}, `Bend ${index + 1}`, gone), ...numbers.map((part) => part.box)),
      show(state) {
        for (const part of numbers) part.show(state);
        gone.disabled = !app.live;
      },
    };
  }

  /** @param {Design} design @param {string} label */
  function build(design, label) {
    const table = tableOf(design, label);
    const name = label === "trunk" || label === "0" ? "Trunk" : `Branch ${label}`;
    title.textContent = name;
    const rows = table ? rowsOf(form, table === "trunk" ? "trunk" : "branch").filter(isNumber) : [];
    const bends = table ? /** @type {number[][] | undefined} */ (valueAt(design, `${table}.bends`)) ?? [] : [];
    parts = [
      ...rows.map((row) => field(name, row, table)),
      ...(table && table !== "trunk" ? pouchFields(name, table, design) : []),
      ...bends.map((_, index) => bendField(name, table, index)),
      ...(table ? [] : [ofLevel()]),
    ];
    body.replaceChildren(...parts.map((part) => part.box));
    free.hidden = Boolean(table);
    for (const one of [child, bend]) one.hidden = !table;
    for (const one of [mirror, remove]) one.hidden = !table || table === "trunk";
    dispatchEvent(new CustomEvent("built"));
  }

  /** Return the numbers of a branch whose level has them. @returns {Part} */
  function ofLevel() {
    const list = el("dl");
    return {
      box: list,
      show() {
        const values = found()?.values ?? /** @type {Record<string, number>} */ ({});
        const rows = rowsOf(form, "branch").filter(isNumber).filter((row) => row.key in values);
        list.replaceChildren(...rows.flatMap((row) => [el("dt", {}, row.label), el("dd", {}, `${number(values[row.key], 2)} ${row.unit}`)]));
      },
    };
  }

  function show(state = app.store.get()) {
    const label = app.branch;
    root.hidden = label === null;
    if (label === null) {
      built = "";
      return;
    }
    const table = tableOf(state.design, label);
    const own = /** @type {Partial<Branch> | undefined} */ (table ? valueAt(state.design, table) : undefined);
    const shape = JSON.stringify([label, table, own?.bends?.length, valueAt(own?.pouch, "shape")]);
    if (shape !== built) {
      built = shape;
      build(state.design, label);
    }
    for (const part of parts) part.show(state);
    text.textContent = found()?.text ?? "";
    for (const one of [free, child, bend, mirror, remove]) one.disabled = !app.live;
  }

  app.onBranch((label) => {
    show();
    if (label === null) return;
    const panel = /** @type {HTMLElement} */ (root.closest("[role=tabpanel]"));
    if (panel.hidden) document.getElementById("tab-design")?.click();
    panel.scrollTop = 0;
  });
  app.onAnswer("live", () => show());
  app.store.subscribe((state) => {
    if (app.branch !== null) show(state);
  });
  show();
}
