// Many maps: the design on a family of maps, its scores, and where its body usually lies.

import { button, el, fillSvg, number, optionsOf, paused, svgEl, ticks, WAYS } from "studio/dom.js";
import { isStale, isStopped } from "studio/connection.js";

const STILL_MS = 120;
const AGAIN_MS = 1500;
const COMPILED_MS = 120_000;
const MOST_GROUNDS = 600;
const CHART = { height: 96, left: 16, right: 16, top: 8, base: 66 };
/** Scores that differ by less look the same. */
const LEAST = 5e-4;
const SORTS = [["seed", "in order"], ["worst", "worst first"], ["best", "best first"], ["change", "most changed first"]];
const FIELDS = {
  count: { least: 1, most: 200, usual: 40 }, seed: { least: 0, most: 2 ** 31, usual: 1000 }, poses: { least: 1, most: 5, usual: 1 },
};

/** @param {number} value */
const score = (value) => value.toFixed(3);
/** @param {number} low @param {number} high */
const range = (low, high) => `${score(low)} to ${score(high)}`;

/** Return a difference with its sign. @param {number} value */
export function signed(value, digits = 3) {
  const text = Math.abs(value).toFixed(digits);
  if (Number(text) === 0) return "0";
  return `${value > 0 ? "+" : "−"}${text}`;
}

/** Conditions of scores, other than the design: only those of the same conditions are compared. @param {StudioState} state */
export function familyConditions(state) {
  return JSON.stringify([state.family, environmentOf(state), state.task, state.growth]);
}

/** Return the kind of many maps: that of the open map until another is chosen. @param {StudioState} state */
export const environmentOf = ({ family, map }) => family.environment ?? map?.source.environment ?? "grid";

/** Tell whether the interval of a paired difference leaves out none at all. @param {{ low: number | null, high: number | null }} difference */
export function isClear({ low, high }) {
  return low !== null && high !== null && (low > LEAST || high < -LEAST);
}

/** @param {FamilyAnswer} answer @returns {Scores} */
function scoresOf({ maps }) {
  return Object.fromEntries(maps.flatMap(({ key, score }) => (score === null ? [] : [[key, score]])));
}

// ---- the scores as a chart

/** Draw bins, every map's score, mean and interval; of the version before the bins and the mean. @param {SVGSVGElement} svg @param {FamilyAnswer} answer @param {Scores} scoresBefore */
function drawChart(svg, answer, scoresBefore) {
  const before = Object.values(scoresBefore);
  const { bins, mean, low, high } = answer.distribution;
  const width = Math.max(240, svg.clientWidth || 600);
  const end = bins.low + bins.step * bins.counts.length;
  const x = (/** @type {number} */ value) => CHART.left + ((value - bins.low) / (end - bins.low)) * (width - CHART.left - CHART.right);
  const most = Math.max(1, ...bins.counts, ...bins.before);
  const y = (/** @type {number} */ count) => CHART.base - (count / most) * (CHART.base - CHART.top);
  const edge = (/** @type {number} */ index) => x(bins.low + index * bins.step);
  /** @param {number} count @param {number} index */
  const bar = (count, index) => {
    const [left, right] = [edge(index), edge(index + 1)];
    return svgEl("rect", { class: "bar", x: left + 0.5, width: Math.max(0.5, right - left - 1), y: y(count), height: CHART.base - y(count) });
  };
  const steps = bins.before.flatMap((count, index) => [index, index + 1].map((at) => `${edge(at).toFixed(1)} ${y(count).toFixed(1)}`));
  const marks = ticks(bins.low, end, 5);
  const beforeMean = before.length ? before.reduce((sum, score) => sum + score, 0) / before.length : null;
  svg.setAttribute("viewBox", `0 0 ${width} ${CHART.height}`);
  svg.replaceChildren(...[
    ...bins.counts.map(bar),
    bins.before.some(Boolean) ? svgEl("path", { class: "before", d: `M${x(bins.low).toFixed(1)} ${CHART.base}L${steps.join(" ")} ${x(end).toFixed(1)} ${CHART.base}` }) : null,
    svgEl("path", { class: "axis", d: `M${CHART.left} ${CHART.base}H${width - CHART.right}` }),
    ...Object.values(scoresOf(answer)).map((value) => svgEl("path", { class: "one", d: `M${x(value).toFixed(1)} ${CHART.base + 2}v6` })),
    low === null || high === null ? null : svgEl("rect", { class: "interval", x: x(low), width: Math.max(1, x(high) - x(low)), y: CHART.top - 6, height: 5 }),
    beforeMean === null ? null : svgEl("path", { class: "mean before", d: `M${x(beforeMean).toFixed(1)} ${CHART.top - 6}V${CHART.base}` }),
    svgEl("path", { class: "mean", d: `M${x(mean).toFixed(1)} ${CHART.top - 7}V${CHART.base + 9}` }),
    ...marks.values.map((value) => svgEl("text", { x: x(value), y: CHART.height - 6, "text-anchor": "middle" }, number(value, marks.digits))),
  ].filter((part) => part !== null));
}

