// Exports: each with its choices, and the command line that writes the same bytes.

import { button, copyable, el, optionsOf, rested, showShare, shownBlocks } from "studio/dom.js";
import { problemOf } from "studio/connection.js";
import { environmentOf } from "studio/family_panel.js";

const WAIT_MS = 150;

/** The exports. @type {ExportEntry[]} */
const EXPORTS = [
  {
    name: "package", title: "Package", about: "laser files, checks, report, instructions", out: "package", place: "Folder",
    options: [
      { key: "copies", label: "copies on the bed", kind: "number", value: 1, least: 1, most: 200 },
      { key: "zip", label: "also as a zip" },
      { key: "r12", label: "also a DXF of release 12" },
      { key: "allow_uncalibrated", label: "although no coupon has confirmed the recipe: for coupons and first trials", when: (found) => found.unverified },
    ],
  },
  {
    name: "report", title: "Report", about: "predictions (simulated), rules, materials", out: "report.html", place: "File",
    options: [
      { key: "poses", label: "poses per map", kind: "number", value: 3, least: 1, most: 1000 },
      { key: "environment", label: "also unseen maps of", kind: "select", value: "", choices: (state) => ["", environmentOf(state)] },
      { key: "count", label: "how many", kind: "number", value: 40, least: 1, most: 10000 },
    ],
  },
  {
    name: "rig", title: "Rig", about: "printable or cut obstacles of the open map", out: "rig", place: "Folder",
    options: [
      { key: "style", label: "style", kind: "select", value: "auto", choices: () => ["auto", "plate", "board"] },
      { key: "printer", label: "printer", kind: "text", value: "generic_220" },
      { key: "fit_mm", label: "longer side, mm (0: as the map)", kind: "number", value: 0, least: 0, most: 100000 },
      { key: "lid", label: "with a lid" },
    ],
  },
  {
    name: "picture", title: "Picture", about: "the robot grown on the open map: SVG, PNG, GIF", out: "grown.svg", place: "File",
    options: [
      { key: "animate", label: "moving (SVG or GIF)" },
      { key: "frames", label: "frames", kind: "number", value: 24, least: 1, most: 1000 },
      { key: "label", label: "with branch ids" },
    ],
  },
  {
    name: "snapshot", title: "Snapshot", about: "this page as one file, to be sent: it needs no server", out: "snapshot.html", place: "File",
    note: "The command opens it again, with design, map and start.",
    options: [
      { key: "family", label: "with the many maps" },
      { key: "date", label: "with today's date" },
    ],
  },
];

/** @param {string} id @param {ExportOption} option */
function control(id, option) {
  const { kind } = option;
  if (kind === "select") return el("select", { id });
  if (!kind) return el("input", { type: "checkbox", id });
  const range = kind === "number" ? { min: option.least, max: option.most, step: "any" } : { spellcheck: "false" };
  return el("input", { type: kind, id, value: option.value, ...range });
}

/** @param {ExportOption} option @param {HTMLInputElement | HTMLSelectElement} input */
function chosen(option, input) {
  if (!option.kind) return "checked" in input && input.checked;
  return option.kind === "number" ? Number(input.value) : input.value;
}

/**
 * Return one export: its elements, what it asks for, and how to show what is known of it.
 * @param {ExportEntry} kind
 * @param {App} app
 * @param {() => void} write
 */
function entry(kind, app, write) {
  const id = (/** @type {string} */ key) => `export-${kind.name}-${key}`;
  const out = el("input", { type: "text", id: id("out"), value: kind.out, spellcheck: "false" });
  const options = kind.options.map((option) => {
    const input = control(id(option.key), option);
    const label = el("label", { for: id(option.key) }, option.label);
    const parts = option.kind ? [label, input] : [input, label];
    return { ...option, input, line: el("span", { class: "option" }, ...parts) };
  });
  const start = button(`Write ${kind.title.toLowerCase()}`, write, { class: "primary", disabled: true });
  const command = copyable(app, `for the ${kind.name}`);
  const line = el("div", { class: "line" }, command.text, command.copy);
  const note = el("p", { class: "note" }, "Reading what would be written …");
  const result = el("div", { class: "result", role: "status" });
  const box = el(
    "section", { class: "export", "data-export": kind.name, "aria-label": kind.title },
    el("div", { class: "head" }, el("h3", {}, kind.title), el("span", { class: "about" }, kind.about),
      el("label", { for: id("out") }, kind.place), out, start),
    el("div", { class: "options" }, ...options.map((option) => option.line)), line, note, result,
  );

  return {
    box, name: kind.name, result,
    /** @returns {AskedExport} */
    asked: () => ({
      out: out.value.trim(),
      options: Object.fromEntries(options.map((option) => [option.key, chosen(option, option.input)])),
    }),
    /** @param {StudioState} state */
    showState(state) {
      for (const { input, choices, value } of options) {
        const wanted = choices?.(state);
        if (!wanted || !("options" in input) || wanted.join() === [...input.options].map((one) => one.value).join()) continue;
        const before = input.value || String(value);
        input.replaceChildren(...optionsOf(wanted.map((name) => [name, name || "none"])));
        input.value = wanted.includes(before) ? before : wanted[0];
      }
    },
    /** @param {CommandsAnswer} found */
    showCommand(found) {
      const known = found.commands[kind.name];
      for (const option of options) option.line.hidden = option.when ? !option.when(found) : false;
      line.hidden = !known?.command;
      start.disabled = false;
      command.text.textContent = known?.command ?? "";
      note.dataset.kind = known?.error ? "error" : "info";
      note.textContent = known?.error ?? kind.note ?? (known?.inputs?.length ? `Written beside it first, as no file has them as they are here: ${known.inputs.join(", ")}` : "");
    },
    /** @param {boolean} isBusy */
    setBusy(isBusy) {
      for (const node of box.querySelectorAll("input, select, button.primary")) node.toggleAttribute("disabled", isBusy);
    },
    /** @param {string} key @param {boolean} isOn */
    check(key, isOn) {
      const found = options.find((option) => option.key === key);
      if (found) Object.assign(found.input, { checked: isOn });
    },
  };
}

