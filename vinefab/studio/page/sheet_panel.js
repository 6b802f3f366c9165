// The sheet: what is cut, with findings in place; pressure, film and time; the fix with its preview.

import { deployedView, patternOf } from "studio/deployed.js";
import { button, counted, el, fillSvg, isHeld, number, optionsOf, showShare, svgEl } from "studio/dom.js";
import { isStale, problemOf } from "studio/connection.js";
import { createView } from "studio/view.js";

const STILL_MS = 150;
const RESTED_MS = 250; // longer than a hand stands still where it turns back
const HELD_MS = 1000; // a hand that rests so long waits for the rules
const ZOOM = 1.4;
const STEP_PX = 40;
const NEAR_MM = 60; // no less is looked at
const FAR_MM = 220; // a finding that marks more is looked at around its place
const RIM_MM = 15;
const KINDS = [["branches", "branches"], ["length", "lengths"], ["angle", "angles"], ["width", "widths"]];
const WORDS = { error: "error", warning: "warning", info: "note" };

/** What the rules depend on, of a state. @param {StudioState} state */
const concern = ({ design, map, pose, recipe, recipe_stamp, growth }) =>
  JSON.stringify([design, map, pose, recipe, recipe_stamp, growth]);
/** @param {number} value @param {string} unit */
const measure = (value, unit, digits = 2) => `${number(value, digits)}${unit ? ` ${unit}` : ""}`;

/** Return the first branches by name. @param {string[]} branches */
function who(branches) {
  return branches.length ? ` ${branches.slice(0, 3).join(", ")}${branches.length > 3 ? ", …" : ""}` : "";
}

/** @param {number} share */
function percent(share) {
  return `${(100 * Math.min(1, Math.max(0, share))).toFixed(2)}%`;
}

// ---- the drawing

/** Kinds of lines, and what they are called. @type {Record<string, string>} */
const LAYERS = { weld: "weld", weldcut: "weld and cut", cut: "cut", mark: "mark", reg: "registration", doc: "labels", finding: "findings" };

/** Return what is to be seen of the job: a box for each layer that it has, and a choice of a piece. @param {Element} job */
function layersView(job) {
  const off = /** @type {Set<string>} */ (new Set());
  const piece = el("select", { id: "sheet-piece", "aria-label": "Pieces shown" });
  const boxes = el("div", { class: "toolbar" });
  const box = el("details", { class: "layers", id: "layers" }, el("summary", {}, "Layers"), boxes, piece);
  let built = "";
  piece.addEventListener("change", apply);

  const parts = () => [...job.querySelectorAll("path[data-piece], .finding")];
  const layerOf = (/** @type {Element} */ part) => part.classList[0];
  const pieceOf = (/** @type {Element} */ part) => part.getAttribute("data-piece") ?? "";

  function apply() {
    for (const part of parts()) {
      const isOther = piece.value !== "" && ![piece.value, ""].includes(pieceOf(part));
      part.toggleAttribute("hidden", off.has(layerOf(part)) || isOther);
    }
  }

  /** Offer what the drawing has now, and hide again what was hidden. */
  function follow() {
    const kinds = Object.keys(LAYERS).filter((kind) => parts().some((part) => layerOf(part) === kind));
    const names = [...new Set(parts().map(pieceOf).filter(Boolean))];
    if (built !== JSON.stringify([kinds, names])) {
      built = JSON.stringify([kinds, names]);
      boxes.replaceChildren(...kinds.map((kind) => {
        const input = el("input", { type: "checkbox", checked: !off.has(kind), "data-layer": kind });
        input.addEventListener("change", () => {
          off[input.checked ? "delete" : "add"](kind);
          apply();
        });
        return el("label", {}, input, ` ${LAYERS[kind]}`);
      }));
      piece.replaceChildren(...optionsOf([["", "all pieces"], ...names.map((name) => [name, `piece ${name}`])]));
      piece.hidden = names.length < 2;
    }
    apply();
  }
  return { box, follow };
}