// ---- where bodies lie

/** Return the shares of a heat map, 0 to 1, row by row from below. @param {Heat} heat */
function heatShares(heat) {
  return Float32Array.from(atob(heat.share), (letter) => letter.charCodeAt(0) / 255);
}

/** @param {string} colour */
function rgb(colour) {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
}

/** Return the colour of a share between 0 and 1. @param {string[]} colours @param {number} share */
function heatColour(colours, share) {
  const at = share * (colours.length - 1);
  const index = Math.min(colours.length - 2, Math.floor(at));
  const [one, two] = [rgb(colours[index]), rgb(colours[index + 1])];
  return one.map((part, place) => Math.round(part + (at - index) * (two[place] - part)));
}

/** @param {HTMLCanvasElement} canvas */
function contextOf(canvas) {
  const context = canvas.getContext("2d");
  if (!context) throw new Error("this browser draws no pictures");
  return context;
}

/** @param {HTMLCanvasElement} canvas @param {Heat} heat @param {Float32Array} shares */
function drawHeat(canvas, heat, shares) {
  canvas.width = heat.columns;
  canvas.height = heat.rows;
  const context = contextOf(canvas);
  const image = context.createImageData(heat.columns, heat.rows);
  const palette = Array.from({ length: 256 }, (_, level) => heatColour(heat.colours, level / 255));
  shares.forEach((share, cell) => {
    if (!share) return;
    const row = heat.rows - 1 - Math.floor(cell / heat.columns);
    image.data.set([...palette[Math.round(255 * share)], 255], 4 * (row * heat.columns + (cell % heat.columns)));
  });
  context.putImageData(image, 0, 0);
}

