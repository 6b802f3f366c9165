// The map: the robot grown on it, the start and the obstacles to be dragged, the length grown.

import { button, el, fillSvg, number, optionsOf, paused, rested, shownBlocks, svgEl, WAYS } from "studio/dom.js";
import { hasBranch } from "studio/branch_edits.js";
import { isStale } from "studio/connection.js";
import { isEdited } from "studio/files_panel.js";
import { mapTools, thingsRow } from "studio/map_tools.js";
import { createView, ZOOM } from "studio/view.js";

const PLAY_S = 4;
const REST_MS = 700;
const HELD_MS = 150; // a hand that rests so long waits for the scores
/** @param {Dragging | null} dragging */
const isShape = (dragging) => ["obstacle", "draw", "size", "turn"].includes(dragging?.kind ?? "");

const LEAST_OBSTACLE_MM = 1;
const MOST_LISTED = 200; // branches of a design of levels; a click chooses any

/** Show a robot at a front length: what lies beyond is not grown yet. @param {Element} layer @param {number} front */
function showFront(layer, front) {
  for (const path of layer.querySelectorAll("path[data-branch]")) {
    const out = front - Number(path.getAttribute("data-base"));
    const whole = out >= Number(path.getAttribute("data-grown"));
    path.classList.toggle("unborn", out <= 0);
    if (whole) path.removeAttribute("stroke-dasharray");
    else path.setAttribute("stroke-dasharray", `${Math.max(0, out)} 1e9`);
  }
  for (const mark of layer.querySelectorAll("[data-front]")) {
    mark.classList.toggle("unborn", Number(mark.getAttribute("data-front")) > front + 1e-6);
  }
}

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const layer = (/** @type {string} */ name) => svgEl("g", { class: `${name}-layer` });
  const layers = {
    ground: layer("ground"), ghost: layer("ghost"), target: layer("target"), robot: layer("robot"),
    edit: layer("edit"), pose: layer("pose"), tool: layer("tool"),
  };
  layers.ghost.classList.add("ghost");
  const svg = svgEl("svg", {
    class: "plan", role: "application", tabindex: 0,
    "aria-label": "Map with the robot. Arrow keys move what is selected; plus and minus zoom.",
  }, ...Object.values(layers));
  const tools = mapTools(app, layers.tool);
  const view = createView(svg, (perPx) => {
    tools.scale(perPx);
    keepNamesInside();
  });
  const front = el("input", { type: "range", id: "front", min: 0, max: 1000, step: 1, value: 1000 });
  const frontOut = el("output", { for: "front", class: "value" });
  const play = button("Grow", () => {
    if (playing) return stop();
    play.textContent = "Stop";
    playing = requestAnimationFrame((now) => step(now, now));
  }, { id: "play" });
  const headline = el("p", { class: "headline", id: "targets" });
  const scores = el("div", { class: "scores", id: "scores" });
  const facts = el("p", { class: "facts", id: "facts" });
  const growth = button("By which rules?", () => document.getElementById("tab-growth")?.click(), { class: "link" });
  const widthLine = el("summary");
  const widthTable = el("div");
  const width = el("details", { class: "width", hidden: true }, widthLine, widthTable);
  const problems = el("ul", { class: "problems", id: "problems" });
  const place = el("select", { id: "environment" });
  const seed = el("input", { type: "number", id: "seed", min: 0, step: 1 });
  const ghost = el("input", { type: "checkbox", id: "ghost", checked: true });
  /**
   * Return a button after which the pointer puts something on the map.
   * @param {string} label
   * @param {string} title
   * @param {(place: Place) => void} put
   */
  const placing = (label, title, put) => button(label, ({ detail, currentTarget }) => {
    const isOn = isPressed(/** @type {Element} */ (currentTarget));
    place_off();
    // By key there is no place to click: it stands in the middle, to be moved.
    const [x, y] = middle();
    if (!detail) put([x, y]);
    else /** @type {Element} */ (currentTarget).setAttribute("aria-pressed", String(!isOn));
  }, { "aria-pressed": "false", title });
  const add = placing("Add an obstacle", "Then drag on the map from corner to corner", (place) => addObstacle(place));
  const aim = placing("Add a target", "Then click where the robot is to come", (place) => addTarget(place));
  const isPressed = (/** @type {Element} */ one) => one.getAttribute("aria-pressed") === "true";
  const place_off = () => {
    tools.turn(false);
    for (const one of [add, aim]) one.setAttribute("aria-pressed", "false");
  };
  const keep = button("Save map", () => app.saveMap(), { title: "Save obstacles, targets and start in a map file", disabled: true });
  const zoom = el("div", { class: "zoom" },
    button("+", () => view.zoom(1 / ZOOM), { "aria-label": "Zoom in" }),
    button("−", () => view.zoom(ZOOM), { "aria-label": "Zoom out" }),
    button("⤢", () => view.fit(), { "aria-label": "Whole map", title: "Whole map" }));

  const canvas = el("div", { class: "canvas" }, svg, zoom, tools.rulers);
  const things = thingsRow(app, { choose, change: changeThing, remove: removeChosen, home: () => app.store.change("start of the map", (state) => { state.pose = null; }) });
  root.append(
    canvas,
    el("div", { class: "told" }, headline, scores, width, facts, problems),
    el("div", { class: "toolbar" }, el("label", {}, "Map ", place), el("label", {}, "seed ", seed), keep, add, aim, ...tools.controls,
      el("span", { class: "gap" }), el("label", {}, ghost, " version before")),
    things.row,
    el("div", { class: "toolbar growth" }, play, el("label", { for: "front" }, "Length grown"), front, frontOut),
  );

  let answer = /** @type {LiveAnswer | null} */ (null);
  let ground = "";
  let drags = 0;
  let dragging = /** @type {Dragging | null} */ (null);
  let chosen = /** @type {Chosen} */ (null);
  let pressed = /** @type {string | null} */ (null); // the branch below the last press
  let source = { of: "", found: /** @type {SourceFound | null} */ (null) };
  let fullMm = 0;
  let share = 1;

  // ---- asking

  let lastMoved = 0;
  addEventListener("moved", (event) => { lastMoved ||= event.detail; });

  /** Return what is asked of what grows. */
  const question = () => ({ have: ground, obstacle: chosen?.kind === "obstacle" ? chosen.id : null, branch: app.branch });

  /** Ask for what grows; while an obstacle is dragged, for scores only once the hand rests. */
  async function ask(isHeld = false) {
    const isShaping = isShape(dragging);
    if (isShaping) askHeld();
    const since = lastMoved;
    lastMoved = 0;
    try {
      await app.ask("live", { ...question(), ground: !isShaping, scores: !isShaping || isHeld });
      if (since) requestAnimationFrame(() => setTimeout(() => {
        app.timings.push(performance.now() - since);
        if (app.timings.length > 5000) app.timings.splice(0, 1000);
      }));
    } catch (error) {
      if (isStale(error)) lastMoved ||= since;
      app.fail(error);
    }
  }

  const askHeld = paused(() => { if (dragging && answer?.isUnscored) ask(true); }, HELD_MS);

  // ---- showing

  function showGrown() {
    const at = share * fullMm;
    if (share < 1 && app.live && at > 0) askFront(at);
    else if (share < 1) showFront(layers.robot, at);
    const cut = !app.live && share < 1 ? ", the final shape cut" : "";
    frontOut.textContent = fullMm ? `${number(at, 0)} of ${number(fullMm, 0)} mm${cut}` : "–";
    front.setAttribute("aria-valuetext", frontOut.textContent);
  }

  // Dashes cut the final robot; a tip that slid along a wall lay elsewhere, which the server knows.
  /** @param {number} front_mm */
  async function askFront(front_mm) {
    const whole = answer;
    try {
      const found = await app.ask("front", { front_mm });
      if (whole !== answer || share >= 1) return;
      fillSvg(layers.robot, found.robot_svg);
      markBranch();
    } catch {
      // A newer length is asked for, or the answer to the design says what is wrong.
    }
  }

  function showGhost() {
    const shown = app.previewed ? app.present : app.reference?.answers?.live;
    fillSvg(layers.ghost, app.showGhost && shown?.robot_svg ? shown.robot_svg : "");
  }

  /** @param {LiveAnswer} found */
  function showPose({ pose, pose_svg }) {
    // The handle that has the focus keeps it; one that had it once does not take it back.
    const active = document.activeElement;
    const held = active && layers.pose.contains(active) ? active.classList : null;
    fillSvg(layers.pose, pose_svg ?? "");
    const handles = { base: "Start of the robot", heading: "Heading of the robot" };
    for (const [name, label] of Object.entries(handles)) {
      const handle = layers.pose.querySelector(`.handle.${name}`);
      if (!pose || !(handle instanceof SVGElement)) continue;
      handle.setAttribute("tabindex", "0");
      handle.setAttribute("role", "slider");
      handle.setAttribute("aria-label", label);
      const { x_mm, y_mm, heading_deg } = pose;
      const words = name === "base" ? `${number(x_mm, 1)}, ${number(y_mm, 1)} mm` : `${number(heading_deg, 1)} degrees`;
      handle.setAttribute("aria-valuetext", words);
      handle.setAttribute("aria-valuenow", String(name === "base" ? x_mm : heading_deg));
      if (held?.contains(name)) handle.focus({ preventScroll: true });
    }
  }

  /** Move the names of targets that the edge of the plan would cut off. */
  function keepNamesInside() {
    const texts = layers.target.querySelectorAll("text");
    for (const text of texts) text.style.transform = "";
    const { right } = svg.getBoundingClientRect();
    for (const [text, over] of [...texts].map((text) => /** @type {const} */ ([text, text.getBoundingClientRect().right - right]))) {
      if (over > 0) text.style.transform = `translateX(${-over - 8}px)`;
    }
  }

  /** Show targets, and of an obstacle that is chosen its shape with frame and handles. @param {LiveAnswer} found */
  function showThings(found) {
    fillSvg(layers.target, found.targets_svg ?? "");
    keepNamesInside();
    const shaped = chosen?.kind === "obstacle" && chosen.id === found.obstacle?.index ? found.obstacle : null;
    const branch = chosen?.kind === "branch" && found.branch?.label === chosen.id ? found.branch : null;
    fillSvg(layers.edit, app.live ? shaped?.svg ?? branch?.svg ?? "" : "");
    if (shaped) obstacle(shaped.index)?.setAttribute("d", shaped.path);
    for (const part of svg.querySelectorAll(".chosen")) part.classList.remove("chosen");
    const part = chosen?.kind === "obstacle" ? obstacle(chosen.id)
      : [...layers.target.children].find((one) => chosen && one.getAttribute("data-target") === chosen.id);
    part?.classList.add("chosen");
    markBranch();
    const targets = found.targets ?? [];
    const count = layers.ground.querySelectorAll("[data-obstacle]").length;
    things.show(chosen, valuesOf(chosen), count, targets.map(({ name }) => name), branches());
    headline.hidden = !targets.length;
    headline.dataset.tone = found.targets_tone ?? "";
    headline.replaceChildren(el("b", {}, `Targets: ${found.targets_headline ?? "nothing grows"}`), ...targets.map(({ name, state, touched }) =>
      button(`${name} ${state ?? ""}`, () => choose({ kind: "target", id: name }), { class: touched ? "touched" : "" })));
  }

  /** Return what branches are called in a list: by their names, or those on the map by their ids where the design has levels. */
  function branches() {
    const names = Object.values(answer?.names ?? {});
    const tips = names.length ? [] : [...layers.robot.querySelectorAll(".tips [data-branch]")];
    return names.length ? names : tips.slice(0, MOST_LISTED).map(labelOf);
  }

  /** @param {Element} part of a branch */
  function labelOf(part) {
    const id = part.getAttribute("data-branch") ?? "";
    return answer?.names[id] ?? id;
  }

  /** Mark the branch that is chosen. */
  function markBranch() {
    for (const part of layers.robot.querySelectorAll("[data-branch]")) part.classList.toggle("chosen", labelOf(part) === app.branch);
  }

  /** @param {Chosen} thing @returns {ThingValues} */
  function valuesOf(thing) {
    if (!thing) return answer?.pose;
    if (thing.kind === "branch") return null;
    if (thing.kind === "obstacle") return answer?.obstacle?.index === thing.id ? answer.obstacle.frame : null;
    const target = targetOf(thing.id);
    return target && { ...target, x_mm: target.point_mm?.[0], y_mm: target.point_mm?.[1] };
  }

  /** @param {string} [id] */
  const targetOf = (id) => answer?.targets?.find(({ name }) => name === id);

  /** @param {LiveAnswer} found */
  function showFacts(found) {
    scores.classList.toggle("stale", Boolean(found.isUnscored));
    if (!found.isUnscored) scores.replaceChildren(...Object.entries(found.scores ?? {}).map(([task, score]) =>
      el("div", { class: "score", "data-task": task },
        el("span", { class: "name" }, found.titles?.[task] ?? task), el("span", { class: "value" }, score === null ? "–" : number(score, 3)),
        el("span", { class: "standing" }, "simulated"))));
    facts.replaceChildren(`${found.facts.text}. `, growth);
    growth.title = `Grown with: ${found.growth.text}`;
    problems.replaceChildren(...[...(found.unscored ?? []), ...(found.problems ?? [])].map((text) => el("li", {}, text)));
  }

  /** Ask how wide the scores are once everything rests: it takes a process that simulates. */
  const askWidth = rested(async () => {
    if (!app.live || answer?.engine !== "kernel") return;
    try {
      const found = await app.ask("width");
      width.hidden = !found.text;
      widthLine.textContent = found.text;
      widthTable.replaceChildren(...shownBlocks(found.blocks));
      width.classList.remove("stale");
    } catch {
      width.hidden = true; // why nothing grows stands with the robot
    }
  }, REST_MS);

  /** @param {LiveAnswer} found @param {StudioState} state */
  function show(found, state) {
    if (found.source) source = { of: JSON.stringify(state.map?.source), found: found.source };
    width.classList.add("stale");
    askWidth();
    // While an obstacle is dragged the scores stay those before, and are shown as such.
    if (!found.scores && answer) Object.assign(found, { scores: answer.scores, titles: answer.titles, unscored: answer.unscored, isUnscored: true });
    answer = found;
    if (found.isUnscored && isShape(dragging)) askHeld(); // it came after the hand had rested
    if (!app.previewed) app.present = found;
    if (found.ground_svg !== null && found.ground_svg !== undefined) {
      fillSvg(layers.ground, found.ground_svg);
      ground = found.ground_key;
    } else if (found.ground_key && found.ground_key !== ground && !isShape(dragging)) {
      ask(); // it was asked before the answer that drew another ground
    }
    if (found.view_box) view.whole(/** @type {Box} */ (found.view_box.split(/[ ,]+/).map(Number)));
    fullMm = found.front_full_mm ?? 0;
    showGhost();
    fillSvg(layers.robot, found.robot_svg ?? "");
    if (share < 1) showFront(layers.robot, share * fullMm);
    showGrown();
    showPose(found);
    showThings(found);
    showFacts(found);
  }

  // ---- the length grown

  /** @param {number} value */
  function setShare(value) {
    const was = share;
    share = Math.min(1, Math.max(0, value));
    front.value = String(Math.round(1000 * share));
    if (was < 1 && share >= 1) fillSvg(layers.robot, answer?.robot_svg ?? "");
    showGrown();
  }
  let playing = 0;
  /** @param {number} begun @param {number} now */
  function step(begun, now) {
    const done = (now - begun) / (1000 * PLAY_S);
    setShare(done);
    if (done < 1 && playing) playing = requestAnimationFrame((next) => step(begun, next));
    else stop();
  }
  function stop() {
    cancelAnimationFrame(playing);
    playing = 0;
    play.textContent = "Grow";
  }
  front.addEventListener("input", () => {
    stop();
    setShare(Number(front.value) / 1000);
  });

  // ---- the start

  /** Return the open map as it is before the page changes it, if it is known by now. @param {StudioState} state */
  const sourceOf = ({ map }) => (map && source.of === JSON.stringify(map.source) ? source.found : null);

  /** Return the start. @param {StudioState} state */
  const poseOf = (state) => state.pose ?? sourceOf(state)?.pose ?? null;

  /** @param {(pose: Pose) => Partial<Pose>} part of the start at present @param {string} [group] */
  function changePose(part, group) {
    app.store.change("start", (state) => {
      const present = poseOf(state) ?? { x_mm: 0, y_mm: 0, heading_deg: 90 };
      state.pose = { ...present, ...part(present) };
    }, group ? { group } : {});
  }

  // ---- obstacles, targets and tips

  /** @param {number} index */
  function obstacle(index) {
    return layers.ground.querySelector(`[data-obstacle="${index}"]`);
  }

  /** @param {Chosen} thing */
  function choose(thing) {
    chosen = thing;
    const branch = thing?.kind === "branch" ? thing.id : null;
    if (branch !== app.branch) app.chooseBranch(branch);
    if (answer) showThings(answer);
    if (app.live) ask();
  }
  app.onBranch((label) => {
    if (label !== (chosen?.kind === "branch" ? chosen.id : null)) choose(label === null ? null : { kind: "branch", id: label });
  });

  /** @param {string} label @param {MapEdit} change @param {string} [group] */
  function edit(label, change, group) {
    app.store.change(label, (state) => {
      if (!state.map) return;
      const { edits } = state.map;
      const last = edits.at(-1);
      // A drag of one obstacle is one edit, however many steps it takes.
      const isSame = last?.[0] === change[0] && (change[0] === "add" || last[1] === change[1]);
      if (group && group === dragging?.edited && isSame) edits[edits.length - 1] = change;
      else edits.push(change);
      if (dragging && group) dragging.edited = group;
    }, group ? { group } : {});
  }

  /**
   * Change the targets of the page: a copy of what the map has, until one is changed.
   * @param {string} label
   * @param {(targets: MapTarget[], map: OpenMap) => void} change
   * @param {string} [group]
   */
  function changeTargets(label, change, group) {
    app.store.change(label, (state) => {
      if (!state.map) return;
      state.map.targets ??= structuredClone(targetsOf(state));
      change(state.map.targets, state.map);
    }, group ? { group } : {});
  }

  /** Return the targets. @param {StudioState} state @returns {MapTarget[]} */
  function targetsOf(state) {
    const own = (/** @type {TargetFound} */ { name, point_mm, area_mm, tolerance_mm }) => ({ name, tolerance_mm, ...(point_mm ? { point_mm } : { area_mm }) });
    return state.map?.targets ?? (sourceOf(state)?.targets ?? []).map(own);
  }

  /** @param {string} name @param {(from: Place) => Place} to @param {string} [group] */
  function moveTarget(name, to, group) {
    changeTargets(`target ${name}`, (targets) => {
      const target = targets.find((one) => one.name === name);
      if (target?.point_mm) target.point_mm = snapped(to(target.point_mm));
    }, group);
  }

  /** Return how many obstacles there are. @param {StudioState} state */
  function obstaclesOf(state) {
    const by = { add: 1, remove: -1, move: 0, place: 0 };
    return (state.map?.edits ?? []).reduce((count, [kind]) => count + by[kind], sourceOf(state)?.obstacles ?? 0);
  }

  /** Add a small obstacle at a place. @param {Place} place */
  function addObstacle([x, y]) {
    const half = Math.max(LEAST_OBSTACLE_MM, 0.03 * middle()[2]);
    chosen = { kind: "obstacle", id: obstaclesOf(app.store.get()) };
    place_off();
    edit("obstacle added", ["add", box([x - half, y - half], [x + half, y + half])]);
    svg.focus({ preventScroll: true });
  }

  /** Return the corners of a box of at least some size. @param {Place} from @param {Place} to @returns {Place[]} */
  function box(from, to) {
    const [[x0, y0], [x1, y1]] = [snapped(from), snapped(to)];
    const [right, up] = [[x0, x1], [y0, y1]].map(([one, other]) => (Math.abs(other - one) < LEAST_OBSTACLE_MM ? one + LEAST_OBSTACLE_MM : other));
    return [[x0, y0], [right, y0], [right, up], [x0, up]];
  }

  /** Take what was typed of a thing. @param {ThingKind} kind @param {string} key @param {string | number} value */
  function changeThing(kind, key, value) {
    if (kind === "start") changePose(() => ({ [key]: value }));
    else if (chosen?.kind === "obstacle") edit("obstacle placed", ["place", chosen.id, { [key]: Number(value) }]);
    else if (chosen) {
      const { id } = chosen;
      if (key === "name") {
        if (targetsOf(app.store.get()).some(({ name }) => name === value)) return app.say(`There is a target ${value} already`, "error");
        chosen = { kind: "target", id: String(value) };
      }
      changeTargets(`target ${id}`, (targets) => {
        const target = targets.find((one) => one.name === id);
        if (key !== "x_mm" && key !== "y_mm") Object.assign(target ?? {}, { [key]: value });
        else if (target?.point_mm) target.point_mm[key === "x_mm" ? 0 : 1] = Number(value);
      });
    }
  }

  /** Return the middle of what is seen, and its shorter side. @returns {[...Place, size: number]} */
  const middle = () => {
    const [x, y, width, height] = (svg.getAttribute("viewBox") ?? "").split(" ").map(Number);
    return [x + width / 2, -(y + height / 2), Math.min(width, height)];
  };

  /** @param {Place} place @returns {Place} */
  const snapped = ([x, y]) => [tools.mm(x), tools.mm(y)];

  /** @param {Place} place */
  function addTarget(place) {
    place_off();
    const taken = targetsOf(app.store.get()).map((target) => target.name);
    const name = [..."ABCDEFGHIJKLMNOPQRSTUVWXYZ"].find((letter) => !taken.includes(letter)) ?? `T${taken.length + 1}`;
    chosen = { kind: "target", id: name };
    changeTargets(`target ${name}`, (targets) => { targets.push({ name, point_mm: snapped(place) }); });
  }

  function removeChosen() {
    if (!chosen) return;
    const gone = chosen;
    if (gone.kind !== "branch") chosen = null;
    if (gone.kind === "branch") app.edits.edit("remove", gone.id);
    else if (gone.kind === "obstacle") edit("obstacle deleted", ["remove", gone.id]);
    else changeTargets(`target ${gone.id} deleted`, (targets, map) => { map.targets = targets.filter((one) => one.name !== gone.id); });
  }

  /** Pull a tip, or a bend, to where the pointer is by now, one step after the other, all of them one undo. @param {TipDrag} held @param {string} group */
  async function pullTip(held, group) {
    if (held.isBusy) return;
    held.isBusy = true;
    const asked = /** @type {TipAsk} */ (held.bend === undefined ? {} : { bend: held.bend });
    while (held.to) {
      asked.to = held.to;
      asked.live = question();
      held.to = null;
      await app.edits.tip(held.branch, asked, group);
    }
    held.bend = asked.bend;
    held.isBusy = false;
    if (dragging !== held) app.store.endGroup();
  }

  // ---- which map

  /** @param {StudioState} state */
  function showSource(state) {
    const { environment = "", file: path = "", seed: number = "" } = state.map?.source ?? {};
    const names = new Set([...(app.hello.environments ?? []), environment].filter(Boolean));
    const file = path.split("/").at(-1);
    const edited = isEdited(state) ? ", changed" : "";
    keep.disabled = !app.live || !state.map || !isEdited(state);
    const options = optionsOf([...names].map((name) => [name]));
    if (file || !state.map) options.unshift(el("option", { value: "" }, file || "none"));
    options.find((option) => option.value === environment)?.append(edited);
    place.replaceChildren(...options);
    place.value = environment;
    seed.disabled = !environment || !app.live;
    place.disabled = !app.live;
    if (document.activeElement !== seed) seed.value = String(number);
  }

  /** @param {MapSource} source */
  function takeSource(source) {
    app.store.change("map", (state) => {
      state.map = { source, edits: [] };
      state.pose = null; // a start belongs to the map that it was put on
    });
  }
  place.addEventListener("change", () => {
    if (place.value) takeSource({ environment: place.value, seed: Number(seed.value) || 0 });
  });
  seed.addEventListener("change", () => {
    const source = app.store.get().map?.source;
    if (seed.validity.valid && seed.value !== "") takeSource({ ...source, seed: Number(seed.value) });
  });

  // ---- the pointer

  /** Return what an element is to be dragged as. @param {EventTarget | null} element @returns {Grabbed} */
  function grabbed(element) {
    if (tools.isOn()) return { kind: "measure" };
    if (!app.live || !(element instanceof Element)) return { kind: "view" };
    if (isPressed(add)) return { kind: "draw" };
    const pose = answer?.pose;
    if (pose && element.closest(".pose-layer .base")) return { kind: "base", pose };
    if (pose && element.closest(".pose-layer .heading")) return { kind: "heading", pose };
    const branch = element.closest(".robot-layer .mark[data-branch]")?.getAttribute("data-branch");
    if (branch) return { kind: "tip", branch: answer?.names[branch] ?? branch, isBusy: false, to: null };
    const bend = element.closest(".edit-layer .bend");
    if (bend && app.branch) return { kind: "tip", branch: app.branch, bend: Number(bend.getAttribute("data-bend")), isBusy: false, to: null };
    const body = element.closest(".robot-layer [data-branch]");
    if (body) return { kind: "view", branch: labelOf(body) };
    const goal = element.closest("[data-target]");
    if (goal) {
      const target = targetOf(goal.getAttribute("data-target") ?? "");
      return target?.point_mm ? { kind: "target", id: target.name, from: target.point_mm } : { kind: "view" };
    }
    const handle = element.closest(".edit-layer .handle");
    const shaped = answer?.obstacle;
    if (handle && shaped) return { kind: handle.classList.contains("turn") ? "turn" : "size", id: shaped.index, frame: shaped.frame };
    const rock = element.closest("[data-obstacle]");
    return rock ? { kind: "obstacle", id: Number(rock.getAttribute("data-obstacle")) } : { kind: "view" };
  }

  svg.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !answer) return;
    const at = view.place(event);
    if (isPressed(aim)) return addTarget([at[0], -at[1]]);
    // The plan keeps its size while it is dragged and when it is let go, however many lines the
    // answers below it have; the next change from elsewhere frees it.
    canvas.style.flex = `0 0 ${canvas.getBoundingClientRect().height}px`;
    const grab = grabbed(event.target);
    pressed = grab.kind === "view" ? grab.branch ?? null : null;
    drags += 1;
    dragging = { ...grab, at: grab.kind === "measure" ? snapped(at) : at, drag: drags, moved: false, matrix: view.matrix() };
    if (grab.kind === "obstacle") choose({ kind: grab.kind, id: grab.id });
    else if (grab.kind === "target") choose({ kind: grab.kind, id: grab.id });
    else if (grab.kind === "tip" || (grab.kind === "view" && grab.branch)) choose({ kind: "branch", id: grab.branch ?? "" });
    else if (grab.kind === "draw") chosen = { kind: "obstacle", id: obstaclesOf(app.store.get()) };
    else if (!["size", "turn", "measure"].includes(grab.kind)) choose(null);
    svg.setPointerCapture(event.pointerId);
    if (grab.kind !== "base" && grab.kind !== "heading") svg.focus({ preventScroll: true });
  });

  svg.addEventListener("pointermove", (event) => {
    if (!dragging) return tools.at(view.place(event));
    dragging.moved = true;
    const [x, y] = view.place(event, dragging.matrix);
    const [dx, dy] = [x - dragging.at[0], y - dragging.at[1]];
    const group = `${dragging.kind} ${dragging.drag}`;
    if (dragging.kind === "measure") return tools.draw(dragging.at, snapped([x, y]));
    tools.at([x, y]);
    if (dragging.kind === "view") {
      view.move(dx, dy);
      dragging.matrix = view.matrix();
      return;
    }
    dispatchEvent(new CustomEvent("moved", { detail: event.timeStamp }));
    drag(dragging, [x, -y], [dx, -dy], group);
  });

  /**
   * Change what was grabbed; places are the map's, in mm.
   * @param {Dragging} held
   * @param {Place} to
   * @param {Place} by
   * @param {string} group
   */
  function drag(held, to, [dx, dy], group) {
    switch (held.kind) {
      case "base": return changePose(() => ({ x_mm: tools.mm(held.pose.x_mm + dx), y_mm: tools.mm(held.pose.y_mm + dy) }), group);
      case "heading": return changePose((pose) => ({ heading_deg: headingFrom(pose, to) }), group);
      case "draw": return edit("obstacle added", ["add", box([held.at[0], -held.at[1]], to)], group);
      case "tip":
        held.to = to;
        return pullTip(held, group);
      case "target": return moveTarget(held.id, () => [held.from[0] + dx, held.from[1] + dy], group);
      case "obstacle": return edit("obstacle moved", ["move", held.id, tools.mm(dx), tools.mm(dy)], group);
      case "turn": return edit("obstacle turned", ["place", held.id, { turn_deg: headingFrom(held.frame, to) }], group);
      case "size": return edit("obstacle resized", ["place", held.id, sized(held.frame, to)], group);
    }
  }

  /** Return the direction from one place to another. @param {{ x_mm: number, y_mm: number }} from @param {Place} to */
  const headingFrom = ({ x_mm, y_mm }, [x, y]) => tools.deg((Math.atan2(y - y_mm, x - x_mm) * 180) / Math.PI);

  /** Return the size of a frame with its corner at a place, its middle kept. @param {Frame} frame @param {Place} corner */
  function sized(frame, [x, y]) {
    const turn = (frame.turn_deg * Math.PI) / 180;
    const [ax, ay] = [x - frame.x_mm, y - frame.y_mm];
    const along = ax * Math.cos(turn) + ay * Math.sin(turn);
    const across = ay * Math.cos(turn) - ax * Math.sin(turn);
    const [width_mm, height_mm] = [along, across].map((half) => Math.max(LEAST_OBSTACLE_MM, tools.mm(2 * half)));
    return { width_mm, height_mm };
  }

  function release() {
    if (!dragging) return;
    const was = dragging;
    dragging = null;
    if (was.kind === "draw") {
      if (was.moved) place_off();
      else addObstacle([was.at[0], -was.at[1]]);
    }
    if (was.kind !== "tip" || !was.isBusy) app.store.endGroup();
    if (isShape(was) && was.moved) ask();
    if (width.classList.contains("stale")) askWidth(); // its time may have come under the hand
    dispatchEvent(new CustomEvent("released"));
  }
  // Not "dblclick": a browser sends none where an answer redraws the branch while it is pressed.
  svg.addEventListener("mousedown", (event) => {
    const [x, y] = view.place(event);
    if (event.detail === 2 && pressed !== null && app.live) app.edits.edit("bend", pressed, [x, -y]);
  });
  svg.addEventListener("pointerup", release);
  svg.addEventListener("pointercancel", release);

  // ---- the keyboard

  svg.addEventListener("keydown", (event) => {
    const far = event.shiftKey ? 10 : 1;
    const way = WAYS[event.key];
    if (event.key === "+" || event.key === "=") view.zoom(1 / ZOOM);
    else if (event.key === "-") view.zoom(ZOOM);
    else if (event.key === "0") view.fit();
    else if (event.key === "Delete" && app.live) removeChosen();
    else if (event.key === "Escape") {
      place_off();
    }
    else if (way && app.live) moveByKey(event.target, way, far);
    else return;
    event.preventDefault();
  });

  /** @param {EventTarget | null} target @param {Place} way @param {number} far */
  function moveByKey(target, [dx, dy], far) {
    const handle = target instanceof Element ? target.closest(".handle") : null;
    if (handle?.classList.contains("heading")) {
      changePose(({ heading_deg }) => ({ heading_deg: heading_deg + far * (dy - dx) }), "heading by key");
    } else if (handle) {
      changePose(({ x_mm, y_mm }) => ({ x_mm: x_mm + far * dx, y_mm: y_mm + far * dy }), "start by key");
    } else if (chosen?.kind === "branch") app.edits.tip(chosen.id, { by: [far * dx, far * dy], live: question() });
    else if (chosen?.kind === "obstacle") edit("obstacle moved", ["move", chosen.id, far * dx, far * dy]);
    else if (chosen) moveTarget(chosen.id, ([x, y]) => [x + far * dx, y + far * dy]);
  }

  ghost.addEventListener("change", () => {
    app.showGhost = ghost.checked;
    showGhost();
  });

  // ---- what comes from elsewhere

  app.onAnswer("live", show);
  app.onPreview(() => {
    root.classList.toggle("previewing", Boolean(app.previewed));
    if (app.live) ask();
  });
  app.onReference(showGhost);
  app.onHighlight((branches) => {
    for (const part of layers.robot.querySelectorAll("[data-branch]")) {
      part.classList.toggle("highlit", branches.includes(part.getAttribute("data-branch") ?? ""));
    }
  });
  const freeHeight = () => { if (!dragging) canvas.style.flex = ""; };
  addEventListener("resize", freeHeight);
  app.store.subscribe((state, before) => {
    freeHeight();
    if (JSON.stringify([state.map, state.pose]) !== JSON.stringify([before.map, before.pose])) showSource(state);
    // What undo takes away is chosen no more.
    if (app.branch !== null && !hasBranch(state.design, app.branch)) app.chooseBranch(null);
    if (chosen?.kind === "obstacle" && (state.map?.edits.length ?? 0) < (before.map?.edits.length ?? 0)) chosen = null;
    if (app.live) ask();
  });
  app.on("engine", () => ask());
  app.on("again", () => ask());
  for (const one of [add, aim]) one.disabled = !app.live;
  showSource(app.store.get());
  if (app.live) ask();
}