/** Return the drawing of the sheet and how to draw in it. @param {(index: number) => void} onMarker takes the finding that is chosen */
function sheetView(onMarker) {
  const layer = (/** @type {string} */ name) => svgEl("g", { class: name });
  const layers = { beds: layer("beds"), ghost: layer("ghost"), outline: layer("outline"), job: layer("job") };
  const svg = svgEl("svg", {
    class: "sheet-drawing", tabindex: 0, role: "group", id: "sheet-drawing",
    "aria-label": "Sheet with findings. Plus and minus zoom, arrow keys move, 0 shows all of it.",
  }, ...Object.values(layers));
  const view = createView(svg);
  const shown = layersView(layers.job);
  let dragged = /** @type {Place | null} */ (null);
  let moved = false;
  const findingOf = (/** @type {Element} */ marker) => Number(marker.getAttribute("data-finding"));

  function perPx() {
    return Number(svg.style.getPropertyValue("--mm-per-px")) || 1;
  }

  /** Choose the finding under the pointer; of several, the one after that which is selected. @param {PointerEvent} event */
  function choose(event) {
    if (moved) return;
    const under = document.elementsFromPoint(event.clientX, event.clientY).map((node) => node.closest("[data-finding]"));
    const markers = [...new Set(under)].filter((marker) => marker !== null).filter((marker) => svg.contains(marker))
      .sort((one, two) => findingOf(one) - findingOf(two));
    if (!markers.length) return;
    const place = markers.findIndex((marker) => marker.classList.contains("selected"));
    onMarker(findingOf(markers[(place + 1) % markers.length]));
  }

  svg.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    moved = false;
    dragged = [event.clientX, event.clientY];
  });
  svg.addEventListener("pointermove", (event) => {
    if (!dragged) return;
    const [dx, dy] = [event.clientX - dragged[0], event.clientY - dragged[1]];
    if (!moved && Math.hypot(dx, dy) < 4) return;
    if (!moved) svg.setPointerCapture(event.pointerId);
    moved = true;
    view.move(dx * perPx(), dy * perPx());
    dragged = [event.clientX, event.clientY];
  });
  // Not "click": a browser sends none where an answer redraws the finding while it is pressed.
  svg.addEventListener("pointerup", (event) => {
    if (dragged) choose(event);
    dragged = null;
  });
  svg.addEventListener("pointercancel", () => { dragged = null; });
  svg.addEventListener("keydown", (event) => {
    const marker = event.target instanceof Element && event.target.closest("[data-finding]");
    if (marker && (event.key === "Enter" || event.key === " ")) {
      event.preventDefault();
      onMarker(findingOf(marker));
      return;
    }
    const step = STEP_PX * perPx();
    /** @type {Record<string, () => void>} */
    const actions = {
      "+": () => view.zoom(1 / ZOOM), "=": () => view.zoom(1 / ZOOM), "-": () => view.zoom(ZOOM), 0: () => view.fit(),
      ArrowLeft: () => view.move(step, 0), ArrowRight: () => view.move(-step, 0),
      ArrowUp: () => view.move(0, step), ArrowDown: () => view.move(0, -step),
    };
    if (!actions[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    actions[event.key]();
  });

  /** Where the flat layout lies on the sheet, as a transform; null where pieces lie apart. @param {RulesAnswer | null} rules */
  function onSheet(rules) {
    const place = rules?.placement;
    return place ? `translate(${place.dx_mm} ${-place.dy_mm}) rotate(${-place.rotation_deg})` : null;
  }

  /** @param {Element} layer @param {string | undefined} outline @param {string | null} transform */
  function flat(layer, outline, transform) {
    fillSvg(layer, outline ?? "");
    if (transform) layer.setAttribute("transform", transform);
    else layer.removeAttribute("transform");
  }

  /** @param {number[]} corners */
  function around([x0, y0, x1, y1]) {
    view.whole([x0 - RIM_MM, -y1 - RIM_MM, x1 - x0 + 2 * RIM_MM, y1 - y0 + 2 * RIM_MM]);
  }

  return {
    svg,
    view,
    layers: shown.box,
    /** Draw the job that the rules were applied to, with its findings. @param {RulesAnswer} rules @param {string} [ghost] */
    job(rules, ghost) {
      layers.beds.replaceChildren();
      layers.outline.replaceChildren();
      fillSvg(layers.job, rules.sheet_svg);
      shown.follow();
      const transform = onSheet(rules);
      flat(layers.ghost, transform ? ghost : "", transform);
      if (rules.sheet_box) view.whole(rules.sheet_box);
    },
    /**
     * Draw the flat outline that follows the pointer, on the bed of the last job if there is one.
     * @param {Answers["cut"]} cut
     * @param {RulesAnswer | null} rules
     * @param {string} [ghost]
     */
    outline(cut, rules, ghost) {
      const transform = onSheet(rules);
      layers.job.replaceChildren();
      fillSvg(layers.beds, transform && rules ? rules.beds_svg : "");
      flat(layers.ghost, ghost, transform);
      flat(layers.outline, cut.outline_svg, transform);
      if (transform && rules?.sheet_box) view.whole(rules.sheet_box);
      else if (cut.outline_box) around(cut.outline_box);
    },
    /** Draw the inflated body over the flat outline, without a bed. @param {Answers["inflated"]} found */
    inflated(found) {
      for (const layer of [layers.beds, layers.job, layers.ghost]) layer.replaceChildren();
      flat(layers.outline, found.svg, null);
      around(found.box);
    },
    /** Mark one finding, and look at its place. @param {number} index @param {boolean} look */
    select(index, look) {
      for (const marker of layers.job.querySelectorAll("[data-finding]")) {
        marker.classList.toggle("selected", findingOf(marker) === index);
      }
      const marker = layers.job.querySelector(`[data-finding="${index}"]`);
      if (!marker) return;
      layers.job.append(marker); // on top of the others
      if (!look) return;
      const marked = /** @type {NodeListOf<SVGGraphicsElement>} */ (marker.querySelectorAll(".marked"));
      const parts = [...marked].map((part) => part.getBBox());
      const sign = marker.querySelector("g")?.transform.baseVal.consolidate()?.matrix;
      if (sign) parts.push(new DOMRect(sign.e, sign.f));
      const x0 = Math.min(...parts.map((box) => box.x));
      const y0 = Math.min(...parts.map((box) => box.y));
      const x1 = Math.max(...parts.map((box) => box.x + box.width));
      const y1 = Math.max(...parts.map((box) => box.y + box.height));
      const size = Math.min(FAR_MM, Math.max(NEAR_MM, 1.4 * (x1 - x0), 1.4 * (y1 - y0)));
      const [x, y] = sign && size === FAR_MM ? [sign.e, sign.f] : [(x0 + x1) / 2, (y0 + y1) / 2];
      view.show([x - size / 2, y - size / 2, size, size]);
    },
  };
}

// ---- pressure, film, time

/** Return what growth needs, the working pressure and what the film may take, as a bar and words. @param {Gauge} gauge */
function gaugeView(gauge) {
  const { needed_loose: loose, needed_tight: tight, working_kpa: working, allowed_kpa: allowed } = gauge;
  const top = 1.15 * Math.max(tight.kpa, working, allowed, 1);
  const at = (/** @type {number} */ kpa) => percent(kpa / top);
  /** @param {number} from @param {number} to */
  const wide = (from, to) => percent(Math.max(0, to - from) / top);
  const aria = `Needed ${number(loose.kpa, 1)} to ${number(tight.kpa, 1)} kPa, working ${number(working, 1)} kPa, allowed ${number(allowed, 1)} kPa`;
  const bar = svgEl("svg", { class: "gauge", role: "img", width: "100%", height: 34, "aria-label": aria },
    svgEl("rect", { class: "track", x: 0, y: 10, width: "100%", height: 14, rx: 2 }),
    svgEl("rect", { class: "beyond", x: at(allowed), y: 10, width: wide(allowed, top), height: 14 }),
    svgEl("rect", { class: "needed", x: 0, y: 13, width: at(loose.kpa), height: 8 }),
    svgEl("rect", { class: "needed tight", x: at(loose.kpa), y: 13, width: wide(loose.kpa, tight.kpa), height: 8 }),
    svgEl("line", { class: "allowed", x1: at(allowed), x2: at(allowed), y1: 6, y2: 28 }),
    svgEl("line", { class: "working", x1: at(working), x2: at(working), y1: 2, y2: 32 }),
  );
  /** @param {string} name @param {string} value @param {string} standing */
  const row = (name, value, standing) => [
    el("dt", { class: name }, name), el("dd", {}, value, el("span", { class: "standing" }, standing)),
  ];
  const [kind, words] = gaugeVerdict(gauge);
  return el("figure", { class: "pressure" },
    el("figcaption", {}, "Pressure ", el("b", { class: kind }, words)),
    bar,
    el("dl", {},
      ...row("needed", `${number(loose.kpa, 1)}–${number(tight.kpa, 1)} kPa`, gauge.needed_standing),
      ...row("working", measure(working, "kPa", 1), gauge.working_standing),
      ...row("allowed", measure(allowed, "kPa", 1), gauge.allowed_standing),
    ),
    el("details", {}, el("summary", {}, "Where these come from"),
      el("p", {}, `Needed: tip ${loose.branch} ${loose.place}; ${gauge.needed_basis}`),
      el("p", {}, `Allowed: ${gauge.allowed_basis}`)),
  );
}

/** Return the kind of news and its words. @param {Gauge} gauge */
function gaugeVerdict(gauge) {
  if (!gauge.is_open) return ["bad", "✕ growth needs more than the film may take"];
  if (gauge.working_kpa > gauge.allowed_kpa) return ["bad", "✕ the working pressure is more than allowed"];
  if (gauge.working_kpa < gauge.needed_loose.kpa) return ["poor", `▲ the working pressure is too low for tip ${gauge.needed_loose.branch}`];
  return gauge.is_open_tight ? ["good", "✓ enough"] : ["poor", "▲ enough if film is stored loosely"];
}

/** Return film, sheet, pieces and time, each with its standing, and every line of the bill folded. @param {RulesAnswer} answer */
function billView(answer) {
  const line = new Map(answer.bill.map((each) => [each.item, each]));
  /** @param {string} name @param {string} text @param {{ standing: string, basis: string }} source */
  const row = (name, text, { standing, basis }) => [
    el("dt", {}, name), el("dd", { title: basis }, text, el("span", { class: "standing" }, standing)),
  ];
  const rows = [];
  const film = line.get("film in branches");
  if (film) rows.push(...row("branches", `${number(film.value / 1000, 2)} m`, film));
  const area = line.get("film area, all plies");
  const [wide, high, total] = [line.get("film width"), line.get("film height"), line.get("machine time, total")];
  if (area && wide && high && total) {
    const sheets = answer.sheets > 1 ? `${answer.sheets} × ` : "";
    rows.push(
      ...row("film", `${number(area.value, 0)} cm²`, area),
      ...row("sheet", `${sheets}${number(wide.value, 0)} × ${number(high.value, 0)} mm`, wide),
      ...row("to cut", `${number(total.value / 60, 1)} min`, total),
    );
  }
  const tiles = answer.tiles ? `, in ${answer.tiles} tiles` : "";
  rows.push(...row("pieces", `${answer.pieces_words}${tiles}`, { standing: "computed", basis: "" }));
  const full = answer.bill.map((each) => el("tr", {},
    el("th", { scope: "row" }, each.item), el("td", {}, measure(each.value, each.unit === "1" ? "" : each.unit)),
    el("td", {}, each.standing), el("td", {}, each.basis)));
  return el("div", { class: "bill" },
    el("dl", {}, ...rows),
    el("details", {}, el("summary", {}, `All ${answer.bill.length} lines`),
      el("table", {}, el("tbody", {}, ...full))));
}

// ---- the panel

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  root.classList.add("sheet-panel");
  const verdict = el("p", { class: "verdict", id: "verdict", role: "status", "aria-live": "polite" });
  const busy = el("span", { class: "busy", "aria-hidden": "true" });
  const drawing = sheetView((index) => choose(index, false));
  const gauge = el("div", { id: "gauge" });
  const bill = el("div", { id: "bill" });
  const list = el("ol", { class: "findings", id: "findings", "aria-label": "Findings" });
  const more = el("div", { class: "more" });
  const fix = fixView(app, () => answer);
  const deployed = deployedView(app, () => draw());
  root.append(
    el("div", { class: "top" },
      el("div", { class: "head" }, verdict, busy),
      el("div", { class: "toolbar" },
        button("+", () => drawing.view.zoom(1 / ZOOM), { "aria-label": "Zoom in on the sheet" }),
        button("−", () => drawing.view.zoom(ZOOM), { "aria-label": "Zoom out of the sheet" }),
        button("Whole sheet", () => drawing.view.fit()),
        deployed.toggle,
        el("span", { class: "gap" }), fix.start),
      drawing.svg, drawing.layers),
    deployed.box, fix.box, gauge, bill, list, more,
  );

  let answer = /** @type {RulesAnswer | null} */ (null);
  let answered = "";
  let asked = "";
  let timer = 0;
  let cut = /** @type {Answers["cut"] | null} */ (null);
  let cutAsked = "";
  let cutTimer = 0;
  let cutFrame = 0;
  let present = /** @type {Answers["cut"] | null} */ (null);
  let selected = /** @type {string | null} */ (null); // fingerprint
  let waiving = "";

  // ---- asking

  function isFresh() {
    return answer !== null && answered === concern(app.shown());
  }

  function ask() {
    clearTimeout(timer);
    timer = 0;
    const state = app.shown();
    const wanted = concern(state);
    if (!app.live || wanted === asked || wanted === answered) return;
    asked = wanted;
    app.ask("rules", {}, { state }).then(() => { asked = ""; }, (error) => {
      if (asked === wanted) asked = "";
      if (isStale(error) || wanted !== concern(app.shown())) return;
      answered = "";
      verdict.textContent = problemOf(error) || "the rules could not be run";
      verdict.dataset.kind = "error";
      busy.textContent = "";
    });
  }

  /** Ask for the flat outline and angles. */
  async function askCut() {
    const state = app.shown();
    const wanted = patternOf(state);
    if (!app.live || wanted === cutAsked) return;
    cutAsked = wanted;
    try {
      await app.ask("cut", {}, { state });
    } catch (error) {
      if (cutAsked === wanted) cutAsked = "";
      app.fail(error);
    }
  }

  /** Ask when the state has been still for a while: a robot that is dragged has the processor to itself. */
  function follow() {
    clearTimeout(cutTimer);
    cancelAnimationFrame(cutFrame);
    // Moves that came while the page was drawing are heard before the next frame.
    if (isHeld()) cutTimer = setTimeout(() => { cutFrame = requestAnimationFrame(askCut); }, RESTED_MS);
    else askCut();
    deployed.follow();
    showFreshness();
    if (!app.live || isFresh()) return;
    clearTimeout(timer);
    timer = setTimeout(ask, isHeld() ? HELD_MS : STILL_MS);
  }

  function showFreshness() {
    const stale = !isFresh() && app.live;
    root.classList.toggle("stale", stale);
    root.classList.toggle("previewing", Boolean(app.previewed));
    root.setAttribute("aria-busy", String(stale));
    busy.textContent = stale ? "checking" : "";
    fix.follow(stale);
  }

  // ---- drawing

  function draw() {
    const ghost = app.previewed ? present?.outline_svg : "";
    const inflated = deployed.shown();
    if (inflated) return drawing.inflated(inflated);
    if (answer?.sheet_svg && isFresh()) drawing.job(answer, ghost);
    else if (cut?.outline_svg) drawing.outline(cut, answer, ghost);
    else if (answer?.sheet_svg) drawing.job(answer, ghost);
    const index = answer?.findings.findIndex((finding) => finding.fingerprint === selected) ?? -1;
    drawing.select(index, false);
  }

  /** @param {RulesAnswer} found */
  function show(found) {
    const { manufacturable, errors, warnings } = found;
    const words = manufacturable ? "✓ manufacturable" : "✕ not manufacturable";
    const text = `${words}: ${counted(errors, "error")}, ${counted(warnings, "warning")}`;
    if (verdict.textContent !== text) verdict.textContent = text;
    verdict.dataset.kind = manufacturable ? (warnings ? "warning" : "ok") : "error";
    gauge.replaceChildren(gaugeView(found.gauge));
    bill.replaceChildren(billView(found));
    if (selected !== null && !found.findings.some((finding) => finding.fingerprint === selected)) {
      selected = null;
      app.highlight([]);
    }
    showList(found);
    more.replaceChildren(...skippedView(found));
  }

  /** @param {RulesAnswer} found */
  function showList({ findings, signs }) {
    const focused = document.activeElement?.closest("#findings li")?.getAttribute("data-key");
    const items = findings.map((finding, index) => findingView(finding, index, signs[finding.severity]));
    list.replaceChildren(...items);
    if (!items.length) list.append(el("li", { class: "none" }, "No findings"));
    if (focused) items.find((item) => item.dataset.key === focused)?.querySelector("button")?.focus();
  }

  // ---- findings

  /** @param {Finding} finding @param {number} index @param {string} path of its sign */
  function findingView(finding, index, path) {
    const isOpen = finding.fingerprint === selected;
    const word = finding.waived ? "waived" : WORDS[finding.severity];
    const sign = svgEl("svg", { class: `mark ${finding.severity}`, viewBox: "-8 -8 16 16", width: 14, height: 14, "aria-hidden": "true" },
      svgEl("path", { class: "sign", d: path }));
    const head = button([sign, el("span", { class: "word" }, word), el("span", { class: "rule" }, finding.rule), el("span", { class: "title" }, finding.title, el("span", { class: "who" }, who(finding.names.length ? finding.names : finding.branches)))],
      () => choose(index, true), { "aria-expanded": String(isOpen), class: "finding-head" });
    return el("li", { class: `${finding.severity}${finding.waived ? " waived" : ""}${isOpen ? " open" : ""}`, "data-key": `${index} ${finding.fingerprint}`, "data-rule": finding.rule },
      head, isOpen ? detailView(finding) : null);
  }

  /** @param {Finding} finding */
  function detailView(finding) {
    const rows = /** @type {Element[]} */ ([]);
    /** @param {string} name @param {string} text */
    const row = (name, text) => rows.push(el("dt", {}, name), el("dd", {}, text));
    if (finding.measured !== null) row("measured", measure(finding.measured, finding.unit, 3));
    if (finding.limit !== null) row("limit", measure(finding.limit, finding.unit, 3));
    if (finding.branches.length) row("branches", (finding.names.length ? finding.names : finding.branches).join(", "));
    row("place", finding.at_mm ? `${number(finding.at_mm[0], 1)}, ${number(finding.at_mm[1], 1)} mm on the sheet` : "the whole robot");
    row("why", finding.reason);
    if (finding.waived) row("waived", finding.waiver_reason);
    return el("div", { class: "detail" }, el("p", {}, finding.message), el("dl", {}, ...rows),
      app.live ? waiverView(finding) : null);
  }

  /** @param {number} index @param {boolean} look */
  function choose(index, look) {
    const finding = answer?.findings[index];
    if (!answer || !finding) return;
    const isOpen = finding.fingerprint === selected;
    selected = isOpen ? null : finding.fingerprint;
    waiving = "";
    showList(answer);
    drawing.select(isOpen ? -1 : index, look && !isOpen);
    app.highlight(isOpen ? [] : finding.branches);
    const item = list.children[index];
    if (!isOpen && !look) item?.scrollIntoView({ block: "nearest" });
    if (look) item?.querySelector("button")?.focus();
  }

  /** Open the form for the reason of a waiver, or close it. @param {string} name */
  function startWaiving(name) {
    waiving = name;
    if (answer) showList(answer);
  }

  /** @param {Finding} finding */
  function waiverView(finding) {
    const name = finding.fingerprint;
    if (finding.waived) {
      return el("div", { class: "buttons" }, button("Take the waiver back", () => dropWaiver(name)));
    }
    if (waiving !== name) {
      return el("div", { class: "buttons" }, button("Waive", () => {
        startWaiving(name);
        list.querySelector("input")?.focus();
      }));
    }
    const reason = el("input", { type: "text", required: true, maxlength: 500, "aria-label": `Reason to waive ${finding.rule}`, placeholder: "Why this is fine here" });
    const form = el("form", { class: "waive" }, reason,
      el("button", { type: "submit", class: "primary" }, "Waive"),
      button("Cancel", () => startWaiving("")));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const words = reason.value.trim();
      if (!words) return;
      waiving = "";
      app.store.change(`waive ${finding.rule}`, (state) => {
        state.design.waive = (state.design.waive ?? []).filter((one) => one.fingerprint !== name);
        state.design.waive.push({ fingerprint: name, reason: words });
      });
    });
    return form;
  }

  /** @param {string} name */
  function dropWaiver(name) {
    app.store.change("take a waiver back", (state) => {
      state.design.waive = (state.design.waive ?? []).filter((one) => one.fingerprint !== name);
    });
  }

  /** @param {RulesAnswer} shown */
  function skippedView(shown) {
    const parts = [];
    if (shown.findings_left_out) parts.push(el("p", {}, `and ${shown.findings_left_out} more findings that are not listed`));
    for (const name of shown.stale_waivers) {
      parts.push(el("p", { class: "stale-waiver" }, `Waiver ${name} names no finding. `, app.live ? button("Remove it", () => dropWaiver(name)) : null));
    }
    if (shown.deployed_problem) parts.push(el("p", { class: "note warning" }, shown.deployed_problem));
    for (const { rule, note } of shown.notes) parts.push(el("p", { class: "note" }, `${rule}: ${note}`));
    const skipped = shown.rules_skipped;
    parts.push(el("details", {},
      el("summary", {}, `${shown.rules_run} rules run, ${skipped.length} skipped`),
      el("ul", {}, ...skipped.map(({ rule, reason }) => el("li", {}, `${rule}: ${reason}`)))));
    return parts;
  }

  // ---- following

  app.onAnswer("rules", (found, state) => {
    if (app.live && concern(state) !== concern(app.shown())) return;
    answer = found;
    answered = concern(app.live ? state : app.shown());
    showFreshness();
    show(found);
    draw();
  });
  app.onAnswer("cut", (found, state) => {
    if (JSON.stringify(state.design) === JSON.stringify(app.store.get().design)) present = found;
    cut = found;
    if (!isFresh()) draw();
  });
  app.onProgress("rules", (_, text) => { if (!isFresh()) busy.textContent = `checking: ${text}`; });
  app.store.subscribe(() => { follow(); });
  app.onPreview((design) => { fix.previewed(design); follow(); draw(); });
  for (const name of ["pointerup", "keyup", "change"]) addEventListener(name, () => { // released: at once
      askCut();
      if (timer) ask();
    }, true);
  app.on("again", () => { asked = cutAsked = ""; askCut(); ask(); });
  follow();
  ask();
}

