// Tools of the map: scale bar, place under the pointer, snapping, measuring, legend; what is chosen, as numbers.

import { button, el, fillSvg, number, optionsOf, svgEl } from "studio/dom.js";

const WIDEST_PX = 110;
const STEPS_MM = [1, 2, 5, 10, 20, 50];
const STEP_DEG = 5;

/** Return the tools: their elements, how a value snaps, and what a drag does while one is on. @param {App} app @param {SVGElement} layer */
export function mapTools(app, layer) {
  const bar = el("span", { class: "scale-bar", role: "img" });
  const cursor = el("output", { class: "cursor" });
  const legend = el("details", { class: "legend" }, el("summary", {}, "Legend"),
    el("ul", { class: "plan" }, app.hello.legend.map(([sign, words]) => {
      const picture = svgEl("svg", { viewBox: "-8 -8 16 16", width: 16, height: 16, "aria-hidden": "true" });
      fillSvg(picture, sign);
      return el("li", {}, picture, words);
    })));
  const step = el("select", { id: "snap" }, optionsOf([["", "off"], ...STEPS_MM.map((mm) => [String(mm), `${mm} mm, ${STEP_DEG}°`])]));
  const measure = button("Measure", () => turn(!isOn()), { "aria-pressed": "false", title: "Drag from one place to another" });
  const isOn = () => measure.getAttribute("aria-pressed") === "true";

  /** @param {boolean} on */
  function turn(on) {
    measure.setAttribute("aria-pressed", String(on));
    if (!on) layer.replaceChildren();
  }

  /** Show the widest bar of 1, 2 or 5 times a power of ten. @param {number} perPx */
  function scale(perPx) {
    const most = WIDEST_PX * perPx;
    const power = 10 ** Math.floor(Math.log10(most));
    const mm = [5, 2, 1].map((factor) => factor * power).find((one) => one <= most);
    if (!mm) return;
    bar.style.width = `${mm / perPx}px`;
    bar.textContent = mm >= 1000 ? `${mm / 1000} m` : `${number(mm, 3)} mm`;
  }

  /** What a hand sets needs no more digits than a laser has. @param {number} value @param {number} size */
  const snapTo = (value, size) => Math.round(100 * (size ? Math.round(value / size) * size : value)) / 100;
  return {
    rulers: el("div", { class: "rulers" }, bar, cursor),
    controls: [el("label", {}, "Snap ", step), measure, legend],
    scale, isOn, turn,
    /** @param {number} value */
    mm: (value) => snapTo(value, Number(step.value)),
    /** @param {number} value */
    deg: (value) => snapTo(value, step.value ? STEP_DEG : 0),
    /** @param {Place} place */
    at([x, y]) { cursor.textContent = `${number(x, 1)}, ${number(-y, 1)} mm`; },
    /** @param {Place} from @param {Place} to */
    draw([x0, y0], [x1, y1]) {
      const [dx, dy] = [x1 - x0, y0 - y1];
      const words = `${number(Math.hypot(dx, dy), 1)} mm, ${number((Math.atan2(dy, dx) * 180) / Math.PI, 1)}°`;
      layer.replaceChildren(
        svgEl("path", { class: "measure", d: `M${x0} ${y0}L${x1} ${y1}` }),
        svgEl("g", { transform: `translate(${x1} ${y1})` }, svgEl("text", { class: "sized", x: 8, y: -8 }, words)),
      );
      cursor.textContent = words;
    },
  };
}

/** Keys of what the server knows, and what the row calls them; lengths are in mm. */
const FIELDS = {
  branch: [], // in their panel
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
    else choose(kind === "target" || kind === "branch" ? { kind, id: rest.join(" ") } : null);
  });
  const gone = button("Delete it", remove);
  const back = button("As in the map", home);
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
     * @param {string[]} branches
     */
    show(chosen, values, count, targets, branches) {
      const names = JSON.stringify([count, targets, branches]);
      if (names !== listed) {
        listed = names;
        const options = [["start", "Start"], ...targets.map((name) => [`target ${name}`, `Target ${name}`]),
          ...Array.from({ length: count }, (_, index) => [`obstacle ${index}`, `Obstacle ${index + 1}`]),
          ...branches.map((name) => [`branch ${name}`, `Branch ${name}`])];
        select.replaceChildren(...optionsOf(options));
      }
      const kind = chosen?.kind ?? "start";
      if (kind !== built) build(kind);
      select.value = chosen ? `${chosen.kind} ${chosen.id}` : "start";
      gone.hidden = kind === "start" || kind === "branch";
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
