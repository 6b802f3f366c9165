// Searches: settings around the design, one search at a time, its curve, its best robot, its front.

import { button, copyable, el, number, optionsOf, rested, svgEl, ticks, WAYS } from "studio/dom.js";
import { isStale, problemOf } from "studio/connection.js";

const STATES = {
  running: ["●", "running"], ended: ["✓", "ended"], stopped: ["■", "stopped"],
  failed: ["✕", "failed"], unfinished: ["■", "not ended"], unreadable: ["✕", "unreadable"],
};
const WIDE = 272; // of a chart, in its own units
const HIGH = 168;
const EDGE = { left: 42, right: 8, top: 10, bottom: 32 };
const TICKS = 4; // about so many on an axis

/** Return a range with some room around values. @param {number[]} values */
function room(values) {
  const [low, high] = [Math.min(...values), Math.max(...values)];
  const margin = 0.06 * (high - low) || 0.05 * Math.abs(high) || 0.5;
  return [low - margin, high + margin];
}

/**
 * Return an empty chart with its axes, and functions from values to places.
 * @param {string} name
 * @param {number[]} x_range
 * @param {number[]} y_range
 * @param {string} x_title
 * @param {string} y_title
 */
function chart(name, [x_low, x_high], [y_low, y_high], x_title, y_title) {
  const at_x = (/** @type {number} */ value) => EDGE.left + ((value - x_low) / (x_high - x_low || 1)) * (WIDE - EDGE.left - EDGE.right);
  const at_y = (/** @type {number} */ value) => HIGH - EDGE.bottom - ((value - y_low) / (y_high - y_low || 1)) * (HIGH - EDGE.top - EDGE.bottom);
  const svg = svgEl("svg", { class: "chart", viewBox: `0 0 ${WIDE} ${HIGH}`, "aria-label": name });
  const [left, right, bottom] = [EDGE.left, WIDE - EDGE.right, HIGH - EDGE.bottom];
  const y_ticks = ticks(y_low, y_high, TICKS);
  for (const value of y_ticks.values) {
    const y = at_y(value);
    svg.append(
      svgEl("line", { class: "grid", x1: left, x2: right, y1: y, y2: y }),
      svgEl("text", { class: "tick", x: left - 4, y: y + 3, "text-anchor": "end" }, value.toFixed(y_ticks.digits)),
    );
  }
  const x_ticks = ticks(x_low, x_high, TICKS);
  for (const value of x_ticks.values) {
    const x = at_x(value);
    svg.append(
      svgEl("line", { class: "axis", x1: x, x2: x, y1: bottom, y2: bottom + 3 }),
      svgEl("text", { class: "tick", x, y: bottom + 13, "text-anchor": "middle" }, value.toFixed(x_ticks.digits)),
    );
  }
  const middle = (EDGE.top + bottom) / 2;
  svg.append(
    svgEl("path", { class: "axis", d: `M${left} ${EDGE.top}V${bottom}H${right}` }),
    svgEl("text", { class: "title", x: right, y: HIGH - 5, "text-anchor": "end" }, x_title),
    svgEl("text", { class: "title", transform: `translate(9 ${middle}) rotate(-90)`, "text-anchor": "middle" }, y_title),
  );
  return { svg, at_x, at_y };
}

/** Return the best fitness so far over the designs that were evaluated. @param {number[][]} points */
function curveChart(points) {
  const last = points[points.length - 1];
  const words = `Best fitness so far, simulated: ${number(last[1], 4)} after ${last[0]} designs`;
  const { svg, at_x, at_y } = chart(
    words, [0, last[0]], room(points.map((point) => point[1])), "designs evaluated", "best fitness (simulated)",
  );
  svg.setAttribute("role", "img");
  const steps = points.slice(1).map(([x, y]) => `H${at_x(x).toFixed(1)}V${at_y(y).toFixed(1)}`);
  const begin = `M${at_x(points[0][0]).toFixed(1)} ${at_y(points[0][1]).toFixed(1)}`;
  svg.append(
    svgEl("path", { class: "curve", d: begin + steps.join("") }),
    svgEl("circle", { class: "curve-end", cx: at_x(last[0]), cy: at_y(last[1]), r: 3 }),
  );
  return svg;
}

/** @param {Objective} objective */
function axisWords(objective) {
  const unit = objective.unit ? `, ${objective.unit}` : "";
  return `${objective.name}${unit} (${objective.kind})`;
}