// ---- the fix

/** @param {App} app @param {() => RulesAnswer | null} rules */
function fixView(app, rules) {
  const start = button("Fix", run, { id: "fix", class: "primary" });
  const box = el("section", { class: "fix", "aria-label": "Fix", hidden: true });
  const bar = el("progress", { max: 1, value: 0, "aria-label": "Fixing" });
  const step = el("span", { class: "step" });
  let running = false;
  let proposal = /** @type {Design | null} */ (null);
  let base = "";
  const keep = /** @type {Set<string>} */ (new Set());

  /** @param {boolean} stale */
  function follow(stale) {
    const shown = rules();
    const hasErrors = Boolean(shown && shown.errors > 0);
    start.disabled = !app.live || stale || running || !hasErrors || Boolean(proposal);
    start.title = !app.live ? "a snapshot: nothing is computed anew" : hasErrors || stale
      ? "Find the smallest change that clears the errors; nothing is taken without you"
      : "No errors: nothing to fix";
    if (proposal && concern(app.store.get()) !== base) end("The design changed: the proposed fix was dropped");
  }

  /** @param {Design | null} design */
  function previewed(design) {
    if (proposal && design !== proposal) close();
  }

  function close() {
    proposal = null;
    box.hidden = true;
    box.replaceChildren();
    follow(false);
  }

  function end(text = "") {
    close();
    if (app.previewed) app.preview(null);
    if (text) app.say(text);
  }

  async function run() {
    running = true;
    base = concern(app.store.get());
    bar.value = 0;
    step.textContent = "looking for the smallest change";
    const cancel = button("Cancel", () => { app.cancel("fix"); running = false; close(); });
    box.hidden = false;
    box.replaceChildren(el("div", { class: "progress" }, bar, cancel), step);
    follow(false);
    cancel.focus();
    let found = /** @type {FixAnswer | null} */ (null);
    let problem = "";
    try {
      found = await app.ask("fix", { keep: [...keep] }, { state: app.store.get() });
    } catch (error) {
      if (!isStale(error)) problem = problemOf(error) || "no fix was found";
    }
    if (!running) return;
    running = false;
    if (problem) failed([problem]);
    else if (!found) close();
    else if (concern(app.store.get()) !== base) end("The design changed meanwhile: the fix was dropped");
    else if (found.design) show(found, found.design);
    else failed(found.lines, found.keep_words);
  }

  function keepView() {
    return el("fieldset", { class: "keep" }, el("legend", {}, "Keep"), ...KINDS.map(([kind, name]) => {
      const input = el("input", { type: "checkbox", checked: keep.has(kind) });
      input.addEventListener("change", () => { keep[input.checked ? "add" : "delete"](kind); });
      return el("label", {}, input, ` ${name}`);
    }), button("Try again", () => { end(); run(); }));
  }

  /** @param {string[]} lines @param {string[]} words */
  function failed(lines, words = []) {
    const title = el("h3", { tabindex: -1 }, "No fix");
    box.hidden = false;
    box.replaceChildren(
      title,
      ...lines.map((line) => el("p", {}, line)),
      ...words.map((line) => el("p", { class: "note" }, line)),
      keepView(), button("Close", close),
    );
    follow(false);
    title.focus();
  }

  /** @param {FixAnswer} found @param {Design} design */
  function show(found, design) {
    proposal = design;
    app.preview(design);
    const take = button("Take", () => {
      end();
      app.store.change(`fix: ${counted(found.changes.length, "change")}`, (state) => { state.design = structuredClone(design); });
    }, { class: "primary", id: "fix-take" });
    box.replaceChildren(
      el("h3", {}, "Proposed change"),
      el("p", {}, found.lines[0]),
      el("ul", { class: "changes" }, ...found.changes.map((text) => el("li", {}, text))),
      ...found.keep_words.map((words) => el("p", { class: "note" }, words)),
      ...(found.locks_changed ?? []).map((key) => el("p", { class: "note warning" }, `${key} is locked, but a fix has no way to keep it`)),
      scoresView(found),
      el("div", { class: "buttons" }, take, button("Leave", () => end(), { id: "fix-leave" })),
      el("details", {}, el("summary", {}, "Another fix"), keepView()),
    );
    follow(false);
    take.focus();
  }

  app.onProgress("fix", (share, text) => {
    showShare(bar, share);
    step.textContent = text;
  });
  return { start, box, follow, previewed };
}

/** @param {FixAnswer} found */
function scoresView(found) {
  if (!found.scores.length) return el("p", { class: "note" }, found.scores_note);
  const rows = found.scores.map(({ task, before, after }) => {
    const difference = after - before;
    const kind = Math.abs(difference) < 5e-5 ? "" : difference > 0 ? "better" : "worse";
    return el("tr", {}, el("th", { scope: "row" }, task), el("td", {}, number(before, 4)), el("td", {}, "→"),
      el("td", {}, number(after, 4)),
      el("td", { class: kind }, kind ? `${difference > 0 ? "+" : ""}${number(difference, 4)}` : "same"));
  });
  return el("table", { class: "scores-table" }, el("caption", {}, `Scores, ${found.scores_note}`), el("tbody", {}, ...rows));
}
