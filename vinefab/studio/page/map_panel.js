// The map: the robot grown on it, the start and the obstacles to be dragged, the length grown.

import { el, fillSvg, number, paused, shownBlocks, svgEl } from "studio/dom.js";
import { thingsRow } from "studio/map_things.js";
import { mapTools } from "studio/map_tools.js";
import { createView, ZOOM } from "studio/view.js";

const PLAY_S = 4;
const REST_MS = 700;
const HELD_MS = 150; // a hand that rests so long waits for the scores
const SHAPING = ["obstacle", "size", "turn"];

const LEAST_OBSTACLE_MM = 1;

/** Show a robot at a front length: what lies beyond is not grown yet. */
export function showFront(layer, front) {
  for (const path of layer.querySelectorAll("path[data-branch]")) {
    const base = Number(path.dataset.base);
    const out = front - base;
    const whole = out >= Number(path.dataset.grown);
    path.classList.toggle("unborn", out <= 0);
    if (whole) path.removeAttribute("stroke-dasharray");
    else path.setAttribute("stroke-dasharray", `${Math.max(0, out)} 1e9`);
  }
  for (const mark of layer.querySelectorAll("[data-front]")) {
    mark.classList.toggle("unborn", Number(mark.dataset.front) > front + 1e-6);
  }
}

