// Elements from code: no markup is ever put together from texts of the user.

const SVG = "http://www.w3.org/2000/svg";

function filled(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "value") node.value = value;
    else if (name === "class") node.setAttribute("class", value);
    else node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

/** Return an element; names that begin with "on" are listeners. */
export function el(tag, attributes, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

const BLOCKS = {
  answer: (one) => el("p", { class: `answer ${one.tone}` }, one.text),
  text: (one) => el("p", {}, one.text),
  remark: (one) => el("p", { class: one.weight }, `${one.weight} ${one.text}`, el("ul", {}, ...one.more.map((line) => el("li", {}, line)))),
  facts: (one) => el("dl", {}, ...one.rows.flatMap(([name, value, detail]) => [
    el("dt", {}, name), el("dd", { title: detail }, value),
  ])),
  table: (one) => el("table", {}, el("caption", {}, one.caption),
    el("tr", {}, ...one.headings.map((word) => el("th", {}, word))),
    ...one.rows.map((row) => el("tr", {}, ...row.map((cell) => el("td", {}, cell))))),
};

/** Return the blocks of a result as elements: a kind each, whatever they are about. */
export function shownBlocks(blocks) {
  return blocks.map((one) => BLOCKS[one.kind](one));
}

/** Return an element of an SVG. */
export function svgEl(tag, attributes, ...children) {
  return filled(document.createElementNS(SVG, tag), attributes, children);
}

/** Replace what is in an SVG node by the elements of an SVG text that the server made. */
export function fillSvg(node, text) {
  const parsed = new DOMParser().parseFromString(`<svg xmlns="${SVG}">${text}</svg>`, "image/svg+xml");
  node.replaceChildren(...document.importNode(parsed.documentElement, true).childNodes);
}

/** Return a number as text with at most so many digits after the point, without idle zeros. */
export function number(value, digits = 2) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const text = Number(value).toFixed(digits);
  return digits && text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}

/** Return a function that runs `fn` once the calls have paused for so long. */
export function paused(fn, wait_ms) {
  let timer = 0;
  return (...values) => {
    clearTimeout(timer);
    timer = setTimeout(() => fn(...values), wait_ms);
  };
}

/** Return the value at a dotted key, `level.0.length`. */
export function valueAt(tree, key) {
  return key.split(".").reduce((node, part) => node?.[part], tree);
}

/** Set the value at a dotted key. */
export function setAt(tree, key, value) {
  const parts = key.split(".");
  const last = parts.pop();
  parts.reduce((node, part) => node[part], tree)[last] = value;
}
