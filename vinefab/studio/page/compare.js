// The comparison of this version with the one before, in every number that a change is made for.

import { button, el, optionsOf, rested } from "studio/dom.js";
import { familyConditions, isClear, signed } from "studio/family_panel.js";

const REST_MS = 500;
const STILL_MS = 120;
/** Which version is compared with: its name and what that means. */
const RULES = {
  step: ["before the last change", "The version that was open, unchanged for half a second, before the design was changed last"],
  saved: ["as last saved or opened", "The design in the file"],
  kept: ["kept as reference", "The version that the button keeps, until another one is kept"],
};

/** Conditions of a panel's answers, other than the design. @type {Record<keyof Compared, (state: StudioState) => string>} */
const CONDITIONS = {
  live: ({ map, pose, growth }) => JSON.stringify([map, pose, growth]),
  rules: ({ map, pose, growth, recipe }) => JSON.stringify([map, pose, growth, recipe]),
  family: familyConditions,
};

const PANELS = /** @type {const} */ (["live", "rules", "family"]);
const GROUPS = ["simulated", "computed"];

/** @param {string} item @param {number} factor @returns {Measure["of"]} */
function billValue(item, factor) {
  return (found) => {
    const line = found.rules?.bill?.find((one) => one.item === item);
    return line ? line.value * factor : null;
  };
}

/** Return what is compared. @param {Partial<Compared>} answers @param {string} task @returns {Measure[]} */
function measures(answers, task) {
  const tasks = Object.keys(answers.live?.scores ?? {});
  return [
    ...tasks.map((name) => /** @type {Measure} */ ({
      key: `score-${name}`, name, group: "simulated", panel: "live", better: 1, digits: 3, unit: "",
      title: `Score on the open map, task ${name}`, of: (found) => found.live?.scores?.[name],
    })),
    {
      key: "family", name: "many maps", group: "simulated", panel: "family", better: 1, digits: 3, unit: "",
      title: `Mean score over many maps, task ${task}`, of: (found) => found.family?.distribution?.mean,
      isUnclear: ({ family }) => Boolean(family?.difference && !isClear(family.difference)),
    },
    {
      key: "grown", name: "length grown", group: "simulated", panel: "live", better: 1, digits: 1, unit: "%",
      title: "Grown over planned length of all branches, on the open map",
      of({ live }) {
        const { grown_mm = 0, planned_mm = 0 } = live?.facts ?? {};
        return planned_mm ? (100 * grown_mm) / planned_mm : null;
      },
    },
    {
      key: "pressure", name: "pressure", group: "simulated", panel: "live", better: -1, digits: 1, unit: "kPa", note: "assumed",
      title: "Pressure that growth to every tip takes on the open map; its constants are assumed",
      of: (found) => found.live?.facts.pressure_needed_kpa,
    },
    {
      key: "film", name: "film", group: "computed", panel: "rules", better: -1, digits: 0, unit: "cm²", note: "assumed",
      title: "Area of the film of all plies; its rim is assumed", of: billValue("film area, all plies", 1),
    },
    {
      key: "time", name: "cutting", group: "computed", panel: "rules", better: -1, digits: 1, unit: "min", note: "assumed",
      title: "Time of the machine, all passes; its accelerations are assumed", of: billValue("machine time, total", 1 / 60),
    },
    {
      key: "errors", name: "errors", group: "computed", panel: "rules", better: -1, digits: 0, unit: "",
      title: "Findings that stand in the way of cutting", of: (found) => found.rules?.errors,
    },
    {
      key: "warnings", name: "warnings", group: "computed", panel: "rules", better: -1, digits: 0, unit: "",
      title: "Findings to be looked at", of: (found) => found.rules?.warnings,
    },
  ];
}

/** @param {Measure} measure */
const nameOf = ({ name, unit }) => (unit ? `${name}, ${unit}` : name);
/** Return a number that is one. @param {number | null | undefined} value */
const known = (value) => (Number.isFinite(value) ? value ?? null : null);

/**
 * Return what is shown of a measure now and before; `comparable` tells whether before is known.
 * @param {Measure} measure
 * @param {Partial<Compared>} now
 * @param {Partial<Compared>} before
 * @param {boolean} comparable
 */
