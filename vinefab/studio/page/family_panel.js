// Many maps: the design on a family of maps, its scores, and where its body usually lies.

import { el, fillSvg, number, paused, svgEl } from "studio/dom.js";

const STILL_MS = 120;
const AGAIN_MS = 1500;
const COMPILED_MS = 120_000;
const MOST_GROUNDS = 600;
const CHART = { height: 96, left: 16, right: 16, top: 8, base: 66 };
/** Scores that differ by less look the same. */
const LEAST = 5e-4;
const SORTS = [["seed", "in order"], ["worst", "worst first"], ["best", "best first"], ["change", "most changed first"]];
const BOUNDS = { count: [1, 200], seed: [0, 2 ** 31], poses: [1, 5] };

const same = (one, two) => JSON.stringify(one) === JSON.stringify(two);
const score = (value) => value.toFixed(3);
const range = (low, high) => `${score(low)} to ${score(high)}`;

/** Return a difference with its sign. */
export function signed(value, digits = 3) {
  const text = Math.abs(value).toFixed(digits);
  if (Number(text) === 0) return "0";
  return `${value > 0 ? "+" : "−"}${text}`;
}

/** What scores depend on beside the design: only those of the same conditions are compared. */
export function familyConditions({ family, task, growth }) {
  return JSON.stringify([family, task, growth]);
}

/** Tell whether the interval of a paired difference leaves out none at all. */
export function isClear({ low, high }) {
  return low !== null && (low > LEAST || high < -LEAST);
}

/** Scores of an answer by the maps' keys. */
function scoresOf(answer) {
  const known = (answer?.maps ?? []).filter((entry) => entry.score !== null);
  return Object.fromEntries(known.map((entry) => [entry.key, entry.score]));
}

// ---- the scores as a chart

function ticks(low, high) {
  const raw = (high - low) / 5;
  const decade = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((part) => part * decade).find((part) => part >= raw);
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9); at * step <= high + 1e-9 * step; at += 1) found.push(at * step);
  return [found, Math.max(0, -Math.floor(Math.log10(step)))];
}

/** Draw bins, every map's score, mean and interval; of the version before the bins and the mean. */
function drawChart(svg, answer, before) {
  const { bins, mean, low, high } = answer.distribution;
  const width = Math.max(240, svg.clientWidth || 600);
  const end = bins.low + bins.step * bins.counts.length;
  const x = (value) => CHART.left + ((value - bins.low) / (end - bins.low)) * (width - CHART.left - CHART.right);
  const most = Math.max(1, ...bins.counts, ...bins.before);
  const y = (count) => CHART.base - (count / most) * (CHART.base - CHART.top);
  const bar = (count, index) => {
    const [left, right] = [x(bins.low + index * bins.step), x(bins.low + (index + 1) * bins.step)];
    return svgEl("rect", { class: "bar", x: left + 0.5, width: Math.max(0.5, right - left - 1), y: y(count), height: CHART.base - y(count) });
  };
  const steps = bins.before.flatMap((count, index) => [
    `${x(bins.low + index * bins.step).toFixed(1)} ${y(count).toFixed(1)}`,
    `${x(bins.low + (index + 1) * bins.step).toFixed(1)} ${y(count).toFixed(1)}`,
  ]);
  const [marks, digits] = ticks(bins.low, end);
  const beforeMean = before.length ? before.reduce((sum, score) => sum + score, 0) / before.length : null;
  svg.setAttribute("viewBox", `0 0 ${width} ${CHART.height}`);
  svg.replaceChildren(...[
    ...bins.counts.map(bar),
    bins.before.some(Boolean) ? svgEl("path", { class: "before", d: `M${x(bins.low).toFixed(1)} ${CHART.base}L${steps.join(" ")} ${x(end).toFixed(1)} ${CHART.base}` }) : null,
    svgEl("path", { class: "axis", d: `M${CHART.left} ${CHART.base}H${width - CHART.right}` }),
    ...answer.maps.filter((entry) => entry.score !== null).map((entry) =>
      svgEl("path", { class: "one", d: `M${x(entry.score).toFixed(1)} ${CHART.base + 2}v6` })),
    low === null ? null : svgEl("rect", { class: "interval", x: x(low), width: Math.max(1, x(high) - x(low)), y: CHART.top - 6, height: 5 }),
    beforeMean === null ? null : svgEl("path", { class: "mean before", d: `M${x(beforeMean).toFixed(1)} ${CHART.top - 6}V${CHART.base}` }),
    svgEl("path", { class: "mean", d: `M${x(mean).toFixed(1)} ${CHART.top - 7}V${CHART.base + 9}` }),
    ...marks.map((value) => svgEl("text", { x: x(value), y: CHART.height - 6, "text-anchor": "middle" }, number(value, digits))),
  ].filter(Boolean));
}

