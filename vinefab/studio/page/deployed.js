// The inflated body in place of the flat sheet: simulated off the live path, dropped by a change.

import { button, el, showShare, shownBlocks } from "studio/dom.js";
import { problemOf } from "studio/connection.js";

const STILL_MS = 400;

/** What flat pattern and deployed shape depend on, of a state. @param {StudioState} state */
export const patternOf = ({ design, recipe, recipe_stamp }) => JSON.stringify([design, recipe, recipe_stamp]);

/** Return the toggle, what stands below the drawing, and what is to be drawn. @param {App} app @param {() => void} redraw */
export function deployedView(app, redraw) {
  const toggle = button("Inflated", () => turn(!isOn), {
    id: "deployed-toggle", "aria-pressed": "false",
    title: "Flat: the sheet as it is cut. Deployed: its shape under pressure (simulated, some seconds)",
  });
  const bar = el("progress", { max: 1, value: 0, "aria-label": "Simulating the shape under pressure" });
  const step = el("span", { class: "step" });
  const box = el("section", { class: "deployed", id: "deployed", "aria-label": "Deployed shape", hidden: true });
  let isOn = false;
  let found = /** @type {Answers["inflated"] | null} */ (null);
  let foundOf = "";
  let asked = "";
  let timer = 0;

  /** Return what was simulated, if that was of what is shown. */
  const fresh = () => (foundOf === patternOf(app.shown()) ? found : null);

  /** @param {boolean} on */
  function turn(on) {
    isOn = on;
    toggle.setAttribute("aria-pressed", String(on));
    box.hidden = !on;
    if (on) follow(0);
    else drop();
    redraw();
  }

  /** Drop what is being simulated. */
  function drop() {
    clearTimeout(timer);
    if (asked) app.cancel("inflated");
    asked = "";
  }

  /** Follow the state: what was simulated of another one is neither shown nor finished. */
  function follow(wait_ms = STILL_MS) {
    if (!isOn || (asked && asked === patternOf(app.shown()))) return;
    drop();
    const known = fresh();
    if (known) return show(known);
    if (!app.live) return say("A snapshot: nothing is simulated here");
    bar.removeAttribute("value");
    step.textContent = "when the design rests";
    box.replaceChildren(el("div", { class: "progress" }, bar, step));
    timer = setTimeout(ask, wait_ms);
  }

  async function ask() {
    const state = app.shown();
    const wanted = patternOf(state);
    asked = wanted;
    try {
      const answer = await app.ask("inflated", {}, { state });
      if (asked !== wanted) return;
      [found, foundOf, asked] = [answer, wanted, ""];
      show(answer);
      redraw();
    } catch (error) {
      if (asked !== wanted) return;
      asked = "";
      const problem = problemOf(error);
      if (problem) say(problem, "note warning");
    }
  }

  /** @param {string} text */
  function say(text, kind = "note") {
    box.replaceChildren(el("p", { class: kind }, text));
  }

  /** @param {Answers["inflated"]} answer */
  function show({ blocks }) {
    const [first, ...rest] = shownBlocks(blocks);
    box.replaceChildren(
      first,
      el("p", { class: "note" }, "Filled: deployed (simulated, unverified). Dashed: flat, as cut. Lines: as designed."),
      el("details", {}, el("summary", {}, "Angles, lengths, loads"), el("div", { class: "wide" }, ...rest)),
    );
  }

  app.onProgress("inflated", (share, text) => {
    showShare(bar, share);
    step.textContent = text;
  });
  app.on("again", () => { if (isOn) { asked = ""; follow(0); } });
  return { toggle, box, follow: () => follow(), shown: () => (isOn ? fresh() : null) };
}
