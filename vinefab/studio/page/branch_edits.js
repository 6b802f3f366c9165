// Edits of branches: the library says what each comes to, one after the other.

import { valueAt } from "studio/dom.js";

/** What an edit is called in undo. @type {Record<BranchEdit, string>} */
const LABELS = { free: "design freed", child: "a branch more", remove: "a branch less", mirror: "a branch mirrored", bend: "a bend more" };

/** Tell whether a design has a branch, by what the page calls it. @param {Design} design @param {string} label */
export const hasBranch = ({ branch }, label) => (branch ? label === "trunk" || branch.some(({ name }) => name === label) : /^0(\.\d+)*$/.test(label));

/** @param {App} app @returns {BranchEdits} */
export function branchEdits(app) {
  let last = /** @type {Promise<unknown>} */ (Promise.resolve());

  /** Do something once all before it is done: it finds the state that they left. @param {() => Promise<unknown>} fn */
  function inTurn(fn) {
    last = last.then(fn).catch((error) => app.fail(error));
    return last;
  }

  return {
    tip: (branch, ask, group) => inTurn(async () => {
      const state = app.store.get();
      const { key, values, bend, live } = await app.ask("tip", { branch, ...ask }, { state });
      // What grows comes with it: a drag waits for one answer, not for two.
      const isOfThis = app.store.get() === state && !app.previewed;
      app.knowing(live && isOfThis ? { live } : {}, () => app.store.change(`${ask.bend === undefined ? "tip" : "bend"} of ${branch}`, ({ design }) => {
        const table = key && /** @type {{ name?: string } | undefined} */ (valueAt(design, key));
        // Undo may have come between: then there is another branch at this place, or none.
        if (table && (table.name ?? branch) === branch) Object.assign(table, values);
      }, group ? { group } : {}));
      if (bend !== undefined) ask.bend = bend;
    }),

    edit: (name, branch, to) => inTurn(async () => {
      for (;;) {
        const state = app.store.get();
        const found = await app.ask("edit", { do: name, branch, to }, { state });
        if (JSON.stringify(app.store.get().design) !== JSON.stringify(state.design)) continue;
        app.store.change(LABELS[name], (next) => {
          next.design = found.design;
          if (name === "free") next.locks = next.locks.filter((key) => !key.startsWith("level."));
        });
        app.chooseBranch(found.branch);
        return;
      }
    }),
  };
}