/** @param {Front} front @param {FrontPoint} point */
function valueWords(front, point) {
  return front.objectives
    .map((objective, place) => {
      const digits = objective.unit ? 0 : 3;
      return `${objective.name} ${number(point.values[place], digits)}${objective.unit ? ` ${objective.unit}` : ""}`;
    })
    .join(", ");
}

/**
 * Return a front as points that are buttons; arrow keys go from one to the next.
 * @param {Front} front
 * @param {number} place of the objective along the chart
 * @param {string | undefined} chosen
 * @param {(point: FrontPoint) => void} choose
 */
function frontChart(front, place, chosen, choose) {
  const [up, along] = [front.objectives[0], front.objectives[place]];
  const { svg, at_x, at_y } = chart(
    "Front: one button for each design", room(front.points.map((point) => point.values[place])),
    room(front.points.map((point) => point.values[0])), axisWords(along), axisWords(up),
  );
  svg.setAttribute("role", "group");
  const order = [...front.points].sort((one, other) => one.values[place] - other.values[place]);
  const first = order.some((point) => point.point === chosen) ? chosen : order[0].point;
  /** @type {SVGElement[]} */
  const marks = order.map((point, index) => {
    const [x, y] = [at_x(point.values[place]), at_y(point.values[0])];
    const breaks = point.breaks ? "; breaks rules or limits" : "";
    const words = `${point.label}: ${valueWords(front, point)}${breaks}`;
    const shape = point.breaks
      ? svgEl("path", { class: "dot", d: `M${x - 4} ${y - 4}l8 8m0-8l-8 8` })
      : svgEl("circle", { class: "dot", cx: x, cy: y, r: 3.5 });
    return svgEl(
      "g",
      {
        class: point.breaks ? "point breaks" : "point", role: "button", tabindex: point.point === first ? 0 : -1,
        "aria-pressed": String(point.point === chosen), "aria-label": words, "data-point": point.point,
        onclick: () => choose(point),
        onkeydown: (event) => {
          const [right, up] = WAYS[event.key] ?? [0, 0];
          if (right || up) marks[(index + right - up + marks.length) % marks.length].focus();
          else if (event.key === "Enter" || event.key === " ") choose(point);
          else return;
          event.preventDefault();
        },
      },
      svgEl("title", {}, words),
      svgEl("circle", { class: "reach", cx: x, cy: y, r: 9 }),
      shape,
    );
  });
  svg.append(...marks);
  return svg;
}

/** Return a line with a command that can be copied, and how to set it. @param {App} app @param {string} what */
function commandLine(app, what) {
  const { text, copy } = copyable(app, what);
  const line = el("div", { class: "command-line" }, text, copy);
  const set = (/** @type {string} */ command) => {
    text.textContent = command;
    line.hidden = !command;
  };
  return { line, set };
}

/** @param {string} label @param {Element} control */
function field(label, control) {
  return el("div", { class: "field" }, el("label", { for: control.id }, label), control);
}

/** @param {string} id @param {number} least @param {number} most */
function numberInput(id, least, most) {
  return el("input", { type: "number", id: `search-${id}`, min: least, max: most, step: 1 });
}

/** @param {HTMLSelectElement} select @param {string[][]} entries @param {string} chosen */
function options(select, entries, chosen) {
  select.replaceChildren(...optionsOf(entries));
  if (entries.some(([value]) => value === chosen)) select.value = chosen;
}