function heatView() {
  const canvas = el("canvas", { role: "img", tabindex: 0 });
  const overlay = svgEl("svg", { class: "heat-overlay", "aria-hidden": "true" });
  const bar = el("canvas", { class: "heat-bar", width: 200, height: 1, "aria-hidden": "true" });
  const here = el("output", { class: "here" });
  const words = el("p", { class: "facts" });
  const box = el("div", { class: "heat" },
    el("div", { class: "heat-plate" }, canvas, overlay),
    el("div", { class: "heat-legend" }, el("span", {}, "seldom"), bar, el("span", {}, "always"), here), words);
  let heat = /** @type {Heat | null} */ (null);
  let shares = new Float32Array();
  let cursor = /** @type {Place | null} */ (null);

  /** Tell the share at a place of the heat map. @param {Heat} map @param {Place} cell */
  function describe({ columns, rows, low_mm, cell_mm, maps }, [column, row]) {
    here.textContent = "";
    if (column < 0 || row < 0 || column >= columns || row >= rows) return;
    const share = shares[row * columns + column];
    const [right, up] = [column, row].map((cell, axis) => low_mm[axis] + (cell + 0.5) * cell_mm);
    const across = `${number(Math.abs(right), 0)} mm ${right < 0 ? "left" : "right"}`;
    here.textContent = `${number(100 * share, 0)} % of ${maps} maps, ${across} of the start, ${number(up, 0)} mm ahead`;
  }

  canvas.addEventListener("pointermove", (event) => {
    if (!heat) return;
    const place = canvas.getBoundingClientRect();
    cursor = [
      Math.floor(((event.clientX - place.left) / place.width) * heat.columns),
      heat.rows - 1 - Math.floor(((event.clientY - place.top) / place.height) * heat.rows),
    ];
    describe(heat, cursor);
  });
  canvas.addEventListener("pointerleave", () => { here.textContent = ""; });
  canvas.addEventListener("keydown", (event) => {
    const way = WAYS[event.key];
    if (!way || !heat) return;
    event.preventDefault();
    const { columns, rows, low_mm, cell_mm } = heat;
    const stride = event.shiftKey ? 1 : 5;
    const [column, row] = cursor ?? [Math.floor(-low_mm[0] / cell_mm), Math.floor(-low_mm[1] / cell_mm)];
    cursor = [
      Math.min(columns - 1, Math.max(0, column + stride * way[0])),
      Math.min(rows - 1, Math.max(0, row + stride * way[1])),
    ];
    describe(heat, cursor);
  });

  /** @param {Heat | null} found */
  function show(found) {
    heat = found;
    box.classList.toggle("empty", !found);
    if (!found) return;
    shares = heatShares(found);
    drawHeat(canvas, found, shares);
    const context = contextOf(bar);
    for (let at = 0; at < 200; at += 1) {
      context.fillStyle = `rgb(${heatColour(found.colours, at / 199).join(" ")})`;
      context.fillRect(at, 0, 1, 1);
    }
    const { columns, rows, low_mm, cell_mm } = found;
    const [x, y] = [-low_mm[0] / cell_mm, rows + low_mm[1] / cell_mm];
    const size = 0.06 * Math.max(columns, rows);
    overlay.setAttribute("viewBox", `0 0 ${columns} ${rows}`);
    overlay.replaceChildren(
      svgEl("circle", { cx: x, cy: y, r: 0.2 * size }),
      svgEl("path", { d: `M${x} ${y}V${y - size}m${-0.3 * size} ${0.35 * size}l${0.3 * size} ${-0.35 * size} ${0.3 * size} ${0.35 * size}` }),
    );
    const area = (/** @type {number} */ least) => shares.filter((share) => share > least).length * cell_mm ** 2 / 100;
    words.textContent = `Share of ${found.maps} maps on which the robot's body covers a place, as seen from the start (simulated). `
      + `On some map ${number(area(0), 0)} cm², on more than half ${number(area(0.5), 0)} cm². Arrow keys read it place by place.`
      + (found.same_size ? "" : " The maps differ in size: where one ends, none of its robots can be.");
    canvas.setAttribute("aria-label", words.textContent);
  }
  return { box, show };
}

// ---- the panel