export function mount(root, app) {
  const layers = Object.fromEntries(
    ["ground-layer", "ghost-layer", "target-layer", "robot-layer", "edit-layer", "pose-layer", "tool-layer"].map((name) => [name, svgEl("g", { class: name })]),
  );
  layers["ghost-layer"].classList.add("ghost");
  const svg = svgEl("svg", {
    class: "plan", role: "application", tabindex: 0,
    "aria-label": "Map with the robot. Arrow keys move what is selected; plus and minus zoom.",
  }, ...Object.values(layers));
  const tools = mapTools(app, layers["tool-layer"]);
  const view = createView(svg, tools.scale);
  const front = el("input", { type: "range", id: "front", min: 0, max: 1000, step: 1, value: 1000 });
  const frontOut = el("output", { for: "front", class: "value" });
  const play = el("button", { type: "button", id: "play" }, "Grow");
  const headline = el("p", { class: "headline", id: "targets" });
  const scores = el("div", { class: "scores", id: "scores" });
  const facts = el("p", { class: "facts", id: "facts" });
  const growth = el("button", { type: "button", class: "link", onclick: () => document.getElementById("tab-growth").click() }, "By which rules?");
  const width = el("details", { class: "width", hidden: true }, el("summary"), el("div"));
  const problems = el("ul", { class: "problems", id: "problems" });
  const place = el("select", { id: "environment" });
  const seed = el("input", { type: "number", id: "seed", min: 0, step: 1 });
  const ghost = el("input", { type: "checkbox", id: "ghost", checked: true });
  const add = el("button", { type: "button" }, "Add an obstacle");
  const aim = el("button", { type: "button", "aria-pressed": "false", title: "Then click where the robot is to come" }, "Add a target");
  const bigger = el("button", { type: "button", "aria-label": "Zoom in" }, "+");
  const smaller = el("button", { type: "button", "aria-label": "Zoom out" }, "−");
  const fit = el("button", { type: "button", "aria-label": "Whole map", title: "Whole map" }, "⤢");

  const things = thingsRow(app, { choose, change: changeThing, remove: removeChosen, home: () => app.store.change("start of the map", (state) => { state.pose = null; }) });
  root.append(
    el("div", { class: "canvas" }, svg, el("div", { class: "zoom" }, bigger, smaller, fit), ...tools.overlay),
    el("div", { class: "told" }, headline, scores, width, facts, problems),
    el("div", { class: "toolbar" }, el("label", {}, "Map ", place), el("label", {}, "seed ", seed), add, aim, ...tools.controls,
      el("span", { class: "gap" }), el("label", {}, ghost, " version before")),
    things.row,
    el("div", { class: "toolbar growth" }, play, el("label", { for: "front" }, "Length grown"), front, frontOut),
  );

  let answer = null;
  let ground = "";
  let drags = 0;
  let dragging = null;
  let chosen = null; // { kind, id } of an obstacle or a target; null: the start
  let fullMm = 0;
  let share = 1;

  // ---- asking

  let lastMoved = 0;
  const timings = (app.timings = []);
  addEventListener("moved", (event) => { lastMoved ||= event.detail; });

  /** Ask for what grows; while an obstacle is dragged, for scores only once the hand rests. */
  async function ask(isHeld = false) {
    const isShaping = SHAPING.includes(dragging?.kind);
    if (isShaping) askHeld();
    const since = lastMoved;
    lastMoved = 0;
    try {
      await app.ask("live", { have: ground, ground: !isShaping, scores: !isShaping || isHeld, obstacle: chosen?.kind === "obstacle" ? chosen.id : null });
      if (since) requestAnimationFrame(() => setTimeout(() => keepTiming(performance.now() - since)));
    } catch (error) {
      if (error.stale) lastMoved ||= since;
      else if (!error.stopped) app.say(error.message, "error");
    }
  }

  const askHeld = paused(() => { if (dragging && answer?.isUnscored) ask(true); }, HELD_MS);

  function keepTiming(ms) {
    timings.push(ms);
    if (timings.length > 5000) timings.splice(0, 1000);
  }

  // ---- showing

  function showRobot() {
    fillSvg(layers["robot-layer"], answer.robot_svg ?? "");
    if (share < 1) showFront(layers["robot-layer"], share * fullMm);
    showGrown();
  }

  function showGrown() {
    const at = share * fullMm;
    if (share < 1 && app.live && at > 0) askFront(at);
    else if (share < 1) showFront(layers["robot-layer"], at);
    const cut = !app.live && share < 1 ? ", the final shape cut" : "";
    frontOut.textContent = fullMm ? `${number(at, 0)} of ${number(fullMm, 0)} mm${cut}` : "–";
    front.setAttribute("aria-valuetext", frontOut.textContent);
  }

  // Dashes cut the final robot; a tip that slid along a wall lay elsewhere, which the server knows.
  async function askFront(front_mm) {
    const whole = answer;
    try {
      const found = await app.ask("front", { front_mm });
      if (whole !== answer || share >= 1) return;
      fillSvg(layers["robot-layer"], found.robot_svg);
    } catch {
      // A newer length is asked for, or the answer to the design says what is wrong.
    }
  }

  function showGhost() {
    const shown = app.previewed ? app.present : app.reference?.answers?.live;
    fillSvg(layers["ghost-layer"], app.showGhost && shown?.robot_svg ? shown.robot_svg : "");
  }

  function showPose() {
    fillSvg(layers["pose-layer"], answer.pose_svg ?? "");
    const handles = { base: "Start of the robot", heading: "Heading of the robot" };
    for (const [name, label] of Object.entries(handles)) {
      const handle = layers["pose-layer"].querySelector(`.handle.${name}`);
      if (!handle) continue;
      handle.setAttribute("tabindex", "0");
      handle.setAttribute("role", "slider");
      handle.setAttribute("aria-label", label);
      const { x_mm, y_mm, heading_deg } = answer.pose;
      const words = name === "base" ? `${number(x_mm, 1)}, ${number(y_mm, 1)} mm` : `${number(heading_deg, 1)} degrees`;
      handle.setAttribute("aria-valuetext", words);
      handle.setAttribute("aria-valuenow", name === "base" ? x_mm : heading_deg);
      if (focused === name) handle.focus({ preventScroll: true });
    }
  }

  /** Show targets, and of an obstacle that is chosen its shape with frame and handles. */
  function showThings() {
    fillSvg(layers["target-layer"], answer.targets_svg ?? "");
    const { obstacle: found } = answer;
    const isShown = found && chosen?.kind === "obstacle" && chosen.id === found.index;
    fillSvg(layers["edit-layer"], isShown && app.live ? found.svg : "");
    if (isShown) obstacle(found.index)?.setAttribute("d", found.path);
    for (const part of svg.querySelectorAll(".chosen")) part.classList.remove("chosen");
    const part = chosen?.kind === "obstacle" ? obstacle(chosen.id)
      : [...layers["target-layer"].children].find((one) => one.dataset.target === chosen?.id);
    part?.classList.add("chosen");
    const targets = answer.targets ?? [];
    const count = layers["ground-layer"].querySelectorAll("[data-obstacle]").length;
    things.show(chosen, valuesOf(chosen), count, targets.map(({ name }) => name));
    headline.hidden = !targets.length;
    headline.dataset.tone = answer.targets_tone ?? "";
    headline.replaceChildren(el("b", {}, `Targets: ${answer.targets_headline ?? "nothing grows"}`), ...targets.map(({ name, state, touched }) => el("button", {
      type: "button", class: touched ? "touched" : "", onclick: () => choose({ kind: "target", id: name }),
    }, `${name} ${state ?? ""}`)));
  }

  function valuesOf(thing) {
    if (!thing) return answer?.pose;
    if (thing.kind === "obstacle") return answer.obstacle?.index === thing.id ? answer.obstacle.frame : null;
    const target = (answer.targets ?? []).find(({ name }) => name === thing.id);
    return target && { ...target, x_mm: target.point_mm?.[0], y_mm: target.point_mm?.[1] };
  }

  function showFacts() {
    scores.classList.toggle("stale", Boolean(answer.isUnscored));
    if (!answer.isUnscored) scores.replaceChildren(...Object.entries(answer.scores ?? {}).map(([task, score]) =>
      el("div", { class: "score", "data-task": task },
        el("span", { class: "name" }, answer.titles?.[task] ?? task), el("span", { class: "value" }, score === null ? "–" : number(score, 3)),
        el("span", { class: "standing" }, "simulated"))));
    facts.replaceChildren(`${answer.facts.text}. `, growth);
    growth.title = `Grown with: ${answer.growth?.text}`;
    problems.replaceChildren(...[...(answer.unscored ?? []), ...(answer.problems ?? [])].map((text) => el("li", {}, text)));
  }

  /** Ask how wide the scores are once everything rests: it takes a process that simulates. */
  const askWidth = paused(async () => {
    if (!app.live || answer?.engine !== "kernel" || dragging) return;
    try {
      const found = await app.ask("width");
      width.hidden = !found.text;
      width.firstChild.textContent = found.text;
      width.lastChild.replaceChildren(...shownBlocks(found.blocks));
      width.classList.remove("stale");
    } catch {
      width.hidden = true; // why nothing grows stands with the robot
    }
  }, REST_MS);

  function show(found) {
    width.classList.add("stale");
    askWidth();
    // While an obstacle is dragged the scores stay those before, and are shown as such.
    if (!found.scores && answer) Object.assign(found, { scores: answer.scores, titles: answer.titles, unscored: answer.unscored, isUnscored: true });
    answer = found;
    if (!app.previewed) app.present = found;
    if (found.ground_svg !== null && found.ground_svg !== undefined) {
      fillSvg(layers["ground-layer"], found.ground_svg);
      ground = found.ground_key;
    }
    if (found.view_box) view.whole(found.view_box);
    fullMm = found.front_full_mm ?? 0;
    showGhost();
    showRobot();
    showPose();
    showThings();
    showFacts();
  }

  // ---- the length grown

  function setShare(value) {
    const was = share;
    share = Math.min(1, Math.max(0, value));
    front.value = Math.round(1000 * share);
    if (was < 1 && share >= 1) fillSvg(layers["robot-layer"], answer?.robot_svg ?? "");
    showGrown();
  }
  let playing = 0;
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
  play.addEventListener("click", () => {
    if (playing) return stop();
    play.textContent = "Stop";
    playing = requestAnimationFrame((now) => step(now, now));
  });

  // ---- the start

  let focused = "";

  function changePose(part, group) {
    const present = answer?.pose ?? { x_mm: 0, y_mm: 0, heading_deg: 90 };
    app.store.change("start", (state) => { state.pose = { ...present, ...state.pose, ...part }; }, group ? { group } : {});
  }

  // ---- obstacles, targets and tips

  function obstacle(index) {
    return layers["ground-layer"].querySelector(`[data-obstacle="${index}"]`);
  }

  function choose(thing) {
    chosen = thing;
    if (answer) showThings();
    if (app.live) ask();
  }

  function edit(label, change, group) {
    app.store.change(label, (state) => {
      if (!state.map) return;
      const { edits } = state.map;
      const last = edits.at(-1);
      // A drag of one obstacle is one edit, however many steps it takes.
      if (group && group === dragging?.edited && last?.[0] === change[0] && last[1] === change[1]) edits[edits.length - 1] = change;
      else edits.push(change);
      if (dragging && group) dragging.edited = group;
    }, group ? { group } : {});
  }

  /** Change the targets of the page: a copy of what the map has, until one is changed. */
  function changeTargets(label, change, group) {
    app.store.change(label, (state) => {
      if (!state.map) return;
      const own = ({ name, point_mm, area_mm, tolerance_mm }) => ({ name, tolerance_mm, ...(point_mm ? { point_mm } : { area_mm }) });
      state.map.targets ??= (answer?.targets ?? []).map(own);
      change(state.map.targets, state.map);
    }, group ? { group } : {});
  }

  function moveTarget(name, [x, y], group) {
    changeTargets(`target ${name}`, (targets) => {
      const target = targets.find((one) => one.name === name);
      if (target?.point_mm) target.point_mm = [tools.mm(x), tools.mm(y)];
    }, group);
  }

  /** Take what was typed of a thing. */
  function changeThing(kind, key, value) {
    if (kind === "start") changePose({ [key]: value });
    else if (kind === "obstacle") {
      const frame = valuesOf(chosen);
      if (frame) edit("obstacle placed", ["place", chosen.id, { ...frame, [key]: value }]);
    } else {
      const { id } = chosen;
      if (key === "name") {
        if (answer.targets.some(({ name }) => name === value)) return app.say(`There is a target ${value} already`, "error");
        chosen = { kind, id: value };
      }
      changeTargets(`target ${id}`, (targets) => {
        const target = targets.find((one) => one.name === id);
        if (key === "x_mm" || key === "y_mm") target.point_mm[key === "x_mm" ? 0 : 1] = value;
        else target[key] = value;
      });
    }
  }

  const middle = () => {
    const [x, y, width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    return [x + width / 2, -(y + height / 2), Math.min(width, height)];
  };

  function addObstacle() {
    const [mx, my, size] = middle();
    const half = Math.max(LEAST_OBSTACLE_MM, 0.03 * size);
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([i, j]) => [tools.mm(mx + i * half), tools.mm(my + j * half)]);
    chosen = { kind: "obstacle", id: layers["ground-layer"].querySelectorAll("[data-obstacle]").length };
    edit("obstacle added", ["add", corners]);
    svg.focus();
  }

  function addTarget([x, y]) {
    aim.setAttribute("aria-pressed", "false");
    const taken = new Set((answer?.targets ?? []).map(({ name }) => name));
    const letters = [..."ABCDEFGHIJKLMNOPQRSTUVWXYZ"];
    const name = letters.find((letter) => !taken.has(letter)) ?? `T${taken.size + 1}`;
    chosen = { kind: "target", id: name };
    changeTargets(`target ${name}`, (targets) => { targets.push({ name, point_mm: [tools.mm(x), tools.mm(y)] }); });
  }

  function removeChosen() {
    if (!chosen) return;
    const { kind, id } = chosen;
    chosen = null;
    if (kind === "obstacle") edit("obstacle deleted", ["remove", id]);
    else changeTargets(`target ${id} deleted`, (targets, map) => { map.targets = targets.filter((one) => one.name !== id); });
  }

  add.addEventListener("click", addObstacle);
  aim.addEventListener("click", (event) => {
    tools.turn(false);
    // By key there is no place to click: it stands in the middle, to be moved.
    if (!event.detail) addTarget(middle());
    else aim.setAttribute("aria-pressed", String(aim.getAttribute("aria-pressed") !== "true"));
  });

  async function moveTip(branch, to, group) {
    try {
      const found = await app.desk("tip", { branch, to });
      if (found.level === null) return;
      app.store.change(`tip of ${branch}`, (state) => {
        const key = found.level < 0 ? state.design.trunk : state.design.level[found.level];
        for (const [name, value] of Object.entries(found.values)) key[name] = Math.round(100 * value) / 100;
      }, { group });
    } catch (error) {
      if (error.message) app.say(error.message, "error");
    }
  }

  /** Pull a tip to where the pointer is by now, one step after the other, all of them one undo. */
  async function pullTip(held, group) {
    if (held.busy) return;
    held.busy = true;
    while (held.to) {
      const to = held.to;
      held.to = null;
      await moveTip(held.branch, to, group);
    }
    held.busy = false;
    if (dragging !== held) app.store.endGroup();
  }

  // ---- which map

  function showSource(state) {
    const source = state.map?.source ?? {};
    const names = [...new Set([...(app.hello.environments ?? []), source.environment ?? []].flat())];
    const file = source.file ? source.file.split("/").at(-1) : "";
    const edited = state.map?.edits.length || state.map?.targets ? ", changed" : "";
    const options = names.map((name) => el("option", { value: name }, name));
    if (file || !state.map) options.unshift(el("option", { value: "" }, file || "none"));
    const chosen = options.find((option) => option.value === (source.environment ?? ""));
    if (chosen) chosen.append(edited);
    place.replaceChildren(...options);
    place.value = source.environment ?? "";
    seed.disabled = !source.environment || !app.live;
    place.disabled = !app.live;
    if (document.activeElement !== seed) seed.value = source.seed ?? "";
  }

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
    const { source } = app.store.get().map;
    if (seed.validity.valid && seed.value !== "") takeSource({ ...source, seed: Number(seed.value) });
  });

  // ---- the pointer

  function grabbed(event) {
    const { target } = event;
    const at = view.place(event);
    if (target.closest(".pose-layer .base")) return { kind: "base", at, pose: { ...answer.pose } };
    if (target.closest(".pose-layer .heading")) return { kind: "heading", at, pose: { ...answer.pose } };
    const tip = target.closest(".robot-layer .mark[data-branch]");
    if (tip) return { kind: "tip", at, branch: tip.dataset.branch, busy: false, to: null };
    const goal = target.closest("[data-target]");
    if (goal) {
      const { point_mm } = answer.targets.find(({ name }) => name === goal.dataset.target);
      return { kind: point_mm ? "target" : "view", at, id: goal.dataset.target, from: point_mm };
    }
    const handle = target.closest(".edit-layer .handle");
    if (handle) return { kind: handle.classList.contains("turn") ? "turn" : "size", at, id: chosen.id, frame: answer.obstacle.frame };
    const rock = target.closest("[data-obstacle]");
    if (rock) return { kind: "obstacle", at, id: Number(rock.dataset.obstacle) };
    return { kind: "view", at };
  }

  svg.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !answer) return;
    const at = view.place(event);
    if (aim.getAttribute("aria-pressed") === "true") return addTarget([at[0], -at[1]]);
    dragging = tools.isOn() ? { kind: "measure", at: [tools.mm(at[0]), tools.mm(at[1])] } : grabbed(event);
    if (!app.live && dragging.kind !== "measure") dragging.kind = "view";
    // The plan keeps its size while it is dragged and when it is let go, however many lines the
    // answers below it have; the next change from elsewhere frees it.
    svg.parentElement.style.flex = `0 0 ${svg.parentElement.getBoundingClientRect().height}px`;
    Object.assign(dragging, { drag: ++drags, moved: false, matrix: view.matrix() });
    const { kind, id } = dragging;
    focused = ["base", "heading"].includes(kind) ? kind : "";
    if (kind === "obstacle" || kind === "target") choose({ kind, id });
    else if (!["size", "turn", "measure"].includes(kind)) choose(null);
    svg.setPointerCapture(event.pointerId);
    if (!focused) svg.focus({ preventScroll: true });
  });

  svg.addEventListener("pointermove", (event) => {
    if (!dragging) return tools.at(view.place(event));
    dragging.moved = true;
    const [x, y] = view.place(event, dragging.matrix);
    const [dx, dy] = [x - dragging.at[0], y - dragging.at[1]];
    const group = `${dragging.kind} ${dragging.drag}`;
    if (dragging.kind === "measure") return tools.draw(dragging.at, [tools.mm(x), tools.mm(y)]);
    tools.at([x, y]);
    if (dragging.kind === "view") {
      view.move(dx, dy);
      dragging.matrix = view.matrix();
      return;
    }
    dispatchEvent(new CustomEvent("moved", { detail: event.timeStamp }));
    MOVES[dragging.kind]({ x, y: -y, dx, dy: -dy, group });
  });

  /** What a drag changes, by what was grabbed; places are the map's, in mm. */
  const MOVES = {
    base({ dx, dy, group }) {
      changePose({ x_mm: tools.mm(dragging.pose.x_mm + dx), y_mm: tools.mm(dragging.pose.y_mm + dy) }, group);
    },
    heading({ x, y, group }) {
      changePose({ heading_deg: tools.deg((Math.atan2(y - dragging.pose.y_mm, x - dragging.pose.x_mm) * 180) / Math.PI) }, group);
    },
    tip({ x, y, group }) {
      dragging.to = [x, y];
      pullTip(dragging, group);
    },
    target({ dx, dy, group }) {
      moveTarget(dragging.id, [dragging.from[0] + dx, dragging.from[1] + dy], group);
    },
    obstacle({ dx, dy, group }) {
      edit("obstacle moved", ["move", dragging.id, tools.mm(dx), tools.mm(dy)], group);
    },
    turn({ x, y, group }) {
      const { frame } = dragging;
      const turn_deg = tools.deg((Math.atan2(y - frame.y_mm, x - frame.x_mm) * 180) / Math.PI);
      edit("obstacle turned", ["place", dragging.id, { ...frame, turn_deg }], group);
    },
    size({ x, y, group }) {
      const { frame } = dragging;
      const turn = (frame.turn_deg * Math.PI) / 180;
      const [ax, ay] = [x - frame.x_mm, y - frame.y_mm];
      const along = ax * Math.cos(turn) + ay * Math.sin(turn);
      const across = ay * Math.cos(turn) - ax * Math.sin(turn);
      const [width_mm, height_mm] = [along, across].map((half) => Math.max(LEAST_OBSTACLE_MM, tools.mm(2 * half)));
      edit("obstacle resized", ["place", dragging.id, { ...frame, width_mm, height_mm }], group);
    },
  };

  function release() {
    if (!dragging) return;
    const was = dragging;
    dragging = null;
    if (!was.busy) app.store.endGroup();
    if (SHAPING.includes(was.kind) && was.moved) ask();
    dispatchEvent(new CustomEvent("released"));
  }
  svg.addEventListener("pointerup", release);
  svg.addEventListener("pointercancel", release);

  // ---- the keyboard

  svg.addEventListener("keydown", (event) => {
    const far = event.shiftKey ? 10 : 1;
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (event.key === "+" || event.key === "=") view.zoom(1 / ZOOM);
    else if (event.key === "-") view.zoom(ZOOM);
    else if (event.key === "0") view.fit();
    else if (event.key === "Delete" && app.live) removeChosen();
    else if (event.key === "Escape") {
      aim.setAttribute("aria-pressed", "false");
      tools.turn(false);
    }
    else if (way && app.live) moveByKey(event, way, far);
    else return;
    event.preventDefault();
  });

  function moveByKey(event, [dx, dy], far) {
    const handle = event.target.closest?.(".handle");
    if (handle?.classList.contains("heading")) {
      focused = "heading";
      changePose({ heading_deg: answer.pose.heading_deg + far * (dy - dx) }, "heading by key");
    } else if (handle) {
      focused = "base";
      changePose({ x_mm: answer.pose.x_mm + far * dx, y_mm: answer.pose.y_mm + far * dy }, "start by key");
    } else if (chosen?.kind === "obstacle") edit("obstacle moved", ["move", chosen.id, far * dx, far * dy]);
    else if (chosen) {
      const { x_mm, y_mm } = valuesOf(chosen);
      moveTarget(chosen.id, [x_mm + far * dx, y_mm + far * dy]);
    }
  }

  bigger.addEventListener("click", () => view.zoom(1 / ZOOM));
  smaller.addEventListener("click", () => view.zoom(ZOOM));
  fit.addEventListener("click", () => view.fit());
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
    const wanted = new Set(branches ?? []);
    for (const part of layers["robot-layer"].querySelectorAll("[data-branch]")) {
      part.classList.toggle("highlit", wanted.has(part.dataset.branch));
    }
  });
  const freeHeight = () => { if (!dragging) svg.parentElement.style.flex = ""; };
  addEventListener("resize", freeHeight);
  app.store.subscribe((state, before) => {
    freeHeight();
    if (JSON.stringify(state.map) !== JSON.stringify(before.map)) showSource(state);
    // What undo takes away is chosen no more.
    if (chosen?.kind === "obstacle" && (state.map?.edits.length ?? 0) < (before.map?.edits.length ?? 0)) chosen = null;
    if (app.live) ask();
  });
  app.on("engine", () => ask());
  app.on("again", () => ask());
  for (const button of [add, aim]) button.disabled = !app.live;
  showSource(app.store.get());
  if (app.live) ask();
}