/** Return the settings of a new search: their elements, how to show a proposal, what they ask. */
function settings() {
  const task = el("select", { id: "search-task" });
  const maps = el("select", { id: "search-maps" });
  const count = numberInput("count", 1, 1000);
  const seed = numberInput("map-seed", 0, 2 ** 31);
  const objectives = el("div", { class: "choices" });
  const levels = [numberInput("levels-low", 1, 10), numberInput("levels-high", 1, 10)];
  const ranges = el("div", { class: "ranges" });
  const fabricable = el("input", { type: "checkbox", id: "search-fabricable" });
  const here = el("input", { type: "checkbox", id: "search-here" });
  const free = el("input", { type: "checkbox", id: "search-free" });
  const only = el("input", { type: "checkbox", id: "search-only" });
  const onlyWords = el("label", { for: only.id });
  const onlyField = el("div", { class: "field", hidden: true }, only, onlyWords);
  let branch = /** @type {string | null} */ (null); // that is chosen on the map
  const population = numberInput("population", 2, 100000);
  const generations = numberInput("generations", 1, 1000000);
  const optimizer = el("select", { id: "search-optimizer" });
  const run_seed = numberInput("seed", 0, 2 ** 31);
  const notes = el("ul", { class: "problems" });
  let proposal = /** @type {Proposal | null} */ (null);
  let edited = /** @type {Record<string, number[]>} */ ({}); // ranges that the user gave, by the keys of the design
  let levels_edited = false;
  const chosen = /** @type {Set<Element>} */ (new Set()); // what the user set: the rest follows the page

  levels[0].setAttribute("aria-label", "Fewest levels");
  levels[1].setAttribute("aria-label", "Most levels");
  for (const input of levels) input.addEventListener("input", () => { levels_edited = true; showRanges(); });
  const checkedObjectives = () => /** @type {HTMLInputElement[]} */ ([...objectives.querySelectorAll("input:checked")]).map((box) => box.value);
  const chosenObjectives = () => checkedObjectives().filter((name) => name !== task.value);
  /** Show what the other settings leave to choose. */
  const showChoices = () => {
    for (const input of [count, seed]) input.disabled = !maps.value.startsWith("environment:");
    for (const box of objectives.querySelectorAll("[data-task]")) box.toggleAttribute("hidden", box.getAttribute("data-task") === task.value);
    const usual = chosenObjectives().length || !fabricable.checked ? "" : "islands";
    here.disabled = !free.checked && (optimizer.value || usual) !== "islands";
    free.disabled = Boolean(proposal?.must_be_free);
    // One branch of its own, where it is.
    onlyField.hidden = branch === null || !free.disabled || !here.checked;
    onlyWords.textContent = `only ${branch === "trunk" ? "the trunk" : `branch ${branch}`}: what hangs on it moves along`;
  };
  /** @param {string | null} label */
  const choose = (label) => {
    if (label !== branch) only.checked = false;
    branch = label;
    showChoices();
  };
  for (const control of [maps, task, objectives, fabricable, optimizer, free, here]) control.addEventListener("change", showChoices);
  for (const control of [task, maps, count, seed, optimizer, fabricable, here, free, population, generations, run_seed]) {
    control.addEventListener("change", () => chosen.add(control));
  }
  // Targets of the open map are reached on that map.
  task.addEventListener("change", () => { if (task.value === "reach" && proposal?.has_targets && !chosen.has(maps)) maps.value = "shown"; });

  /** @param {SearchValue} value */
  function rangeRow(value) {
    const words = `${value.level === 1 ? "trunk" : `level ${value.level}`} ${value.label}`;
    const label = el("span", { class: "name" }, value.label);
    if (value.locked) {
      const fixed = `${number(value.value, 2)}, locked`;
      return el("div", { class: "range" }, label, el("span", { class: "fixed", "aria-label": `${words} fixed at ${fixed}` }, fixed), el("span", { class: "unit" }, value.unit));
    }
    const shown = edited[value.key] ?? value.range;
    const ends = ["lowest", "highest"].map((end, place) => el("input", {
      type: "number", min: value.limits[0], max: value.limits[1], step: value.whole ? 1 : "any", value: shown[place],
      "aria-label": `${words}, ${end}`, "data-key": value.key, "data-end": place,
    }));
    for (const input of ends) {
      input.addEventListener("change", () => { edited[value.key] = ends.map((end) => Number(end.value)); });
    }
    return el("div", { class: "range" }, label, ends[0], el("span", { "aria-hidden": "true" }, "to"), ends[1], el("span", { class: "unit" }, value.unit));
  }

  function showRanges() {
    if (!proposal) return;
    const most = Number(levels[1].value) || proposal.levels[1];
    const rows = [];
    let level = 0;
    for (const value of proposal.values) {
      if (value.level > most) continue;
      if (value.level !== level) {
        level = value.level;
        rows.push(el("h4", {}, level === 1 ? "Trunk" : `Level ${level}`));
      }
      rows.push(rangeRow(value));
    }
    const depth = Math.max(...proposal.values.map((value) => value.level));
    if (most > depth) {
      const usual = Object.entries(proposal.deeper).map(([name, [low, high, unit]]) => `${name} ${low} to ${high}${unit ? ` ${unit}` : ""}`);
      rows.push(el("p", { class: "facts" }, `Levels ${depth + 1} to ${most}: ${usual.join(", ")}`));
    }
    ranges.replaceChildren(...rows);
  }

  const around = button("Around the design", () => { edited = {}; showRanges(); });
  const usual = button("Usual ranges", () => {
    const { values = [], deeper = {} } = proposal ?? {};
    edited = Object.fromEntries(values.map(({ key, label }) => [key, deeper[label].slice(0, 2).map(Number)]));
    showRanges();
  });

  /** @param {Proposal} found @param {StudioState} state */
  function show(found, state) {
    proposal = found;
    const given = found.settings;
    const known = new Set(found.values.map((value) => value.key));
    edited = Object.fromEntries(Object.entries(edited).filter(([key]) => known.has(key)));
    options(task, found.tasks.map((name) => [name, name]), chosen.has(task) ? task.value : given.task);
    const files = state.family.files ?? [];
    options(maps, [
      ...(found.has_map ? [["shown", "the map on this page"]] : []),
      ...found.environments.map((name) => [`environment:${name}`, `generated: ${name}`]),
      ...(files.length ? [["files", `the ${files.length} files of Many maps`]] : []),
    ], chosen.has(maps) ? maps.value : given.maps.shown ? "shown" : `environment:${given.maps.environment}`);
    options(optimizer, [["", "usual"], ...found.optimizers.map((name) => [name, name])], chosen.has(optimizer) ? optimizer.value : given.optimizer);
    if (!levels_edited) found.levels.forEach((value, place) => { levels[place].value = String(value); });
    const checked = new Set(checkedObjectives());
    objectives.replaceChildren(...found.objectives.map(({ name, kind, words }) => {
      const box = el("input", { type: "checkbox", value: name, id: `search-objective-${name}` });
      box.checked = checked.has(name);
      return el("div", { "data-task": kind === "task" ? name : null }, box, el("label", { for: box.id }, words));
    }));
    for (const [input, value] of /** @type {const} */ ([
      [count, given.maps.count], [seed, given.maps.seed], [population, given.population],
      [generations, given.generations], [run_seed, given.seed],
    ])) if (!chosen.has(input) && document.activeElement !== input) input.value = String(value);
    if (!chosen.has(fabricable)) fabricable.checked = given.fabricable;
    if (!chosen.has(here)) here.checked = given.start_here;
    if (!chosen.has(free) || found.must_be_free) free.checked = given.free;
    notes.replaceChildren(...found.notes.map((note) => el("li", {}, note)));
    showRanges();
    showChoices();
  }

  /** @param {StudioState} state */
  function asked(state) {
    const named = maps.value.startsWith("environment:") ? maps.value.slice("environment:".length) : "";
    const most = Number(levels[1].value);
    const open = (proposal?.values ?? []).filter((value) => !value.locked && value.level <= most);
    return {
      task: task.value,
      objectives: chosenObjectives(),
      maps: named ? { environment: named, count: Number(count.value), seed: Number(seed.value) }
        : maps.value === "shown" ? { shown: true } : { files: state.family.files },
      levels: levels.map((input) => Number(input.value)),
      ranges: Object.fromEntries(open.map((value) => [value.key, edited[value.key] ?? value.range])),
      fabricable: fabricable.checked,
      population: Number(population.value),
      generations: Number(generations.value),
      optimizer: optimizer.value,
      seed: Number(run_seed.value),
      start_here: here.checked && !here.disabled,
      free: free.checked,
      only: only.checked && !onlyField.hidden ? branch : null,
    };
  }

  const box = el("div", { class: "settings" },
    field("Task", task),
    field("Maps", maps),
    el("div", { class: "field pair" }, el("label", { for: count.id }, "Count"), count, el("label", { for: seed.id }, "first seed"), seed),
    el("fieldset", {},
      el("legend", {}, "Space"),
      el("div", { class: "range" }, el("span", { class: "name" }, "levels"), levels[0], el("span", { "aria-hidden": "true" }, "to"), levels[1]),
      ranges,
      el("div", { class: "buttons wrap" }, around, usual),
      notes,
    ),
    el("details", {}, el("summary", {}, "A front: more than one aim"), el("p", { class: "facts" }, "Beside the task's score; the search then keeps every compromise."), objectives),
    el("fieldset", {},
      el("legend", {}, "How"),
      el("div", { class: "field" }, fabricable, el("label", { for: fabricable.id }, "only robots that can be made, with this recipe")),
      el("div", { class: "field" }, free, el("label", { for: free.id }, "every branch has its own angle and length")),
      el("div", { class: "field" }, here, el("label", { for: here.id }, "begin at the present design"), el("span", { class: "unit" }, "(free trees, islands)")),
      onlyField,
      el("div", { class: "field pair" }, el("label", { for: population.id }, "Designs"), population, el("label", { for: generations.id }, "× generations"), generations),
      el("div", { class: "field pair" }, el("label", { for: optimizer.id }, "Optimizer"), optimizer, el("label", { for: run_seed.id }, "seed"), run_seed),
    ),
  );
  return { box, show, asked, choose, isShown: () => proposal !== null };
}

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const heading = el("h3", {}, "Search");
  const state_word = el("p", { class: "state" });
  const bar = el("progress", { max: 1, value: 0, "aria-label": "Share of the generations" });
  const line = el("p", { class: "facts", role: "status" });
  const best = el("p", { class: "best" });
  const curve = el("div", { class: "curve-box" });
  const stop = button("Stop", () => ask("search_stop"));
  const resume = button("Resume", () => { if (event) resumeRun(event.folder); });
  const on_map = button("Show the best on the map", () => {
    const is_on = on_map.getAttribute("aria-pressed") !== "true";
    endPreview();
    on_map.setAttribute("aria-pressed", String(is_on));
    showBest();
  }, { "aria-pressed": "false", title: "The map shows the best robot so far; yours comes back when this is turned off" });
  const take = button("Take the best", () => takeDesign(event?.best, `best of ${event?.folder}`), { class: "primary" });
  const command = commandLine(app, "of the search");
  const card = el("div", { class: "card", hidden: true }, state_word, bar, line, curve, best, el("div", { class: "buttons wrap" }, on_map, take, stop, resume), command.line);

  const front_title = el("h4", {}, "Front");
  const front_axis = el("select", { "aria-label": "Value along the chart" });
  const front_box = el("div", {});
  const front_words = el("p", { class: "facts", role: "status" });
  const take_point = button("Take this one", () => takeDesign(chosen?.design, `${chosen?.point.label} of ${front?.folder}`), { class: "primary", disabled: true });
  const back = button("Back to mine", () => endPreview(), { disabled: true });
  const front_card = el("div", { class: "card", hidden: true }, front_title, front_axis, front_box, front_words, el("div", { class: "buttons" }, take_point, back));

  const form = settings();
  app.onBranch(form.choose);
  form.choose(app.branch);
  const folder = el("input", { type: "text", id: "search-folder", spellcheck: "false" });
  const start = button("Start", async () => {
    if (!form.isShown()) return;
    const given = form.asked(app.store.get());
    const found = await ask("search_start", { ...given, folder: folder.value });
    if (!found) return;
    endPreview();
    delete folder.dataset.edited;
    fresh.open = false;
    is_running = true;
    showStart();
    app.say(`Searching: ${found.command}`);
    root.scrollTo({ top: 0 });
  }, { class: "primary", disabled: true });
  const start_command = commandLine(app, "to start");
  const waiting = el("p", { class: "facts" }, "Reading what can be searched …");
  const problem = el("p", { class: "problem", hidden: true });
  const fresh = el("details", { class: "new", open: true }, el("summary", {}, "A new search"), waiting, form.box, field("Folder", folder), problem, el("div", { class: "buttons" }, start), start_command.line);

  const runs = el("ul", { class: "runs" });
  const earlier = el("details", {}, el("summary", {}, "Searches in this folder"), runs, el("div", { class: "buttons" }, button("Look again", () => listRuns())));
  root.append(heading, card, front_card, fresh, earlier);

  let event = /** @type {SearchEvent | null} */ (null); // the last of the search that is shown
  let front = /** @type {ShownFront | null} */ (null);
  let chosen = /** @type {ChosenPoint | null} */ (null); // of the front, on the map
  let previewed = /** @type {Design | null} */ (null); // what this panel put on the map
  let is_asking = false;
  let is_running = false;
  let asks_again = false; // the design has changed since

  /** Return what the server answers, or nothing where it refuses. @template {RequestName} Q @param {Q} name */
  async function ask(name, given = {}) {
    problem.hidden = true;
    try {
      return await app.request(name, given);
    } catch (error) {
      problem.textContent = problemOf(error);
      problem.hidden = isStale(error);
      app.fail(error);
      return null;
    }
  }

  /** @param {Design | null} design */
  function preview(design) {
    // The preview of another panel stays where it is.
    if (!design && (!previewed || app.previewed !== previewed)) {
      previewed = null;
      return;
    }
    previewed = design;
    app.preview(design);
  }

  function endPreview() {
    on_map.setAttribute("aria-pressed", "false");
    chosen = null;
    preview(null);
    showChosen();
  }

  function showBest() {
    if (on_map.getAttribute("aria-pressed") !== "true" || !event?.best) return;
    if (JSON.stringify(event.best) !== JSON.stringify(previewed)) preview(event.best);
  }

  /** @param {Design | null | undefined} design @param {string} label */
  function takeDesign(design, label) {
    if (!design) return;
    endPreview();
    app.store.change(label, (state) => { state.design = structuredClone(design); });
    app.say(`Took it: ${label}. Undo brings yours back`);
  }

  /** @param {SearchEvent} found */
  function showEvent(found) {
    event = found;
    app.answers.search = found;
    card.hidden = false;
    const [sign, word] = STATES[found.state];
    state_word.dataset.state = found.state;
    state_word.textContent = `${sign} ${word}: ${found.folder}`;
    bar.value = found.share;
    bar.setAttribute("aria-valuetext", found.line);
    if (line.textContent !== found.line) line.textContent = found.line;
    line.dataset.kind = found.state === "failed" ? "error" : "info";
    curve.replaceChildren(...(found.curve.length ? [curveChart(found.curve)] : []));
    best.replaceChildren(
      el("span", { class: "value" }, found.best_touched || (found.best_score === null ? "–" : number(found.best_score, 4))),
      el("span", { class: "standing" }, found.best_touched && found.best_score !== null ? `${number(found.best_score, 4)} ${found.best_words}` : found.best_words),
    );
    is_running = found.state === "running";
    stop.hidden = !is_running;
    resume.hidden = found.state !== "stopped" && !(found.state === "failed" && found.generations);
    showStart();
    for (const one of [on_map, take]) one.disabled = !found.best || !app.live;
    for (const one of [stop, resume]) one.disabled = !app.live;
    command.set(found.command);
    showBest();
    if (found.front?.points.length) showFront(found.folder, found.front);
    else if (is_running && front && front.folder !== found.folder) front_card.hidden = true;
  }

  /** @param {string} folder @param {Front} found */
  function showFront(folder, found) {
    if (front?.folder !== folder) chosen = null;
    const is_new = front?.folder !== folder || front.objectives.length !== found.objectives.length;
    front = { folder, ...found };
    front_card.hidden = false;
    front_title.textContent = `Front of ${folder}: ${found.points.length} designs${found.is_final ? "" : " so far"}`;
    if (is_new) options(front_axis, found.objectives.slice(1).map((one, place) => [String(place + 1), `against ${axisWords(one)}`]), "1");
    front_axis.hidden = found.objectives.length < 3;
    drawFront();
  }

  function drawFront() {
    if (!front) return;
    const focused = front_box.contains(document.activeElement) && document.activeElement?.getAttribute("data-point");
    front_box.replaceChildren(frontChart(front, Number(front_axis.value) || 1, chosen?.point.point, choosePoint));
    const mark = focused && front_box.querySelector(`[data-point="${CSS.escape(focused)}"]`);
    if (mark instanceof SVGElement) mark.focus();
    showChosen();
  }

  function showChosen() {
    const words = chosen && front ? `${chosen.point.label}: ${valueWords(front, chosen.point)}. ${chosen.words}` : "Choose a point to see its robot on the map.";
    front_words.textContent = words;
    take_point.disabled = back.disabled = !chosen || !app.live;
    for (const mark of front_box.querySelectorAll("[data-point]")) {
      mark.setAttribute("aria-pressed", String(mark.getAttribute("data-point") === chosen?.point.point));
    }
  }

  /** @param {FrontPoint} point */
  async function choosePoint(point) {
    if (!app.live || !front) return;
    const found = await ask("search_load", { folder: front.folder, point: point.point });
    if (!found) return;
    on_map.setAttribute("aria-pressed", "false");
    chosen = { point, design: found.design, words: found.words };
    preview(found.design);
    showChosen();
  }

  /** @param {string} name */
  async function loadBest(name) {
    const found = await ask("search_load", { folder: name, point: "best" });
    if (found) takeDesign(found.design, `best of ${name}`);
  }

  /** @param {string} name */
  async function loadFront(name) {
    const found = await ask("search_front", { folder: name });
    if (!found) return;
    if (!found.front.points.length) {
      app.say(`${name}: no design on its front yet`);
      return;
    }
    showFront(found.folder, found.front);
    front_card.scrollIntoView({ block: "nearest" });
  }

  /** @param {string} name */
  async function resumeRun(name) {
    const found = await ask("search_resume", { folder: name });
    if (found) app.say(`Going on: ${found.command}`);
  }

  /** @param {ListedRun} run */
  function runItem(run) {
    const [sign, word] = STATES[run.state];
    const can_load = run.best_score !== null && run.best_score !== undefined;
    /** @param {string} text @param {string} about @param {(folder: string) => void} act */
    const acts = (text, about, act, disabled = false) =>
      button(text, () => act(run.folder), { "aria-label": `${about} ${run.folder}`, disabled });
    const buttons = [
      run.state === "unfinished" ? acts("Resume", "Resume", resumeRun, event?.state === "running") : null,
      can_load ? acts("Take the best", "Take the best of", loadBest) : null,
      run.objectives?.length ? acts("Front", "Show the front of", loadFront) : null,
    ];
    return el("li", {},
      el("p", { class: "state", "data-state": run.state }, `${sign} ${word}: ${run.folder}`),
      el("p", { class: "facts" }, [run.task, run.best_touched, can_load ? `${number(run.best_score, 4)}: ${run.best_words}` : "", run.line].filter(Boolean).join("; ")),
      el("div", { class: "buttons wrap" }, ...buttons),
    );
  }

  async function listRuns() {
    const found = await ask("search_runs");
    if (!found) return;
    const rest = found.left_out ? [el("li", { class: "facts" }, `and ${found.left_out} older ones`)] : [];
    const part = found.is_whole ? [] : [el("li", { class: "facts" }, "Not all folders were looked at: there are too many")];
    const none = found.runs.length ? [] : [el("li", { class: "facts" }, `None yet in ${found.home}`)];
    runs.replaceChildren(...found.runs.map(runItem), ...none, ...rest, ...part);
    if (found.search && JSON.stringify(found.search) !== JSON.stringify(event)) showEvent(found.search);
  }

  /** Nothing is started before the form is filled: until then it says so. */
  function showStart() {
    start.disabled = is_running || !app.live || !form.isShown();
    form.box.hidden = !form.isShown();
    waiting.hidden = form.isShown();
  }

  async function propose() {
    if (!app.live || root.hidden) return;
    if (is_asking) {
      asks_again = true;
      return;
    }
    is_asking = true;
    asks_again = false;
    const own = folder.dataset.edited ? { folder: folder.value } : {};
    const found = await ask("search_propose", own);
    is_asking = false;
    if (asks_again) propose();
    if (!found) return;
    form.show(found, app.store.get());
    showStart();
    if (!folder.dataset.edited) folder.value = found.folder;
    start_command.set(found.command);
  }

  front_axis.addEventListener("change", drawFront);
  folder.addEventListener("change", () => {
    if (folder.value) folder.dataset.edited = "true";
    else delete folder.dataset.edited;
    propose();
  });
  earlier.addEventListener("toggle", () => { if (earlier.open) listRuns(); });
  app.on("search", (found) => {
    const was = event?.state;
    showEvent(found);
    if (found.state === "running" || found.state === was) return;
    // A search that is over leaves the map as the design is; its best is a button away.
    endPreview();
    app.say(`${found.folder}: ${found.line}`, found.state === "failed" ? "error" : "info");
    if (earlier.open) listRuns();
    propose();
  });
  /** Ask the server what there is; a page that shows no searches does not make it load them. */
  const refresh = () => {
    if (root.hidden) return;
    propose();
    listRuns();
  };
  app.on("again", refresh);
  addEventListener("tabshown", (shown) => { if (shown.detail === root.id) refresh(); });
  const soon = rested(propose, 300);
  app.store.subscribe((state, before) => {
    // What the hand changes is what the map shows.
    if (previewed && JSON.stringify(state.design) !== JSON.stringify(before.design)) endPreview();
    soon();
  });

  if (!app.live) {
    for (const part of [fresh, earlier]) part.hidden = true;
    if (app.answers.search) showEvent(app.answers.search);
    else root.append(el("p", { class: "facts" }, "No search was run when this snapshot was made."));
    return;
  }
  showStart();
  refresh();
}