/** @param {Element} place @param {WrittenAnswer} answer */
function showWritten(place, answer) {
  const { written, refused, findings = [], inputs, view } = answer;
  if (refused) {
    const errors = findings.filter((finding) => finding.severity === "error" && !finding.waived);
    place.replaceChildren(
      el("p", { class: "refused" }, `Nothing written: ${refused}`),
      el("ul", {}, ...errors.slice(0, 12).map((finding) => el("li", {}, `${finding.id} ${finding.message}`))),
    );
    return;
  }
  const folders = new Set(written.map((name) => name.replace(/[^/\\]*$/, "")));
  const where = written.length > 1 && folders.size === 1 ? ` in ${[...folders][0]}` : "";
  place.replaceChildren(el("details", {},
    el("summary", {}, written.length === 1 ? `Written: ${written[0]}` : `Written: ${written.length} files${where}`),
    el("ul", {}, ...[...written, ...inputs].map((name) => el("li", {}, name))),
    ...shownBlocks(view),
  ));
}

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const open = button("Export", () => {
    for (const one of entries) one.showState(app.store.get());
    entries.at(-1)?.check("family", Boolean(app.answers.family));
    dialog.showModal();
    showCommands();
  }, { "aria-haspopup": "dialog" });
  const entries = EXPORTS.map((kind) => entry(kind, app, () => write(kind.name)));
  const bar = el("progress", { max: 1, value: 0, "aria-label": "Progress of the export" });
  const words = el("span", { class: "words", role: "status" });
  const stop = button("Stop", () => app.cancel("export"));
  const working = el("div", { class: "working", hidden: true }, bar, words, stop);
  const dialog = el(
    "dialog", { class: "exports", "aria-labelledby": "export-title" },
    el("div", { class: "title" }, el("h2", { id: "export-title" }, "Export"), working, button("Close", () => { dialog.close(); })),
    el("p", { class: "about" }, "Each command, run in the folder where the studio was started, writes the same bytes. Nothing that vinefab did not write is overwritten."),
    ...entries.map((one) => one.box),
  );
  root.append(open, dialog);
  let isBusy = false;

  function files() {
    const state = app.store.get();
    return { design_file: app.file.path ?? null, map_file: state.map?.source?.file ?? null };
  }

  /** @param {object} what */
  const ask = (what) => app.ask("export", { ...what, ...files() }, { state: app.store.get() });

  const showCommands = rested(async () => {
    if (!app.live || !dialog.open || isBusy) return;
    const exports = Object.fromEntries(entries.map((one) => [one.name, one.asked()]));
    try {
      const found = await ask({ what: "command", exports });
      if ("commands" in found) for (const one of entries) one.showCommand(found);
    } catch (error) {
      app.fail(error);
    }
  }, WAIT_MS);

  /** @param {boolean} value */
  function setBusy(value) {
    isBusy = value;
    working.hidden = !value;
    for (const one of entries) one.setBusy(value);
  }

  /** Return what only the page knows of a snapshot. @param {AskedExport} asked */
  function shown(asked) {
    const { family, date } = asked.options;
    const options = { family, date: date ? new Date().toISOString().slice(0, 10) : "" };
    return { ...asked, options, reference: app.reference?.design ?? null };
  }

  /** @param {ExportKind} name */
  async function write(name) {
    const one = entries.find((entry) => entry.name === name);
    if (!one) return;
    one.result.replaceChildren();
    bar.value = 0;
    words.textContent = name;
    setBusy(true);
    try {
      const asked = one.asked();
      const answer = await ask({ what: name, ...(name === "snapshot" ? shown(asked) : asked) });
      if ("written" in answer) showWritten(one.result, answer);
    } catch (error) {
      const text = problemOf(error) || "Stopped: nothing was written";
      one.result.replaceChildren(el("p", { class: "refused" }, text));
    } finally {
      setBusy(false);
      showCommands();
    }
  }

  app.onProgress("export", (share, text) => {
    showShare(bar, share);
    words.textContent = text;
  });
  dialog.addEventListener("input", showCommands);
  open.disabled = !app.live;
  if (!app.live) open.title = "A snapshot cannot export: open it with vinefab studio";
}
