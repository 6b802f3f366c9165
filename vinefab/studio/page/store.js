// The state of the page: one plain object, replaced as a whole by every change, with its history.

const MOST_STEPS = 500;

/** Return a store of a state. */
export function createStore(first) {
  let state = first;
  let past = [];
  let future = [];
  let group = null;
  const listeners = new Set();

  function tell(before) {
    for (const listener of listeners) listener(state, before);
  }

  /** Go to the last step of one list, and put the present state on the other. */
  function go(from, to) {
    const step = from.pop();
    if (!step) return;
    to.push({ state, label: step.label });
    const before = state;
    group = null;
    state = step.state;
    tell(before);
  }

  return {
    get: () => state,
    canUndo: () => (past.length ? past.at(-1).label : ""),
    canRedo: () => (future.length ? future.at(-1).label : ""),
    steps: () => past.length,

    /** Change a copy of the state; changes of one group are undone in one step. */
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
      tell(before);
    },

    /** End a group: the next change is a step of its own. */
    endGroup() {
      group = null;
    },

    /** Take another state, such as an opened file, as one step. */
    replace(label, next) {
      this.change(label, (copy) => {
        for (const key of Object.keys(copy)) delete copy[key];
        Object.assign(copy, structuredClone(next));
      });
    },

    undo: () => go(past, future),
    redo: () => go(future, past),

    /** Call a function after every change with the new and the old state. */
    subscribe(listener) {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
  };
}
