// Tools over the map: scale bar, place under the pointer, steps to snap to, measure, legend.

import { el, fillSvg, number, svgEl } from "studio/dom.js";

const WIDEST_PX = 110;
const STEPS_MM = [1, 2, 5, 10, 20, 50];
const STEP_DEG = 5;

/** What a hand sets needs no more digits than a laser has. @param {number} value */
const hundredth = (value) => Math.round(100 * value) / 100;

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
  const step = el("select", { id: "snap" }, [["", "off"], ...STEPS_MM.map((mm) => [String(mm), `${mm} mm, ${STEP_DEG}°`])]
    .map(([value, text]) => el("option", { value }, text)));
  const measure = el("button", { type: "button", "aria-pressed": "false", title: "Drag from one place to another" }, "Measure");
  measure.addEventListener("click", () => turn(!isOn()));
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

  /** @param {number} value @param {number} size */
  const snapTo = (value, size) => hundredth(size ? Math.round(value / size) * size : value);
  return {
    overlay: [legend, el("div", { class: "rulers" }, bar, cursor)],
    controls: [el("label", {}, "Snap ", step), measure],
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
