// The growth options in force, each to be changed: by them every robot of the page is grown.

import { dragSteps, labelled, parameter } from "studio/design_panel.js";
import { button, el, optionsOf, setAt, valueAt } from "studio/dom.js";

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const drag = dragSteps();
  const text = el("p", { class: "facts" });
  const origin = el("p", { class: "facts" });
  const reset = button("As usual for this design", () => app.store.change("usual growth options", (state) => { state.growth = {}; }));
  const tree = {
    /** @param {StudioState} state @param {{ key: string }} row */
    valueOf({ growth }, { key }) {
      const value = valueAt(growth, key) ?? valueAt(app.answers.live?.growth.values, key);
      return Array.isArray(value) ? value[0] : value;
    },
    /** @param {StudioState} state @param {{ key: string }} row @param {unknown} value */
    write({ growth }, { key }, value) {
      if (value === valueAt(app.answers.live?.growth.usual, key)) Reflect.deleteProperty(growth, key);
      else setAt(growth, key, value);
    },
  };
  const parts = app.hello.growth_form.map((row) => (row.slider ? parameter("Growth", row, app, drag, tree) : choice(row)));
  root.append(el("div", { class: "parameters wide-labels" }, ...parts.map((part) => part.box)),
    el("div", { class: "buttons" }, reset), text, origin);

  /** @param {ChoiceRow | FlagRow} row @returns {Part} */
  function choice(row) {
    const id = `growth-${row.key}`;
    const input = row.flag ? el("input", { type: "checkbox", id })
      : el("select", { id }, optionsOf(row.choices.map((value) => [value])));
    const now = () => ("checked" in input ? input.checked : input.value);
    input.addEventListener("change", () => app.store.change(row.label.toLowerCase(), (state) => tree.write(state, row, now())));
    return {
      box: labelled(id, row, input),
      show(state) {
        Object.assign(input, { [row.flag ? "checked" : "value"]: tree.valueOf(state, row), disabled: !app.live });
      },
    };
  }

  function show() {
    const state = app.store.get();
    const found = app.answers.live?.growth;
    if (!found) return;
    for (const part of parts) part.show(state);
    text.textContent = `In force: ${found.text}.`;
    const changed = Object.keys(state.growth).length;
    origin.textContent = changed ? `${changed} changed here; not part of the design's file.`
      : found.trained ? "As this design was trained." : "The defaults.";
    reset.disabled = !app.live || !changed;
  }

  app.onAnswer("live", show);
  app.store.subscribe(show);
}
