// Elements from code: no markup is ever put together from texts of the user.

const COPIED_MS = 1500;
const SVG = "http://www.w3.org/2000/svg";

/**
 * @template {Element} N
 * @param {N} node
 * @param {Record<string, unknown>} attributes
 * @param {Child[]} children
 * @returns {N}
 */
function filled(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), /** @type {EventListener} */ (value));
    else if (name === "value") Object.assign(node, { value });
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

/** Show a share of a phase; null: nothing is counted. @param {HTMLProgressElement} bar @param {number | null} share */
export function showShare(bar, share) {
  if (share === null) bar.removeAttribute("value");
  else bar.value = share;
}

/**
 * Return an element; names that begin with "on" are listeners.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Attributes<HTMLElementEventMap>} attributes
 * @param {...Child} children
 */
export function el(tag, attributes = {}, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

/** Return a button. @param {Child} content @param {(event: MouseEvent) => unknown} onclick */
export const button = (content, onclick, attributes = {}) => el("button", { type: "button", onclick, ...attributes }, content);

/** Return the options of a select: values, and their words where these differ. @param {readonly (readonly string[])[]} entries */
export const optionsOf = (entries) => entries.map(([value, words = value]) => el("option", { value }, words));

/** Where arrow keys go, up counted positive. @type {Record<string, Place | undefined>} */
export const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/**
 * Return a command that can be copied.
 * @param {App} app
 * @param {string} what is copied
 */
export function copyable(app, what) {
  const text = el("code", { class: "command", tabindex: 0, "aria-label": `Command ${what}` });
  const copy = button("Copy", async () => {
    try {
      await navigator.clipboard.writeText(text.textContent);
      copy.textContent = "Copied";
      setTimeout(() => { copy.textContent = "Copy"; }, COPIED_MS);
    } catch {
      getSelection()?.selectAllChildren(text);
      app.say("The command is selected: copy it by hand");
    }
  }, { "aria-label": `Copy the command ${what}` });
  return { text, copy };
}

/** @param {Block} one */
function shownBlock(one) {
  switch (one.kind) {
    case "answer": return el("p", { class: `answer ${one.tone}` }, one.text);
    case "text": return el("p", {}, one.text);
    case "remark": return el("p", { class: one.weight }, `${one.weight} ${one.text}`, el("ul", {}, ...one.more.map((line) => el("li", {}, line))));
    case "facts": return el("dl", {}, ...one.rows.flatMap(([name, value, detail]) => [
      el("dt", {}, name), el("dd", { title: detail }, value),
    ]));
    case "table": return el("table", {}, el("caption", {}, one.caption),
      el("tr", {}, ...one.headings.map((word) => el("th", {}, word))),
      ...one.rows.map((row) => el("tr", {}, ...row.map((cell) => el("td", {}, cell)))));
  }
}

/** Return the blocks of a result as elements: a kind each, whatever they are about. @param {Block[]} blocks */
export const shownBlocks = (blocks) => blocks.map(shownBlock);

/**
 * Return an element of an SVG.
 * @template {keyof SVGElementTagNameMap} K
 * @param {K} tag
 * @param {Attributes<SVGElementEventMap>} attributes
 * @param {...Child} children
 */
export function svgEl(tag, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, tag), attributes, children);
}

/** Replace what is in an SVG node by the elements of an SVG text that the server made. @param {Element} node @param {string} text */
export function fillSvg(node, text) {
  const parsed = new DOMParser().parseFromString(`<svg xmlns="${SVG}">${text}</svg>`, "image/svg+xml");
  node.replaceChildren(...document.importNode(parsed.documentElement, true).childNodes);
}

/** Return a number as text with at most so many digits after the point, without idle zeros. @param {number | null} [value] */
export function number(value, digits = 2) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const text = value.toFixed(digits);
  return digits && text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}

/** Return round values within a range, about so many, and their digits. @param {number} low @param {number} high @param {number} about */
export function ticks(low, high, about) {
  const span = high - low || Math.abs(high) || 1;
  const rough = span / about;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10) * power;
  const values = [];
  for (let at = Math.ceil(low / step - 1e-9); at * step <= high + 1e-9 * span; at += 1) values.push(at * step);
  return { values, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

/** @param {number} count @param {string} word */
export const counted = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;

/**
 * Return a function that runs `fn` once the calls have paused for so long.
 * @template {unknown[]} V
 * @param {(...values: V) => unknown} fn
 * @param {number} wait_ms
 * @returns {(...values: V) => void}
 */
export function paused(fn, wait_ms) {
  let timer = 0;
  return (...values) => {
    clearTimeout(timer);
    timer = setTimeout(() => fn(...values), wait_ms);
  };
}

const waiting = /** @type {Set<() => void>} */ (new Set());
let holds = false;
for (const name of /** @type {const} */ (["pointerdown", "pointermove", "pointerup", "pointercancel"])) {
  addEventListener(name, (event) => {
    const held = event.buttons !== 0 && name !== "pointercancel";
    if (holds === held || (held && name === "pointermove")) return;
    holds = held;
    for (const run of held ? [] : waiting) run();
    if (!held) waiting.clear();
  }, true);
}

/** Tell whether a hand holds something: then what follows it has the processor to itself. */
export const isHeld = () => holds;

/**
 * Return a function that runs `fn` once the calls have paused for so long and no hand holds anything.
 * @param {() => unknown} fn
 * @param {number} wait_ms
 */
export function rested(fn, wait_ms) {
  const run = paused(() => { if (holds) waiting.add(run); else fn(); }, wait_ms);
  return run;
}

/** Return the value at a dotted key, `level.0.length`. @param {unknown} tree @param {string} key */
export function valueAt(tree, key) {
  return key.split(".").reduce((node, part) => /** @type {Record<string, unknown> | null | undefined} */ (node)?.[part], tree);
}

/** Set the value at a dotted key. @param {object} tree @param {string} key @param {unknown} value */
export function setAt(tree, key, value) {
  const cut = key.lastIndexOf(".");
  Object.assign(/** @type {object} */ (cut < 0 ? tree : valueAt(tree, key.slice(0, cut))), { [key.slice(cut + 1)]: value });
}
