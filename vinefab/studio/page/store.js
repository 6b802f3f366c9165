// The state of the page: one plain object, replaced as a whole by every change, with its history.

const MOST_STEPS = 500;

/** Return a store of a state, with the steps before and after it. @param {StudioState} first @param {{ past: Step[], future: Step[] }} [steps] */
export function createStore(first, steps = { past: [], future: [] }) {
  let state = first;
  const past = [...steps.past];
  let future = [...steps.future];
  let group = /** @type {string | null} */ (null);
  const listeners = /** @type {Set<Follow>} */ (new Set());

  /** @param {StudioState} before */
  function notify(before) {
    for (const listener of listeners) listener(state, before);
  }

  /** Go to the last step of one list, and put the present state on the other. @param {Step[]} from @param {Step[]} to */
  function go(from, to) {
    const step = from.pop();
    if (!step) return;
    to.push({ state, label: step.label });
    const before = state;
    group = null;
    state = step.state;
    notify(before);
  }

  return {
    get: () => state,
    /** Return the steps to be kept over a reload. */
    history: () => ({ past, future }),
    canUndo: () => past.at(-1)?.label ?? "",
    canRedo: () => future.at(-1)?.label ?? "",
    steps: () => past.length,

    /**
     * Change a copy of the state; changes of one group are undone in one step.
     * @param {string} label
     * @param {(state: StudioState) => unknown} fn
     * @param {{ group?: string }} [options]
     */
    change(label, fn, options = {}) {
      const next = structuredClone(state);
      fn(next);
      if (JSON.stringify(next) === JSON.stringify(state)) return;
      const before = state;
      if (!options.group || options.group !== group) {
        past.push({ state, label });
        if (past.length > MOST_STEPS) past.shift();
      }
      group = options.group ?? null;
      future = [];
      state = next;
      notify(before);
    },

    /** Change every state alike, those of the history too: of what can be undone no longer. @param {(state: StudioState) => unknown} fn */
    rewrite(fn) {
      const changed = (/** @type {StudioState} */ old) => {
        const next = structuredClone(old);
        fn(next);
        return next;
      };
      const before = state;
      state = changed(state);
      // A step that makes no difference any more is none.
      const differs = (/** @type {Step} */ step, /** @type {number} */ place, /** @type {Step[]} */ steps) =>
        JSON.stringify(step.state) !== JSON.stringify((steps[place + 1] ?? { state }).state);
      for (const steps of [past, future]) {
        const all = steps.map((step) => ({ ...step, state: changed(step.state) }));
        steps.splice(0, steps.length, ...all.filter(differs));
      }
      group = null;
      notify(before);
    },

    /** End a group: the next change is a new step. */
    endGroup() {
      group = null;
    },

    /** Take another state, such as an opened file, as one step. @param {string} label @param {StudioState} next */
    replace(label, next) {
      this.change(label, (/** @type {Partial<StudioState>} */ copy) => {
        for (const key of /** @type {(keyof StudioState)[]} */ (Object.keys(copy))) delete copy[key];
        Object.assign(copy, structuredClone(next));
      });
    },

    undo: () => go(past, future),
    redo: () => go(future, past),

    /** Call a function after every change with the new and the old state. @param {Follow} listener */
    subscribe(listener) {
      listeners.add(listener);
    },
  };
}