/** @param {string} label @param {keyof typeof FIELDS} key @param {App} app @param {string} title */
function numberField(label, key, app, title) {
  const { least, most, usual } = FIELDS[key];
  const input = el("input", { type: "number", id: `family-${key}`, min: least, max: most, step: 1, title });
  input.addEventListener("change", () => {
    if (input.value !== "" && input.validity.valid) {
      app.store.change(`many maps: ${label.toLowerCase()}`, (state) => { state.family[key] = Number(input.value); });
    } else app.say(`${label}: a whole number, ${least} to ${most}`, "error");
    show(app.store.get());
  });
  /** @param {StudioState} state */
  function show(state) {
    if (document.activeElement !== input || !app.live) input.value = String(state.family[key] ?? usual);
    input.disabled = !app.live || (key !== "poses" && Boolean(state.family.files?.length));
  }
  return { line: el("label", {}, `${label} `, input), show };
}

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const grounds = /** @type {Map<string, string>} */ (new Map());
  const tiles = /** @type {Map<string, Tile>} */ (new Map());
  const seen = /** @type {Set<string>} */ (new Set());
  const heat = heatView();
  let answer = /** @type {FamilyAnswer | null} */ (null);
  let asked = "";
  let evaluated = 0;
  let before = /** @type {Scores} */ ({});
  let view = "maps";

  // ---- controls

  const environment = el("select", { id: "family-environment" });
  const files = el("textarea", { id: "family-files", rows: 3, spellcheck: false, placeholder: "one map file per line" });
  const listed = el("select", { id: "family-listed", multiple: true, size: 5, "aria-label": "Map files in this folder" });
  const filesLine = el("div", { class: "field files", hidden: true }, el("label", { for: "family-files" }, "Map files"), listed, files);
  const fields = [
    numberField("Maps", "count", app, "How many maps, with seeds one after the other"),
    numberField("Seed", "seed", app, "Seed of the first map; the others follow"),
    numberField("Poses", "poses", app, "Deployments on each map, from poses drawn around its start"),
  ];
  const sort = el("select", { id: "family-sort" }, optionsOf(SORTS));
  const views = ["maps", "heat"].map((name) => button(name === "maps" ? "Maps" : "Where it goes", () => setView(name),
    { "aria-pressed": String(name === view), "data-view": name }));
  const chart = svgEl("svg", { class: "score-chart", role: "img" });
  const summary = el("p", { class: "summary" });
  const change = el("p", { class: "summary change" });
  const status = el("span", { role: "status" });
  const stop = button("Stop", () => app.cancel("family"));
  const busy = el("p", { class: "facts busy", hidden: true }, status, " ", stop);
  const grid = el("div", { class: "tiles", role: "list", "aria-label": "Maps of the family" });
  root.append(
    el("div", { class: "toolbar" },
      el("label", {}, "Environment ", environment), ...fields.map((field) => field.line),
      el("span", { class: "gap" }), el("div", { class: "views", role: "group", "aria-label": "View" }, ...views),
      el("label", {}, "Sorted ", sort)),
    filesLine, summary, change, chart, busy, grid, heat.box,
  );

  environment.addEventListener("change", () => {
    const isFiles = environment.value === "files";
    if (isFiles) return showFiles();
    filesLine.hidden = true;
    return app.store.change("many maps: environment", ({ family }) => {
      family.environment = environment.value;
      delete family.files;
    });
  });
  files.addEventListener("change", () => takeFiles(files.value.split("\n").map((name) => name.trim()).filter(Boolean)));
  listed.addEventListener("change", () => takeFiles([...listed.selectedOptions].map((option) => option.value)));

  /** @param {string[]} names */
  function takeFiles(names) {
    app.store.change("many maps: files", ({ family }) => {
      if (names.length) family.files = names;
      else delete family.files;
    });
  }

  /** Offer the map files of the folder; paths can be written in any case. */
  async function showFiles() {
    filesLine.hidden = false;
    files.focus();
    try {
      const { maps } = await app.request("choices");
      listed.replaceChildren(...optionsOf(maps.map(({ path }) => [path])));
      markListed();
      if (!listed.hidden) listed.focus();
    } catch (error) {
      app.fail(error, "Map files: ");
    }
  }

  function markListed() {
    const names = new Set(app.store.get().family.files);
    for (const option of listed.options) option.selected = names.has(option.value);
    listed.hidden = !listed.options.length;
  }
  sort.addEventListener("change", arrange);

  /** @param {StudioState} state */
  function showControls(state) {
    const { family } = state;
    const names = answer?.environments ?? [environmentOf(state)];
    if (environment.dataset.names !== names.join()) {
      environment.dataset.names = names.join();
      environment.replaceChildren(...optionsOf([...names.map((name) => [name]), ["files", "map files"]]));
    }
    const isFiles = Boolean(family.files?.length);
    if (isFiles && filesLine.hidden && app.live) showFiles();
    environment.value = isFiles ? "files" : environmentOf(state);
    environment.disabled = files.disabled = listed.disabled = !app.live;
    filesLine.hidden = !isFiles;
    markListed();
    if (document.activeElement !== files) files.value = (family.files ?? []).join("\n");
    for (const field of fields) field.show(state);
  }

  function showChart() {
    if (answer) drawChart(chart, answer, before);
  }

  /** @param {string} name */
  function setView(name) {
    view = name;
    for (const one of views) one.setAttribute("aria-pressed", String(one.dataset.view === name));
    grid.hidden = name !== "maps";
    chart.toggleAttribute("hidden", name !== "maps");
    heat.box.hidden = name !== "heat";
    sort.disabled = name !== "maps";
    if (!answer) return;
    if (name === "heat") heat.show(answer.heat);
    else showChart();
  }

  // ---- asking

  /** @param {StudioState} state */
  const conditions = (state) => `${familyConditions(state)} ${JSON.stringify(state.design)}`;

  /** @param {StudioState} state @returns {Scores} */
  function versionBefore(state) {
    const { reference } = app;
    const isSame = reference && familyConditions(reference.state) === familyConditions(state);
    return isSame && reference.answers.family ? scoresOf(reference.answers.family) : {};
  }

  /** Tell whether compiled code lies on disk; after so long no other process compiles it. */
  const isCompiled = () => app.answers.live?.engine === "kernel" || performance.now() > COMPILED_MS;

  /** @param {boolean} quick */
  async function ask(quick) {
    if (!app.live || root.hidden) return;
    const state = app.shown();
    before = versionBefore(state);
    const options = { have: [...grounds.keys()], before, soon: true, compiled: isCompiled() };
    if (quick) Object.assign(options, { quick: true, heat: view === "heat", draw: view === "maps" ? [...seen] : [] });
    else asked = conditions(state);
    try {
      const found = await app.ask("family", options);
      setStatus(found.compiling ? `${found.evaluated} of ${found.maps.length} maps so far: ${found.compiling}` : "");
      // While another process compiles, more maps are asked for only as long as more come.
      const grew = found.evaluated !== evaluated;
      evaluated = found.evaluated;
      if (found.compiling && (grew || isCompiled())) setTimeout(atRest, AGAIN_MS);
    } catch (error) {
      if (!quick && !isStopped(error)) asked = "";
      if (isStale(error)) return;
      setStatus(isStopped(error) ? "stopped; any change goes on" : "");
      app.fail(error, "Many maps: ");
    }
  }

  /** @param {string} text */
  function setStatus(text, isRunning = false) {
    status.textContent = text;
    stop.hidden = !isRunning;
    busy.hidden = !text;
  }

  const atRest = paused(() => ask(false), STILL_MS);

  function changed() {
    if (!app.live || root.hidden || conditions(app.shown()) === asked) return;
    const isSame = familyConditions(app.shown()) === answer?.conditions;
    // Other maps have to be prepared: nothing of them can be shown quickly, and those that were
    // asked for before are not waited for.
    if (isSame) ask(true);
    else if (!stop.hidden) app.cancel("family");
    root.classList.toggle("outdated", !isSame);
    atRest();
  }

  app.onProgress("family", (_, text) => setStatus(text, true));
  app.store.subscribe((state) => {
    showControls(state);
    markOpen();
    changed();
  });
  app.onPreview(changed);
  for (const event of /** @type {const} */ (["again", "engine"])) {
    app.on(event, () => {
      asked = "";
      setTimeout(changed, AGAIN_MS);
    });
  }
  app.onReference(() => {
    if (!app.live && answer) show(answer, app.store.get());
    if (!app.live || root.hidden || JSON.stringify(before) === JSON.stringify(versionBefore(app.shown()))) return;
    asked = "";
    atRest();
  });
  addEventListener("tabshown", () => {
    if (root.hidden) return;
    changed();
    showChart();
  });
  new ResizeObserver(() => { if (!root.hidden) showChart(); }).observe(root);

  // ---- the maps

  const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      const key = target.getAttribute("data-key") ?? "";
      if (isIntersecting) seen.add(key);
      else seen.delete(key);
      if (isIntersecting) draw(tiles.get(key));
    }
  }, { root: null, rootMargin: "100px" });

  /** @param {FamilyMap} entry @returns {Tile} */
  function makeTile(entry) {
    const parts = { ground: svgEl("g"), robot: svgEl("g") };
    const svg = svgEl("svg", { class: "plan", viewBox: entry.view_box, "aria-hidden": "true" }, parts.ground, parts.robot);
    const value = el("span", { class: "value" });
    const difference = el("span", { class: "difference" });
    const opens = button([svg, el("span", { class: "caption" }, el("span", { class: "name" }, entry.name), value, difference)],
      () => open(tiles.get(entry.key)?.entry ?? entry), { "data-key": entry.key });
    const item = el("div", { role: "listitem", class: "tile", "data-key": entry.key }, opens);
    svg.style.setProperty("--mm-per-px", (Number(entry.view_box.split(" ")[2]) / 120).toFixed(3));
    watcher.observe(item);
    return { ...parts, item, button: opens, value, difference, entry, drawn: {} };
  }

  /** Draw what has changed of a map that is in view. @param {Tile} [tile] */
  function draw(tile) {
    if (!tile || !seen.has(tile.entry.key)) return;
    for (const name of /** @type {const} */ (["ground", "robot"])) {
      const text = tile.entry[`${name}_svg`];
      if (text === null || tile.drawn[name] === text) continue;
      fillSvg(tile[name], text);
      tile.drawn[name] = text;
    }
  }

  /** Return what a map has gained over the version before, if both are known. @param {FamilyMap} entry */
  const gainOf = ({ key, score }) => (score === null || before[key] === undefined ? null : score - before[key]);

  /** @param {Tile} tile */
  function showTile(tile) {
    const { entry } = tile;
    const gain = gainOf(entry);
    const words = gain === null ? "" : Math.abs(gain) < LEAST ? "=" : signed(gain);
    const kind = gain === null || words === "=" ? "" : gain > 0 ? " better" : " worse";
    tile.value.textContent = entry.score === null ? "…" : score(entry.score);
    tile.difference.textContent = words;
    tile.difference.setAttribute("class", `difference${kind}`);
    tile.item.classList.toggle("waiting", entry.score === null);
    const facts = entry.score === null ? "not evaluated yet"
      : `score ${score(entry.score)} (simulated), ${number(100 * (entry.grown_share ?? 0), 0)} % grown, ${entry.deployed} of ${entry.branches} branches out`;
    tile.button.setAttribute("aria-label", `${entry.name}: ${facts}${gain === null ? "" : `, ${words === "=" ? "as before" : `${words} to the version before,${kind}`}`}. Open this map`);
    tile.button.title = `${entry.name}: ${facts}`;
    tile.button.disabled = !app.live;
    draw(tile);
  }

  function markOpen() {
    const source = app.store.get().map?.source;
    for (const tile of tiles.values()) {
      const { environment: kind, seed, file } = tile.entry.source;
      const isOpen = file ? source?.file === file : source?.environment === kind && source?.seed === seed && !Object.keys(source?.options ?? {}).length;
      if (isOpen) tile.button.setAttribute("aria-current", "true");
      else tile.button.removeAttribute("aria-current");
    }
  }

  /** @param {FamilyMap} entry */
  function open(entry) {
    app.store.change(`map ${entry.name}`, (state) => {
      state.map = { source: { ...entry.source }, edits: [] };
      state.pose = entry.pose ? { ...entry.pose } : null;
    });
    document.getElementById("tab-map")?.click();
  }

  function arrange() {
    if (!answer) return;
    /** What comes first has the least of it. @type {Record<string, (entry: FamilyMap) => number>} */
    const ranks = {
      seed: () => 0, worst: ({ score }) => score ?? Infinity, best: ({ score }) => -(score ?? -Infinity),
      change: (entry) => -Math.abs(gainOf(entry) ?? 0),
    };
    const rank = ranks[sort.value];
    const ranked = answer.maps.map((entry) => ({ item: tiles.get(entry.key)?.item, rank: rank(entry) }));
    const wanted = ranked.sort((one, two) => (one.rank < two.rank ? -1 : Number(one.rank > two.rank))).map(({ item }) => item)
      .filter((item) => item !== undefined);
    if (wanted.some((item, index) => grid.children[index] !== item) || wanted.length !== grid.children.length) grid.replaceChildren(...wanted);
  }

  // ---- showing

  /** @param {FamilyAnswer} found */
  function showTiles({ maps }) {
    const keys = new Set(maps.map((entry) => entry.key));
    for (const [key, tile] of tiles) {
      if (keys.has(key)) continue;
      watcher.unobserve(tile.item);
      tile.item.remove();
      tiles.delete(key);
      seen.delete(key);
    }
    for (const entry of maps) {
      const tile = tiles.get(entry.key) ?? makeTile(entry);
      tiles.set(entry.key, tile);
      tile.entry = entry;
      showTile(tile);
    }
  }

  /** @param {FamilyAnswer} found */
  function showSummary(found) {
    const { mean, low, high, maps, quantiles } = found.distribution;
    const interval = low === null || high === null ? `${maps} ${maps === 1 ? "map" : "maps"}: no interval` : `95 % interval ${range(low, high)} over ${maps} maps`;
    const about = found.quick ? "≈ " : "";
    const partly = found.evaluated < found.maps.length ? `, the first of ${found.maps.length}` : "";
    summary.replaceChildren(
      el("span", { class: "name" }, `${found.title}, mean `), el("span", { class: "value" }, `${about}${score(mean)}`),
      el("span", { class: "facts" }, ` ${interval}${partly} · half of the maps ${range(quantiles[25], quantiles[75])} · ${number(100 * found.grown_share, 0)} % grown`),
      el("span", { class: "standing" }, "simulated"),
    );
    const { difference } = found;
    change.hidden = !difference;
    if (difference) {
      const clear = isClear(difference);
      const kind = !clear ? "" : difference.mean > 0 ? "better" : "worse";
      const verdict = clear ? kind : "no clear difference";
      change.replaceChildren(
        el("span", { class: `value ${kind}` }, signed(difference.mean)),
        el("span", { class: "facts" }, ` to the version before, map by map: ${verdict}`
          + (difference.low === null || difference.high === null ? "" : ` (95 % interval ${signed(difference.low)} to ${signed(difference.high)} over ${difference.maps} maps)`)
          + ` · better on ${difference.better}, worse on ${difference.worse} of ${difference.maps} maps`),
      );
    }
    const all = Object.values(scoresOf(found));
    chart.setAttribute("aria-label", `Scores of ${maps} maps: mean ${score(mean)}, ${interval}, least ${score(Math.min(...all))}, greatest ${score(Math.max(...all))}`);
  }

  /** @param {FamilyAnswer} found @param {StudioState} state */
  function show(found, state) {
    answer = found;
    found.conditions = familyConditions(state);
    root.classList.toggle("outdated", app.live && familyConditions(app.shown()) !== found.conditions);
    if (!app.live) before = versionBefore(state);
    for (const entry of found.maps) {
      if (entry.ground_svg) grounds.set(entry.key, entry.ground_svg);
      // A stored answer is whole: grounds that the page held already are put back.
      else entry.ground_svg = grounds.get(entry.key) ?? null;
    }
    for (const key of [...grounds.keys()].slice(0, -MOST_GROUNDS)) grounds.delete(key);
    showControls(app.store.get());
    showTiles(found);
    if (!found.quick || !grid.children.length) arrange();
    markOpen();
    showSummary(found);
    if (!root.hidden) showChart();
    if (view === "heat" && (found.heat || !found.quick)) heat.show(found.heat);
  }

  setView("maps");
  showControls(app.store.get());
  app.onAnswer("family", show);
  if (app.live) changed();
}
