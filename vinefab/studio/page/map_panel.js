// The map: the robot grown on it, the start and the obstacles to be dragged, the length grown.

import { el, fillSvg, number, paused, shownBlocks, svgEl } from "studio/dom.js";
import { createView, ZOOM } from "studio/view.js";

const PLAY_S = 4;
const REST_MS = 700;

/** What a hand sets needs no more digits than a laser has. */
const hundredth = (value) => Math.round(100 * value) / 100;
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
    ["ground-layer", "ghost-layer", "robot-layer", "edit-layer", "pose-layer"].map((name) => [name, svgEl("g", { class: name })]),
  );
  layers["ghost-layer"].classList.add("ghost");
  const svg = svgEl("svg", {
    class: "plan", role: "application", tabindex: 0,
    "aria-label": "Map with the robot. Arrow keys move what is selected; plus and minus zoom.",
  }, ...Object.values(layers));
  const view = createView(svg);
  const front = el("input", { type: "range", id: "front", min: 0, max: 1000, step: 1, value: 1000 });
  const frontOut = el("output", { for: "front", class: "value" });
  const play = el("button", { type: "button", id: "play" }, "Grow");
  const scores = el("div", { class: "scores", id: "scores" });
  const facts = el("p", { class: "facts", id: "facts" });
  const growth = el("button", { type: "button", class: "link", onclick: () => document.getElementById("tab-growth").click() }, "By which rules?");
  const width = el("details", { class: "width", hidden: true }, el("summary"), el("div"));
  const problems = el("ul", { class: "problems", id: "problems" });
  const pose = Object.fromEntries([
    ["x_mm", "x", "mm"], ["y_mm", "y", "mm"], ["heading_deg", "heading", "°"],
  ].map(([key, label, unit]) => {
    const input = el("input", { type: "number", step: "any", id: `pose-${key}` });
    input.addEventListener("change", () => {
      if (input.value !== "" && input.validity.valid) changePose({ [key]: Number(input.value) }, "");
    });
    return [key, { input, label: el("label", {}, `${label} `, input, ` ${unit}`) }];
  }));
  const place = el("select", { id: "environment" });
  const seed = el("input", { type: "number", id: "seed", min: 0, step: 1 });
  const ghost = el("input", { type: "checkbox", id: "ghost", checked: true });
  const add = el("button", { type: "button" }, "Add an obstacle");
  const remove = el("button", { type: "button", disabled: true }, "Delete it");
  const home = el("button", { type: "button" }, "As in the map");
  const bigger = el("button", { type: "button", "aria-label": "Zoom in" }, "+");
  const smaller = el("button", { type: "button", "aria-label": "Zoom out" }, "−");
  const fit = el("button", { type: "button", "aria-label": "Whole map", title: "Whole map" }, "⤢");

  root.append(
    el("div", { class: "canvas" }, svg, el("div", { class: "zoom" }, bigger, smaller, fit)),
    el("div", { class: "told" }, scores, width, facts, problems),
    el("div", { class: "toolbar" }, el("label", {}, "Map ", place), el("label", {}, "seed ", seed),
      add, remove, el("span", { class: "gap" }), el("label", {}, ghost, " version before")),
    el("div", { class: "toolbar pose" }, el("span", {}, "Start"), ...Object.values(pose).map((part) => part.label), home),
    el("div", { class: "toolbar growth" }, play, el("label", { for: "front" }, "Length grown"), front, frontOut),
  );

  let answer = null;
  let ground = "";
  let drags = 0;
  let dragging = null;
  let selected = null;
  let fullMm = 0;
  let share = 1;

  // ---- asking

  let lastMoved = 0;
  const timings = (app.timings = []);
  addEventListener("moved", (event) => { lastMoved ||= event.detail; });

  async function ask() {
    const since = lastMoved;
    lastMoved = 0;
    try {
      await app.ask("live", { have: ground, ground: dragging?.kind !== "obstacle" });
      if (since) requestAnimationFrame(() => setTimeout(() => keepTiming(performance.now() - since)));
    } catch (error) {
      if (error.stale) lastMoved ||= since;
      else if (!error.stopped) app.say(error.message, "error");
    }
  }

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
    for (const [key, { input }] of Object.entries(pose)) {
      if (document.activeElement !== input) input.value = Number(number(answer.pose?.[key], 2)) || 0;
      input.disabled = !app.live;
    }
  }

  function showFacts() {
    scores.replaceChildren(...Object.entries(answer.scores ?? {}).map(([task, score]) =>
      el("div", { class: "score", "data-task": task },
        el("span", { class: "name" }, answer.titles?.[task] ?? task), el("span", { class: "value" }, score === null ? "–" : number(score, 3)),
        el("span", { class: "standing" }, "simulated"))));
    facts.replaceChildren(`${answer.facts.text}. `, growth);
    growth.title = `Grown with: ${answer.growth?.text}`;
    problems.replaceChildren(...(answer.problems ?? []).map((text) => el("li", {}, text)));
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
    answer = found;
    if (!app.previewed) app.present = found;
    if (found.ground_svg !== null && found.ground_svg !== undefined) {
      fillSvg(layers["ground-layer"], found.ground_svg);
      ground = found.ground_key;
      showSelected();
    }
    if (found.view_box) view.whole(found.view_box);
    fullMm = found.front_full_mm ?? 0;
    showGhost();
    showRobot();
    showPose();
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
    app.store.change("start", (state) => {
      const { x_mm, y_mm, heading_deg } = { ...present, ...state.pose, ...part };
      state.pose = { x_mm: hundredth(x_mm), y_mm: hundredth(y_mm), heading_deg: hundredth(heading_deg) };
    }, group ? { group } : {});
  }

  home.addEventListener("click", () => app.store.change("start of the map", (state) => { state.pose = null; }));

  // ---- obstacles and tips

  function obstacle(index) {
    return layers["ground-layer"].querySelector(`[data-obstacle="${index}"]`);
  }

  function showSelected() {
    for (const path of layers["ground-layer"].querySelectorAll(".selected")) path.classList.remove("selected");
    if (selected !== null) obstacle(selected)?.classList.add("selected");
    remove.disabled = selected === null || !app.live;
    for (const button of [add, home]) button.disabled = !app.live;
  }

  function edit(label, change, group) {
    app.store.change(label, (state) => {
      if (!state.map) return;
      const { edits } = state.map;
      const last = edits.at(-1);
      // A drag of one obstacle is one edit, however many steps it takes.
      if (group && change[0] === "move" && last?.[0] === "move" && last[1] === change[1] && group === dragging?.edited) {
        last[2] = change[2];
        last[3] = change[3];
      } else edits.push(change);
      if (dragging && group) dragging.edited = group;
    }, group ? { group } : {});
  }

  function moveObstacle(index, dx, dy, group) {
    edit("obstacle moved", ["move", index, hundredth(dx), hundredth(dy)], group);
  }

  function addObstacle() {
    const [x, y, width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    const half = Math.max(LEAST_OBSTACLE_MM, 0.03 * Math.min(width, height));
    const [mx, my] = [x + width / 2, -(y + height / 2)];
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([i, j]) => [hundredth(mx + i * half), hundredth(my + j * half)]);
    const count = layers["ground-layer"].querySelectorAll("[data-obstacle]").length;
    selected = count;
    edit("obstacle added", ["add", corners]);
    svg.focus();
  }

  function removeSelected() {
    if (selected === null) return;
    const index = selected;
    selected = null;
    edit("obstacle deleted", ["remove", index]);
  }

  add.addEventListener("click", addObstacle);
  remove.addEventListener("click", removeSelected);

  async function moveTip(branch, to, group) {
    try {
      const found = await app.desk("tip", { branch, to });
      if (found.level === null) return;
      app.store.change(`tip of ${branch}`, (state) => {
        const key = found.level < 0 ? state.design.trunk : state.design.level[found.level];
        for (const [name, value] of Object.entries(found.values)) key[name] = hundredth(value);
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
    const edited = state.map?.edits.length ? `, ${state.map.edits.length} changes` : "";
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
    const rock = target.closest("[data-obstacle]");
    if (rock) return { kind: "obstacle", at, index: Number(rock.dataset.obstacle) };
    return { kind: "view", at };
  }

  svg.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !answer) return;
    // Where the drawing stood when it was grabbed: what is told below may move it.
    dragging = { ...grabbed(event), id: ++drags, moved: false, matrix: view.matrix() };
    if (!app.live) dragging.kind = "view";
    selected = dragging.kind === "obstacle" ? dragging.index : null;
    focused = ["base", "heading"].includes(dragging.kind) ? dragging.kind : "";
    showSelected();
    svg.setPointerCapture(event.pointerId);
    if (!focused) svg.focus({ preventScroll: true });
  });

  svg.addEventListener("pointermove", (event) => {
    if (!dragging) return;
    dragging.moved = true;
    const [x, y] = view.place(event, dragging.matrix);
    const [dx, dy] = [x - dragging.at[0], y - dragging.at[1]];
    const group = `${dragging.kind} ${dragging.id}`;
    if (dragging.kind === "view") {
      view.move(dx, dy);
      dragging.matrix = view.matrix();
      return;
    }
    dispatchEvent(new CustomEvent("moved", { detail: event.timeStamp }));
    if (dragging.kind === "base") {
      changePose({ x_mm: dragging.pose.x_mm + dx, y_mm: dragging.pose.y_mm - dy }, group);
    } else if (dragging.kind === "heading") {
      const { x_mm, y_mm } = dragging.pose;
      changePose({ heading_deg: (Math.atan2(-y - y_mm, x - x_mm) * 180) / Math.PI }, group);
    } else if (dragging.kind === "obstacle") {
      obstacle(dragging.index)?.setAttribute("transform", `translate(${dx} ${dy})`);
      moveObstacle(dragging.index, dx, -dy, group);
    } else if (dragging.kind === "tip") {
      dragging.to = [x, -y];
      pullTip(dragging, group);
    }
  });

  function release() {
    if (!dragging) return;
    const was = dragging;
    dragging = null;
    if (!was.busy) app.store.endGroup();
    if (was.kind === "obstacle" && was.moved) ask();
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
    else if (event.key === "Delete" && app.live) removeSelected();
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
    } else if (selected !== null) moveObstacle(selected, far * dx, far * dy, "");
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
  app.store.subscribe((state, before) => {
    if (JSON.stringify(state.map) !== JSON.stringify(before.map)) showSource(state);
    if ((state.map?.edits.length ?? 0) < (before.map?.edits.length ?? 0)) selected = null;
    if (app.live) ask();
  });
  app.on("engine", ask);
  app.on("again", ask);
  showSelected();
  showSource(app.store.get());
  if (app.live) ask();
}
