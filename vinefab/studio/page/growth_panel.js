// The growth options in force, each to be changed: by them every robot of the page is grown.

import { dragSteps, parameter } from "studio/design_panel.js";
import { el } from "studio/dom.js";

export function mount(root, app) {
  const drag = dragSteps();
  const text = el("p", { class: "facts" });
  const origin = el("p", { class: "facts" });
  const reset = el("button", {
    type: "button", onclick: () => app.store.change("usual growth options", (state) => { state.growth = {}; }),
  }, "As usual for this design");
  const usual = () => app.answers.live?.growth?.usual ?? {};
  const tree = {
    valueOf(state, row) {
      const value = state.growth[row.key] ?? app.answers.live?.growth?.values[row.key];
      return Array.isArray(value) ? value[0] : value;
    },
    write(state, row, value) {
      if (value === usual()[row.key]) delete state.growth[row.key];
      else state.growth[row.key] = value;
    },
  };
  const parts = app.hello.growth_form.map((row) => (row.slider ? parameter({ ...row, name: "Growth" }, app, drag, tree) : choice(row)));
  root.append(el("div", { class: "parameters wide-labels" }, ...parts.map((part) => part.line)),
    el("div", { class: "buttons" }, reset), text, origin);

  function choice(row) {
    const id = `growth-${row.key}`;
    const input = row.flag ? el("input", { type: "checkbox", id })
      : el("select", { id }, row.choices.map((value) => el("option", { value }, value)));
    input.addEventListener("change", () => app.store.change(row.label.toLowerCase(), (state) => {
      tree.write(state, row, row.flag ? input.checked : input.value);
    }));
    const show = (state) => {
      input[row.flag ? "checked" : "value"] = tree.valueOf(state, row);
      input.disabled = !app.live;
    };
    return { show, row, line: el("div", { class: "field", "data-about": `${row.label}: ${row.about}` }, el("label", { for: id, title: row.about }, row.label), input) };
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
