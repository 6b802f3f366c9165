// What part of a drawing is seen: panels share it.

/** How much closer one step brings. */
export const ZOOM = 1.25;

const OUT = 4;
const IN = 500;

/**
 * A view of an SVG: what part of it is seen; zooms about a point, moves, and keeps marks in size.
 * @param {SVGSVGElement} svg
 * @param {(perPx: number) => void} [changed]
 */
export function createView(svg, changed = () => {}) {
  let whole = /** @type {Box} */ ([0, 0, 100, 100]);
  let seen = /** @type {Box | null} */ (null);

  function apply() {
    const [x, y, width, height] = seen ?? whole;
    svg.setAttribute("viewBox", `${x} ${y} ${width} ${height}`);
    const box = svg.getBoundingClientRect();
    const perPx = Math.max(width / Math.max(1, box.width), height / Math.max(1, box.height));
    svg.style.setProperty("--mm-per-px", perPx.toFixed(5));
    changed(perPx);
  }

  const matrix = () => (svg.getScreenCTM() ?? new DOMMatrix()).inverse();

  /** @param {MouseEvent} event @returns {Place} */
  function place(event, from = matrix()) {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(from);
    return [x, y];
  }

  /** @param {number} factor @param {Place} [about] */
  function zoom(factor, about) {
    const [x, y, width, height] = seen ?? whole;
    const [px, py] = about ?? [x + width / 2, y + height / 2];
    const widest = (OUT * whole[2]) / width;
    const closest = whole[2] / (IN * width);
    const by = Math.min(widest, Math.max(closest, factor));
    seen = [px - (px - x) * by, py - (py - y) * by, width * by, height * by];
    apply();
  }

  svg.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1 / ZOOM : ZOOM, place(event));
  }, { passive: false });
  new ResizeObserver(apply).observe(svg);

  return {
    /** Return where on the drawing an event is, by the present matrix or an earlier one. */
    place,
    matrix,
    zoom,
    fit() {
      seen = null;
      apply();
    },
    /** @param {Box} box */
    show(box) {
      seen = box;
      apply();
    },
    /** Take the box of the whole drawing. @param {Box} box */
    whole(box) {
      if (box.every((value, index) => value === whole[index])) return;
      whole = box;
      seen = null;
      apply();
    },
    /** @param {number} dx @param {number} dy */
    move(dx, dy) {
      const [x, y, width, height] = seen ?? whole;
      seen = [x - dx, y - dy, width, height];
      apply();
    },
  };
}