// ---- where bodies lie

/** Return the shares of a heat map, 0 to 1, row by row from below. */
export function heatShares(heat) {
  return Float32Array.from(atob(heat.share), (letter) => letter.charCodeAt(0) / 255);
}

function rgb(colour) {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
}

/** Return the colour of a share between 0 and 1. */
function heatColour(colours, share) {
  const at = share * (colours.length - 1);
  const index = Math.min(colours.length - 2, Math.floor(at));
  const [one, two] = [rgb(colours[index]), rgb(colours[index + 1])];
  return one.map((part, place) => Math.round(part + (at - index) * (two[place] - part)));
}

function drawHeat(canvas, heat) {
  canvas.width = heat.columns;
  canvas.height = heat.rows;
  const context = canvas.getContext("2d");
  const image = context.createImageData(heat.columns, heat.rows);
  const palette = Array.from({ length: 256 }, (_, level) => heatColour(heat.colours, level / 255));
  heatShares(heat).forEach((share, cell) => {
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
  let heat = null;
  let shares = null;
  let cursor = null;

  function tell(column, row) {
    const inside = column >= 0 && row >= 0 && column < heat.columns && row < heat.rows;
    if (!inside) return (here.textContent = "");
    const share = shares[row * heat.columns + column];
    const [right, up] = [column, row].map((cell, axis) => heat.low_mm[axis] + (cell + 0.5) * heat.cell_mm);
    const across = `${number(Math.abs(right), 0)} mm ${right < 0 ? "left" : "right"}`;
    here.textContent = `${number(100 * share, 0)} % of ${heat.maps} maps, ${across} of the start, ${number(up, 0)} mm ahead`;
    return null;
  }

  canvas.addEventListener("pointermove", (event) => {
    if (!heat) return;
    const place = canvas.getBoundingClientRect();
    cursor = [
      Math.floor(((event.clientX - place.left) / place.width) * heat.columns),
      heat.rows - 1 - Math.floor(((event.clientY - place.top) / place.height) * heat.rows),
    ];
    tell(...cursor);
  });
  canvas.addEventListener("pointerleave", () => { here.textContent = ""; });
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!step || !heat) return;
    event.preventDefault();
    const stride = event.shiftKey ? 1 : 5;
    const start = heat.low_mm.map((low) => Math.floor(-low / heat.cell_mm));
    cursor = (cursor ?? start).map((cell, axis) =>
      Math.min([heat.columns, heat.rows][axis] - 1, Math.max(0, cell + stride * step[axis])));
    tell(...cursor);
  });

  function show(found) {
    heat = found;
    box.classList.toggle("empty", !heat);
    if (!heat) return;
    shares = heatShares(heat);
    drawHeat(canvas, heat);
    const context = bar.getContext("2d");
    for (let at = 0; at < 200; at += 1) {
      context.fillStyle = `rgb(${heatColour(heat.colours, at / 199).join(" ")})`;
      context.fillRect(at, 0, 1, 1);
    }
    const [x, y] = [-heat.low_mm[0] / heat.cell_mm, heat.rows + heat.low_mm[1] / heat.cell_mm];
    const size = 0.06 * Math.max(heat.columns, heat.rows);
    overlay.setAttribute("viewBox", `0 0 ${heat.columns} ${heat.rows}`);
    overlay.replaceChildren(
      svgEl("circle", { cx: x, cy: y, r: 0.2 * size }),
      svgEl("path", { d: `M${x} ${y}V${y - size}m${-0.3 * size} ${0.35 * size}l${0.3 * size} ${-0.35 * size} ${0.3 * size} ${0.35 * size}` }),
    );
    const area = (least) => shares.reduce((sum, share) => sum + (share > least), 0) * heat.cell_mm ** 2 / 100;
    words.textContent = `Share of ${heat.maps} maps on which the robot's body covers a place, as seen from the start (simulated). `
      + `On some map ${number(area(0), 0)} cm², on more than half ${number(area(0.5), 0)} cm². Arrow keys read it place by place.`
      + (heat.same_size ? "" : " The maps differ in size: where one ends, none of its robots can be.");
    canvas.setAttribute("aria-label", words.textContent);
  }
  return { box, show };
}