export function comparedCell(measure, now, before, comparable) {
  const [present, former] = [known(measure.of(now)), comparable ? known(measure.of(before)) : null];
  const cell = { now: "–", before: "–", change: "", kind: "" };
  if (present !== null) cell.now = present.toFixed(measure.digits);
  if (former === null) return cell;
  cell.before = former.toFixed(measure.digits);
  if (present === null) return cell;
  const gain = present - former;
  const isSame = Math.abs(gain) < 0.5 * 10 ** -measure.digits;
  cell.kind = isSame ? "same" : gain * measure.better > 0 ? "better" : "worse";
  cell.change = isSame ? "=" : signed(gain, measure.digits);
  // By chance alone the mean over maps would differ as much: neither better nor worse.
  if (!isSame && measure.isUnclear?.(now)) cell.kind = "no clear difference";
  return cell;
}

/** @param {Design} design @param {StudioState} state @returns {Version} */
function version(design, state) {
  return { design, key: JSON.stringify(design), state, answers: {}, conditions: {} };
}

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const choice = el("select", { id: "compare-with" }, optionsOf(Object.entries(RULES).map(([key, [text]]) => [key, text])));
  const keep = button("Keep this as reference", () => {
    kept.kept = now;
    keptAt = new Date().toTimeString().slice(0, 5);
    choice.value = "kept";
    show();
    app.say(`Kept as reference: ${now.design.name} as it is now`);
  }, { id: "keep-reference" });
  const rule = el("span", { class: "facts rule" });
  const bodies = GROUPS.map(() => el("tbody"));
  const tables = GROUPS.map((name, index) => el("table", { class: "differences" },
    el("thead", {}, el("tr", {}, [name, "before", "now", "change"].map((text) => el("th", { scope: "col" }, text)))), bodies[index]));
  const changes = el("span");
  const toolbar = el("div", { class: "toolbar" }, el("label", {}, "Compared with ", choice), keep, rule);
  root.append(
    el("summary", {}, "Changed: ", changes),
    toolbar,
    el("div", { class: "tables" }, tables),
  );

  const rows = /** @type {Map<string, ReturnType<typeof makeRow>>} */ (new Map());
  const kept = /** @type {Record<keyof typeof RULES, Version | null>} */ ({ step: null, saved: null, kept: null });
  let now = version(app.shown().design, app.shown());
  let changedAt = -Infinity;
  let stash = /** @type {{ now: Version, step: Version | null } | null} */ (null);
  let keptAt = "";
  let announced = /** @type {Version | null} */ (null);

  // ---- versions

  const chosen = () => /** @type {keyof typeof RULES} */ (choice.value);
  const current = () => kept[chosen()];

  /** Take note that another design is shown; what rested before is the version before. */
  function follow() {
    const state = app.shown();
    const moment = performance.now();
    if (JSON.stringify(state.design) !== now.key) {
      if (now.answers.live && moment - changedAt > REST_MS) kept.step = now;
      changedAt = moment;
      now = version(state.design, state);
    }
    now.state = state;
    const saved = app.file.saved_design ?? state.design; // a copy has no file
    const savedKey = JSON.stringify(saved);
    if (kept.saved?.key !== savedKey) {
      kept.saved = [now, kept.step, kept.kept].find((one) => one?.key === savedKey) ?? version(saved, state);
    } else if (savedKey === now.key) kept.saved = now;
    show();
    compareAtRest();
  }

  /** @template {keyof Compared} P @param {P} panel @param {Answers[P]} answer @param {StudioState} state */
  function take(panel, answer, state) {
    const isPart = "quick" in answer && (answer.quick || answer.compiling);
    if (JSON.stringify(state.design) === now.key && !isPart) {
      now.answers[panel] = answer;
      now.conditions[panel] = CONDITIONS[panel](state);
    }
    show();
  }

  /** Grow the version before on what is open now: another map or start makes its numbers void. */
  const compareAtRest = rested(async () => {
    const reference = current();
    const state = app.shown();
    if (!app.live || !reference || reference === now || !app.answers.live) return;
    if (reference.conditions.live === CONDITIONS.live(state)) return;
    try {
      const answer = await app.ask("before", { ground: false }, { state: { ...state, design: reference.design } });
      reference.answers = { ...reference.answers, live: answer };
      reference.conditions.live = CONDITIONS.live(state);
      announce(true);
      show();
    } catch (error) {
      app.fail(error, "Comparison: ");
    }
  }, STILL_MS);

  /** Tell the other panels which version is compared with. @param {boolean} again */
  function announce(again) {
    const reference = current();
    const shown = reference && reference !== now && reference.key !== now.key ? reference : null;
    if (shown === announced && !again) return;
    announced = shown;
    app.setReference(shown);
  }

  // ---- showing

  /** @param {Measure} measure */
  function makeRow(measure) {
    const kind = el("small");
    const change = el("span");
    const [before, now] = [el("td"), el("td", { class: "now" })];
    const heading = el("th", { scope: "row" }, nameOf(measure), measure.note ? el("span", { class: "standing" }, measure.note) : null);
    const row = el("tr", { "data-measure": measure.key }, heading, before, now, el("td", {}, change, kind));
    return { row, before, now, change, kind };
  }

  /** @param {Measure} measure @param {Partial<Compared>} answers @param {Version | null} reference */
  function showRow(measure, answers, reference) {
    const parts = rows.get(measure.key) ?? makeRow(measure);
    rows.set(measure.key, parts);
    const comparable = reference !== null && reference.conditions[measure.panel] === CONDITIONS[measure.panel](app.shown());
    const found = comparedCell(measure, answers, reference?.answers ?? {}, comparable);
    for (const part of /** @type {const} */ (["before", "now", "change", "kind"])) {
      const text = found[part] === "same" ? "" : found[part];
      if (parts[part].textContent !== text) parts[part].textContent = text;
    }
    parts.kind.setAttribute("class", ["better", "worse"].includes(found.kind) ? found.kind : "");
    const why = !reference || comparable ? "" : ". Not known of the version before under what is open now";
    parts.row.title = `${measure.title}${why}`;
    parts.row.hidden = found.now === "–" && found.before === "–";
    return { row: parts.row, change: found.change && found.kind !== "same" ? `${nameOf(measure)} ${found.change}` : "" };
  }

  /** @param {Version | null} reference */
  function words(reference) {
    const [text, meaning] = RULES[chosen()];
    choice.title = meaning;
    if (!reference) return choice.value === "kept" ? "none is kept yet" : "none yet: change the design";
    if (reference.key === now.key) return "this is that version";
    return choice.value === "kept" ? `${text} at ${keptAt}` : meaning.charAt(0).toLowerCase() + meaning.slice(1);
  }

  function show() {
    const reference = current();
    const compared = reference && reference.key !== now.key ? reference : null;
    // While a design is dragged its answers are one step behind: they are shown as they come.
    const answers = { live: app.answers.live, rules: app.answers.rules, family: app.answers.family };
    const shown = measures(answers, app.shown().task ?? "coverage").map((measure) => ({ group: measure.group, ...showRow(measure, answers, compared) }));
    // Folded away, its room kept: the map must not jump under the hand.
    const changed = shown.map(({ change }) => change).filter(Boolean).join(" · ");
    if (changes.textContent !== changed) changes.textContent = changed;
    root.classList.toggle("unchanged", !changed && !root.hasAttribute("open"));
    bodies.forEach((body, index) => {
      const wanted = shown.filter(({ group }) => group === GROUPS[index]).map(({ row }) => row);
      if (wanted.length !== body.children.length || wanted.some((row, place) => body.children[place] !== row)) body.replaceChildren(...wanted);
    });
    const text = words(reference);
    if (rule.textContent !== text) Object.assign(rule, { textContent: text, title: text });
    announce(false);
  }

  choice.addEventListener("change", () => {
    show();
    compareAtRest();
  });

  // ---- what happens

  app.store.subscribe(follow);
  app.on("engine", () => {
    // What no interpreter scores can be scored now, of the version before too.
    for (const one of Object.values(kept)) if (one) delete one.conditions.live;
    compareAtRest();
  });
  app.onPreview((design) => {
    if (design && !stash) stash = { now, step: kept.step };
    if (design) {
      // What is open is what a preview is compared with.
      follow();
      kept.step = stash?.now ?? null;
      show();
      return;
    }
    const was = stash;
    stash = null;
    if (was && JSON.stringify(app.store.get().design) === was.now.key) [now, kept.step] = [was.now, was.step];
    follow();
  });
  for (const panel of PANELS) app.onAnswer(panel, (answer, state) => take(panel, answer, state));
  if (!app.live) showStored();
  follow();

  /** Show the version that a snapshot was compared with, if there was one. */
  function showStored() {
    const reference = app.answers.reference;
    root.hidden = !reference;
    root.toggleAttribute("open", true);
    if (!reference) return;
    const state = app.shown();
    // Its answers were computed for the snapshot, under what is open in it.
    const conditions = Object.fromEntries(PANELS.map((panel) => [panel, CONDITIONS[panel](state)]));
    kept.step = { ...version(reference.design, state), answers: reference.answers, conditions };
    toolbar.replaceChildren("Compared with the version before");
  }
}
