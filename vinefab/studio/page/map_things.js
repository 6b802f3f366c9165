// What is chosen on the map, as numbers: the start, an obstacle, a target.

import { el, number } from "studio/dom.js";

/** Keys of what the server knows, and what the row calls them; lengths are in mm. */
const FIELDS = {
  start: [["x_mm", "x"], ["y_mm", "y"], ["heading_deg", "heading °"]],
  obstacle: [["x_mm", "x"], ["y_mm", "y"], ["width_mm", "wide"], ["height_mm", "high"], ["turn_deg", "turned °"]],
  target: [["name", "name"], ["x_mm", "x"], ["y_mm", "y"], ["tolerance_mm", "within"]],
};

/**
 * Return the row of numbers; `change` takes the kind that is chosen and what was typed.
 * @param {App} app
 * @param {{
 *   choose(thing: Chosen): void, remove(): void, home(): void,
 *   change(kind: ThingKind, key: string, value: string | number): void,
 * }} actions
 */
export function thingsRow(app, { choose, change, remove, home }) {
  const select = el("select", { "aria-label": "What is chosen on the map", id: "thing" });
  select.addEventListener("change", () => {
    const [kind, ...rest] = select.value.split(" ");
    if (kind === "obstacle") choose({ kind, id: Number(rest[0]) });
    else choose(kind === "target" ? { kind, id: rest.join(" ") } : null);
  });
  const gone = el("button", { type: "button", onclick: remove }, "Delete it");
  const back = el("button", { type: "button", onclick: home }, "As in the map");
  const box = el("span", { class: "numbers" });
  const row = el("div", { class: "toolbar things" }, select, box, gone, back);
  let built = "";
  let listed = "";
  let inputs = /** @type {Record<string, HTMLInputElement>} */ ({});

  /** @param {ThingKind} kind */
  function build(kind) {
    built = kind;
    inputs = {};
    box.replaceChildren(...FIELDS[kind].map(([key, label]) => {
      const id = `${kind === "start" ? "pose" : kind}-${key}`;
      const input = key === "name" ? el("input", { type: "text", id, maxlength: 40, size: 6 })
        : el("input", { type: "number", step: "any", id });
      input.addEventListener("change", () => {
        const value = key === "name" ? input.value.trim() : Number(input.value);
        if (input.value !== "" && input.validity.valid) change(kind, key, value);
      });
      inputs[key] = input;
      return el("label", { title: key.endsWith("_mm") ? "mm" : "" }, `${label} `, input);
    }));
  }

  return {
    row,
    /**
     * Show what is chosen and its values; `count` obstacles and targets are there.
     * @param {Chosen} chosen
     * @param {ThingValues} values
     * @param {number} count
     * @param {string[]} targets
     */
    show(chosen, values, count, targets) {
      const names = JSON.stringify([count, targets]);
      if (names !== listed) {
        listed = names;
        const options = [["start", "Start"], ...targets.map((name) => [`target ${name}`, `Target ${name}`]),
          ...Array.from({ length: count }, (_, index) => [`obstacle ${index}`, `Obstacle ${index + 1}`])];
        select.replaceChildren(...options.map(([value, text]) => el("option", { value }, text)));
      }
      const kind = chosen?.kind ?? "start";
      if (kind !== built) build(kind);
      select.value = chosen ? `${chosen.kind} ${chosen.id}` : "start";
      gone.hidden = kind === "start";
      back.hidden = kind !== "start";
      for (const part of [gone, back]) part.disabled = !app.live;
      for (const [key, input] of Object.entries(inputs)) {
        const value = values?.[key];
        if (document.activeElement !== input) input.value = String(typeof value === "number" ? Number(number(value, 2)) : value ?? "");
        input.disabled = !app.live || value === undefined;
      }
    },
  };
}