// ---- the panel

function numberField(label, key, app, title) {
  const [least, most] = BOUNDS[key];
  const input = el("input", { type: "number", id: `family-${key}`, min: least, max: most, step: 1, title });
  input.addEventListener("change", () => {
    if (input.value !== "" && input.validity.valid) {
      app.store.change(`many maps: ${label.toLowerCase()}`, (state) => { state.family[key] = Number(input.value); });
    } else app.say(`${label}: a whole number, ${least} to ${most}`, "error");
    show(app.store.get());
  });
  function show(state) {
    const fallback = { count: 40, seed: 1000, poses: 1 }[key];
    if (document.activeElement !== input || !app.live) input.value = state.family?.[key] ?? fallback;
    input.disabled = !app.live || (key !== "poses" && Boolean(state.family?.files?.length));
  }
  return { line: el("label", {}, `${label} `, input), show };
}

export function mount(root, app) {
  const grounds = new Map();
  const tiles = new Map();
  const seen = new Set();
  const heat = heatView();
  let answer = null;
  let asked = "";
  let evaluated = 0;
  let before = {};
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
  const sort = el("select", { id: "family-sort" }, SORTS.map(([value, text]) => el("option", { value }, text)));
  const views = ["maps", "heat"].map((name) => el("button", {
    type: "button", "aria-pressed": String(name === view), "data-view": name, onclick: () => setView(name),
  }, name === "maps" ? "Maps" : "Where it goes"));
  const chart = svgEl("svg", { class: "score-chart", role: "img" });
  const summary = el("p", { class: "summary" });
  const change = el("p", { class: "summary change" });
  const status = el("span", { role: "status" });
  const stop = el("button", { type: "button", onclick: () => app.cancel("family") }, "Stop");
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
      const { maps } = await app.desk("choices");
      listed.replaceChildren(...maps.map(({ path }) => el("option", { value: path }, path)));
      markListed();
      if (!listed.hidden) listed.focus();
    } catch (error) {
      app.say(`Map files: ${error.message}`, "error");
    }
  }

  function markListed() {
    const names = new Set(app.store.get().family?.files ?? []);
    for (const option of listed.options) option.selected = names.has(option.value);
    listed.hidden = !listed.options.length;
  }
  sort.addEventListener("change", arrange);

  function showControls(state) {
    const { family = {} } = state;
    const names = answer?.environments ?? [family.environment ?? "grid"];
    if (environment.dataset.names !== names.join()) {
      environment.dataset.names = names.join();
      environment.replaceChildren(...names.map((name) => el("option", { value: name }, name)), el("option", { value: "files" }, "map files"));
    }
    const isFiles = Boolean(family.files?.length);
    if (isFiles && filesLine.hidden && app.live) showFiles();
    environment.value = isFiles ? "files" : family.environment ?? "grid";
    environment.disabled = files.disabled = listed.disabled = !app.live;
    filesLine.hidden = !isFiles;
    markListed();
    if (document.activeElement !== files) files.value = (family.files ?? []).join("\n");
    for (const field of fields) field.show(state);
  }

  function setView(name) {
    view = name;
    for (const button of views) button.setAttribute("aria-pressed", String(button.dataset.view === name));
    grid.hidden = name !== "maps";
    chart.toggleAttribute("hidden", name !== "maps");
    heat.box.hidden = name !== "heat";
    sort.disabled = name !== "maps";
    if (!answer) return;
    if (name === "heat") heat.show(answer.heat);
    else drawChart(chart, answer, Object.values(before));
  }

  // ---- asking

  const conditions = (state) => `${familyConditions(state)} ${JSON.stringify(state.design)}`;

  function versionBefore(state) {
    const reference = app.reference;
    const found = reference?.answers?.family;
    if (!found || familyConditions(reference.state) !== familyConditions(state)) return {};
    return scoresOf(found);
  }

  /** Tell whether compiled code lies on disk; after so long nobody else compiles it. */
  const isCompiled = () => app.answers.live?.engine === "kernel" || performance.now() > COMPILED_MS;

  async function ask(quick) {
    if (!app.live || root.hidden) return;
    const state = app.shown();
    before = versionBefore(state);
    const options = { have: [...grounds.keys()], before, soon: true, compiled: isCompiled() };
    if (quick) Object.assign(options, { quick: true, heat: view === "heat", draw: view === "maps" ? [...seen] : [] });
    else asked = conditions(state);
    try {
      const found = await app.ask("family", options);
      tell(found.compiling ? `${found.evaluated} of ${found.maps.length} maps so far: ${found.compiling}` : "");
      // While another process compiles, more maps are asked for only as long as more come.
      const grew = found.evaluated !== evaluated;
      evaluated = found.evaluated;
      if (found.compiling && (grew || isCompiled())) setTimeout(atRest, AGAIN_MS);
    } catch (error) {
      if (!quick && !error.stopped) asked = "";
      if (error.stale) return;
      tell(error.stopped ? "stopped; any change goes on" : "");
      if (!error.stopped) app.say(`Many maps: ${error.message}`, "error");
    }
  }

  function tell(text, isRunning = false) {
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

  app.onProgress("family", (share, text) => tell(`${text} (${number(100 * share, 0)} %)`, true));
  app.store.subscribe((state) => {
    showControls(state);
    markOpen();
    changed();
  });
  app.onPreview?.(changed);
  for (const event of ["again", "engine"]) {
    app.on(event, () => {
      asked = "";
      setTimeout(changed, AGAIN_MS);
    });
  }
  app.onReference?.(() => {
    if (!app.live && answer) show(answer, app.store.get());
    if (!app.live || root.hidden || same(before, versionBefore(app.shown()))) return;
    asked = "";
    atRest();
  });
  addEventListener("tabshown", () => {
    if (root.hidden) return;
    changed();
    if (answer) drawChart(chart, answer, Object.values(before));
  });
  new ResizeObserver(() => { if (answer && !root.hidden) drawChart(chart, answer, Object.values(before)); }).observe(root);

  // ---- the maps

  const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      if (isIntersecting) seen.add(target.dataset.key);
      else seen.delete(target.dataset.key);
      if (isIntersecting) draw(tiles.get(target.dataset.key));
    }
  }, { root: null, rootMargin: "100px" });

  function makeTile(entry) {
    const parts = { ground: svgEl("g"), robot: svgEl("g") };
    const svg = svgEl("svg", { class: "plan", viewBox: entry.view_box, "aria-hidden": "true" }, parts.ground, parts.robot);
    const value = el("span", { class: "value" });
    const difference = el("span", { class: "difference" });
    const button = el("button", { type: "button", "data-key": entry.key, onclick: () => open(tiles.get(entry.key).entry) },
      svg, el("span", { class: "caption" }, el("span", { class: "name" }, entry.name), value, difference));
    const item = el("div", { role: "listitem", class: "tile", "data-key": entry.key }, button);
    svg.style.setProperty("--mm-per-px", (Number(entry.view_box.split(" ")[2]) / 120).toFixed(3));
    watcher.observe(item);
    return { ...parts, item, button, value, difference, entry, drawn: {} };
  }

  /** Draw what has changed of a map that is in view. */
  function draw(tile) {
    if (!tile || !seen.has(tile.entry.key)) return;
    const { ground_svg, robot_svg } = tile.entry;
    for (const [name, text] of [["ground", ground_svg], ["robot", robot_svg]]) {
      if (text === null || text === undefined || tile.drawn[name] === text) continue;
      fillSvg(tile[name], text);
      tile.drawn[name] = text;
    }
  }

  function showTile(tile) {
    const { entry } = tile;
    const old = before[entry.key];
    const gain = entry.score === null || old === undefined ? null : entry.score - old;
    const words = gain === null ? "" : Math.abs(gain) < LEAST ? "=" : signed(gain);
    const kind = words === "" || words === "=" ? "" : gain > 0 ? " better" : " worse";
    tile.value.textContent = entry.score === null ? "…" : score(entry.score);
    tile.difference.textContent = words;
    tile.difference.setAttribute("class", `difference${kind}`);
    tile.item.classList.toggle("waiting", entry.score === null);
    const facts = entry.score === null ? "not evaluated yet"
      : `score ${score(entry.score)} (simulated), ${number(100 * entry.grown_share, 0)} % grown, ${entry.deployed} of ${entry.branches} branches out`;
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

  function open(entry) {
    app.store.change(`map ${entry.name}`, (state) => {
      state.map = { source: { ...entry.source }, edits: [] };
      state.pose = entry.pose ? { ...entry.pose } : null;
    });
    document.getElementById("tab-map")?.click();
  }

  function arrange() {
    if (!answer) return;
    const gain = (entry) => (before[entry.key] === undefined || entry.score === null ? 0 : Math.abs(entry.score - before[entry.key]));
    const known = (entry, otherwise) => entry.score ?? otherwise;
    const order = {
      seed: () => 0, worst: (one, two) => known(one, Infinity) - known(two, Infinity),
      best: (one, two) => known(two, -Infinity) - known(one, -Infinity), change: (one, two) => gain(two) - gain(one),
    }[sort.value];
    const wanted = [...answer.maps].sort(order).map((entry) => tiles.get(entry.key).item);
    if (wanted.some((item, index) => grid.children[index] !== item) || wanted.length !== grid.children.length) grid.replaceChildren(...wanted);
  }

  // ---- showing

  function showTiles() {
    const keys = new Set(answer.maps.map((entry) => entry.key));
    for (const [key, tile] of tiles) {
      if (keys.has(key)) continue;
      watcher.unobserve(tile.item);
      tile.item.remove();
      tiles.delete(key);
      seen.delete(key);
    }
    for (const entry of answer.maps) {
      if (!tiles.has(entry.key)) tiles.set(entry.key, makeTile(entry));
      const tile = tiles.get(entry.key);
      tile.entry = entry;
      showTile(tile);
    }
  }

  function showSummary() {
    const { mean, low, high, maps, quantiles } = answer.distribution;
    const interval = low === null ? `${maps} ${maps === 1 ? "map" : "maps"}: no interval` : `95 % interval ${range(low, high)} over ${maps} maps`;
    const about = answer.quick ? "≈ " : "";
    const partly = answer.evaluated < answer.maps.length ? `, the first of ${answer.maps.length}` : "";
    summary.replaceChildren(
      el("span", { class: "name" }, `${answer.title}, mean `), el("span", { class: "value" }, `${about}${score(mean)}`),
      el("span", { class: "facts" }, ` ${interval}${partly} · half of the maps ${range(quantiles[25], quantiles[75])} · ${number(100 * answer.grown_share, 0)} % grown`),
      el("span", { class: "standing" }, "simulated"),
    );
    const { difference } = answer;
    change.hidden = !difference;
    if (difference) {
      const clear = isClear(difference);
      const kind = !clear ? "" : difference.mean > 0 ? "better" : "worse";
      const verdict = clear ? kind : "no clear difference";
      change.replaceChildren(
        el("span", { class: `value ${kind}` }, signed(difference.mean)),
        el("span", { class: "facts" }, ` to the version before, map by map: ${verdict}`
          + (difference.low === null ? "" : ` (95 % interval ${signed(difference.low)} to ${signed(difference.high)} over ${difference.maps} maps)`)
          + ` · better on ${difference.better}, worse on ${difference.worse} of ${difference.maps} maps`),
      );
    }
    const all = Object.values(scoresOf(answer));
    chart.setAttribute("aria-label", `Scores of ${maps} maps: mean ${score(mean)}, ${interval}, least ${score(Math.min(...all))}, greatest ${score(Math.max(...all))}`);
  }

  function show(found, state) {
    answer = found;
    answer.conditions = familyConditions(state);
    root.classList.toggle("outdated", app.live && familyConditions(app.shown()) !== answer.conditions);
    if (!app.live) before = versionBefore(state);
    for (const entry of answer.maps) {
      if (entry.ground_svg) grounds.set(entry.key, entry.ground_svg);
      // A stored answer is whole: grounds that the page held already are put back.
      else entry.ground_svg = grounds.get(entry.key) ?? null;
      entry.robot_svg ??= null;
    }
    while (grounds.size > MOST_GROUNDS) grounds.delete(grounds.keys().next().value);
    showControls(app.store.get());
    showTiles();
    if (!answer.quick || !grid.children.length) arrange();
    markOpen();
    showSummary();
    if (!root.hidden) drawChart(chart, answer, Object.values(before));
    if (view === "heat" && (answer.heat || !answer.quick)) heat.show(answer.heat);
  }

  setView("maps");
  showControls(app.store.get());
  app.onAnswer("family", show);
  if (app.live) changed();
}
